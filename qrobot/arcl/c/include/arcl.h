/* arcl.h - ARCL for programs in C and C++ (Corke & Kirkham, "The ARCL Robot Programming System").
 *
 * Millimetres, degrees, milliseconds. All names are described in docs/reference/arcl-c.md. Compile with `qrobot cc`.
 */
#ifndef ARCL_H
#define ARCL_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#define ARCL_ANY ...
#define ARCL_ASSERT static_assert
#else
#define ARCL_ANY /* any arguments */
#define ARCL_ASSERT __extension__ _Static_assert
#endif

/* The motion engine and the library have to find a field where the program has it. */
#define ARCL_LAYOUT(type, field, place)                                                                             \
    ARCL_ASSERT(offsetof(type, field) == (place),                                                                   \
                "structures lie otherwise here than the motion engine reads them: compile for 64 bits, without "    \
                "options that change layouts, such as -m32 or -fpack-struct")

/* --------------------------------------------------------------------------------------------- types of Table 1 */

#define ARCL_JOINTS_MAX 32
#define ARCL_COLUMNS_MAX 10

typedef int Event;

typedef struct arcl_vector {
    double x, y, z;
} Vector;

typedef struct arcl_trans {
    char *name;
    Vector t_n, t_o, t_a, t_p; /* three axes, and a position in mm */
} Trans;
ARCL_LAYOUT(Trans, t_n, 8);

typedef struct arcl_robot {
    char *name;
} ROBOT;

typedef struct arcl_pos {
    char *name;
} Pos;

/* Valid until 256 more have been asked for. */
typedef struct arcl_motion {
    char *name;
    double t0;         /* when it was taken out of the queue, ms */
    volatile int code; /* how it ended: 0 as long as it has not, EVENT_DONE, EVENT_STOP, or the event of its error */
} Motion;
ARCL_LAYOUT(Motion, t0, 8);
ARCL_LAYOUT(Motion, code, 16);

typedef struct arcl_iod {
    char *name;
} IOD;

typedef struct arcl_semaphore {
    char *name;
} Semaphore;

typedef struct arcl_diff {
    Vector d, r; /* mm, degrees */
} Diff;

typedef struct arcl_force {
    Vector f, m; /* N, N m */
} Force;

typedef struct arcl_quat {
    double s, x, y, z;
} Quat;

typedef struct arcl_quatvect {
    Quat q;
    Vector v; /* mm */
} QuatVect;

typedef struct arcl_jacob {
    double n; /* joints */
    double m[6 * ARCL_COLUMNS_MAX]; /* row by row, n to a row: v and w = m * joint rates, in m and rad */
} Jacob;

/* One sample of a motion: degrees (mm on a sliding joint), per second, N m (N). */
typedef struct arcl_feedback {
    double t;     /* ms */
    double share; /* of the motion that is done, 0 to 1 */
    double n;     /* joints */
    double joints[ARCL_JOINTS_MAX], rates[ARCL_JOINTS_MAX], setpoint[ARCL_JOINTS_MAX], torque[ARCL_JOINTS_MAX];
} Feedback;
ARCL_LAYOUT(Feedback, joints, 24);

/* ----------------------------------------------------------------------------------------------------- numbers */

#define OK 0
#define ERROR (-1)
#define MOVE_STOP 1

enum {
    ARCL_ARGCV = 1,
    ARCL_ROBOT,
    ARCL_AMI,
    ARCL_AKI,
    ARCL_PERIOD,
    ARCL_STREAM,
    ARCL_START,
    ARCL_CLEAR,
    ARCL_BRIDGE,
    MOV_TRAJ = 101,
    MOV_TIME,
    MOV_TACC,
    MOV_VT,
    MOV_VR,
    MOV_JVEL,
    MOV_SHARE,
    MOV_CONFIG,
    MOV_SYNC,
    MOV_DONEPROC,
    MOV_NOTIFY,
    MOV_FEEDBACK,
    MOV_OFFSET,
    MOV_UPDATE,
    MOV_NAME
};
enum { TRAJ_JOINT = 1, TRAJ_CART };
enum { CONST = 1, VARB, HOLD, FNDEF };
enum { IOD_IN = 1, IOD_OUT };
enum { GRIP_OPEN = 1, GRIP_CLOSE, GRIP_CLOSE_BY, GRIP_OPEN_BY, GRIP_RELAX };
enum {
    EVENT_DEQ = 1,
    EVENT_BEGIN,
    EVENT_NEAR,
    EVENT_DONE,
    EVENT_STOP,
    EVENT_LIMIT,
    EVENT_REACH,
    EVENT_SINGULAR,
    EVENT_FAST,
    EVENT_FAULT,
    EVENT_ERROR
};

