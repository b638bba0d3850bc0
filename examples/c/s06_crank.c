/* S-06: a crank is turned four times; where its shaft is, the program knows only roughly.
 *
 * Hayward & Paul 1986, section 3.4.2. Repairs are marked with an exclamation mark: the paper prints two different axes,
 * its hand holds the handle where a rod stands in its hole here, and what it teaches is known here. The same as
 * examples/08_crank.py.
 *
 *     qrobot cc examples/c/s06_crank.c -o crank
 *     qrobot run --lockstep --scene crank ./crank
 */
#include <stdio.h>
#include "rccl.h"

#define TURNS 4
#define WRONG 6. /* mm, by which the program is wrong about the shaft */

POS_PTR get, turn;
int turns;

/* Background functions attached to the functional transforms. */

pxfn(t)
TRSF_PTR t;
{
    Rot(t, zunit, turn->scal * 360 * turns); /*! xunit */
}

nxfn(t)
TRSF_PTR t;
{
    Rot(t, zunit, turn->scal * 360 * turns); /*! yunit; the handle's z axis points down, the shaft's up: no minus */
}

main()
{
    TRSF_PTR e, shaft, handle, hole, rotpx, rotnx;
    double begin;

    rotpx = newtrans("ROTPX", pxfn);
    rotnx = newtrans("ROTNX", nxfn);
    shaft = gentr_trsl("SHAFT", 500. + WRONG, 0., -300.);
    handle = gentr_rot("HANDLE", 100., 0., -10., yunit, 180.);
    hole = gentr_rot("HOLE", 600., 0., -310., yunit, 180.); /*! taught in the paper */
    e = gentr_trsl("E", 0., 0., 156.25); /* to the end of the rod */
    get = makeposition("GET", t6, e, EQ, hole, TL, e);
    turn = makeposition("TURN", t6, e, EQ, shaft, rotpx, handle, rotnx, TL, handle);

    setmode('c');
    setvel(200., 90.);
    distance("dz", -40.);
    move(get);
    setvel(20., 90.);
    move(get);
    waitfor(completed)

    comply("fx fz", 0., 10.); /*! 0, 0 in the paper: the rod is pressed down a little */
    turns = TURNS; /* 4 turns */
    setime(200, 4000 * turns); /* 4 sec per turn */
    begin = how.time;
    move(turn);
    waitfor(turn->end);
    if (turn->code == -1)
        printf("turned %d times in %.1f s\n", turns, (how.time - begin) / 1000.);
    else
        printf("the crank was lost, code %d\n", turn->code);

    lock("fx fz");
    setvel(50., 90.);
    distance("dz", -40.);
    move(get); /* depart */
    waitfor(completed)
    return 0;
}
