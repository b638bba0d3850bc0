/* channel.h - between the calls of rccl.h and arcl.h and the engine, which is another process (qrobot/c_transport/engine.py).
 *
 * What both see lies in shared memory. A call is a message to the engine and its answer; functions of the program are
 * called by messages the other way, on a channel and a thread of their own.
 */
#ifndef CHANNEL_H
#define CHANNEL_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#define SHIM_VERSION 7
#define SHIM_REFS 24
#define SHIM_NUMBERS 64
#define SHIM_TEXT 256
#define SHIM_NAME 64 /* of a transform or a position; what is longer is cut */
#define SHIM_ROOM 512 /* of the largest object */
#define SHIM_MANIP (SHIM_REFS - 1) /* reference to the manipulator of a call */

/* arcl_call.c, in programs that call ARCL: calls the function that the engine names in shared memory; and where. */
void arcl_obey(void) __attribute__((weak));
int64_t arcl_cell_place(void) __attribute__((weak));

/* manip.c, in programs of Multi-RCCL. */
int rccl_has_manipulators(void) __attribute__((weak));

/* start.c of rci.h, in programs that have tasks of RCI: 1 when those run on virtual time. */
int rci_is_virtual(void) __attribute__((weak));

/* program.c of rci.h: lets the arms of all tasks begin to come to rest, in a handler of a signal too. */
void rci_begin_stop(void) __attribute__((weak));

/* program.c of rci.h: has tasks closed at exit, behind what is registered later. */
void rci_close_at_exit(void) __attribute__((weak));

/* Weak: a program may have a function of that name itself. */
#define API __attribute__((weak))
/* Variables that the engine sees too. They fill whole pages of memory, so that none of the program's own lies on one. */
#if defined __x86_64__ || defined __i386__
#define SHIM_PAGE 4096
#else
#define SHIM_PAGE 65536 /* the largest of any processor */
#endif
#define SHARED __attribute__((section("rccl_shared"), aligned(SHIM_PAGE), used))
#define WHOLE_PAGES(type) \
    union { \
        type of; \
        char room[(sizeof(type) + SHIM_PAGE - 1) / SHIM_PAGE * SHIM_PAGE]; \
    }

/* What a message says; mirrored in qrobot/c_transport/message.py. */
enum op {
    OP_HELLO = 1,
    OP_CONTROL,
    OP_RELEASE,
    OP_NEWTRANS,
    OP_FREETRANS,
    OP_MAKEPOSITION,
    OP_JPOSITION,
    OP_FREEPOS,
    OP_MAKE,
    OP_TRMULT,
    OP_INVERT,
    OP_MOVE,
    OP_STOP,
    OP_SETVEL,
    OP_SETMODE,
    OP_SETCONF,
    OP_SAMPLE_PERIOD,
    OP_SETIME,
    OP_EVALFN,
    OP_DISTANCE,
    OP_LIMIT,
    OP_COMPLY,
    OP_LOCK,
    OP_UPDATE,
    OP_HAND,
    OP_NEXT_SAMPLE,
    OP_TEACH,
    OP_STEPMODE,
    OP_MAKEDB,
    OP_GETR,
    OP_SAVER,
    OP_DUMPDB,
    OP_ADCOPEN,
    OP_ENCTOANG,
    OP_ANGTOENC,
    OP_OVERRIDE,
    OP_PAUSE,
    OP_RESUME,
    OP_KEEP_PATH,
    OP_KEPT,
    OP_RETRACT,
    OP_COLLISION,
    OP_SETLOAD,
    OP_ANALOG,
    /* of ARCL */
    OP_ARCL_CALL = 50,
    OP_ARCL_WORD,
    /* of Multi-RCCL, whose other calls name their manipulator in the last of the references */
    OP_MANIP_OPEN = 60,
    OP_MAKE_POSITION,
    OP_MAINTAIN,
    OP_TRACKING_MODE,
    OP_CANCEL,
    OP_POSE,
    /* from the engine */
    OP_REPLY = 100,
    OP_ERROR,
    OP_SAY,
    OP_ASK,
    OP_CALL_TRANSFORM,
    OP_CALL_FUNCTION,
    OP_SIGNAL,
    OP_CALL_ARCL,
    OP_AGAIN,
};

