/* RCI, the Robot Control Interface, for programs in C (Lloyd, Parker and McClain 1987, section 4).
 *
 *     #include "rci.h"
 *
 *     void swing(RCI_TASK *td) { td->chg.setpoints[0] += 0.001; }      called once in each sample period
 *     int over() { return rci_runs(rci_descriptor("puma560")) >= 100; }
 *
 *     int main()
 *     {
 *         RCI_TASK *arm = rci_create("puma560", "");
 *
 *         if (arm == 0 || rci_control(arm, swing, 0, 0) || rci_start(arm->bit) || rci_wait(over))
 *             return 1;                               the call that failed has said why, on stderr
 *         return rci_close() != 0;
 *     }
 *
 * `qrobot cc program.c -o program` compiles and links it. Control tasks are threads of the program; what stands between
 * them and the bridge is the C of this library. How to use it: docs/how-to/write-an-rci-task-in-c.md; every call:
 * docs/reference/c-surface-rci.md. Units are SI: rad or m, N m or N, s.
 *
 * A handler of a signal in the planning program may ask (rci_state, rci_runs, rci_how, ...), send, receive, and exit();
 * it makes, starts, releases and waits for nothing: let it set a flag that the function of rci_wait() looks at.
 *
 * Calls that can fail return 0, or -1 (pointers: 0) after a line on stderr, which rci_error() keeps. No task waits for
 * stderr, which may be a terminal that is held. C89 and C++.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef RCI_H
#define RCI_H

#ifdef __cplusplus
extern "C" {
#endif

#define RCI_JOINTS 32          /* the most that a robot can have */
#define RCI_TASKS 30           /* of one program */
#define RCI_PARENT 1UL         /* bit of the planning program, in masks */
#define RCI_ALL 0x7FFFFFFFUL   /* the parent and all tasks */
#define RCI_LONGEST_MESSAGE 4064

enum rci_state {
    RCI_CREATED, RCI_ATTACHING, RCI_READY, RCI_ACTIVE, RCI_RELEASING, RCI_RELEASED, RCI_ENDED
};
enum rci_joint_mode { RCI_HOLD = 0, RCI_POSITION = 1, RCI_TORQUE = 2 };
enum rci_hand { RCI_RELAXED = 0, RCI_OPEN = 1, RCI_CLOSED = 2 };

/* What the robot does: read before the control function is called. The servo's modes and flags are those of the page
 * on the wire protocol. */
typedef struct {
    int n;                          /* joints */
    double time;                    /* s, of the robot's clock */
    double q[RCI_JOINTS];           /* measured */
    double v[RCI_JOINTS];
    double tau[RCI_JOINTS];         /* commanded by the servo */
    double q_setpoint[RCI_JOINTS];  /* where the servo wants the joints now: begin a motion here */
    double force[6];                /* on the wrist sensor, in its frame; NaN where it is not known */
    int mode, fault, event, event_joint;
    unsigned long flags;
    unsigned long inputs, outputs;
    int hand;
} RCI_HOW;

/* What it is to do: checked and sent when the control function has returned. */
typedef struct {
    int modes[RCI_JOINTS];          /* RCI_HOLD, RCI_POSITION, RCI_TORQUE */
    double setpoints[RCI_JOINTS];
    int hand;                       /* RCI_RELAXED, RCI_OPEN, RCI_CLOSED */
    unsigned long outputs;          /* output 1 in bit 0, 16 of them */
} RCI_CHG;

/* A robot at joint level. Arrays have n entries, matrices n rows of n. */
typedef struct {
    const char *name;
    const char *file;               /* by which rci_robot() asks for it */
    int n;
    const double *q_min, *q_max, *v_max, *a_max, *tau_max;
    const double *q_offset;         /* joint position at encoder zero */
    const double *rad_per_count;    /* signed joint units of motor displacement per count */
    const long *count_offset;       /* what the host adds to a counter */
    const long *counts_per_rev;
    const double *dac_per_Nm;       /* DAC counts per N m of motor torque in joint units */
    const double *coupling;         /* motor displacements = coupling (q - q_offset) */
    const double *uncoupling;       /* its inverse */
} RCI_ROBOT;

