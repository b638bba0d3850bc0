/* A weld with a weave, in C: a functional transform swings the tool while it goes along the seam (Corke & Kirkham, 2.5).
 *
 * The function is called at each sample with its transform and the motion that it is part of; m->t0 is the time at which
 * that motion was taken out of the queue. */
#include <arcl.h>
#include <math.h>
#include <stdlib.h>

#define WEAVE_AMP 10.0 /* mm */
#define WEAVE_FREQ 2.0 /* Hz */
#define TwoPI 6.283185307179586

/* It grows within the first half second: the tool has no speed yet. */
static void weave_func(Trans *weave, Motion *m)
{
    double elapsed = ami_treal() - m->t0;
    double theta = TwoPI * elapsed * WEAVE_FREQ / 1000.0;

    weave->t_p.x = WEAVE_AMP * sin(theta) * pow(elapsed < 500.0 ? elapsed / 500.0 : 1.0, 3);
}

int main(int argc, char *argv[])
{
    ROBOT *rp = arcl_open(ARCL_ARGCV, argc, argv, 0);
    Trans *torch, *seam, *along, *weave;
    Pos *begin, *welded;

    if (rp == NULL)
        exit(1);
    torch = new_trans_tr("torch", 0.0, 0.0, 150.0);
    seam = new_trans_rpy("seam", 500.0, -100.0, 0.0, 0.0, 180.0, 0.0);
    along = new_trans_tr("along", 0.0, 200.0, 0.0);
    weave = new_trans("weave", FNDEF, weave_func);

    begin = makeposition(T6, torch, EQ, seam, TL, torch);
    welded = makeposition(T6, torch, EQ, seam, along, weave, TL, torch);

    move(rp, begin, MOV_TRAJ, TRAJ_JOINT, MOV_CONFIG, "ruf", MOV_TIME, 4000, MOV_SYNC, 0);
    move(rp, welded, MOV_TRAJ, TRAJ_CART, MOV_VT, 40, MOV_VR, 30, MOV_SYNC, 0);
    arcl_close(rp);
    return 0;
}
