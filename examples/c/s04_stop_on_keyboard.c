/* S-04: the arm moves until somebody hits return, and where it was then is put into the world model.
 *
 * Hayward & Paul 1986, section 3.3, as printed from `update` to the end; the same as examples/05_stop_on_keyboard.py. On
 * virtual time no time passes at the keyboard: it is a program for `qrobot up`.
 */
#include <stdio.h>
#include "rccl.h"

main()
{
    TRSF_PTR e, ref, loc;
    POS_PTR p;

    e = gentr_trsl("E", 0., 0., 100.);
    ref = gentr_rot("REF", 500., 50., -300., yunit, 180.);
    loc = gentr_trsl("LOC", 0., 200., 0.);
    p = makeposition("P", t6, e, EQ, ref, loc, TL, e);

    move(park);
    waitfor(completed)
    setmode('c');
    setvel(40., 30.);

    update(loc, p);
    move(p);
    printf("hit <return> to stop the arm\n");
    getchar();
    nextmove = YES;
    waitfor(completed)
    if (p->code != YES)
        printf("The arm was in P when <return> was hit\n");

    printf("LOC is now %.1f %.1f %.1f mm\n", loc->p.x, loc->p.y, loc->p.z);
    return 0;
}
