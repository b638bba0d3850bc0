/* Threads of processors: one for each, another one when a function does not come back, and their end. */
#include "inside.h"

#include <sys/mman.h>
#include <sys/resource.h>

#define CAP_IPC_LOCK 14 /* linux/capability.h */

/* Whether any amount of memory may be locked, by the limit or by a capability. */
static int may_lock_all(void)
{
    unsigned long long capabilities = 0;
    struct rlimit limit;
    char line[128];
    FILE *status;

    if (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY)
        return 1;
    if ((status = fopen("/proc/self/status", "re")) == NULL)
        return 0;
    while (fgets(line, sizeof line, status) != NULL && sscanf(line, "CapEff: %llx", &capabilities) != 1)
        continue;
    fclose(status);
    return (int)(capabilities >> CAP_IPC_LOCK & 1);
}

/* Keep all pages of the program in memory, those to come as well. With a finite limit later allocations would fail. */
static void lock_memory(void)
{
    static int done;

    if (!done && may_lock_all())
        (void)mlockall(MCL_CURRENT | MCL_FUTURE);
    done = 1;
}

/* A thread for a processor, which has no signals: those are the planning program's. NULL with errno: there is none. */
static struct seat *new_seat(struct processor *processor)
{
    struct seat *seat = calloc(1, sizeof *seat);
    sigset_t before;
    int error;

    if (seat == NULL)
        return NULL;
    seat->processor = processor;
    if (rci_program.virtual_time)
        return seat;
    lock_memory();
    rci_block_signals(&before);
    error = pthread_create(&seat->thread, NULL, rci_run_processor, seat);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (error == 0)
        return seat;
    free(seat);
    errno = error;
    return NULL;
}

/* Let a processor have a thread, if it has none. Returns 0, or -1. */
int rci_processor_start(struct processor *processor)
{
    struct seat *seat;
    int has_one;

    rci_lock();
    has_one = processor->seat != NULL;
    rci_unlock();
    if (has_one)
        return 0;
    if ((seat = new_seat(processor)) == NULL)
        return rci_fail("processor %s: no thread: %s", processor->name, strerror(errno));
    rci_lock();
    processor->seat = seat;
    rci_unlock();
    return 0;
}

/* Ask for a stop, in answer to the newest state, by one try: the lock is held. What has come is read: else the end of
 * the connection would take the command back (RFC 9293, 3.6.1). */
static void ask_for_stop(RCI_TASK *td)
{
    struct rci_inside *in = td->inside;

    if (in->link == NULL || rci_link_hear(td) < 0 || !in->cycle.has_state)
        return;
    rci_cycle_stop(&in->cycle, 0);
    rci_cycle_step(td, rci_now_ns());
    rci_cycle_answer(td);
    in->link->timeout_ms = 0;
    (void)qrobot_send(in->link, &in->cycle.command);
}

/* No other thread can be had: all tasks of a processor end, their arms are to stop and are let go. The lock is held. */
static void abandon(const struct processor *processor, const char *why)
{
    RCI_TASK *td;
    int index = 0;

    while ((td = rci_task_of(processor, &index)) != NULL) {
        enum rci_state state = td->inside->state;

        if (state == RCI_ATTACHING || state == RCI_READY || state == RCI_ACTIVE)
            rci_end_task(td, "its processor has no thread any more: %s", why);
        ask_for_stop(td);
        rci_let_go(td);
    }
}

/* A function does not come back: its task ends, another thread goes on with the processor and stops its arm. The old
 * one loses its priority, so that it delays nobody, and ends when its function does. The lock is held. */
void rci_give_up(struct seat *seat)
{
    struct sched_param none;

    memset(&none, 0, sizeof none);
    seat->given_up = 1;
    rci_end_task(seat->running, "one of its functions takes longer than %g s and was given up",
                 (double)seat->running->inside->allowed_ns * 1e-9);
    pthread_setschedparam(seat->thread, SCHED_OTHER, &none);
    pthread_detach(seat->thread);
    seat->next_lost = rci_program.lost_seats;
    rci_program.lost_seats = seat;
    if ((seat->processor->seat = new_seat(seat->processor)) == NULL)
        abandon(seat->processor, strerror(errno));
}

/* Until its thread has ended. The watch is awake meanwhile: a function that does not come back is given up. */
static void end_thread(struct processor *processor)
{
    const struct timespec moment = {0, 1000000};
    struct seat *seat;

    rci_lock();
    processor->over = 1;
    rci_processor_wake(processor);
    while ((seat = processor->seat) != NULL && !seat->ended && !rci_program.virtual_time) {
        rci_unlock();
        nanosleep(&moment, NULL);
        rci_lock();
    }
    rci_unlock();
}

static void forget_processor(struct processor *processor)
{
    struct seat *seat = processor->seat;

    if (seat != NULL && !rci_program.virtual_time)
        pthread_join(seat->thread, NULL);
    free(seat);
    close(processor->wake[0]);
    close(processor->wake[1]);
    free(processor);
}

/* Forget threads that came back after all. Returns how many have not. */
static int count_lost(void)
{
    struct seat **at = &rci_program.lost_seats;
    int lost = 0;

    while (*at != NULL) {
        struct seat *seat = *at;

        if (seat->ended) {
            *at = seat->next_lost;
            free(seat);
        } else {
            at = &seat->next_lost;
            lost++;
        }
    }
    return lost;
}

/* End the threads of all processors. */
void rci_processors_end(void)
{
    for (struct processor *each = rci_program.processors; each != NULL; each = each->next)
        end_thread(each);
}

/* In a child of the program, which has none of the threads: close its copies of the pipes. */
void rci_processors_leave(void)
{
    for (struct processor *each = rci_program.processors; each != NULL; each = each->next) {
        close(each->wake[0]);
        close(each->wake[1]);
    }
}

/* Forget processors whose threads have ended, and the watch with them. Returns how many threads never came back. */
int rci_processors_forget(void)
{
    struct processor *each, *next;
    int lost;

    for (each = rci_program.processors; each != NULL; each = next) {
        next = each->next;
        forget_processor(each);
    }
    rci_program.processors = NULL;
    rci_lock();
    lost = count_lost();
    rci_unlock();
    return lost;
}
