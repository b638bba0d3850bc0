/* S-09: an assembly cell: show the pallet, find the plate, take two parts and fit them into its hole, put the tray on a
 * belt. Written from the documentation alone, with every call there is; docs/how-to/run-a-legacy-c-program.md tells how
 * the first try went.
 *
 *     qrobot cc examples/c/s09_assembly_cell.c -o assembly_cell
 *     printf 'joint 6 5\nq\nworld dx -150 dy 120 dz -50\nrecord\nq\ny\n' |
 *         CELL_DB=cell.db qrobot run --lockstep --scene peg ./assembly_cell
 *
 * What is typed: joint 6 is turned in stepmode; then the pallet is shown, recorded and saved, which is asked for only once.
 */
#include <math.h>
#include <stdlib.h>
#include "rccl.h"
#include "rtc.h"
#include "umac.h"
#include "hand.h"

#define PARTS 2
#define FLANGE 56.25  /* from T6 to the flange, mm */
#define ROD 100.      /* from the flange to the tip */
#define PUSHED -7     /* the code of a force limit */
#define SEEN 7        /* our own code: the light barrier */
#define ESTOP 4       /* in how.flags: not pressed */

TRSF_PTR world, e, e2, pallet, slot, plate, side, hole, where, gauge, line, belt, tray;
POS_PTR pick, grip, touch, insert, out, inspect, deliver, safe;
real level;                /* of the light barrier: z of T6 */
volatile bool fitting = NO;
volatile event seen;       /* our own: the light barrier, signalled by a function */
int samples;
double started, torque;    /* of the belt, ms; the largest torque on the waist, N m */

belt_moves(t)              /* the belt: 40 mm/s along y of its line */
TRSF_PTR t;
{
    t->p.y = .040 * (how.time - started);
}

barrier()                  /* ends a motion when the hand is low enough */
{
    if (t6->p.z <= level) {
        seen = 1;
        nextmove = SEEN;
    }
}

look()                     /* at every sample, before the command is made up */
{
    ++samples;
    if (fabs(how.tau[0]) > torque) torque = fabs(how.tau[0]);
    if (!(how.flags & ESTOP)) {
        mess = "emergency stop";
        terminate = YES;
    }
}

twist()                    /* turns the part a little while it goes in; lamp 1 is on meanwhile */
{
    if (fitting && chg.modes[5] == 1) chg.setpoints[5] += .003 * sin(.006 * how.time);
    chg.outputs = fitting ? 1 : 0;
}

state(what)                /* prints how the robot is */
char *what;
{
    real angles[RCCL_JOINTS], again[RCCL_JOINTS];
    int counts[RCCL_JOINTS], i;

    for (i = 0; i < how.n; ++i) angles[i] = how.q[i];
    angtoenc(counts, angles);
    enctoang(again, counts);
    printf("%s: mode %d, hand %d, inputs %d, waist %.3f rad (%d counts, %.3f), asked %.3f, %.2f rad/s, fz %.1f = %d/1000 N\n",
           what, how.mode, how.hand, how.inputs, how.q[0], counts[0], again[0], how.q_setpoint[0], how.v[0],
           how.force[2], how.adcr);
}

model()                    /* the cell as transforms and equations */
{
    VECT axis;

    axis.x = axis.y = 0.; axis.z = 1.;
    world = newtrans("WORLD", const);
    e = gentr_trsl("E", 0., 0., FLANGE + ROD);
    e2 = gentr_rot("E2", 0., 0., FLANGE + ROD, &axis, 30.);         /* the same, turned */
    pallet = newtrans("PALLET", varb);                              /* to be taught */
    slot = newtrans("SLOT", hold);
    plate = gentr_pao("PLATE", 500., 0., -295., 0., 0., -1., 0., 1., 0.);   /* really at -300 */
    side = gentr_rot("SIDE", -40., 0., 0., zunit, 0.);              /* a place on it to touch */
    hole = trsl(newtrans("HOLE", varb), 3., 2., 0.);                /* really 0, 0 */
    where = newtrans("WHERE", varb);
    gauge = newtrans("GAUGE", hold);
    belt = newtrans("BELT", belt_moves);
    line = gentr_rpy("LINE", 450., -200., -150., 0., 0., 0.);       /* where the belt begins */
    tray = gentr_eul("TRAY", 0., 0., 0., 0., 180., 0.);

    pick = makeposition("PICK", world, t6, e, EQ, pallet, slot, TL, e);
    grip = makeposition("GRIP", world, t6, e, EQ, pallet, slot, TL, e);     /* pick keeps its code meanwhile */
    touch = makeposition("TOUCH", world, t6, e, EQ, plate, side, TL, e);
    insert = makeposition("INSERT", world, t6, e, EQ, plate, hole, TL, e);
    out = makeposition("OUT", world, t6, e, EQ, plate, where, TL, e);
    inspect = makeposition("INSPECT", world, t6, e, EQ, plate, gauge, TL, e);
    deliver = makeposition("DELIVER", world, t6, e2, EQ, line, belt, tray, TL, e2);
    safe = jposition("SAFE", 10., -50., 175., 0., 55., 20.);
}

find_plate()               /* a guarded approach, unless the data base knows the plate */
{
    if (getr(plate) == YES) return;
    setmode("joint");
    setvel(200., 90.);
    distance("dz", -30.);
    move(touch);
    setmod('c');
    setval(20., 20.);
    distance("dz", 30.);
    limit("fz", 15.);
    update(plate, touch);
    move(touch);
    waitfor(touch->end)
    waitfor(touch->end)
    printf("plate %s at z = %.1f\n", touch->code == PUSHED ? "found" : "NOT found", plate->p.z);
    setvel(50., 30.);
    distance("dz", -40.);
    move(touch);
    waitfor(touch->end)
    saver(plate);
}

