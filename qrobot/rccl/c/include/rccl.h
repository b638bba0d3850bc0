/* rccl.h - RCCL 1.0 for programs in C (Hayward & Paul 1986).
 *
 * Millimetres, degrees, milliseconds, newtons, newton metres. The table of all names and where they come from is
 * docs/reference/c-surface.md; later releases of RCCL have other calls. Compile with `qrobot cc`.
 */
#ifndef RCCL_H
#define RCCL_H

#include <stdio.h> /* printr writes to a file */

#if !defined bool && !defined __cplusplus && !(defined __STDC_VERSION__ && __STDC_VERSION__ >= 202311L)
typedef int bool;
#endif
typedef float real;
typedef int event;

#define YES 1
#define NO 0

/* ------------------------------------------------------------------------------------------------- transforms */

typedef struct vector {
    real x, y, z;
} VECT, *VECT_PTR;

typedef struct transform {
    char *name;
    int (*fn)(); /* of a functional one: called at every sample */
    int kind;
    VECT n, o, a, p; /* three axes, and a position in mm */
} TRSF, *TRSF_PTR;

/* What is a macro here was a function, and may be declared as one: `TRSF_PTR newtrans();` declares, and does nothing else.
 * RCCL_CALL(f, g, ...) is f where there are arguments, and g where there are none. */
#define RCCL_FIRST(first, ...) first
#define RCCL_CALL(call, name, ...) RCCL_FIRST(__VA_OPT__(call, ) name, ~)

/* The kinds of newtrans: what is none of them is a function. What the gentr_ functions make is const. These three are for
 * functions of a program that take a kind themselves; const, hold and varb are known to newtrans alone, so that variables
 * may have such names. */
#define rccl_const ((int (*)()) 1)
#define rccl_varb ((int (*)()) 2)
#define rccl_hold ((int (*)()) 3)

/* `const` was an ordinary name when RCCL was written, and is a keyword now. So that it may stand where else a function
 * does, `(type) - 0` is written for it: with a function that is a difference, with const it casts 0 to a const int. */
#define newtrans(...) RCCL_CALL(RCCL_NEWTRANS, newtrans, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_NEWTRANS(name, type)                                                                     \
    __extension__({                                                                                   \
        char *rccl_name = (name);                                                                     \
        enum { varb = 2, hold = 3 };                                                                  \
        _Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Wimplicit-int\"")           \
        int (*rccl_kind)() = (int (*)()) (long) ((type) - 0);                                         \
        _Pragma("GCC diagnostic pop")                                                                 \
        rccl_newtrans(rccl_name, rccl_kind, #type);                                                   \
    })

extern VECT_PTR xunit, yunit, zunit;
extern TRSF_PTR t6; /* where the last link was measured at the newest sample */

TRSF_PTR newtrans();
TRSF_PTR rccl_newtrans(char *name, int (*kind)(), char *word);
TRSF_PTR gentr_trsl(char *name, double px, double py, double pz);
TRSF_PTR gentr_rot(char *name, double px, double py, double pz, VECT_PTR v, double a);
TRSF_PTR gentr_eul(char *name, double px, double py, double pz, double phi, double theta, double psi);
TRSF_PTR gentr_rpy(char *name, double px, double py, double pz, double roll, double pitch, double yaw);
TRSF_PTR gentr_pao(char *name, double px, double py, double pz, double ax, double ay, double az, double ox, double oy,
                   double oz);
int freetrans(TRSF_PTR t);

/* These change their first argument and return it. */
TRSF_PTR rot(TRSF_PTR t, VECT_PTR v, double angle);
TRSF_PTR trsl(TRSF_PTR t, double px, double py, double pz);
TRSF_PTR eul(TRSF_PTR t, double phi, double theta, double psi);
TRSF_PTR rpy(TRSF_PTR t, double roll, double pitch, double yaw);
TRSF_PTR assigntr(TRSF_PTR t, TRSF_PTR other);
TRSF_PTR trmult(TRSF_PTR t, TRSF_PTR left, TRSF_PTR right);
TRSF_PTR invert(TRSF_PTR t, TRSF_PTR other);
#define Rot (void) rot
#define Trsl (void) trsl
#define Eul (void) eul
#define Rpy (void) rpy
#define Assigntr (void) assigntr
#define Trmult (void) trmult
#define Invert (void) invert
int printr(TRSF_PTR t, FILE *file);

