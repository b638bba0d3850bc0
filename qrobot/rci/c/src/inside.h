/* Inside of the library behind rci.h.
 *
 * A processor is a thread; it runs its tasks one after another. One lock guards everything that more than one thread
 * sees. It is held for microseconds, inherits priorities, and is never held while a function of the program runs, a
 * handler of a signal included, nor while anything is written to stderr.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef RCI_INSIDE_H
#define RCI_INSIDE_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif

#include "qrobot_wire.h"
#include "rci.h"
#include <pthread.h>
#include <signal.h>

#define NS INT64_C(1000000000)
#define TEXT_BYTES 512
#define NAME_BYTES 64
#define FASTEST_HZ 1000
#define FALLBACK_HZ 100
#define ALLOWED_NS (NS / 2)        /* [A] for a function, as in Python */
#define NEVER INT64_MAX

enum phase { POWERING, STARTING, FOLLOWING, STOPPING, LEFT };

/* Where a task stands with its robot; the phases are those of qrobot/rci/robot_cycle.py. */
struct cycle {
    enum phase phase;
    double period_s, waited_s, asked_s, start_s, stopping_s;
    int power, power_off, stopped, has_state;
    int starts;                    /* streams begun */
    int event_before;              /* told before power was asked for */
    int powering;                  /* power was seen to come on, whoever had asked for it */
    int carried;                   /* the arm has held: an end of its power is told */
    long heard;                    /* states */
    int heeds_stops;               /* that somebody asks for: the arm was taken, and none was told of since */
    uint32_t stream;
    RCI_CHG said;                  /* in the command before */
    struct qrobot_state state;     /* the newest */
    struct qrobot_command command; /* its answer */
};

/* An arm by its name, and where its bridge is: "" for where QROBOT_BRIDGE says. */
struct arm {
    char name[NAME_BYTES + 1], address[NAME_BYTES + 1];
};

struct clock_entry {
    long interval, offset;
    int64_t next;                  /* tick, NEVER while it is not active */
};

struct rci_inside {
    char name[NAME_BYTES + 1], address[NAME_BYTES + 1], error[TEXT_BYTES];
    struct processor *processor;
    enum rci_state state;
    int priority, started_up, told, silent;
    RCI_FUNCTION control1, control2, startup, trigger;
    RCI_WAKEUP wakeup;
    int device, device_ready;
    struct clock_entry clock, trigger_clock;
    int64_t active_from, asked;    /* ticks: the first that counts, and when its wake-up function was asked */
    int64_t allowed_ns, longest_ns;
    long woken, served, runs, missed;
    struct qrobot_link *link;      /* 0 while it holds no robot */
    struct cycle cycle;
    int64_t heard_ns, next_ns;     /* when its robot was heard; on virtual time, when it will be */
    struct mailbox *mailbox;
};

/* One thread at one processor. When it does not come back it is given up, and another one takes the processor over. */
struct seat {
    struct processor *processor;
    pthread_t thread;
    int given_up, ended, real_time;
    RCI_TASK *running;
    int64_t began_ns;
    struct seat *next_lost;
};

struct processor {
    char name[NAME_BYTES + 1];
    int cpu;                       /* -1 where the system puts it */
    int over;
    int wake[2];                   /* a pipe: look again */
    struct seat *seat;
    struct processor *next;
};

struct program {
    pthread_mutex_t lock;
    int begun, sealed, virtual_time, watching, watch_over;
    long rate_hz;
    int64_t epoch_ns, now_ns, tick; /* the last two: virtual time, and its newest tick */
    RCI_TASK *tasks[RCI_TASKS], parent;
    struct rci_inside parent_inside;
    int n_tasks;
    struct processor *processors;
    pthread_t parent_thread, watch;
    struct area *areas;
    struct seat *lost_seats;       /* of threads that never came back */
    struct qrobot_link *greeting;  /* a link of which no task has heard yet */
};

extern struct program rci_program;
extern const RCI_ROBOT rci_robot_table[];
extern const int rci_robot_count;