extern Vector *const arcl_xunit, *const arcl_yunit, *const arcl_zunit;
#define xunit arcl_xunit
#define yunit arcl_yunit
#define zunit arcl_zunit
#define EQ ((Trans *) 1)
#define TL ((Trans *) 2)
#define T6 ((Trans *) 3)

/* -------------------------------------------------------------------------------------- values of open argument lists
 *
 * Each argument goes along with its type, so that 2000 and 2000.0 mean the same, a list that lacks its final 0 ends
 * nevertheless, and what is of a wrong type is told and not obeyed. */

typedef struct arcl_value {
    int kind;
    double number;
    const void *pointer;
} arcl_value;
ARCL_LAYOUT(arcl_value, pointer, 16);

arcl_value arcl_integer(long long number);
arcl_value arcl_real(double number);
arcl_value arcl_text(const char *text);
arcl_value arcl_words(char **words);
arcl_value arcl_nothing(const void *pointer);
arcl_value arcl_trans_value(const Trans *t);
arcl_value arcl_object(const void *p);
arcl_value arcl_vector_value(const Vector *v);
arcl_value arcl_answering(int (*function)(ARCL_ANY));
arcl_value arcl_silent(void (*function)(ARCL_ANY));
arcl_value arcl_itself(arcl_value value);
arcl_value arcl_strange(ARCL_ANY);
arcl_value arcl_joints_value(int count, const double *numbers);

ROBOT *arcl_list_open(int count, const arcl_value *values);
Motion *arcl_list_move(int count, const arcl_value *values);
void arcl_list_stop(int count, const arcl_value *values);
void arcl_list_gripper(int count, const arcl_value *values);
Trans *arcl_list_new_trans(int count, const arcl_value *values);
Pos *arcl_list_makeposition(int count, const arcl_value *values);
Pos *arcl_list_joint_pos(int count, const arcl_value *values);
Pos *arcl_list_robot_pos(int count, const arcl_value *values);
void arcl_list_wait(int count, const arcl_value *values);
double arcl_list_treal(int count, const arcl_value *values);

/* ---------------------------------------------------------------------------------------------- calls of fixed form */

Trans *new_trans_tr(const char *name, double px, double py, double pz);
Trans *new_trans_rotvec(const char *name, double px, double py, double pz, const Vector *axis, double deg);
Trans *new_trans_rpy(const char *name, double px, double py, double pz, double roll, double pitch, double yaw);
Trans *new_trans_eul(const char *name, double px, double py, double pz, double phi, double theta, double psi);
Trans *new_trans_quatvect(const char *name, const QuatVect *pose);
Trans *new_trans_diff(const char *name, const Diff *diff);
Trans *trans_assign(Trans *t, const Trans *other);
Trans *trans_mult(Trans *t, const Trans *left, const Trans *right);
Trans *trans_invert(Trans *t, const Trans *other);
int trans_rpy(const Trans *t, double *rpy); /* roll, pitch, yaw in rpy[0] to rpy[2] */

Vector *new_vector(double x, double y, double z);
double vect_dot(const Vector *a, const Vector *b);
Vector *vect_cross(const Vector *a, const Vector *b);
Vector *vect_unit(const Vector *a);
Quat *new_quat(double s, double x, double y, double z);
Quat *new_quat_rotvec(const Vector *axis, double deg);
Quat *quat_mult(const Quat *left, const Quat *right);
Quat *quat_invert(const Quat *q);
Quat *quat_interp(const Quat *begin, const Quat *end, double share);
QuatVect *new_quatvect(const Quat *q, const Vector *v);
QuatVect *quatvect_of(const Trans *t);
Diff *new_diff(double dx, double dy, double dz, double rx, double ry, double rz);
Diff *diff_of(const Trans *t);
Diff *diff_in(const Trans *t, const Diff *diff);
Force *new_force(double fx, double fy, double fz, double mx, double my, double mz);
Force *force_from(const Trans *t, const Force *force);
Jacob *new_jacob(ROBOT *rp, const Pos *joints); /* of at most 10 joints, at a position of joint_pos or robot_pos */

void arcl_free(void *object); /* any but robots and motions; motions under way go on */

