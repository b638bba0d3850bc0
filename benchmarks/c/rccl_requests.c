/* The same as arcl_requests.c in RCCL, where the time is a call of its own. */
#include "move_timer.h"
#include "rccl.h"

int main(int argc, char **argv)
{
    int i, batches = atoi(argv[1]), size = atoi(argv[2]);
    POS_PTR places[2] = {jposition("A", 0., -45., 180., 0., 45., 0.), jposition("B", 2., -45., 180., 0., 45., 0.)};
    control();
    for (i = 0; argc > 3 && i < batches * size; i++) {
        timer_begin();
        setime(100., 112.);
        move(places[i % 2]);
        timer_end();
        if (i % size == size - 1)
            waitfor(completed)
    }
    return timer_write(argv[3]);
}
