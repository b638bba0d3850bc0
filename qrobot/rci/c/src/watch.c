/* The watch over tasks that run too long, in real time. */
#include "inside.h"

#define WATCH_NS (NS / 200)

static void look(void)
{
    int64_t now_ns = qrobot_now_ns();

    for (struct processor *each = rci_program.processors; each != NULL; each = each->next) {
        struct seat *seat = each->seat;

        if (seat != NULL && seat->running != NULL && now_ns - seat->began_ns > seat->running->inside->allowed_ns)
            rci_give_up(seat);
    }
}

static void *watch(void *argument)
{
    const struct timespec moment = {0, WATCH_NS};
    struct seat seat;

    rci_signals_are_blocked();
    memset(&seat, 0, sizeof seat);
    rci_take_fifo(&seat, 1);
    rci_lock();
    while (!rci_program.watch_over) {
        look();
        rci_unlock();
        nanosleep(&moment, NULL);
        rci_lock();
    }
    rci_unlock();
    return argument;
}

int rci_watch_start(void)
{
    sigset_t before;
    int error;

    if (rci_program.watching || rci_program.virtual_time)
        return 0;
    rci_program.watch_over = 0;
    rci_block_signals(&before);
    error = pthread_create(&rci_program.watch, NULL, watch, NULL);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    rci_program.watching = error == 0;
    return error == 0 ? 0 : rci_fail("rci_start: no thread: %s", strerror(error));
}

void rci_watch_end(void)
{
    if (!rci_program.watching)
        return;
    rci_lock();
    rci_program.watch_over = 1;
    rci_unlock();
    pthread_join(rci_program.watch, NULL);
    rci_program.watching = 0;
}