/* One message, whole on a SOCK_SEQPACKET; each op knows which fields it uses. */
struct message {
    int32_t op;
    int32_t n;
    int64_t refs[SHIM_REFS]; /* places in the shared memory, or functions of the program */
    double numbers[SHIM_NUMBERS];
    char text[SHIM_TEXT];
};
_Static_assert(sizeof(struct message) == 968, "message.py says so");

/* Calls of functions and their answers are short: op, number of the call and one reference. */
#define SHIM_BRIEF (offsetof(struct message, refs) + sizeof(int64_t))

/* How the engine calls a function while the thread that serves it is awake: who looks here is not woken up by a message.
 * Each word has one writer. Calls are numbered; a call that is not done soon is repeated by a message with its number. */
struct shim_cell {
    int64_t called, op, ref, processor; /* by the engine, `called` last: the newest call, and where it was made */
    int64_t done, asking, looking; /* by the program: the newest call that is done, or asks the engine; it looks here */
    int64_t waiting; /* by the program: threads of it that wait for their turn to ask */
};

/* shared.c */
extern struct shim_cell shim_cell;
int shim_share(void); /* Share the memory; its file. */
void shim_unshare(void); /* In a child of the program: what it changes is its own. Async-signal-safe. */
int64_t shim_ref(const volatile void *p); /* Place of p in it, -1 when it lies elsewhere. */
void *shim_at(int64_t ref);
void *shim_new(const char *name, char **kept); /* SHIM_ROOM bytes, all zero; where its name is kept. */
int shim_used(const void *p); /* True for what shim_new gave and nobody has freed. */
void shim_free(void *p);
void shim_globals(int64_t *refs);

/* channel.c */
#define SHIM_IN_HANDLER \
    "a handler that interrupts a call must not call, nor jump out of it: let it set nextmove or terminate"
struct message shim_message(enum op op, const char *text);
struct message *shim_ask(struct message *m); /* Ask the engine; the answer, OP_REPLY or OP_ERROR, stands in m. */
int shim_serving(void); /* True in a function that the engine calls. */
int shim_calling(void); /* True in a handler of a signal that has interrupted a call, and in what it has jumped to. */
struct message *shim_call(struct message *m); /* Ask the engine; the answer stands in m. Ends the program on an error. */
int shim_call_last(struct message *m, int wait); /* Likewise, and no thread asks behind it. False when it would have to wait. */
void shim_open(int foreground);
void shim_serve(int channel); /* Obey the engine until it closes the channel. */
void shim_close(void); /* Nothing more will be asked. */
void shim_wait_closed(int timeout_ms);

/* event.c */
int shim_take(volatile int *event, int stays); /* Use up one signal, if there is one; of what `stays` none is used up. */

/* motion.c: what a hand holds: kg, mm, kg m2; NULL for a centre or an inertia of zeros. */
void shim_load(struct message *m, double kg, const double *centre, const double *inertia);

/* start.c */
void shim_start(void); /* Reach the engine; does nothing the second time. */
void shim_die(const char *text) __attribute__((noreturn)); /* Say why, and exit with status 1. */
int shim_parted(void); /* True in the thread that has let go of the arm, which can ask nothing any more. */
void shim_stay(void); /* Does not return when another thread ends the program, which takes this one along. */
void *shim_need(void *given, const char *call, const char *what); /* What was given; ends the program at NULL. */

/* terminal.c */
void shim_say(const char *who, const char *text); /* On stderr, unless there is no text. */
void shim_say_now(const char *text); /* On stderr; what would have to wait is kept. Async-signal-safe. */
void shim_say_mess(void); /* Likewise. */
void shim_say_rest(void); /* What was kept. */
void shim_forget_unsaid(void); /* In a child of the program. */
void shim_flush_output(void); /* That of the program, unless it would have to wait. */
int shim_read_line(char *line, size_t room); /* From stdin; false at its end. */

#endif
