/* Two arms share a place, in C: whichever holds the semaphore may enter (Corke & Kirkham, section 2.7).
 *
 * The generator asks EVENT_DEQ before a motion begins. Answered with MOVE_STOP the arm stays where it is, and the
 * generator asks again. Arms that run are named by their bridges: `s13_two_arms 127.0.0.1:5600 127.0.0.1:5601`. */
#include <arcl.h>
#include <stdio.h>
#include <stdlib.h>

static ROBOT *arms[2];
static Semaphore *sem_excl;

static int number_of(ROBOT *rp)
{
    return rp == arms[0] ? 1 : 2;
}

/* Enter the shared place only when nobody is there. */
static int excl_proc(Event event, ROBOT *rp)
{
    static ROBOT *who_is_in;

    switch (event) {
    case EVENT_DEQ:
        if (sem_take(sem_excl) != OK)
            return MOVE_STOP;
        who_is_in = rp;
        printf("%6.2f s: arm %d enters\n", ami_treal(rp) / 1000.0, number_of(rp));
        break;
    case EVENT_DONE:
        if (rp == who_is_in) {
            printf("%6.2f s: arm %d is done\n", ami_treal(rp) / 1000.0, number_of(rp));
            who_is_in = NULL;
            sem_give(sem_excl);
        }
    }
    return OK;
}

int main(int argc, char *argv[])
{
    int i;

    arms[0] = arcl_open(ARCL_BRIDGE, argc > 2 ? argv[1] : "", ARCL_ARGCV, argc, argv, 0);
    arms[1] = arcl_open(ARCL_BRIDGE, argc > 2 ? argv[2] : "", 0);
    if (arms[0] == NULL || arms[1] == NULL)
        exit(1);
    sem_excl = new_sem("shared place");
    for (i = 0; i < 2; i++) {
        move(arms[i], robot_pos(arms[i], "park"), MOV_SHARE, 30, 0);
        move(arms[i], joint_pos(arms[i], "shared", 20, 100, -20, 0, 60, 0), MOV_NOTIFY, excl_proc, NULL);
        move(arms[i], robot_pos(arms[i], "park"), 0);
    }
    for (i = 0; i < 2; i++)
        arcl_close(arms[i]);
    return 0;
}
