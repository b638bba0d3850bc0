/* S-03: one equation, many goals: a hold transform is read from a data base while the arm moves.
 *
 * Hayward & Paul 1986, section 3.3, as printed from `e = gentr...` to the end of the loop; the data base is a table here.
 * The same as examples/04_data_base.py.
 */
#include <stdio.h>
#include "rccl.h"

#define MAX 3

float places[][3] = {{0, 0, 0}, {0, 80, 0}, {-60, 80, -30}, {-60, 0, -30}, {-30, 40, -60}};
int next;

gettr(loc) /* the next location; NO when there is none */
TRSF_PTR loc;
{
    if (next == sizeof(places) / sizeof(places[0]))
        return NO;
    Trsl(loc, places[next][0], places[next][1], places[next][2]);
    ++next;
    return YES;
}

main()
{
    TRSF_PTR e, ref, loc;
    POS_PTR p;

    setmode('c');
    setvel(150., 90.);

    e = gentr_trsl("E", 0., 0., 100.);
    ref = gentr_rot("REF", 500., 50., -300., yunit, 180.);
    loc = newtrans("LOC", hold);

    p = makeposition("P", t6, e, EQ, ref, loc, TL, e);

    while (gettr(loc) != NO) {
        waitas(nbrequest < MAX)
        move(p);
    }

    waitfor(completed)
    printf("%d locations visited\n", p->end);
    return 0;
}
