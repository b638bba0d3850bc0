/* Every call of arcl.h that needs no second arm, and what it gives. The argument is a file for the symbol table. */
#include <arcl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static int begun, ended, told, samples, notified[16];
static double latest;

static void check(const char *what, int well)
{
    printf("%s: %s\n", what, well ? "as it should be" : "WRONG");
}

static int near(double a, double b)
{
    return fabs(a - b) < 1e-9;
}

static int notify(Event event, ROBOT *rp)
{
    notified[event]++;
    begun += event == EVENT_BEGIN;
    return strcmp(rp->name, "puma560") ? MOVE_STOP : OK;
}

static void done(ROBOT *rp, Motion *m)
{
    ended += rp != NULL && m->code == EVENT_DONE && m->t0 >= 0;
}

static int feedback(Feedback *f)
{
    samples++;
    return f->n != 6 || f->share > 0.5;
}

static int on_error(Event event, ROBOT *rp, const char *text)
{
    told += event == EVENT_REACH && rp != NULL && strstr(text, "far") != NULL;
    return OK;
}

static void sway(Trans *t, Motion *m)
{
    t->t_p.y = (ami_treal() - m->t0) / 100.0;
    latest = t->t_p.y;
}

static int soon(void)
{
    return samples > 3;
}

static void types(const char *file)
{
    Trans *a = new_trans_rpy("a", 1, 2, 3, 10, 20, 30), *b = new_trans_eul("b", 4, 5, 6, 10, 20, 30);
    Trans *t = new_trans("t", VARB, 0); /* lists may be closed by 0 */
    double rpy[3];
    Vector *v = new_vector(3, 0, 4);
    Quat *q = new_quat_rotvec(zunit, 90), *half = quat_interp(new_quat(1, 0, 0, 0), q, 0.5);
    QuatVect *w = quatvect_of(a);
    Force *f = force_from(new_trans_tr("x", 1000, 0, 0), new_force(0, 0, 10, 0, 0, 0));

    trans_rpy(trans_mult(t, b, trans_invert(new_trans("i", VARB), b)), rpy);
    check("a transform and its inverse", near(t->t_p.x, 0) && near(rpy[0], 0) && near(t->t_a.z, 1));
    trans_rpy(a, rpy);
    check("angles", near(rpy[0], 10) && near(rpy[1], 20) && near(rpy[2], 30) && near(a->t_p.z, 3));
    check("vectors", near(vect_dot(v, xunit), 3) && near(vect_cross(zunit, xunit)->y, 1) && near(vect_unit(v)->z, 0.8));
    check("quaternions", near(q->s, sqrt(0.5)) && near(half->z, sin(atan(1) / 2)) && near(quat_mult(q, q)->z, 1)
                             && near(quat_invert(q)->z, -q->z) && near(w->v.y, 2) && near(new_quatvect(q, v)->v.x, 3));
    check("a pose", near(trans_assign(t, new_trans_quatvect("w", w))->t_p.y, 2));
    check("small motions", near(diff_of(new_trans_diff("d", new_diff(1, 2, 3, 0, 0, 0)))->d.y, 2)
                               && near(diff_in(new_trans_tr("x", 10, 0, 0), new_diff(0, 0, 0, 0, 0, 1))->r.z, 1));
    check("a force", near(f->f.z, 10) && near(f->m.y, -10));
    sym_enter(a);
    check("symbols", sym_lookup("a") == a && sym_lookup("none") == NULL && sym_dump(file) == 1 && sym_delete("a") == 1);
    check("a file", sym_delete("a") == 0 && sym_load(file) == 1 && near(sym_lookup("a")->t_p.z, 3));
    arcl_free(b);
    arcl_free(v);
}

static void motions(ROBOT *rp)
{
    Trans *swing = new_trans("swing", FNDEF, sway, 0), *goal = new_trans_rpy("goal", 500, 100, 200, 0, 90, 0);
    Pos *pos = makeposition("place", T6, EQ, goal, swing, TL, goal);
    Pos *far = makeposition("far", T6, EQ, new_trans_tr("f", 9000, 0, 0), TL, T6, 0);
    Pos *park = robot_pos(rp, "park", 0);
    Jacob *j = new_jacob(rp, joint_pos(rp, "j", 0, 45, -90, 0, 45.0f, 0L, 0));
    Semaphore *s = new_sem("s");
    IOD *lines = new_iod(rp, IOD_OUT, 2, 3);
    Motion *m;

    check("a matrix", j->n == 6 && near(j->m[2 * 6], 0) && fabs(j->m[6]) > 0.1);
    check("semaphores", sem_take(s) == OK && sem_take(s) == ERROR && sem_give(s) == OK && sem_pend(s) == OK);
    iod_write(lines, 5);
    gripper(rp, GRIP_CLOSE_BY, 40.0);
    gripper(rp, GRIP_OPEN);
    m = move(rp, pos, MOV_CONFIG, "run", MOV_TIME, 2000, MOV_NOTIFY, notify, MOV_DONEPROC, done, 0);
    check("a motion that waits", m->code == 0 && !strcmp(m->name, "place"));
    arcl_wait(rp);
    check("a motion", m->code == EVENT_DONE && begun == 1 && ended == 1 && notified[EVENT_DEQ] == 1 && latest > 19);
    check("lines", iod_read(lines) == 5);
    check("an analogue output", isnan(iod_value(named_iod(rp, "power"))) && iod_set_value(named_iod(rp, "power"), 50) == OK
          && near(iod_value(named_iod(rp, "power")), 50));
    check("named lines", iod_read(named_iod(rp, "lamps")) == 2 && isnan(iod_value(named_iod(rp, "pressure"))));
    m = move(rp, park, MOV_JVEL, 20.0, MOV_FEEDBACK, feedback, 0);
    arcl_wait(rp, soon);
    arcl_wait(rp);
    check("feedback", m->code == EVENT_STOP && samples > 10);
    arcl_errproc(on_error);
    m = move(rp, far, 0);
    move(rp, park, MOV_NAME, "home");
    arcl_wait(rp);
    check("an error", told == 1 && m->code == EVENT_REACH);
    arcl_errproc(NULL);
    m = move(rp, park, MOV_TIME, 1e4, 0);
    arcl_override(rp, 50.0);
    arcl_keep_path(rp, 1, 200.0, 30.0);
    arcl_pause(rp);
    arcl_resume(rp);
    check("a path that nobody left", !*arcl_kept(rp));
    arcl_skip(rp);
    stop(rp, MOV_TIME, 500, 0);
    arcl_wait(rp);
    check("a stop", m->code == EVENT_STOP && ami_treal(rp) > 2000 && near(where(rp)->t_n.x * 0, 0));
}

int main(int argc, char **argv)
{
    ROBOT *rp = arcl_open(ARCL_PERIOD, 28, ARCL_ARGCV, argc, argv, 0);

    check("a command line", argc == 4 && !strcmp(argv[2], "word") && argv[3] == NULL && !strcmp(rp->name, "puma560"));
    types(argv[1]);
    motions(rp);
    arcl_close(rp);
    printf("all calls made\n");
    return 0;
}
