/* A program in C whose task of RCI has an arm forks a child that lives on: in the program, or in the function of the
 * task ("task"). Prints the child's process number. */
#include "rci.h"
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static RCI_TASK *arm;
static int in_task;

static void have_child(void)
{
    int child = fork();

    if (child == 0)
        for (;;)
            pause();
    printf("%d\n", child);
    fflush(stdout);
}
static void stay(RCI_TASK *td)
{
    rci_goto(td, td->how.q_setpoint);
    if (in_task && rci_runs(td) == 5)
        have_child();
}
static int moved(void) { return rci_runs(arm) > 5; }
static int forever(void) { return 0; }

int main(int n, char **words)
{
    in_task = n > 1 && strcmp(words[1], "task") == 0;
    if ((arm = rci_create("puma560", "")) == 0 || rci_control(arm, stay, 0, 0) || rci_start(arm->bit) ||
        rci_wait(moved))
        return 1;
    if (!in_task)
        have_child();
    return rci_wait(forever);
}
