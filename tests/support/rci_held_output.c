/* Tasks of RCI in C whose program, or whose own functions, say on stderr what nobody reads.
 *
 *     onclock | interval | trigger    a call of the planning program fails while a task runs
 *     prints RUNS [note]              the function of the arm's task prints and fails in each run; with "note" stderr
 *                                     takes no word of how many lines are missing
 *
 * Behind rci_close nothing waits any more: status 9 if something does. */
#define _GNU_SOURCE
#include "rci.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static RCI_TASK *fast, *arm;
static int asked, closed, no_note;
static long most;

int nanosleep(const struct timespec *wanted, struct timespec *left)
{
    if (closed)
        _exit(9);
    return clock_nanosleep(CLOCK_REALTIME, 0, wanted, left) == 0 ? 0 : -1;
}

ssize_t write(int fd, const void *data, size_t size)
{
    while (no_note && fd == STDERR_FILENO && memmem(data, size, "lines are missing", 17) != 0)
        pause();
    return syscall(SYS_write, fd, data, size);
}

static void count(RCI_TASK *td)
{
    static long left = 300; /* the call of the program, which fails, has long begun then */

    (void)td;
    if (__atomic_load_n(&asked, __ATOMIC_ACQUIRE) && --left == 0)
        _exit(write(1, "ran on\n", 7) == 7 ? 0 : 5);
}

static void print(RCI_TASK *td)
{
    rci_goto(td, td->how.q_setpoint);
    if (rci_runs(td) < most) {
        rci_print("run %ld", rci_runs(td));
        rci_descriptor("nobody");
    }
}

static int over(void) { return rci_runs(arm) >= most + 5; }

/* Its arm must be held up by no line; the program ends when it is told to. */
static int prints(void)
{
    if (rci_control(arm, print, 0, 0) || rci_start(arm->bit) || rci_wait(over))
        return 2;
    if (puts("ran on") < 0 || fflush(stdout) || getchar() == EOF)
        return 3;
    if (rci_close())
        return 4;
    closed = 1;
    return 0;
}

int main(int n, char **words)
{
    const char *what = n > 1 ? words[1] : "";

    most = n > 2 ? atol(words[2]) : 0;
    no_note = n > 3;
    if ((arm = rci_create("puma560", "")) == 0 || (fast = rci_create("fast", "aux")) == 0)
        return 1;
    if (strcmp(what, "prints") == 0)
        return prints();
    if (rci_clock(1000) || rci_control(fast, count, 0, 0) || rci_onclock(fast, 1, 0) || rci_start(fast->bit))
        return 1;
    __atomic_store_n(&asked, 1, __ATOMIC_RELEASE);
    if (strcmp(what, "onclock") == 0)
        rci_onclock(arm, 500, 0);
    else if (strcmp(what, "interval") == 0)
        rci_onclock(fast, 0, 0);
    else
        rci_trigger(fast, 0, 0, count);
    for (;;)
        pause();
}