take(i)                    /* part i from the pallet */
int i;
{
    trsl(slot, 0., 25. * i, 0.);
    pick->end = 0;
    setmode('j');
    setvel(250., 120.);
    distance("dz", -40.);
    move(pick);                        /* above it */
    setmode('c');
    setvel(60., 60.);
    distance("dz", 15.);               /* the turn to what follows begins 6 mm before its end */
    evalfn(barrier);
    move(pick);                        /* down until the barrier sees the hand */
    setime(100., 600.);
    move(grip);                        /* a dwell, in the middle of which the hand closes */
    waitfor(pick->end)
    waitfor(pick->end)
    printf("part %d: ended with %d\n", i + 1, pick->code);
    waitfor(seen)
    waitas(grip->scal > .5)
    CLOSE
    waitfor(grip->end)
    distance("dz", -60.);
    move(pick);
}

bool fit()                 /* the part into the hole */
{
    bool fitted;

    setmode('j');
    setvel(250., 120.);
    distance("dz", -40.);
    move(insert);
    setmode('c');
    setvel(50., 30.);
    distance("dz", -4.);               /* as near as it is safe: an arm that gives way drifts */
    move(insert);
    waitfor(insert->end)
    waitfor(insert->end)
    setvel(20., 20.);
    comply("fx fy", 0., 0.);
    limit("fz", 60.);
    distance("dz", 15.);
    update(where, out);                /* where the tip is in the end, seen from the plate */
    fitting = YES;
    move(insert);
    waitfor(insert->end)
    fitting = NO;
    fitted = insert->code == -1;
    OPEN
    lock("fx fy");
    setvel(50., 30.);
    distance("dz", -55.);
    move(out);                         /* straight up from there */
    waitfor(out->end)
    if (fitted) {
        hole->p.x = where->p.x;        /* the next one need not search */
        hole->p.y = where->p.y;
    }
    printf("%s: tip at %.1f %.1f, %.1f deep\n", fitted ? "fitted" : "NOT fitted", where->p.x, where->p.y, where->p.z);
    return fitted;
}

report()                   /* where the hole is in the base */
{
    TRSF_PTR a, b, c;
    TRSF before;

    a = newtrans("A", varb); b = newtrans("B", varb); c = newtrans("C", varb);
    before = *where;
    trmult(a, plate, where);
    printr(a, stdout);
    Invert(b, plate);
    Trmult(c, b, a);
    printf("back by the inverse: off by %.3f mm\n", fabs(c->p.x - before.p.x) + fabs(c->p.y - before.p.y));
    invert(b, assigntr(c, a));
    Assigntr(a, c);
    Trmult(c, a, b);
    printf("a transform times its inverse: n.x %.3f o.y %.3f a.z %.3f\n", c->n.x, c->o.y, c->a.z);
    freetrans(a); freetrans(b); freetrans(c);
}

views()                    /* looks at the result from four sides, at a sample period of 20 ms */
{
    sample(20.);
    setmode('j');
    setvel(200., 90.);
    Rot(gauge, xunit, 15.);      gauge->p.z = -90.; move(inspect);
    rot(gauge, yunit, 15.);      gauge->p.z = -90.; move(inspect);
    Eul(gauge, 0., 10., 20.);    gauge->p.z = -90.; move(inspect);
    eul(gauge, 0., 10., -20.);   gauge->p.z = -90.; move(inspect);
    rpy(gauge, 30., 0., 0.);     gauge->p.z = -90.; move(inspect);
    Rpy(gauge, -30., 5., 5.);    gauge->p.z = -90.; move(inspect);
    Trsl(gauge, 0., 0., -100.);  move(inspect);
    waitas(nbrequest < 2)
    printf("fewer than two views wait\n");
    waitfor(completed)
    sample(28.);
}

pumatask()
{
    int i;
    char *file;

    if ((file = getenv("CELL_DB")) == NULL) file = "assembly_cell.db";
    makedb(file);
    model();
    stepmode();
    if (teach(pallet, pick) == NO) {
        printf("no pallet, no work\n");
        exit(1);
    }
    dumpdb();
    release("the cell was taught");

    mess = "the cell is at rest";
    control(look, twist);
    adcopen(2);
    chg.hand = 1;
    setconf("lun");
    setvel(250., 120.);
    move(safe);
    waitfor(safe->end)
    state("ready");
    find_plate();
    for (i = 0; i < PARTS; ++i) {
        level = pallet->p.z + FLANGE + ROD + 1.;
        take(i);
        if (!fit()) mess = "a part did not fit";
    }
    report();
    views();

    started = how.time;                /* the tray goes onto the belt, and with it for a while */
    setmode('c');
    setvel(200., 90.);
    move(deliver);
    waitfor(deliver->end)
    for (i = 0; i < 20; ++i) suspendfg();
    printf("on the belt at y = %.0f\n", t6->p.y);
    move(there);
    waitfor(there->end)
    setmode('j');
    move(park);
    waitas(park->scal > .3)
    stop(300.);                        /* somebody looks in */
    waitfor(park->end)
    printf("on the way to %s: stopped with %d\n", park->name, park->code);
    move(park);
    waitfor(park->end)
    freepos(safe);
    state("done");
    printf("%d samples, %.1f N m on the waist\n", samples, torque);
}