/* -------------------------------------------------------------------------------------------------- positions */

typedef struct position {
    char *name;
    volatile int code;   /* why the latest motion to it ended: -1 at its goal, or the number given to nextmove; 0 before */
    volatile float scal; /* 0 from `move` on, grows to 1 during the motion */
    volatile event end;  /* signalled at the end of each motion */
} POS, *POS_PTR;

#define EQ ((TRSF_PTR) 1)
#define TL ((TRSF_PTR) 2)
#define makeposition(...) \
    RCCL_CALL(rccl_makeposition, makeposition, __VA_ARGS__)(__VA_OPT__(__VA_ARGS__, (TRSF_PTR) 0))

extern POS_PTR park, there; /* there: always where the arm is, so that a move to it is an absolute stop */

POS_PTR makeposition();
POS_PTR rccl_makeposition(char *name, ...);
#define jposition(...) RCCL_CALL(RCCL_JPOSITION, jposition, __VA_ARGS__)(__VA_ARGS__) /* degrees, mm on a sliding joint */
#define RCCL_JPOSITION(name, ...) rccl_jposition(name, RCCL_VALUES(__VA_ARGS__))
POS_PTR jposition();
POS_PTR rccl_jposition(char *name, int count, double *degs);
int freepos(POS_PTR p);

/* ---------------------------------------------------------------------------------------------------- motions */

/* Functions without a type were int: `int move(), setvel();` may be declared. They return YES. */
int move(POS_PTR p);
int stop(double ms);

int setvel(double tv, double rv);
#define setval setvel
#define setmode(...) RCCL_CALL(rccl_setmode, setmode, __VA_ARGS__)(__VA_OPT__((long) (__VA_ARGS__)))
#define setmod setmode
int setconf(char *letters);
int sample(double ms);
int setmode(); /* 'j', 'c', "joint", "cartesian" */
int rccl_setmode(long mode);

int setime(double ta, double ts);
int evalfn(int (*fn)());
#define distance(...) RCCL_CALL(RCCL_DISTANCE, distance, __VA_ARGS__)(__VA_ARGS__)
#define limit(...) RCCL_CALL(RCCL_LIMIT, limit, __VA_ARGS__)(__VA_ARGS__)
#define comply(...) RCCL_CALL(RCCL_COMPLY, comply, __VA_ARGS__)(__VA_ARGS__)
int distance();
int limit();
int comply();
int lock(char *dirs);
int update(TRSF_PTR trans, POS_PTR equa);

/* How many numbers there are, and they themselves, integers among them made into floating point. */
#define RCCL_VALUES(...) ((int) (sizeof((double[]) {__VA_ARGS__}) / sizeof(double))), ((double[]) {__VA_ARGS__})
#define RCCL_DISTANCE(spec, ...) rccl_distance(spec, RCCL_VALUES(__VA_ARGS__))
#define RCCL_LIMIT(spec, ...) rccl_limit(spec, RCCL_VALUES(__VA_ARGS__))
#define RCCL_COMPLY(dirs, ...) rccl_comply(dirs, RCCL_VALUES(__VA_ARGS__))
int rccl_distance(char *spec, int count, double *values);
int rccl_limit(char *spec, int count, double *values);
int rccl_comply(char *dirs, int count, double *values);

#define OPEN rccl_open_hand();
#define CLOSE rccl_close_hand();
void rccl_open_hand(void);
void rccl_close_hand(void);

/* ------------------------------------------------------------------------------- speed, and going on after a stop */

