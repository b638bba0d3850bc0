/* Requests of motions to two places in turns, some at a time, and how long each takes the program: batches, size, file. */
#include <arcl.h>
#include "move_timer.h"

int main(int argc, char **argv)
{
    int batches = atoi(argv[1]), size = atoi(argv[2]);
    ROBOT *rp = arcl_open(0);
    Pos *places[2] = {joint_pos(rp, "a", 0, 135, 0, 0, 45, -180), joint_pos(rp, "b", 2, 135, 0, 0, 45, -180)};
    for (int i = 0; argc > 3 && i < batches * size; i++) {
        timer_begin();
        move(rp, places[i % 2], MOV_TIME, 112, 0);
        timer_end();
        if (i % size == size - 1)
            arcl_wait(rp);
    }
    arcl_close(rp);
    return timer_write(argv[3]);
}
