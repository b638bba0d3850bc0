/* four_places.c - an arm of Multi-RCCL goes round four places on a table that is turned meanwhile (Lloyd, Parker &
 * McClain 1987, section 3.2). The twin of examples/18_four_places.py.
 *
 *   qrobot cc examples/c/four_places.c -o four_places
 *   qrobot run --offline ./four_places
 *   qrobot run --lockstep ./four_places
 *   qrobot up & ./four_places           the same in real time
 */
#include <stdio.h>
#include <rccl.h>

#define PLACES 4

float places[PLACES][2] = {{0, -60}, {80, -60}, {80, 60}, {0, 60}};
int samples = 0;

/* The table, which turns by 3 degrees a second. */
turn(t) TRSF *t;
{
    samples++;
    Rot(t, zunit, 0.003 * 28 * samples);
}

main()
{
    MANIP *arm;
    POS *p0;
    TRSF *tool, *table, *turned, *p;
    int i;

    arm = rccl_open("puma560");
    rccl_control(arm);
    tool = gentr_trsl("TOOL", 0., 0., 100.);
    table = gentr_rot("TABLE", 480., 60., -250., yunit, 180.); /* its z axis points down */
    p = newtrans("P", hold);
    turned = newtrans("TURNED", turn);
    p0 = makePosition(TRANS, tool, EQ, table, turned, p, TL, tool);

    setmode(arm, 'c');
    setvel(arm, 120., 60.);
    for (i = 0; i < PLACES; i++) {
        trsl(p, places[i][0], places[i][1], 0.);
        move(arm, p0);
    }
    for (i = 0; i < PLACES; i++) {
        wait_for(p0->end);
        printf("place %d: x %.1f y %.1f mm\n", i + 1, arm->trans.p.x + 100 * arm->trans.a.x,
               arm->trans.p.y + 100 * arm->trans.a.y);
    }
}
