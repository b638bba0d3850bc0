/* Tasks of RCI in C in real time: no robot ("crowd"), or an arm that swings until something happens ("swing", "rogue"). */
#include "rci.h"
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/select.h>
#include <unistd.h>

extern double swing_angle(long run); /* of rci_live_more.c */

static RCI_TASK *arm, *fast, *slow, *device, *rogue;
static volatile sig_atomic_t signals;
static int endless = 1;

#define ENDLESS __atomic_load_n(&endless, __ATOMIC_RELAXED)
static int rogue_mode;
static int ends[2];

static void on_signal(int number) { (void)number; signals++; }

static void swing(RCI_TASK *td)
{
    static double rest;

    rest = rci_runs(td) ? rest : td->how.q_setpoint[0];
    td->chg.setpoints[0] = rest + swing_angle(rci_runs(td));
    if (rci_runs(td) == 30)
        printf("swings\n"), fflush(stdout);
    while (rogue_mode && rci_runs(td) == 40 && ENDLESS)
        continue;
}
static void count(RCI_TASK *td)
{
    long *seen = (long *)rci_getMemory("seen"), n = rci_runs(td);

    __atomic_fetch_add(seen, 1L, __ATOMIC_RELAXED);
    rci_send(slow->bit, &n, sizeof n);
}
static void collect(RCI_TASK *td)
{
    long n;
    RCI_TASK *sender;

    while (rci_receive(RCI_ALL, &n, sizeof n, &sender) > 0)
        td->user = sender;
    if (rci_runs(td) < 3)
        rci_signal(SIGUSR1);
}
static void read_device(RCI_TASK *td)
{
    char letter;

    td->user = read(ends[0], &letter, 1) == 1 ? td : 0;
}
static void hang(RCI_TASK *td) { (void)td; while (ENDLESS) continue; }
static int forever(void) { return 0; }
static int worked(void) { return rci_runs(fast) > 50 && rci_runs(slow) > 3 && rci_runs(device) == 2 && signals > 0; }

/* A terminal's program waits by select; signals interrupt it, tasks do not. */
static void select_for_a_while(void)
{
    struct timeval wait = {0, 20000};
    fd_set none;

    FD_ZERO(&none);
    select(0, &none, 0, 0, &wait);
}

static int crowd(void)
{
    long runs;

    signal(SIGUSR1, on_signal);
    if (pipe(ends) || rci_clock(1000) || (fast = rci_create("fast", "aux")) == 0 ||
        (slow = rci_create("slow", "aux1")) == 0 || (device = rci_create("device", "")) == 0 ||
        (rogue = rci_create("rogue", "aux")) == 0)
        return 1;
    if (rci_sharedMemory("seen", sizeof(long), fast, RCI_ALL) == 0 || rci_control(fast, count, 0, 0) ||
        rci_control(slow, collect, 0, 0) || rci_control(device, read_device, 0, 0) || rci_control(rogue, hang, 0, 0))
        return 1;
    if (rci_onclock(fast, 1, 0) || rci_onclock(slow, 10, 3) || rci_deviceInterrupt(device, ends[0]) ||
        rci_onclock(rogue, 5, 0) || rci_timeout(rogue, 0.05) || rci_start(fast->bit | slow->bit | device->bit))
        return 1;
    select_for_a_while();
    if (write(ends[1], "ab", 2) != 2 || rci_wait(worked))
        return 1;
    if (rci_start(rogue->bit) || rci_wait(forever) == 0) /* it is told that the task ended */
        return 2;
    printf("%s\n", rci_taskError(rogue));
    if (rci_start(rogue->bit) == 0) /* its function has not come back, and would write into what the new run reads */
        return 5;
    runs = rci_runs(fast);
    while (rci_runs(fast) < runs + 20) /* others of its processor go on */
        select_for_a_while();
    close(ends[1]);
    if (rci_wait(forever) == 0) /* a device that is closed ends its task alone */
        return 3;
    printf("%s\n", rci_taskError(device));
    __atomic_store_n(&endless, 0, __ATOMIC_RELAXED);
    usleep(100000);
    rci_close();
    return 0;
}

int main(int argc, char **argv)
{
    int status;

    if (argc > 1 && strcmp(argv[1], "crowd") == 0)
        return crowd();
    rogue_mode = argc > 1 && strcmp(argv[1], "rogue") == 0;
    if ((arm = rci_create("puma560", "")) == 0 || rci_control(arm, swing, 0, 0) || rci_start(arm->bit))
        return 1;
    status = rci_wait(forever);
    return status ? 4 : 0;
}
