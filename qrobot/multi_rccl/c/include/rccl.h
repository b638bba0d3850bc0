/* rccl.h - Multi-RCCL for programs in C: several manipulators, each with a trajectory generator of its own (Lloyd, Parker
 * & McClain 1987, section 3). Every call about motions has its manipulator as its first argument.
 *
 * Millimetres, degrees, milliseconds, newtons, newton metres. The table of all names and where they come from is
 * docs/reference/c-surface.md. `qrobot cc` takes this header for programs that open manipulators, and else that of RCCL
 * 1.0, which has the same name.
 */
#ifndef RCCL_H
#define RCCL_H

#include "rccl_world.h"

/* ----------------------------------------------------------------------------------------------- manipulators */

/* An arm, or the frame of an object, which has no joints. What it reports is as of the newest sample. */
typedef struct manip {
    char *name;
    volatile int n;           /* joints, 0 of an object's frame */
    volatile int mode;        /* of the servo: 0 off, 4 holding, 5 tracking, 7 fault; all in docs/reference/wire-protocol.md */
    volatile int flags;       /* 1 powered, 2 calibrated, 4 emergency stop not pressed, 16 at rest */
    volatile int inputs;      /* bits, input 1 is bit 0 */
    volatile int outputs;     /* bits: those that are to be on; the program's to change */
    volatile event completed; /* it has nothing to do */
    volatile int nbrequest;   /* motions that wait in its queue */
    volatile int nextmove;    /* not 0: ends its present motion, whose position gets it as its code */
    TRSF trans;               /* where it is, as it is sent: T6 of an arm, an object's frame; &m->trans stands in equations */
    real j6[RCCL_JOINTS];     /* joint positions as they are sent, degrees (mm on a sliding joint) */
    double force[6];          /* wrist sensor, N and N m, in its frame; NaN where it is not known */
} MANIP, *MANIP_PTR;
RCCL_LAYOUT(MANIP, trans, 40);
RCCL_LAYOUT(MANIP, j6, 112);
RCCL_LAYOUT(MANIP, force, 240);

/* The calls have the names of RCCL 1.0, but are other functions. Where a call may be left without some of its arguments it
 * is a macro, and may be declared as a function all the same: `int stop();`. */

/* A manipulator: "OBJECT_FRAME", or what begins so, is an object's. Of an arm the robot's file and its bridge ("host:port")
 * may follow: rccl_open("left", "puma560", "127.0.0.1:5600"). */
#define rccl_open(...) RCCL_CALL(RCCL_OPEN, rccl_manip_open, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_OPEN(...) rccl_manip_open((char *[4]) {__VA_ARGS__})
MANIP_PTR rccl_manip_open();

/* Turn its trajectory generator on; a sample period of all manipulators may follow, ms. */
#define rccl_control(...) RCCL_CALL(RCCL_CONTROL, rccl_manip_control, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_CONTROL(m, ...) rccl_manip_control(m, (double[2]) {__VA_ARGS__})
int rccl_manip_control();

#define rccl_release rccl_manip_release
int rccl_release(MANIP_PTR m);

/* -------------------------------------------------------------------------------------------------- positions */

#define TRANS ((TRSF_PTR) 3) /* the unknown: the transform of whichever manipulator is moved */

/* makePosition(TRANS, tool, EQ, coord, p, TL, tool): no name. The unknown of makePositionFor is its first argument, such as
 * &left->trans: a position for that manipulator alone. */
#define makePosition(...) RCCL_CALL(RCCL_MAKE_POSITION, makePosition, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_MAKE_POSITION(...) rccl_make_position((TRSF_PTR) 0, __VA_ARGS__, (TRSF_PTR) 0)
#define makePositionFor(...) RCCL_CALL(RCCL_MAKE_POSITION_FOR, makePositionFor, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_MAKE_POSITION_FOR(unknown, ...) rccl_make_position(unknown, __VA_ARGS__, (TRSF_PTR) 0)
#define jposition(...) RCCL_CALL(RCCL_JPOSITION, rccl_manip_jposition, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_JPOSITION(m, name, ...) rccl_manip_jposition(m, name, RCCL_VALUES(__VA_ARGS__))
POS_PTR makePosition();
POS_PTR makePositionFor();
POS_PTR rccl_make_position(TRSF_PTR unknown, ...);
POS_PTR rccl_manip_jposition(); /* of an arm: degrees, mm on a sliding joint */
POS_PTR rccl_pose(MANIP_PTR m, char *name); /* ours: "park", or another pose of the robot's file */

/* ---------------------------------------------------------------------------------------------------- motions */

#define move rccl_manip_move
int move(MANIP_PTR m, POS_PTR p);