/* One control task. Its functions use `how` and `chg`; everybody else asks rci_how(). */
typedef struct rci_task {
    const char *name;
    unsigned long bit;              /* stands for the task in masks */
    const char *processor;
    const RCI_ROBOT *robot;         /* 0 for a task without one */
    RCI_HOW how;
    RCI_CHG chg;
    void *user;                     /* for the program */
    struct rci_inside *inside;      /* for the library */
} RCI_TASK;

typedef void (*RCI_FUNCTION)(RCI_TASK *);
typedef int (*RCI_WAKEUP)(void);

/* Creation and deletion */
int rci_robot(const char *name, const char *file, const char *bridge);
int rci_clock(long rate_hz);
RCI_TASK *rci_create(const char *name, const char *proc);
int rci_control(RCI_TASK *td, RCI_FUNCTION control1, RCI_FUNCTION control2, RCI_FUNCTION startup);
int rci_priority(RCI_TASK *td, int priority);
int rci_close(void);
const char *rci_error(void);

/* Scheduling. The device of rci_deviceInterrupt() is no file on a disk, which is always readable. When its far end is
 * closed, and everything was read, the task ends (rci_wait() tells); it may start again, with another device. */
int rci_onclock(RCI_TASK *td, long interval, long offset);
int rci_onfunction(RCI_TASK *td, RCI_WAKEUP wakeup);
int rci_deviceInterrupt(RCI_TASK *td, int descriptor);
int rci_trigger(RCI_TASK *td, long interval, long offset, RCI_FUNCTION trigger);
int rci_timeout(RCI_TASK *td, double seconds);
int rci_start(unsigned long mask);
int rci_release(unsigned long mask);
int rci_powerOff(unsigned long mask);
long rci_ticks(void);
int rci_wait(RCI_WAKEUP predicate);

/* What a task does: any thread may ask */
enum rci_state rci_state(RCI_TASK *td);
long rci_runs(RCI_TASK *td);
long rci_runCount(RCI_TASK *td);
long rci_missed(RCI_TASK *td);
double rci_longest(RCI_TASK *td);
const char *rci_taskError(RCI_TASK *td);
int rci_how(RCI_TASK *td, RCI_HOW *how);
int rci_realTime(RCI_TASK *td);

/* Shared memory and messages */
void *rci_sharedMemory(const char *label, unsigned long size, RCI_TASK *hostTd, unsigned long accessMask);
void *rci_getMemory(const char *label);
int rci_sharedData(unsigned long accessMask, void *addr, unsigned long size);
long rci_send(unsigned long sendcode, const void *buffer, long size);
long rci_receive(unsigned long getcode, void *buffer, long size, RCI_TASK **sender);
int rci_signal(int number);        /* to the planning program; what its handler may call is said above */

/* Support */
RCI_TASK *rci_descriptor(const char *name);
RCI_TASK *rci_self(void);
int rci_print(const char *format, ...);  /* a task does not wait until the line is written */
void *rci_malloc(unsigned long size);
void rci_free(void *memory);
int rci_testAndSet(long *word);
void rci_clear(long *word);

/* chg in one call, and conversions of the robot of a task */
void rci_goto(RCI_TASK *td, const double *q);
void rci_drive(RCI_TASK *td, const double *setpoints, const int *torque);
void rci_hold(RCI_TASK *td);
int rci_angtoenc(const RCI_ROBOT *robot, const double *q, long *counts);
int rci_enctoang(const RCI_ROBOT *robot, const long *counts, double *q);
int rci_tortodac(const RCI_ROBOT *robot, const double *tau, long *dac);
int rci_dactotor(const RCI_ROBOT *robot, const long *dac, double *tau);

#ifdef __cplusplus
}
#endif
#endif