/* Ours. rccl_ stands before their names, for programs may have functions that are called so. */
int rccl_override(double percent); /* of the programmed speed, 0 to 100, also of the motion under way */
int rccl_pause(void);              /* come to a standstill on the path; the queue stays */
int rccl_resume(void);             /* go on after that, and go back to a path that was kept */
int rccl_keep_path(int keep, double way_back_mm, double way_back_deg); /* motions outlive a stop of the servo: YES, 300., 45. */
int rccl_retract(double mm);       /* go back so far after a collision, by the way travelled: 0 to 300 */
int rccl_collision(char *reaction, double mm, double *thresholds); /* "stop", "comply", "retract"; N m of each joint, or NULL */
int rccl_setload(double kg, double *centre, double *inertia); /* what the hand holds: mm, kg m2 (xx yy zz xy xz yz), or NULL */
char *rccl_kept(void);             /* why the arm stands off its path, until somebody confirms; "" else */

/* --------------------------------------------------------------------------------------------- synchronization */

extern volatile int nextmove;    /* not 0: ends the present motion, whose position gets it as its code */
extern volatile event completed; /* the arm has nothing to do */
extern volatile int nbrequest;   /* motions that wait in the queue */

/* Whole statements, as the papers write them: a semicolon behind them does no harm. */
#define waitfor(event) rccl_waitfor(&(event));
#define waitas(predicate) while (!(predicate)) rccl_sample();
void rccl_waitfor(volatile event *e);
void rccl_sample(void);
int suspendfg(void);

/* ------------------------------------------------------------------------------------------ teaching, data base */

int teach(TRSF_PTR trans, POS_PTR pos);
int stepmode(void);
int makedb(char *file);
int getr(TRSF_PTR t);
int saver(TRSF_PTR t);
int dumpdb(void);

/* ---------------------------------------------------------------------------------------------- the real-time layer */

#define RCCL_JOINTS 32
#define ADC_NONE (-2147483647 - 1) /* of how.adcr: the sensor does not tell, or there is none */

/* The robot at the newest sample: rad, rad/s, N m (m, m/s, N on a sliding joint). */
struct rccl_how {
    int n;           /* joints */
    int mode;        /* of the servo: 0 off, 4 holding, 5 tracking, 7 fault; all in docs/reference/wire-protocol.md */
    int flags;       /* 1 powered, 2 calibrated, 4 emergency stop not pressed, 16 at rest */
    int inputs;      /* bits */
    int hand;        /* 0 relaxed, 1 open, 2 closed */
    int outputs;     /* bits, output 1 is bit 0: those that are on */
    int adcr;        /* the reading that adcopen chose, thousandths of N or N m; ADC_NONE where it is not known */
    double time;     /* ms since control */
    double q[RCCL_JOINTS], v[RCCL_JOINTS], tau[RCCL_JOINTS], q_setpoint[RCCL_JOINTS];
    double force[6]; /* wrist sensor, N and N m, in its frame; NaN where it is not known */
};

/* What the next command says. Hand and outputs are the program's at any time; the joints are those of the motions, anew at
 * each sample, unless a function given to control changes them then. */
struct rccl_chg {
    int hand;    /* 0 relaxed, 1 open, 2 closed */
    int outputs; /* bits, output 1 is bit 0: those that are to be on */
    int modes[RCCL_JOINTS]; /* 0 hold, 1 position, 2 torque */
    double setpoints[RCCL_JOINTS];
};

extern volatile struct rccl_how how;
extern volatile struct rccl_chg chg;
extern volatile int terminate; /* not 0: the arm comes to rest and the program ends, with status 1 */
extern char *mess;             /* printed at the end */

/* Both may be left out: fn1 and fn2 are called at every sample, and may change chg. */
#define control(...) \
    RCCL_CALL(rccl_control, control, __VA_ARGS__)(__VA_OPT__((int (*[3])()) {__VA_ARGS__}))
/* What is said at the end; may be left out. */
#define release(...) RCCL_CALL(rccl_release, release, __VA_ARGS__)(__VA_OPT__((char *[2]) {__VA_ARGS__}))
int control();
int release();
int rccl_control(int (**functions)());
int rccl_release(char **said);
int adcopen(int channel);
int enctoang(real *angles, int *counts); /* the first argument is the result */
int angtoenc(int *counts, real *angles);

#endif