/* Come to rest: stop(m, p, ms) at p, for at least so long; both may be left out. Queued as a motion is. */
#define stop(...) RCCL_CALL(RCCL_STOP, rccl_manip_stop, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_STOP(m, ...) \
    rccl_manip_stop(m, RCCL_FIRST(__VA_OPT__(__VA_ARGS__, )(POS_PTR) 0, ~), RCCL_THIRD(~ __VA_OPT__(, __VA_ARGS__), 0., 0., ~))
#define RCCL_THIRD(first, second, third, ...) third
int rccl_manip_stop(MANIP_PTR m, POS_PTR p, double ms);

int maintain(MANIP_PTR m, POS_PTR p); /* be there at once, and stay with it */
int trackingMode(MANIP_PTR m);        /* stay with the goal of the next motion when that goal moves */
int rccl_cancel(MANIP_PTR m, double ms); /* ours: forget all motions and come to rest, as stop(ms) of one arm */

#define setvel rccl_manip_setvel
#define setval setvel
#define setconf rccl_manip_setconf
#define setime rccl_manip_setime
#define evalfn rccl_manip_evalfn
#define lock rccl_manip_lock
int setvel(MANIP_PTR m, double tv, double rv);
int setconf(MANIP_PTR m, char *letters);
int setime(MANIP_PTR m, double ta, double ts);
int evalfn(MANIP_PTR m, int (*fn)());
int lock(MANIP_PTR m, char *dirs);

#define setmode(...) RCCL_CALL(RCCL_SETMODE, rccl_manip_setmode, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_SETMODE(m, ...) rccl_manip_setmode(m, (long) (__VA_ARGS__))
#define setmod setmode
int rccl_manip_setmode(); /* 'j', 'c', "joint", "cartesian" */

#define distance(...) RCCL_CALL(RCCL_DISTANCE, rccl_manip_distance, __VA_ARGS__)(__VA_ARGS__)
#define limit(...) RCCL_CALL(RCCL_LIMIT, rccl_manip_limit, __VA_ARGS__)(__VA_ARGS__)
#define comply(...) RCCL_CALL(RCCL_COMPLY, rccl_manip_comply, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_DISTANCE(m, spec, ...) rccl_manip_distance(m, spec, RCCL_VALUES(__VA_ARGS__))
#define RCCL_LIMIT(m, spec, ...) rccl_manip_limit(m, spec, RCCL_VALUES(__VA_ARGS__))
#define RCCL_COMPLY(m, dirs, ...) rccl_manip_comply(m, dirs, RCCL_VALUES(__VA_ARGS__))
int rccl_manip_distance();
int rccl_manip_limit();
int rccl_manip_comply();

/* When the next motion of an arm ends, trans gets the value that makes the equation of p true there. */
#define update rccl_manip_update
int update(MANIP_PTR m, TRSF_PTR trans, POS_PTR p);

/* A person moves an arm in the terminal and records trans; NO if it was not. */
#define teach rccl_manip_teach
int teach(MANIP_PTR m, TRSF_PTR trans, POS_PTR p);

/* The hand of an arm, now. */
#define GRASP(m) rccl_manip_hand(m, YES)
#define OPEN(m) rccl_manip_hand(m, NO)
int rccl_manip_hand(MANIP_PTR m, int closed);

/* ---------------------------------------------------------- speed, collisions, load, and going on after a stop */

/* Ours: as in RCCL 1.0, of one arm. */
#define rccl_override rccl_manip_override
#define rccl_pause rccl_manip_pause
#define rccl_collision rccl_manip_collision
#define rccl_setload rccl_manip_setload
#define rccl_retract rccl_manip_retract
int rccl_override(MANIP_PTR m, double percent);
int rccl_pause(MANIP_PTR m);
int rccl_collision(MANIP_PTR m, char *reaction, double mm, double *thresholds);
int rccl_setload(MANIP_PTR m, double kg, double *centre, double *inertia);
int rccl_retract(MANIP_PTR m, double mm);
#define rccl_keep_path rccl_manip_keep_path
#define rccl_resume rccl_manip_resume
#define rccl_kept rccl_manip_kept
int rccl_keep_path(MANIP_PTR m, int keep, double way_back_mm, double way_back_deg);
int rccl_resume(MANIP_PTR m);
char *rccl_kept(MANIP_PTR m);

/* --------------------------------------------------------------------------------------------- synchronization */

/* Whole statements, as the papers write them: a semicolon behind them does no harm. */
#define wait_for(event) rccl_manip_waitfor(&(event));
#define waitfor(event) rccl_manip_waitfor(&(event));
#define waitas(predicate) while (!(predicate)) rccl_manip_sample();
void rccl_manip_waitfor(volatile event *e);
void rccl_manip_sample(void);

extern volatile int terminate; /* not 0: all arms come to rest and the program ends, with status 1 */
extern char *mess;             /* printed at the end */

#endif
