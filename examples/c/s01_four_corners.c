/* S-01: a square traced four times, the program keeping pace with the corners.
 *
 * Hayward & Paul 1986, section 3.3, which prints the loop and the waiting; the place of the square is ours. The same as
 * examples/02_four_corners.py.
 *
 *     qrobot cc examples/c/s01_four_corners.c -o four_corners
 *     qrobot run --offline ./four_corners
 */
#include <stdio.h>
#include "rccl.h"

main()
{
    TRSF_PTR e, table, c0, c1, c2, c3;
    POS_PTR p0, p1, p2, p3;
    int i;

    e = gentr_trsl("E", 0., 0., 100.);
    table = gentr_rot("TABLE", 500., 50., -300., yunit, 180.);
    c0 = gentr_trsl("CORNER0", 0., 0., 0.);
    c1 = gentr_trsl("CORNER1", 0., 150., 0.);
    c2 = gentr_trsl("CORNER2", -100., 150., 0.);
    c3 = gentr_trsl("CORNER3", -100., 0., 0.);
    p0 = makeposition("P0", t6, e, EQ, table, c0, TL, e);
    p1 = makeposition("P1", t6, e, EQ, table, c1, TL, e);
    p2 = makeposition("P2", t6, e, EQ, table, c2, TL, e);
    p3 = makeposition("P3", t6, e, EQ, table, c3, TL, e);

    move(park);
    setmode('c');
    setvel(200., 90.);

    for (i = 0; i < 4; ++i) {
        move(p0);
        move(p1);
        move(p2);
        move(p3);
    }
    waitfor(p0->end);
    printf("starting first square\n");
    waitfor(p0->end)
    printf("starting second square\n");
    waitfor(p0->end)
    printf("starting third square\n");
    waitfor(p0->end)
    printf("starting fourth square\n");
    waitfor(completed)
    printf("done; corners passed %d %d %d %d times since somebody waited\n", p0->end, p1->end, p2->end, p3->end);
    return 0;
}