void arcl_close(ROBOT *rp);
void arcl_skip(ROBOT *rp);
void arcl_override(ROBOT *rp, double percent); /* of the programmed speed, above 0 to 100 */
void arcl_keep_path(ROBOT *rp, int keep, double way_back_mm, double way_back_deg); /* motions outlive a stop: 1, 300, 45 */
void arcl_retract(ROBOT *rp, double mm); /* go back so far after a collision, by the way travelled: 0 to 300 */
char *arcl_kept(ROBOT *rp); /* why the arm stands off its path, "" on it; good until the next call */
void arcl_pause(ROBOT *rp);       /* motions stand still on their path, or on the way back to it */
void arcl_resume(ROBOT *rp);      /* they go on, and an arm off its path may be led back */
void arcl_setload(ROBOT *rp, double kg, const Vector *centre, const double *inertia); /* mm and kg m2 (xx yy zz xy xz yz), or null pointers */
void arcl_collision(ROBOT *rp, const char *reaction, int joints, const double *thresholds); /* "stop" or "comply"; N m of each joint, or 0 and a null pointer */
int arcl_errproc(int (*function)(Event, ROBOT *, const char *)); /* a null pointer: ARCL decides again */
Trans *where(ROBOT *rp);

/* `teach`: a person moves the arm; the function gets T6 at each ENTER, good until it returns, and ends it by MOVE_STOP.
 * Gives how often that was. */
int arcl_teach(ROBOT *rp, int (*function)(Trans *, ROBOT *));

IOD *new_iod(ROBOT *rp, int direction, int first, int count);
IOD *named_iod(ROBOT *rp, const char *name); /* lines or an analogue channel, by its name in the deployment file */
long iod_read(IOD *iod);
double iod_value(IOD *iod); /* in the unit of the deployment file; NaN: there is none now */
int iod_write(IOD *iod, long value);
int iod_set_value(IOD *iod, double value); /* of an analogue output, in the unit of the deployment file */

Semaphore *new_sem(const char *name);
int sem_take(Semaphore *semaphore);
int sem_give(Semaphore *semaphore);
int sem_clear(Semaphore *semaphore);
int sem_pend(Semaphore *semaphore);

Trans *sym_enter(Trans *t);
Trans *sym_lookup(const char *name); /* a null pointer: there is none */
int sym_delete(const char *name);    /* 1, or 0 when there was none */
int sym_dump(const char *path);      /* how many */
int sym_load(const char *path);

#ifdef __cplusplus
}

/* ------------------------------------------------------------------------------------- calls with open lists, in C++ */

namespace arcl_lists {
inline arcl_value value(int x) { return arcl_integer(x); }
inline arcl_value value(long x) { return arcl_integer(x); }
inline arcl_value value(long long x) { return arcl_integer(x); }
inline arcl_value value(unsigned x) { return arcl_integer(x); }
inline arcl_value value(unsigned long x) { return arcl_integer((long long) x); }
inline arcl_value value(unsigned long long x) { return arcl_integer((long long) x); }
inline arcl_value value(double x) { return arcl_real(x); }
inline arcl_value value(const char *x) { return arcl_text(x); }
inline arcl_value value(char **x) { return arcl_words(x); }
inline arcl_value value(decltype(nullptr)) { return arcl_nothing(nullptr); }
inline arcl_value value(const Trans *x) { return arcl_trans_value(x); }
inline arcl_value value(const Pos *x) { return arcl_object(x); }
inline arcl_value value(const ROBOT *x) { return arcl_object(x); }
inline arcl_value value(const arcl_value &x) { return x; }
template <class... A> arcl_value value(int (*x)(A...)) { return arcl_answering((int (*)(ARCL_ANY)) x); }
template <class... A> arcl_value value(void (*x)(A...)) { return arcl_silent((void (*)(ARCL_ANY)) x); }

/* The numbers of arcl_joints, which a list has to itself: an arcl_value would lead to an array that is gone. */
template <int n> struct joints {
    double numbers[n ? n : 1];
};
template <int n> arcl_value value(const joints<n> &x) { return arcl_joints_value(n, x.numbers); }

template <class R, class... A> R call(R (*list)(int, const arcl_value *), A... given)
{
    const arcl_value values[] = {value(given)..., arcl_integer(0)}; /* never empty */
    return list((int) sizeof...(given), values);
}
}

