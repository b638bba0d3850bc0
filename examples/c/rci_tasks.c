/* Two tasks of RCI take turns on one clock (Lloyd, Parker and McClain 1987, section 4.3.4).
 *
 *     if ((clock_ticks - offset) % interval == 0) wakeup the task
 *
 * Both have an interval of 4 ticks; the second one has an offset of 2. No robot is needed. On virtual time the table is
 * the same in every run. In Python: examples/15_rci_tasks.py.
 *
 *     qrobot cc examples/c/rci_tasks.c -o rci_tasks
 *     qrobot run --offline ./rci_tasks
 *     ./rci_tasks                                     in real time
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "rci.h"
#include <stdio.h>

#define RUNS 4 /* of the second task */

static RCI_TASK *first, *second;

/* The control function of both: a line of the table. */
static void note(RCI_TASK *td)
{
    printf("%5ld  %-7s %9ld\n", rci_ticks(), td->name, rci_runCount(td));
}

static int over(void)
{
    return rci_runs(second) >= RUNS;
}

int main(void)
{
    if (rci_clock(100) || (first = rci_create("first", "")) == 0 || (second = rci_create("second", "")) == 0)
        return 1;
    if (rci_control(first, note, 0, 0) || rci_control(second, note, 0, 0))
        return 1;
    if (rci_onclock(first, 4, 0) || rci_onclock(second, 4, 2))
        return 1;
    printf("%5s  %-7s %9s\n", "tick", "task", "run count");
    if (rci_start(first->bit | second->bit) || rci_wait(over))
        return 1;
    printf("first: %ld runs, %ld missed\n", rci_runs(first), rci_missed(first));
    printf("second: %ld runs, %ld missed\n", rci_runs(second), rci_missed(second));
    return rci_close() != 0;
}
