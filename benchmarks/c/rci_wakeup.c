/* Wake-ups of tasks of RCI in C: how late each was, and what messages and shared memory take between two processors.
 *
 *     rci_wakeup tasks RATE COUNT RUNS        COUNT tasks on one processor
 *     rci_wakeup twin RATE 1 RUNS             a bare loop of the same priority
 *     rci_wakeup messages 1000 1 RUNS         from a task to another that a pipe wakes
 *     rci_wakeup memory 1000 1 RUNS           to another that looks all the time
 *     rci_wakeup answers RATE 1 RUNS BRIDGE   a task with a robot, which a bridge times: nothing but the missed
 *
 * Writes a line of each duration in ns, and last the number of wake-ups that were missed. */
#define _GNU_SOURCE
#include "rci.h"
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000L
#define CLOSE 5000L /* ns */
#define MOST 5

static RCI_TASK *tasks[MOST];
static long *late[MOST], runs, count, rate, epoch, done;
static int ends[2];

static long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

/* The instant of tick 0, by looking at clock and ticks until they leave no room; preemption cannot mislead it. */
static void find_epoch(void)
{
    long earliest = 0, latest = now_ns();
    while (latest - earliest > CLOSE) {
        long before = now_ns(), tick = rci_ticks(), after = now_ns();
        earliest = before - (tick + 1) * SECOND / rate > earliest ? before - (tick + 1) * SECOND / rate : earliest;
        latest = after - tick * SECOND / rate < latest ? after - tick * SECOND / rate : latest;
    }
    epoch = (earliest + latest) / 2;
}

static void note(RCI_TASK *td)
{
    long at = rci_runs(td), k = (long)(size_t)td->user;
    if (at < runs)
        late[k][at] = now_ns() - epoch - rci_ticks() * SECOND / rate;
}

static void tell(RCI_TASK *td)
{
    long at = now_ns();
    (void)td;
    if (rci_send(tasks[1]->bit, &at, sizeof at) > 0 && write(ends[1], "", 1) < 0)
        exit(1);
}

static void hear(RCI_TASK *td)
{
    long at;
    char unread;
    RCI_TASK *sender;
    if (read(ends[0], &unread, 1) == 1 && rci_receive(RCI_ALL, &at, sizeof at, &sender) > 0 && rci_runs(td) < runs)
        late[0][rci_runs(td)] = now_ns() - at;
}

static void post(RCI_TASK *td)
{
    (void)td;
    __atomic_store_n((long *)rci_getMemory("word"), now_ns(), __ATOMIC_RELEASE);
}

static void look(RCI_TASK *td)
{
    static long before;
    long *word = rci_getMemory("word"), at, until = now_ns() + SECOND / rate;
    while ((at = __atomic_load_n(word, __ATOMIC_ACQUIRE)) == before && now_ns() < until)
        continue;
    if (at != before && rci_runs(td) > 0 && done < runs)
        late[0][done++] = now_ns() - at;
    before = at;
}

static void stay(RCI_TASK *td)
{
    rci_goto(td, td->how.q_setpoint);
}

static int over(void)
{
    return rci_runs(tasks[0]) >= runs + 5;
}

static void create(int k, const char *processor, RCI_FUNCTION function, long interval)
{
    char name[8];
    snprintf(name, sizeof name, "task%d", k);
    if ((tasks[k] = rci_create(name, processor)) == 0 || rci_control(tasks[k], function, 0, 0) ||
        (interval && rci_onclock(tasks[k], interval, 0)))
        exit(1);
    tasks[k]->user = (void *)(size_t)k;
}

static void *twin(void *none)
{
    struct sched_param fifo = {20};
    long deadline = now_ns() + SECOND / rate;
    pthread_setschedparam(pthread_self(), SCHED_FIFO, &fifo);
    for (long k = 0; k < runs; k++, deadline += SECOND / rate) {
        struct timespec t = {deadline / SECOND, deadline % SECOND};
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL);
        late[0][k] = now_ns() - deadline;
    }
    return none;
}

static long answer(const char *bridge)
{
    long missed;
    if (rci_clock(rate) || rci_robot("arm", "puma560", bridge) || (tasks[0] = rci_create("arm", "aux")) == 0 ||
        rci_control(tasks[0], stay, 0, 0) || rci_onclock(tasks[0], 1, 0) || rci_start(tasks[0]->bit) || rci_wait(over))
        exit(1);
    missed = rci_missed(tasks[0]);
    rci_close();
    return missed;
}

static long run_tasks(const char *what)
{
    unsigned long mask = 0;
    long missed = 0;
    if (rci_clock(rate) || pipe(ends) || rci_sharedMemory("word", sizeof(long), 0, RCI_ALL) == 0)
        exit(1);
    find_epoch();
    if (strcmp(what, "tasks") == 0)
        for (int k = 0; k < count; k++)
            create(k, "aux", note, 1);
    else {
        create(0, "aux", strcmp(what, "messages") == 0 ? tell : post, 1);
        create(1, "aux1", strcmp(what, "messages") == 0 ? hear : look, strcmp(what, "memory") == 0);
        if (strcmp(what, "messages") == 0 && rci_deviceInterrupt(tasks[1], ends[0]))
            exit(1);
    }
    for (int k = 0; k < MOST && tasks[k]; k++)
        mask |= tasks[k]->bit;
    if (rci_start(mask) || rci_wait(over))
        exit(1);
    for (int k = 0; k < MOST && tasks[k]; k++)
        missed += rci_missed(tasks[k]);
    rci_close();
    return missed;
}

int main(int argc, char **argv)
{
    pthread_t thread;
    long missed = 0;
    if ((argc != 5 && argc != 6) || (rate = atol(argv[2])) < 1 || (count = atol(argv[3])) < 1 || count > MOST)
        return 2;
    runs = atol(argv[4]);
    for (int k = 0; k < MOST; k++)
        late[k] = calloc((size_t)runs, sizeof(long));
    if (strcmp(argv[1], "twin") == 0)
        pthread_create(&thread, NULL, twin, NULL), pthread_join(thread, NULL);
    else
        missed = argc == 6 ? answer(argv[5]) : run_tasks(argv[1]);
    for (int k = 0; k < count; k++)
        for (long i = 0; i < runs; i++)
            if (late[k][i] != 0)
                printf("%ld\n", late[k][i]);
    printf("%ld\n", missed);
    return 0;
}
