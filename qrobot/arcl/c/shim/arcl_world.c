/* arcl_world.c - transforms, positions and the other types of arcl.h. */
#include <string.h>

#include "arcl_call.h"

static Vector x_axis = {1, 0, 0}, y_axis = {0, 1, 0}, z_axis = {0, 0, 1};
Vector *const arcl_xunit = &x_axis, *const arcl_yunit = &y_axis, *const arcl_zunit = &z_axis;

/* An object of plain numbers; it has no name. */
static void *plain(const char *call, int count, const arcl_value *values)
{
    char *kept;
    struct message m = arcl_call(call, NULL, count, values);
    double *p = shim_new("", &kept);
    memcpy(p, m.numbers, (size_t) m.n * sizeof *p);
    return p;
}

static void *made(const char *call, const char *name, int count, const arcl_value *values)
{
    void *p = arcl_named(name);
    arcl_call(call, p, count, values);
    return p;
}

#define R arcl_real
#define T arcl_trans_value
#define N arcl_text
#define V arcl_vector_value
#define SIX_OF(p) arcl_numbers(SIX, p)
#define QUAT_OF(p) arcl_numbers(QUATERNION, p)

/* ---------------------------------------------------------------------------------------------------- transforms */

static const char *name_among(int count, const arcl_value *values)
{
    return count && values[0].kind == TEXT ? values[0].pointer : "";
}

API Trans *arcl_list_new_trans(int count, const arcl_value *values)
{
    return made("new_trans", name_among(count, values), count, values);
}

API Trans *new_trans_tr(const char *name, double px, double py, double pz)
{
    return made("new_trans_tr", name, LIST(N(name), R(px), R(py), R(pz)));
}

API Trans *new_trans_rotvec(const char *name, double px, double py, double pz, const Vector *axis, double deg)
{
    return made("new_trans_rotvec", name, LIST(N(name), R(px), R(py), R(pz), V(axis), R(deg)));
}

API Trans *new_trans_rpy(const char *name, double px, double py, double pz, double roll, double pitch, double yaw)
{
    return made("new_trans_rpy", name, LIST(N(name), R(px), R(py), R(pz), R(roll), R(pitch), R(yaw)));
}

API Trans *new_trans_eul(const char *name, double px, double py, double pz, double phi, double theta, double psi)
{
    return made("new_trans_eul", name, LIST(N(name), R(px), R(py), R(pz), R(phi), R(theta), R(psi)));
}

API Trans *new_trans_quatvect(const char *name, const QuatVect *pose)
{
    return made("new_trans_quatvect", name, LIST(N(name), arcl_numbers(POSE, pose)));
}

API Trans *new_trans_diff(const char *name, const Diff *diff)
{
    return made("new_trans_diff", name, LIST(N(name), SIX_OF(diff)));
}

API Trans *trans_assign(Trans *t, const Trans *other)
{
    arcl_call("trans_assign", NULL, LIST(T(t), T(other)));
    return t;
}

API Trans *trans_mult(Trans *t, const Trans *left, const Trans *right)
{
    arcl_call("trans_mult", NULL, LIST(T(t), T(left), T(right)));
    return t;
}

API Trans *trans_invert(Trans *t, const Trans *other)
{
    arcl_call("trans_invert", NULL, LIST(T(t), T(other)));
    return t;
}

API int trans_rpy(const Trans *t, double *rpy)
{
    shim_need(rpy, "trans_rpy", "an array for the result");
    struct message m = arcl_call("trans_rpy", NULL, LIST(T(t)));
    memcpy(rpy, m.numbers, 3 * sizeof *rpy);
    return OK;
}

/* ------------------------------------------------------------------------------------------------------- numbers */

API Vector *new_vector(double x, double y, double z)
{
    return plain("new_vector", LIST(R(x), R(y), R(z)));
}

API double vect_dot(const Vector *a, const Vector *b)
{
    return arcl_call("vect_dot", NULL, LIST(V(a), V(b))).numbers[0];
}

API Vector *vect_cross(const Vector *a, const Vector *b)
{
    return plain("vect_cross", LIST(V(a), V(b)));
}

API Vector *vect_unit(const Vector *a)
{
    return plain("vect_unit", LIST(V(a)));
}

API Quat *new_quat(double s, double x, double y, double z)
{
    return plain("new_quat", LIST(R(s), R(x), R(y), R(z)));
}

API Quat *new_quat_rotvec(const Vector *axis, double deg)
{
    return plain("new_quat_rotvec", LIST(V(axis), R(deg)));
}

API Quat *quat_mult(const Quat *left, const Quat *right)
{
    return plain("quat_mult", LIST(QUAT_OF(left), QUAT_OF(right)));
}

API Quat *quat_invert(const Quat *q)
{
    return plain("quat_invert", LIST(QUAT_OF(q)));
}

API Quat *quat_interp(const Quat *begin, const Quat *end, double share)
{
    return plain("quat_interp", LIST(QUAT_OF(begin), QUAT_OF(end), R(share)));
}

