/* The loop of benchmarks/wakeup.py in C: sleep to a margin before the deadline, spin the rest, note how late it woke. */
#define _GNU_SOURCE
#include <time.h>

#define SECOND 1000000000L
#define MARGIN_UP 2000
#define MARGIN_DOWN 2
#define MARGIN_MAX 150000

static long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

static long wait_until(long deadline, long margin)
{
    struct timespec t = {(deadline - margin) / SECOND, (deadline - margin) % SECOND};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
    if (margin == 0)
        return 0;
    if (now_ns() > deadline)
        return margin + MARGIN_UP < MARGIN_MAX ? margin + MARGIN_UP : MARGIN_MAX;
    while (now_ns() < deadline)
        ;
    return margin - MARGIN_DOWN > MARGIN_UP ? margin - MARGIN_DOWN : MARGIN_UP;
}

void wake_ups(long period, long margin, long *late, long n)
{
    long deadline = (now_ns() / period + 2) * period + period / 2;
    for (long k = 0; k < n; k++) {
        margin = wait_until(deadline, margin);
        long now = now_ns(), skipped = (now - deadline) / period;
        late[k] = now - deadline;
        deadline += (1 + (skipped > 0 ? skipped : 0)) * period;
    }
}
