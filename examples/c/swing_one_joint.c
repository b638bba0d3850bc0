/* Swing the last joint by a tenth of a turn and back, as a control task of an RCI does.
 *
 *     cc -o swing_one_joint -I qrobot/wire/c examples/c/swing_one_joint.c -lm
 *     qrobot up &                                     # or any bridge; QROBOT_BRIDGE=host:port says where
 *     ./swing_one_joint puma560
 *
 * The main program waits for power, then calls control() once a sample until it has nothing more to do. Ctrl-C and every
 * failure leave a controlled stop behind.
 */
#include "rci_driver.h"

#include <math.h>
#include <signal.h>

#define TURN 6.283185307179586
#define STROKE (TURN / 10)
#define NEAR 0.05 /* rad */
#define MOVE_S 2.0
#define POWER_S 20.0
#define ASK_AGAIN_S 4.0 /* longer than the servo itself waits for power */
#define POWER_STOPPED 81 /* an event: somebody wanted no power while it came */

static volatile sig_atomic_t interrupted;

static void interrupt(int number)
{
    (void)number;
    interrupted = 1;
}

/* Wait until the arm follows setpoints. Power comes on a request that is raised: it is low at first, for a program before
 * this one may have left it high, and again when it was refused, as while an arm without power still swings; but not
 * against somebody who has stopped the arm, or taken its power, while it came.
 * Returns NULL, or what is in the way. */
static const char *power_on(struct driver *driver, struct how *how, struct chg *chg)
{
    double until = how->time + POWER_S, asked = how->time - ASK_AGAIN_S;
    int coming = 0;

    do {
        coming = coming || driver->state.mode == QROBOT_MODE_POWERING;
        if (coming && driver->state.mode == QROBOT_MODE_OFF && driver->state.event == POWER_STOPPED)
            return qrobot_fault_text(POWER_STOPPED);
        chg->power = how->powered || how->time - asked < ASK_AGAIN_S;
        if (!chg->power)
            asked = how->time;
        if (driver_exchange(driver, how, chg) != QROBOT_OK)
            return driver->link.error;
        if (how->fault)
            return qrobot_fault_text(how->fault);
        if (interrupted)
            return "interrupted";
    } while (!(how->powered && how->following) && how->time < until);
    if (how->following)
        return NULL;
    return driver->state.event ? qrobot_fault_text(driver->state.event)
                               : "the arm does not get ready: is it calibrated, and the emergency stop released?";
}

/* The control function: where the last joint is to be `t` seconds after the start. There and back on a cosine. */
static double path(double t)
{
    return STROKE * 0.5 * (1.0 - cos(TURN * t / (2.0 * MOVE_S)));
}

/* Returns NULL when the swing was made, or what came in between. */
static const char *swing(struct driver *driver, struct how *how, struct chg *chg, double *reached)
{
    int last = driver->link.joints - 1;
    double begin = how->time, rest = how->setpoint[last];

    memcpy(chg->angle, how->setpoint, sizeof chg->angle);
    chg->move = 1;
    while (how->time - begin < 2.0 * MOVE_S) {
        chg->angle[last] = rest + path(how->time - begin);
        if (driver_exchange(driver, how, chg) != QROBOT_OK)
            return driver->link.error;
        if (interrupted)
            return "interrupted";
        if (!chg->move)
            return how->fault ? qrobot_fault_text(how->fault) : qrobot_fault_text(driver->state.event);
        if (fabs(how->angle[last] - rest) > fabs(*reached))
            *reached = how->angle[last] - rest;
    }
    return fabs(*reached - STROKE) < NEAR ? NULL : "the joint did not follow";
}

int main(int argc, char **argv)
{
    struct driver driver;
    struct how how;
    struct chg chg;
    const char *trouble;
    double reached = 0.0;

    if (argc != 2) {
        fprintf(stderr, "usage: %s ROBOT\n", argv[0]);
        return 2;
    }
    signal(SIGINT, interrupt);
    signal(SIGTERM, interrupt);
    if (driver_startup(&driver, argv[1], NULL, &how, &chg) != QROBOT_OK) {
        fprintf(stderr, "%s\n", driver.link.error);
        return 1;
    }
    trouble = power_on(&driver, &how, &chg);
    if (trouble == NULL)
        trouble = swing(&driver, &how, &chg, &reached);
    if (trouble != NULL)
        fprintf(stderr, "%s\n", trouble);
    else
        printf("joint %d of %s swung by %.3f rad\n", driver.link.joints, driver.link.robot, reached);
    driver_release(&driver, trouble == NULL ? "done" : trouble);
    return trouble == NULL ? 0 : 1;
}