template <class... A> ROBOT *arcl_open(A... a) { return arcl_lists::call(arcl_list_open, a...); }
template <class... A> Motion *move(ROBOT *rp, A... a) { return arcl_lists::call(arcl_list_move, rp, a...); }
template <class... A> void stop(ROBOT *rp, A... a) { arcl_lists::call(arcl_list_stop, rp, a...); }
template <class... A> void gripper(ROBOT *rp, A... a) { arcl_lists::call(arcl_list_gripper, rp, a...); }
template <class... A> Trans *new_trans(const char *name, A... a)
{
    return arcl_lists::call(arcl_list_new_trans, name, a...);
}
template <class... A> Pos *makeposition(A... a) { return arcl_lists::call(arcl_list_makeposition, a...); }
template <class... A> Pos *joint_pos(ROBOT *rp, A... a) { return arcl_lists::call(arcl_list_joint_pos, rp, a...); }
template <class... A> Pos *robot_pos(ROBOT *rp, A... a) { return arcl_lists::call(arcl_list_robot_pos, rp, a...); }
template <class... A> void arcl_wait(ROBOT *rp, A... a) { arcl_lists::call(arcl_list_wait, rp, a...); }
template <class... A> double ami_treal(A... a) { return arcl_lists::call(arcl_list_treal, a...); }
inline int teach(ROBOT *rp, int (*function)(Trans *, ROBOT *)) { return arcl_teach(rp, function); }
template <class... A> arcl_lists::joints<(int) sizeof...(A)> arcl_joints(A... a) { return {{(double) a...}}; }

#else

/* --------------------------------------------------------------------------------------- calls with open lists, in C */

#define arcl_open(...) arcl_list_open(ARCL_LIST(__VA_ARGS__))
#define move(...) arcl_list_move(ARCL_LIST(__VA_ARGS__))
#define stop(...) arcl_list_stop(ARCL_LIST(__VA_ARGS__))
#define gripper(...) arcl_list_gripper(ARCL_LIST(__VA_ARGS__))
#define new_trans(...) arcl_list_new_trans(ARCL_LIST(__VA_ARGS__))
#define makeposition(...) arcl_list_makeposition(ARCL_LIST(__VA_ARGS__))
#define joint_pos(...) arcl_list_joint_pos(ARCL_LIST(__VA_ARGS__))
#define robot_pos(...) arcl_list_robot_pos(ARCL_LIST(__VA_ARGS__))
#define arcl_wait(...) arcl_list_wait(ARCL_LIST(__VA_ARGS__))
#define ami_treal(...) arcl_list_treal(ARCL_LIST(__VA_ARGS__))
#define teach(...) arcl_teach(__VA_ARGS__)
#define arcl_joints(...)                                                                                            \
    arcl_joints_value((int) (sizeof((double[]) {__VA_ARGS__}) / sizeof(double)), ((double[]) {__VA_ARGS__}))

/* How many values there are, and they themselves. A last 0 is added, so that no list is empty; it does not count. */
#define ARCL_LIST(...)                                                                                              \
    (int) (sizeof((arcl_value[]) {ARCL_EACH(__VA_ARGS__) {0, 0, 0}}) / sizeof(arcl_value)) - 1,                 \
        ((arcl_value[]) {ARCL_EACH(__VA_ARGS__) {0, 0, 0}})

/* clang-format off */
#define ARCL_VALUE(x) _Generic((x), \
    char: arcl_integer, signed char: arcl_integer, unsigned char: arcl_integer, short: arcl_integer, \
    unsigned short: arcl_integer, int: arcl_integer, unsigned: arcl_integer, long: arcl_integer, \
    unsigned long: arcl_integer, long long: arcl_integer, unsigned long long: arcl_integer, \
    float: arcl_real, double: arcl_real, \
    char *: arcl_text, const char *: arcl_text, char **: arcl_words, void *: arcl_nothing, \
    Trans *: arcl_trans_value, const Trans *: arcl_trans_value, Pos *: arcl_object, const Pos *: arcl_object, \
    ROBOT *: arcl_object, int (*)(): arcl_answering, void (*)(): arcl_silent, arcl_value: arcl_itself, \
    default: arcl_strange)(x)

/* ARCL_VALUE of each argument, a comma behind each: the macros expand one another up to 64 times. */
#define ARCL_EACH(...) __VA_OPT__(ARCL_E1(ARCL_STEP(__VA_ARGS__)))
#define ARCL_STEP(x, ...) ARCL_VALUE(x), __VA_OPT__(ARCL_AGAIN ARCL_NOW () (__VA_ARGS__))
#define ARCL_NOW
#define ARCL_AGAIN() ARCL_STEP
#define ARCL_E1(...) ARCL_E2(ARCL_E2(ARCL_E2(ARCL_E2(__VA_ARGS__))))
#define ARCL_E2(...) ARCL_E3(ARCL_E3(ARCL_E3(ARCL_E3(__VA_ARGS__))))
#define ARCL_E3(...) ARCL_E4(ARCL_E4(ARCL_E4(ARCL_E4(__VA_ARGS__))))
#define ARCL_E4(...) __VA_ARGS__
/* clang-format on */

#endif
#endif
