/* One arm mirrors another: a master and a slave, two tasks of RCI on one clock.
 *
 * The master's task moves its arm and posts where the arm was measured, in shared memory. The slave's task sends its own
 * arm to the mirror image of that, left for right; wherever the arms stand, it goes first to the mirror image of where
 * the master is. In Python: examples/16_mirror.py.
 *
 *     qrobot cc examples/c/rci_mirror.c -o rci_mirror
 *     qrobot run --offline ./rci_mirror               two ideal arms
 *     qrobot up two_arms & ./rci_mirror               two emulated ones, in real time; ./rci_mirror 4 at 4 ms
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "rci.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define SWING_MS 8400
#define SMOOTH_MS 30.0
#define JOINTS 6
#define PI 3.14159265358979

struct posted {
    long word;      /* test and set: whoever gets 0 has the rest until it clears it */
    volatile int there;
    volatile int mirrors;   /* the slave is where it should be: the master swings */
    double q[JOINTS];
};

static const double swing[JOINTS] = {0.4363, 0.2618, -0.3491, 0.1745, 0.3491, -0.2618};
static const double mirror[JOINTS] = {-1.0, 1.0, 1.0, -1.0, 1.0, -1.0}; /* joints 1, 4 and 6 turn the other way */
static RCI_TASK *left, *right;
static long period = 28; /* ticks of 1 ms */
static long swung;       /* samples of the master's swing */
static double behind;    /* the slave's largest distance from the mirror image */

/* Post the measured joints; swing, gently at both ends, once the slave mirrors. */
static void master(RCI_TASK *td)
{
    static double rest[JOINTS];
    struct posted *posted = rci_getMemory("master");
    double way = (double)((swung += posted->mirrors) * period) / SWING_MS;
    double share = 0.5 * (1.0 - cos(2.0 * PI * (way < 1.0 ? way : 1.0)));
    double q[RCI_JOINTS];
    int j;

    for (j = 0; j < JOINTS; j++) {
        rest[j] = rci_runs(td) == 0 ? td->how.q_setpoint[j] : rest[j];
        q[j] = rest[j] + share * swing[j];
    }
    rci_goto(td, q);
    if (!rci_testAndSet(&posted->word)) {
        for (j = 0; j < JOINTS; j++)
            posted->q[j] = td->how.q[j];
        posted->there = 1;
        rci_clear(&posted->word);
    }
}

/* Go to `goal`, gently at both ends, at half the joints' speed and acceleration; 1 at the end. */
static int approach(RCI_TASK *td, const double *goal)
{
    static double start[JOINTS], samples;
    static long begin;
    double share;
    int j;

    for (j = 0; samples < 1.0 && j < JOINTS; j++)
        start[j] = td->chg.setpoints[j];
    if (samples < 1.0) {
        begin = rci_runs(td);
        samples = 1.0;
        for (j = 0; j < JOINTS; j++) {
            double way = fabs(goal[j] - start[j]);
            double seconds = PI * fmax(way / td->robot->v_max[j], sqrt(way / td->robot->a_max[j]));

            samples = fmax(samples, ceil(seconds * 1e3 / (double)period));
        }
    }
    share = fmin((double)(rci_runs(td) - begin) / samples, 1.0);
    for (j = 0; j < JOINTS; j++)
        td->chg.setpoints[j] = start[j] + 0.5 * (1.0 - cos(PI * share)) * (goal[j] - start[j]);
    return share == 1.0;
}

/* Follow the mirror image of what the master has posted, smoothly: two bridges have clocks of their own, so that one
 * sample finds nothing new and the next one twice as much. While the master writes the slave goes by what it knew. */
static void follow(RCI_TASK *td, const double *goal)
{
    int j;

    for (j = 0; j < JOINTS; j++) {
        double most = 0.9 * td->robot->v_max[j] * (double)period * 1e-3;
        double step = (goal[j] - td->chg.setpoints[j]) * (double)period / (SMOOTH_MS + (double)period);

        td->chg.setpoints[j] += step > most ? most : step < -most ? -most : step;
        behind = fabs(goal[j] - td->how.q[j]) > behind ? fabs(goal[j] - td->how.q[j]) : behind;
    }
}

/* Go to the mirror image of where the master stands, and follow it from then on. */
static void slave(RCI_TASK *td)
{
    static double goal[JOINTS];
    static int known;
    struct posted *posted = rci_getMemory("master");
    int j;

    if (!rci_testAndSet(&posted->word)) {
        for (j = 0; j < JOINTS; j++)
            goal[j] = mirror[j] * posted->q[j];
        known = posted->there;
        rci_clear(&posted->word);
    }
    if (known && posted->mirrors)
        follow(td, goal);
    else if (known)
        posted->mirrors = approach(td, goal);
}

static int over(void)
{
    return swung * period > SWING_MS + 600;
}

/* Where a bridge is: the environment's word for it, or that of the deployment file "two_arms". */
static const char *bridge(const char *variable, const char *usual)
{
    return getenv(variable) ? getenv(variable) : usual;
}

int main(int argc, char **argv)
{
    if (argc > 1)
        period = atol(argv[1]);
    if (rci_clock(1000) || rci_robot("left", "puma560", bridge("LEFT_BRIDGE", "127.0.0.1:5600")) ||
        rci_robot("right", "puma560", bridge("RIGHT_BRIDGE", "127.0.0.1:5601")))
        return 1;
    if ((left = rci_create("left", "")) == 0 || (right = rci_create("right", "")) == 0 || rci_priority(left, 1))
        return 1;
    if (rci_sharedMemory("master", sizeof(struct posted), left, right->bit) == 0)
        return 1;
    if (rci_control(left, master, 0, 0) || rci_control(right, slave, 0, 0) || rci_onclock(left, period, 0) ||
        rci_onclock(right, period, 0))
        return 1;
    if (rci_start(left->bit | right->bit) || rci_wait(over) || rci_close())
        return 1;
    printf("the slave was at most %.2f degrees behind\n", behind * 57.29578);
    return 0;
}