API QuatVect *new_quatvect(const Quat *q, const Vector *v)
{
    return plain("new_quatvect", LIST(QUAT_OF(q), V(v)));
}

API QuatVect *quatvect_of(const Trans *t)
{
    return plain("quatvect_of", LIST(T(t)));
}

API Diff *new_diff(double dx, double dy, double dz, double rx, double ry, double rz)
{
    return plain("new_diff", LIST(R(dx), R(dy), R(dz), R(rx), R(ry), R(rz)));
}

API Diff *diff_of(const Trans *t)
{
    return plain("diff_of", LIST(T(t)));
}

API Diff *diff_in(const Trans *t, const Diff *diff)
{
    return plain("diff_in", LIST(T(t), SIX_OF(diff)));
}

API Force *new_force(double fx, double fy, double fz, double mx, double my, double mz)
{
    return plain("new_force", LIST(R(fx), R(fy), R(fz), R(mx), R(my), R(mz)));
}

API Force *force_from(const Trans *t, const Force *force)
{
    return plain("force_from", LIST(T(t), SIX_OF(force)));
}

API Jacob *new_jacob(ROBOT *rp, const Pos *joints)
{
    return plain("new_jacob", LIST(arcl_object(rp), arcl_object(joints)));
}

/* ----------------------------------------------------------------------------------------------------- positions */

API Pos *arcl_list_makeposition(int count, const arcl_value *values)
{
    return made("makeposition", name_among(count, values), count, values);
}

/* The name stands behind the robot. */
static Pos *made_position(const char *call, int count, const arcl_value *values)
{
    return made(call, count ? name_among(count - 1, values + 1) : "", count, values);
}

API Pos *arcl_list_joint_pos(int count, const arcl_value *values)
{
    return made_position("joint_pos", count, values);
}

API Pos *arcl_list_robot_pos(int count, const arcl_value *values)
{
    return made_position("robot_pos", count, values);
}

void arcl_give_back(void *p)
{
    if (!p)
        return;
    shim_start();
    if (!shim_used(p))
        shim_die("arcl_free: a pointer leads to no object that ARCL has made, or to one that was freed");
    arcl_call("arcl_free", p, 0, NULL);
    shim_free(p);
}

API void arcl_free(void *p)
{
    arcl_give_back(p);
}

/* ------------------------------------------------------------------------------------------- lines and semaphores */

API IOD *new_iod(ROBOT *rp, int direction, int first, int count)
{
    return made("new_iod", "", LIST(arcl_object(rp), arcl_integer(direction), arcl_integer(first), arcl_integer(count)));
}

API IOD *named_iod(ROBOT *rp, const char *name)
{
    return made("named_iod", "", LIST(arcl_object(rp), N(name)));
}

API double iod_value(IOD *iod)
{
    return arcl_call("iod_value", NULL, LIST(arcl_object(iod))).numbers[0];
}

API long iod_read(IOD *iod)
{
    return (long) arcl_call("iod_read", NULL, LIST(arcl_object(iod))).numbers[0];
}

API int iod_write(IOD *iod, long value)
{
    arcl_call("iod_write", NULL, LIST(arcl_object(iod), arcl_integer(value)));
    return OK;
}

API int iod_set_value(IOD *iod, double value)
{
    arcl_call("iod_set_value", NULL, LIST(arcl_object(iod), arcl_real(value)));
    return OK;
}

API Semaphore *new_sem(const char *name)
{
    return made("new_sem", name, LIST(N(name)));
}

static int of_semaphore(const char *call, Semaphore *semaphore)
{
    return (int) arcl_call(call, NULL, LIST(arcl_object(semaphore))).numbers[0];
}

API int sem_take(Semaphore *semaphore)
{
    return of_semaphore("sem_take", semaphore);
}

API int sem_give(Semaphore *semaphore)
{
    return of_semaphore("sem_give", semaphore);
}

API int sem_clear(Semaphore *semaphore)
{
    return of_semaphore("sem_clear", semaphore);
}

API int sem_pend(Semaphore *semaphore)
{
    return of_semaphore("sem_pend", semaphore);
}

/* -------------------------------------------------------------------------------------------------- symbol table */

API Trans *sym_enter(Trans *t)
{
    arcl_call("sym_enter", NULL, LIST(T(t)));
    return t;
}

/* A transform that came from a file is made when it is looked up. */
API Trans *sym_lookup(const char *name)
{
    Trans *fresh = arcl_named(name);
    struct message m = arcl_call("sym_lookup", fresh, LIST(N(name)));
    if (m.n && m.refs[0] == shim_ref(fresh))
        return fresh;
    shim_free(fresh);
    return m.n ? shim_at(m.refs[0]) : NULL;
}

API int sym_delete(const char *name)
{
    return (int) arcl_call("sym_delete", NULL, LIST(N(name))).numbers[0];
}

API int sym_dump(const char *path)
{
    return (int) arcl_call("sym_dump", NULL, LIST(N(path))).numbers[0];
}

API int sym_load(const char *path)
{
    return (int) arcl_call("sym_load", NULL, LIST(N(path))).numbers[0];
}
