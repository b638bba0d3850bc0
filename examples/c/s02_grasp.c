/* S-02: a grasp in three steps: 10 mm above, down, and the hand closes in the middle of a 400 ms dwell.
 *
 * Hayward & Paul 1986, section 3.3, as printed from `p->end = 0` to CLOSE. The same as examples/03_grasp.py.
 */
#include <stdio.h>
#include "rccl.h"

main()
{
    TRSF_PTR e, part;
    POS_PTR p;

    e = gentr_trsl("E", 0., 0., 100.);
    part = gentr_rot("PART", 500., 100., -300., yunit, 180.);
    p = makeposition("P", t6, e, EQ, part, TL, e);

    OPEN
    setmode('c');
    setvel(200., 90.);

    p->end = 0; /* reset count */
    distance("dz", -10.); /* backup 10 mm */
    move(p); /* move approach */
    move(p); /* move final */
    setime(0, 400); /* during 400 ms */
    move(p); /* stay there */
    waitfor(p->end) /* wait for motion */
    waitfor(p->end) /* completion */
    waitas(p->scal > .5) /* wait half time */
    CLOSE /* close hand */

    printf("hand closed at %.0f ms\n", how.time);
    waitfor(completed)
    return 0;
}
