/* A control law of one's own at setpoint level: joint 1 becomes a spring with a damper, the others hold.
 *
 * RCI takes the place of RCCL's trajectory generator (Lloyd, Parker and McClain 1987, section 2) by a hybrid controller:
 * torque on one joint and position on the rest. The spring's end is half a radian away; the arm goes there and rests.
 * In Python: examples/17_spring.py.
 *
 *     qrobot cc examples/c/rci_spring.c -o rci_spring
 *     qrobot run --lockstep ./rci_spring
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#include "rci.h"
#include <stdio.h>

#define SPRING 30.0 /* N m/rad */
#define DAMPER 25.0 /* N m s/rad */
#define AWAY 0.5    /* rad */
#define SAMPLES 250 /* of 28 ms */

static RCI_TASK *arm;
static double rest[RCI_JOINTS]; /* where the arm stood */
static double gone, farthest;

/* Torque on joint 1, position on all others. */
static void hybrid(RCI_TASK *td)
{
    static const int torque[RCI_JOINTS] = {1};
    double setpoints[RCI_JOINTS];
    int j;

    for (j = 0; j < td->how.n; j++) {
        if (rci_runs(td) == 0)
            rest[j] = td->how.q_setpoint[j];
        setpoints[j] = rest[j];
    }
    gone = td->how.q[0] - rest[0];
    farthest = gone > farthest ? gone : farthest;
    setpoints[0] = SPRING * (AWAY - gone) - DAMPER * td->how.v[0];
    rci_drive(td, setpoints, torque);
}

static int over(void)
{
    return rci_runs(arm) >= SAMPLES;
}

int main(void)
{
    if ((arm = rci_create("puma560", "")) == 0 || rci_control(arm, hybrid, 0, 0))
        return 1;
    if (rci_start(arm->bit) || rci_wait(over))
        return 1;
    if (rci_close())
        return 1;
    printf("joint 1 has gone %.3f rad of %g, at most %.3f\n", gone, AWAY, farthest);
    return 0;
}
