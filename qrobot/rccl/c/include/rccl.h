/* rccl.h - RCCL 1.0 for programs in C (Hayward & Paul 1986).
 *
 * Millimetres, degrees, milliseconds, newtons, newton metres. The table of all names and where they come from is
 * docs/reference/c-surface.md; the release for several manipulators has an rccl.h of its own. Compile with `qrobot cc`.
 */
#ifndef RCCL_H
#define RCCL_H

#include "rccl_world.h"

extern TRSF_PTR t6; /* where the last link was measured at the newest sample */

/* -------------------------------------------------------------------------------------------------- positions */

#define makeposition(...) \
    RCCL_CALL(rccl_makeposition, makeposition, __VA_ARGS__)(__VA_OPT__(__VA_ARGS__, (TRSF_PTR) 0))

extern POS_PTR park;

POS_PTR makeposition();
POS_PTR rccl_makeposition(char *name, ...);
#define jposition(...) RCCL_CALL(RCCL_JPOSITION, jposition, __VA_ARGS__)(__VA_ARGS__) /* degrees, mm on a sliding joint */
#define RCCL_JPOSITION(name, ...) rccl_jposition(name, RCCL_VALUES(__VA_ARGS__))
POS_PTR jposition();
POS_PTR rccl_jposition(char *name, int count, double *degs);

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
int rccl_analog(int output, double volts); /* ours: an analogue output of the deployment file, from 1; binary ones: chg.outputs */

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

/* --------------------------------------------------------------------------------------------------- teaching */

int teach(TRSF_PTR trans, POS_PTR pos);
int stepmode(void);

/* ---------------------------------------------------------------------------------------------- the real-time layer */

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
RCCL_LAYOUT(struct rccl_how, time, 32);
RCCL_LAYOUT(struct rccl_how, force, 1064);

/* What the next command says. Hand and outputs are the program's at any time; the joints are those of the motions, anew at
 * each sample, unless a function given to control changes them then. */
struct rccl_chg {
    int hand;    /* 0 relaxed, 1 open, 2 closed */
    int outputs; /* bits, output 1 is bit 0: those that are to be on */
    int modes[RCCL_JOINTS]; /* 0 hold, 1 position, 2 torque */
    double setpoints[RCCL_JOINTS];
};
RCCL_LAYOUT(struct rccl_chg, setpoints, 136);

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
