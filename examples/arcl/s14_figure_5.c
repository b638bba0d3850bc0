/* Figure 5 of the ARCL paper in C: PARK, a position, PARK at 10 mm/s, off line (Corke & Kirkham, section 4).
 *
 *     qrobot cc examples/arcl/s14_figure_5.c -o s14_figure_5
 *     ./s14_figure_5 +m +nolim
 *
 * prints the figure to the character; +tr its second part, no switch its first. The twin in Python, s14_figure_5.py,
 * tells where PARK comes from, and why +nolim is needed. */
#include <arcl.h>
#include <stdlib.h>

#define PARK 0.0, 90.0, -90.0, 0.0, 90.0, 0.0 /* degrees */

int main(int argc, char *argv[])
{
    ROBOT *rp = arcl_open(ARCL_ARGCV, argc, argv, ARCL_AMI, "offline", ARCL_START, arcl_joints(PARK), 0);
    Trans *base, *tool, *p;
    Pos *pos, *park;

    if (rp == NULL)
        exit(1);
    base = new_trans_tr("base", 0.0, 0.0, 862.0);
    tool = new_trans_tr("tool", 0.0, 0.0, 170.0);
    p = new_trans_rpy("p", 500.0, 600.0, 800.0, 0.0, 30.0, 0.0);
    pos = makeposition(base, T6, tool, EQ, p, TL, tool);
    park = joint_pos(rp, "PARK", PARK, TL, tool);

    move(rp, park, MOV_TIME, 300, 0);
    move(rp, pos, MOV_VT, 10, MOV_VR, 10, 0);
    move(rp, park, MOV_CONFIG, "run", 0);
    arcl_close(rp);
    return 0;
}