/* program.c */
int rci_fail(const char *format, ...) __attribute__((format(printf, 1, 2)));
void rci_begin(void);
void rci_block_signals(sigset_t *before); /* all of them, in this thread */
void rci_signals_are_blocked(void); /* in a thread of ours, which has all signals blocked */
void rci_lock(void);
void rci_unlock(void);
void rci_make_lock(pthread_mutex_t *lock);
int rci_may_not_wait(void); /* in a thread of ours, or while this one has the lock */
int rci_is_task(const RCI_TASK *td, const char *call);
unsigned long rci_known(void); /* bits of all tasks */
int rci_are_tasks(unsigned long mask, const char *call);
const RCI_ROBOT *rci_find_robot(const char *name, char *address);
void rci_forget_robots(void);
extern __thread RCI_TASK *rci_current;

/* tell.c: any thread may say something, with the lock as well */
void rci_say(const char *format, ...) __attribute__((format(printf, 1, 2)));
void rci_say_the_unsaid(void);
void rci_tell_begin(void);
int rci_tell_start(void);
int rci_tell_all(void);
void rci_tell_end(void);

/* clock.c */
int64_t rci_now_ns(void);
int64_t rci_tick_at(int64_t now_ns);
int64_t rci_time_of(int64_t tick);
int64_t rci_entry_first(const struct clock_entry *entry, int64_t after);
long rci_entry_take(struct clock_entry *entry, int64_t tick);

/* runner.c: the lock is held, and let go while a function of the program runs, or on virtual time a robot is awaited */
void rci_end_task(RCI_TASK *td, const char *format, ...) __attribute__((format(printf, 2, 3)));
int rci_wake_tasks(struct processor *processor, int64_t tick);
int rci_run_tasks(struct seat *seat);
void rci_ask_functions(struct seat *seat);
int rci_call(struct seat *seat, RCI_TASK *td, RCI_FUNCTION function);
int rci_sample(struct seat *seat, RCI_TASK *td);
RCI_TASK *rci_task_of(const struct processor *processor, int *index);

/* cycle.c */
void rci_cycle_begin(struct cycle *cycle, double period_s);
void rci_cycle_stop(struct cycle *cycle, int power_off);
void rci_cycle_hear(RCI_TASK *td);
const char *rci_cycle_step(RCI_TASK *td, int64_t now_ns);
const char *rci_cycle_ask(RCI_TASK *td);
void rci_cycle_answer(RCI_TASK *td);

/* arms.c */
int rci_find_arm(const RCI_TASK *td, struct qrobot_link *link, struct arm *arm);

/* link.c */
int rci_link_open(RCI_TASK *td, int power_off, const char *call);
void rci_link_close(RCI_TASK *td, const char *reason);
int rci_link_hear(RCI_TASK *td);
void rci_links_leave(void);

/* processor.c */
struct processor *rci_processor(const char *name);
void rci_processor_wake(struct processor *processor);
void rci_round(struct seat *seat);
void rci_take_fifo(struct seat *seat, int above);
void *rci_run_processor(void *argument);
void rci_let_go(RCI_TASK *td);

/* seats.c, watch.c */
int rci_processor_start(struct processor *processor);
void rci_processors_end(void);
int rci_processors_forget(void);
void rci_processors_leave(void);
int rci_watch_start(void);
void rci_watch_end(void);
void rci_give_up(struct seat *seat);

/* start.c */
void rci_let_pass(void);
void rci_begin_release(RCI_TASK *td, int power_off);

/* rccl/c/shim/start.c, in programs that call RCCL or ARCL: 1 when an arm is to be moved by them. */
int shim_has_engine(void) __attribute__((weak));

/* program.c, for RCCL and ARCL */
void rci_close_at_exit(void);
void rci_begin_stop(void);

/* share.c */
struct mailbox *rci_parents_mailbox(void);
struct mailbox *rci_mailbox(void);
void rci_mailbox_free(struct mailbox *mailbox);
void rci_areas_free(void);

#endif
