/* The program of the ARCL paper in C: a position equation, and ways to move to it (Corke & Kirkham, 2.1 to 2.3).
 *
 *     qrobot cc examples/arcl/s11_first_program.c -o s11_first_program
 *     qrobot run --offline ./s11_first_program +tr +m
 *
 * "lun", the last configuration, needs joint 1 at 180 degrees, which no PUMA 560 reaches: an error for the program's
 * handler, which goes on. */
#include <arcl.h>
#include <stdio.h>
#include <stdlib.h>

static int on_error(Event event, ROBOT *rp, const char *text)
{
    (void) rp;
    printf("error event %d: %s\n", event, text);
    return OK;
}

int main(int argc, char *argv[])
{
    ROBOT *rp;
    Trans *stand, *work, *base, *tool, *here;
    Pos *pos;

    rp = arcl_open(ARCL_ARGCV, argc, argv, 0);
    if (rp == NULL) {
        fprintf(stderr, "Can't open manipulator\n");
        exit(1);
    }
    arcl_errproc(on_error);

    base = new_trans_tr("base", 0.0, 0.0, 300.0);
    tool = new_trans_tr("tool", 0.0, 0.0, 170.0);
    stand = new_trans_tr("stand", 600.0, 100.0, 500.0);
    work = new_trans_rotvec("work", -100.0, 50.0, 345.0, yunit, 30.0);
    pos = makeposition(base, T6, tool, EQ, stand, work, TL, tool);

    move(rp, pos, MOV_CONFIG, "run", 0);
    move(rp, pos, MOV_TRAJ, TRAJ_CART, 0);
    move(rp, pos, MOV_TRAJ, TRAJ_JOINT, MOV_TIME, 2000, MOV_SYNC, 0);
    move(rp, pos, MOV_TRAJ, TRAJ_JOINT, MOV_TIME, 2000, MOV_CONFIG, "lun", 0);
    arcl_wait(rp);
    here = where(rp);
    printf("T6 at %.1f %.1f %.1f mm\n", here->t_p.x, here->t_p.y, here->t_p.z);
    arcl_close(rp);
    return 0;
}
