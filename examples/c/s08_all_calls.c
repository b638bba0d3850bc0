/* S-08: everything that rccl.h has, in one program: a small cell with a belt, a table and a person who teaches.
 *
 * Written from docs/reference/c-surface.md alone; it prints what it has found out, one line for each part.
 *
 *     qrobot cc examples/c/s08_all_calls.c -o all_calls
 *     printf 'q\nworld dz -20\nrecord\nq\nn\n' | qrobot run --offline ./all_calls cell.db
 */
#include <stdio.h>
#include "rccl.h"
#include "umac.h"
#include "rtc.h"
#include "hand.h"

#define SPEED 60. /* mm/s, of the belt */

TRSF_PTR e, table, pin, belt;
POS_PTR over;
int samples, commands;
event half_way;

/* ---- functions that are called at every sample */

first()
{
    ++samples;
    chg.outputs = samples & 1; /* a lamp that blinks */
}

second()
{
    ++commands;
}

conveyor(t) /* the belt moves as long as the program runs */
TRSF_PTR t;
{
    t->p.y = SPEED * how.time / 1000.;
}

monitor() /* half of the way is enough */
{
    if (over->scal > .5) {
        ++half_way;
        nextmove = 7;
    }
}

/* ---- the parts */

report(what, well)
char *what;
int well;
{
    printf("%-28s %s\n", what, well ? "as it should be" : "WRONG");
}

int near(a, b) /* to a thousandth */
double a, b;
{
    return a - b < 1e-3 && b - a < 1e-3;
}

transforms()
{
    TRSF_PTR a, b, c;

    a = gentr_eul("A", 10., 20., 30., 90., 0., 0.);
    b = gentr_rpy("B", 10., 20., 30., 90., 0., 0.);
    report("Euler and roll about z", near(a->n.y, b->n.y) && near(a->o.x, -1.));
    c = gentr_pao("C", 0., 0., 5., 0., 0., 1., 0., 1., 0.);
    report("approach and orientation", near(c->a.z, 1.) && near(c->n.x, 1.) && near(c->p.z, 5.));
    Trmult(c, a, invert(newtrans("I", varb), a));
    report("a times its inverse", near(c->n.x, 1.) && near(c->p.x, 0.) && near(c->p.z, 0.));
    Assigntr(c, rot(newtrans("R", varb), xunit, 180.));
    report("half a turn about x", near(c->n.x, 1.) && near(c->a.z, -1.));
    Rot(c, zunit, 90.);
    Eul(a, 90., 0., 0.);
    Rpy(b, 90., 0., 0.);
    report("three quarters the same", near(a->o.x, c->o.x) && near(b->o.x, c->o.x));
    Invert(c, trsl(a, 1., 2., 3.));
    report("a shift taken back", near(c->p.y, -2.));
    Trsl(a, 0., 0., 0.);
    printr(c, stdout);
    freetrans(a);
    freetrans(b);
    freetrans(c);
}

motions()
{
    POS_PTR bent;
    real angles[6];
    int counts[6], again[6], j;

    bent = jposition("BENT", 10., -80., 170., 0., 10., 0.);
    setmode('j');
    sample(28.);
    setime(200, 1500);
    move(bent);
    waitfor(bent->end)
    report("a joint position", bent->code == -1 && near(how.q_setpoint[0] * 57.29578, 10.));
    for (j = 0; j < 6; ++j)
        angles[j] = how.q[j];
    angtoenc(counts, angles);
    enctoang(angles, counts);
    angtoenc(again, angles);
    report("counts and angles", counts[0] == again[0] && counts[5] == again[5]);
    freepos(bent);

    setmod("cartesian");
    setconf("");
    setvel(200., 90.);
    distance("dz", -50);
    limit("fz dz", 200., 50.);
    move(over);
    waitas(over->scal > .3)
    stop(100.);
    waitfor(completed)
    report("a stop on the way", over->code == -2);
    setval(250., 90.);
    evalfn(monitor);
    over->end = 0;
    move(over);
    waitfor(over->end)
    waitfor(half_way)
    report("a monitor", over->code == 7);
    comply("fx fy", 0., 0.);
    lock("fx fy");
}

tracking()
{
    double begin;

    distance("dz", -20.);
    move(over);
    move(over);
    waitas(nbrequest == 0)
    waitfor(completed)
    begin = how.time;
    CLOSE
    while (how.time < begin + 500.)
        suspendfg();
    report("with the belt", t6->p.y > belt->p.y - 10. && t6->p.y < belt->p.y + 10.);
    move(there);
    waitfor(completed)
    OPEN
}

taught(file)
char *file;
{
    TRSF_PTR place;
    POS_PTR p;

    makedb(file);
    place = newtrans("PLACE", hold);
    p = makeposition("TAUGHT", t6, place, EQ, table, TL, place);
    update(place, p);
    move(there);
    waitfor(completed)
    saver(place);
    report("recorded and read", getr(place) == YES);
    dumpdb();
    stepmode();
    place = newtrans("CORNER", varb);
    p = makeposition("CORNER", t6, EQ, place, TL, place);
    report("taught", teach(place, p) == YES);
}

main(argc, argv)
int argc;
char **argv;
{
    mess = "the cell is at rest";
    control(first, second);
    adcopen(2);
    transforms();
    e = gentr_trsl("E", 0., 0., 100.);
    table = gentr_rot("TABLE", 500., 0., -300., yunit, 180.);
    pin = gentr_trsl("PIN", 0., 0., 0.);
    belt = newtrans("BELT", conveyor);
    over = makeposition("OVER", t6, e, EQ, table, belt, pin, TL, e);
    move(park);
    waitfor(completed)
    motions();
    tracking();
    taught(argc > 1 ? argv[1] : "cell.db");
    move(park);
    waitfor(completed)
    report("functions at every sample", samples > 100 && commands >= samples - 1 && how.adcr == ADC_NONE);
    release("all calls made");
    return 0;
}
