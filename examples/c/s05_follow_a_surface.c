/* S-05: a proximity sensor keeps the tool at its distance from a surface that nobody has measured.
 *
 * Hayward & Paul 1986, section 3.4.1. Repairs are marked with an exclamation mark. The sensor is made up: it looks at a
 * wavy table from where the arm was measured. The same as examples/10_follow_a_surface.py.
 */
#include <math.h>
#include <stdio.h>
#include "rccl.h"

#define OFFSET 20. /* mm, distance to keep */
#define RANGE 2.   /* mm, more than that the sensor does not tell */

float sensor; /* mm, the reading */
float gain = .2;
double least = 1000., most;
TRSF_PTR table;

/* Background functions. */

look() /*! the paper's sensor reads itself at every sample */
{
    double y, depth; /* of the tip, in the frame of the table, whose z axis points down */

    y = t6->p.y + 100. * t6->a.y - table->p.y;
    depth = table->p.z - (t6->p.z + 100. * t6->a.z);
    sensor = 5. * sin(y / 20.) - depth;
}

sensfn(t)
TRSF_PTR t;
{
    double error;

    look();
    error = sensor - OFFSET;
    if (error > RANGE) /*! a sensor has a range */
        error = RANGE;
    if (error < -RANGE)
        error = -RANGE;
    t->p.z += error * gain;
}

double off_by() /* what is wrong, mm */
{
    look();
    return fabs(sensor - OFFSET);
}

double watch() /* the extremes of the way, and how much of it is done */
{
    look();
    if (sensor < least)
        least = sensor;
    if (sensor > most)
        most = sensor;
    return 0.;
}

main()
{
    TRSF_PTR e, over, disp, sens;
    POS_PTR p1, p2;

    e = gentr_trsl("E", 0., 0., 100.);
    table = gentr_rot("TABLE", 500., 50., -300., yunit, 180.);
    over = gentr_trsl("OVER", 0., 0., -20.);
    disp = gentr_trsl("DISP", 0., 100., -20.);
    sens = newtrans("SENS", sensfn);

    p1 = makeposition("P1", t6, e, EQ, table, over, sens, TL, e); /*! the paper leaves SENS out of both equations */
    p2 = makeposition("P2", t6, e, EQ, table, disp, sens, TL, e);

    setmode('c');
    setvel(100., 90.);
    move(p1);
    waitas(p1->end > 0 && off_by() < .5) /* the sensor has brought it there */
    setvel(25., 90.);
    move(p2);
    waitas(watch() + p2->scal > .95)
    printf("between %.1f and %.1f mm over a surface that goes up and down by 10\n", least, most);
    move(park);
    waitfor(completed)
    return 0;
}
