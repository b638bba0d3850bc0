/* S-10: boxes come along a belt; each is taken while the belt moves, carried past a reader over a wall, tilted into a
 * slot of the rack, and the next one may be on its way already. Written from the documentation and the papers alone, in
 * the way of the time; docs/how-to/run-a-legacy-c-program.md tells how the first try went.
 *
 *     qrobot cc examples/c/s10_belt_to_rack.c -o belt_to_rack -lm
 *     qrobot run --lockstep ./belt_to_rack 3
 */
#include <math.h>
#include <stdlib.h>
#include "rccl.h"
#include "hand.h"

#define BOXES 2
#define SPEED 30.       /* of the belt, mm/s */
#define REACH 260.      /* mm, how far along the belt a box can still be taken */
#define LABEL 3         /* the reader has seen a label */
#define PITCH 70.       /* of the rack, mm */
#define TILT 25.        /* degrees */

#define FIXED(t, x, y, z) t = gentr_trsl("t", x, y, z)
#define FRAME(t, kind)    t = newtrans("t", kind)
#define EQUATION(p, a, b) p = makeposition("p", t6, e, EQ, a, b, TL, e)

/* as lint wants it */
TRSF_PTR newtrans(), gentr_trsl(), gentr_rot(), trsl(), rot();
POS_PTR makeposition();
int move(), setvel(), setmode(), setime(), distance(), evalfn(), update(), control();

TRSF_PTR e, e_tilt, down, belt, box, wall, window, rack, slot, tilt, seen;
POS_PTR pick, over, scan, drop, turn, at_label;
int hold, varb;         /* boxes in the rack, boxes that were let go */
int nlabels;
double laid;            /* when the box was laid on the belt, ms */
double where_y;         /* of the label of this box, mm */
double nearest;         /* to the top of the wall on this way, mm */
event told;             /* the reader has told of a label */

double along()          /* how far the belt has carried the box, mm */
{
    return SPEED * (how.time - laid) / 1000.;
}

belt_fn(t)              /* the belt runs along y, past its beginning */
TRSF_PTR t;
{
    Trsl(t, 0., along(), 0.);
}

tilt_fn(t)              /* the hand tilts while the motion to TURN goes on */
TRSF_PTR t;
{
    Rot(t, yunit, turn->scal * TILT);
}

double tip(axis)        /* where the tip of the tool was measured: 0, 1, 2 for x, y, z */
int axis;
{
    if (axis == 0) return t6->p.x + e->p.z * t6->a.x;
    if (axis == 1) return t6->p.y + e->p.z * t6->a.y;
    return t6->p.z + e->p.z * t6->a.z;
}

reader()                /* sees the label when it passes by */
{
    if (tip(1) > where_y) return;
    ++told;
    nextmove = LABEL;
}

double off(t)           /* how far the tip is from there, mm */
TRSF_PTR t;
{
    double dx, dy, dz;

    dx = tip(0) - t->p.x;
    dy = tip(1) - t->p.y;
    dz = tip(2) - t->p.z;
    return sqrt(dx * dx + dy * dy + dz * dz);
}

watch()                 /* at every sample */
{
    if (off(wall) < nearest) nearest = off(wall);
}

world()
{
    FIXED(e, 0., 0., 120.);
    e_tilt = gentr_trsl("E_TILT", 0., 0., 120.);
    down = gentr_rot("DOWN", 450., 0., -250., yunit, 180.);     /* the beginning of the belt */
    FRAME(belt, belt_fn);
    FRAME(box, hold);
    FRAME(tilt, &tilt_fn);
    FRAME(slot, const);
    FRAME(seen, varb);
    wall = gentr_rot("WALL", 520., 60., -60., yunit, 180.);
    window = gentr_rot("WINDOW", 520., -140., -80., yunit, 180.);
    rack = gentr_rot("RACK", 400., -260., -180., yunit, 180.);

    pick = makeposition("PICK", t6, e, EQ, down, belt, box, TL, e);
    over = makeposition("OVER", t6, e, EQ, wall, TL, e);
    scan = makeposition("SCAN", t6, e, EQ, window, TL, e);
    EQUATION(at_label, window, seen);
    EQUATION(drop, rack, slot);
    turn = makeposition("TURN", t6, e_tilt, EQ, rack, slot, tilt, TL, tilt);
}

bool take(n)            /* box n; NO when it is out of reach */
int n;
{
    double begun;

    laid = how.time - 1000. * n;               /* each comes a second later than one would like */
    trsl(box, 10. * n, 0., -30.);
    if (along() > REACH) return NO;
    setmode('c');
    setvel(250., 120.);
    pick->end = 0;                              /* reset count */
    distance("dz", -40.);
    move(pick);                                 /* approach, with the belt */
    move(pick);                                 /* final */
    setime(0, 400);                             /* during 400 ms */
    move(pick);                                 /* stay there, with the belt */
    waitfor(pick->end)
    waitfor(pick->end)
    begun = how.time;
    if (along() > REACH) {                      /* it ran away */
        stop(0);
        waitfor(completed)
        return NO;
    }
    waitas(pick->scal > .5)                     /* wait half time */
    CLOSE
    printf("box %d: taken after %.0f mm, hand closed %.0f ms into the dwell, %.1f mm behind the belt\n", n + 1, along(),
           how.time - begun, down->p.y + along() - tip(1));
    return YES;
}

bool carry()            /* over the wall and past the reader; NO when it has seen no label */
{
    double passing;

    nearest = 1000.;
    told = 0;
    setvel(300., 120.);
    distance("dz", -60.);
    move(pick);                                 /* up with it, still with the belt */
    move(over);
    setvel(120., 90.);
    distance("dy", -60.);                       /* farther than needed */
    evalfn(reader);
    update(seen, at_label);
    move(scan);
    waitfor(over->end)                          /* a via point: this is as near as it gets */
    passing = off(wall);
    waitfor(scan->end)
    printf("  over the wall %.1f mm from its top, %.1f at the nearest\n", passing, nearest);
    if (scan->code != LABEL)
        return NO;
    waitfor(told)
    ++nlabels;
    printf("  label seen at y = %.1f, the arm stands at %.1f\n", window->p.y + seen->p.y, tip(1));
    return YES;
}

put()                   /* into the rack */
{
    trsl(slot, 0., PITCH * hold, 0.);
    setmode('j');
    setvel(300., 120.);
    distance("dz", -50.);
    move(drop);
    setmode('c');
    move(drop);
    setime(100, 900);
    move(turn);                                 /* tilt it in */
    waitfor(turn->end)
    printf("  tilted to %.2f of its way, code %d\n", turn->scal, turn->code);
    OPEN
    ++hold;
    distance("dz", -50.);
    move(drop);                                 /* straight again; the next one is on its way meanwhile */
}

main(argc, argv)
char *argv[];
{
    int i, n, first;

    n = argc > 1 ? atoi(argv[1]) : BOXES;
    first = argc > 2 ? atoi(argv[2]) : 0;       /* so many have gone by */
    world();
    control(watch);
    mess = "the belt is empty";
    OPEN
    setvel(300., 120.);
    move(park);
    waitfor(completed)
    for (i = first; i < first + n; ++i) {
        where_y = -150. - 10. * i;
        if (!take(i)) {
            printf("box %d: lost\n", i + 1);
            ++varb;
            continue;
        }
        if (!carry())
            printf("  no label\n");
        put();
    }
    printf("%d of %d boxes in the rack, %d labels, %d lost\n", hold, n, nlabels, varb);
    setmode('j');
    move(park);                                 /* and that is all */
}
