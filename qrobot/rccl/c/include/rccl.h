/* rccl.h - RCCL 1.0 for programs in C (Hayward & Paul 1986).
 *
 * Millimetres, degrees, milliseconds, newtons, newton metres. The table of all names and where they come from is
 * docs/reference/c-surface.md. Compile with `qrobot cc`.
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

/* The kinds of newtrans: what is none of them is a function. What the gentr_ functions make is const. */
#define rccl_const ((int (*)()) 1)
#define varb ((int (*)()) 2)
#define hold ((int (*)()) 3)

/* `const` was an ordinary name when RCCL was written, and is a keyword now: newtrans looks for it before C does. */
#define RCCL_KIND_const ~, rccl_const
#define RCCL_KIND_varb ~, varb
#define RCCL_KIND_hold ~, hold
#define RCCL_SECOND_OF(first, second, ...) second
#define RCCL_SECOND(...) RCCL_SECOND_OF(__VA_ARGS__)
#define newtrans(name, type) rccl_newtrans(name, RCCL_SECOND(RCCL_KIND_##type, type, ~))

extern VECT_PTR xunit, yunit, zunit;
extern TRSF_PTR t6; /* where the last link was measured at the newest sample */

TRSF_PTR rccl_newtrans(char *name, int (*kind)());
TRSF_PTR gentr_trsl(char *name, double px, double py, double pz);
TRSF_PTR gentr_rot(char *name, double px, double py, double pz, VECT_PTR v, double a);
TRSF_PTR gentr_eul(char *name, double px, double py, double pz, double phi, double theta, double psi);
TRSF_PTR gentr_rpy(char *name, double px, double py, double pz, double roll, double pitch, double yaw);
TRSF_PTR gentr_pao(char *name, double px, double py, double pz, double ax, double ay, double az, double ox, double oy,
                   double oz);
void freetrans(TRSF_PTR t);

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
void printr(TRSF_PTR t, FILE *file);

/* -------------------------------------------------------------------------------------------------- positions */

typedef struct position {
    char *name;
    volatile int code;   /* why the latest motion to it ended: -1 at its goal, or the number given to nextmove; 0 under way */
    volatile float scal; /* 0 to 1 during the motion */
    volatile event end;  /* signalled at the end of each motion */
} POS, *POS_PTR;

#define EQ ((TRSF_PTR) 1)
#define TL ((TRSF_PTR) 2)
#define makeposition(...) rccl_makeposition(__VA_ARGS__, (TRSF_PTR) 0)

extern POS_PTR park, there; /* there: always where the arm is, so that a move to it is an absolute stop */

POS_PTR rccl_makeposition(char *name, ...);
#define jposition(name, ...) rccl_jposition(name, RCCL_VALUES(__VA_ARGS__)) /* degrees, mm on a sliding joint */
POS_PTR rccl_jposition(char *name, int count, double *degs);
void freepos(POS_PTR p);

/* ---------------------------------------------------------------------------------------------------- motions */

void move(POS_PTR p);
void stop(double ms);

void setvel(double tv, double rv);
#define setval setvel
#define setmode(m) rccl_setmode((long) (m)) /* 'j', 'c', "joint", "cartesian" */
#define setmod setmode
void setconf(char *letters);
void sample(double ms);
void rccl_setmode(long mode);

void setime(double ta, double ts);
void evalfn(int (*fn)());
#define distance(spec, ...) rccl_distance(spec, RCCL_VALUES(__VA_ARGS__))
#define limit(spec, ...) rccl_limit(spec, RCCL_VALUES(__VA_ARGS__))
#define comply(dirs, ...) rccl_comply(dirs, RCCL_VALUES(__VA_ARGS__))
void lock(char *dirs);
void update(TRSF_PTR trans, POS_PTR equa);

/* How many numbers there are, and they themselves, integers among them made into floating point. */
#define RCCL_VALUES(...) ((int) (sizeof((double[]) {__VA_ARGS__}) / sizeof(double))), ((double[]) {__VA_ARGS__})
void rccl_distance(char *spec, int count, double *values);
void rccl_limit(char *spec, int count, double *values);
void rccl_comply(char *dirs, int count, double *values);

#define OPEN rccl_open_hand();
#define CLOSE rccl_close_hand();
void rccl_open_hand(void);
void rccl_close_hand(void);

/* --------------------------------------------------------------------------------------------- synchronization */

extern volatile int nextmove;    /* not 0: ends the present motion, whose position gets it as its code */
extern volatile event completed; /* the arm has nothing to do */
extern volatile int nbrequest;   /* motions that wait in the queue */

/* Whole statements, as the papers write them: a semicolon behind them does no harm. */
#define waitfor(event) rccl_waitfor(&(event));
#define waitas(predicate) while (!(predicate)) rccl_sample();
void rccl_waitfor(volatile event *e);
void rccl_sample(void);
void suspendfg(void);

/* ------------------------------------------------------------------------------------------ teaching, data base */

int teach(TRSF_PTR trans, POS_PTR pos);
void stepmode(void);
void makedb(char *file);
int getr(TRSF_PTR t);
void saver(TRSF_PTR t);
void dumpdb(void);

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
#define control(...) rccl_control((int (*[3])()) {__VA_ARGS__})
/* What is said at the end; may be left out. */
#define release(...) rccl_release((char *[2]) {__VA_ARGS__})
int rccl_control(int (**functions)());
void rccl_release(char **said);
void adcopen(int channel);
void enctoang(real *angles, int *counts); /* the first argument is the result */
void angtoenc(int *counts, real *angles);

#endif
