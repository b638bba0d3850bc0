/* channel.c - messages to the motion engine and from it. */
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "shim.h"

#define GONE "the motion engine has gone; the bridge brings the arm to rest"

#define AWAKE_NS 300000        /* the engine computes between the calls of one sample */
#define EARLY_NS 500000        /* most that we are awake before a sample, in case it is early */
#define EARLY_SHARE 32         /* and no more than this part of the period */
#define SAME_SHARE 4           /* what comes within this part of the period belongs to the same sample */
#define LONGEST_NS 110000000   /* between two samples; what takes longer is a pause */

static int foreground = -1;
static pthread_mutex_t calling = PTHREAD_MUTEX_INITIALIZER; /* a program may have threads of its own */
static __thread int served = -1; /* in functions that the engine calls: its channel */

void shim_open(int channel)
{
    foreground = channel;
}

struct message shim_message(enum op op, const char *text)
{
    struct message m;
    memset(&m, 0, sizeof m);
    m.op = op;
    if (text)
        strncpy(m.text, text, SHIM_TEXT - 1);
    return m;
}

/* False when nobody listens any more. */
static int say(int channel, const struct message *m, size_t size)
{
    while (send(channel, m, size, MSG_NOSIGNAL) < 0)
        if (errno != EINTR)
            return 0;
    return 1;
}

/* False at the end of the conversation. */
static int hear(int channel, struct message *m, int flags)
{
    ssize_t got;
    do
        got = recv(channel, m, sizeof *m, flags);
    while (got < 0 && errno == EINTR);
    return got >= (ssize_t) SHIM_BRIEF;
}

/* The engine asks the person at the terminal; the end of the input is an answer with n = 0. */
static void ask_person(struct message *m)
{
    printf("%s", m->text);
    fflush(stdout);
    m->n = fgets(m->text, SHIM_TEXT, stdin) != NULL;
}

/* Until the engine has answered; meanwhile it may talk to the person at the terminal. */
static void converse(int channel, struct message *m)
{
    int heard = say(channel, m, sizeof *m) && hear(channel, m, 0);
    while (heard && (m->op == OP_SAY || m->op == OP_ASK)) {
        if (m->op == OP_SAY) {
            printf("%s\n", m->text);
        } else {
            ask_person(m);
            heard = say(channel, m, sizeof *m);
        }
        heard = heard && hear(channel, m, 0);
    }
    if (!heard)
        shim_die(GONE);
}

struct message *shim_call(struct message *m)
{
    shim_start();
    if (served >= 0) {
        converse(served, m);
    } else {
        pthread_mutex_lock(&calling);
        converse(foreground, m);
        pthread_mutex_unlock(&calling);
    }
    if (m->op == OP_ERROR)
        shim_die(m->text);
    return m;
}

static void obey(struct message *m)
{
    TRSF_PTR t = shim_at(m->refs[0]);
    if (m->op == OP_CALL_TRANSFORM && t->fn)
        t->fn(t);
    else if (m->op == OP_CALL_FUNCTION)
        ((int (*)()) (intptr_t) m->refs[0])();
    else if (m->op == OP_SIGNAL)
        __atomic_fetch_add((event *) t, 1, __ATOMIC_ACQ_REL);
    m->op = OP_REPLY;
}

static long now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000L + now.tv_nsec;
}

/* True when something can be heard within `ns`; we sleep meanwhile. */
static int doze(int channel, long ns)
{
    struct pollfd wanted = {channel, POLLIN, 0};
    struct timespec timeout = {0, ns > 0 ? ns : 0};
    return ppoll(&wanted, 1, &timeout, NULL) > 0;
}

/* The same, and we stay awake: on a second processor, for on a single one the engine would wait for us. */
static int look(int channel, long ns)
{
    static long processors = 0;
    if (!processors)
        processors = sysconf(_SC_NPROCESSORS_ONLN);
    long until = now_ns() + ns;
    while (processors > 1 && now_ns() < until) {
        if (doze(channel, 0))
            return 1;
        sched_yield(); /* a message may have put the engine on our processor although another one is idle */
    }
    return 0;
}

/* To wake us would cost the engine more than the call itself, and in the middle of a sample. So we stay awake between
 * the calls of one sample, and wake up by ourselves shortly before the next one is due. */
static int hear_next(int channel, struct message *m)
{
    static long began = 0, period = LONGEST_NS; /* of the newest sample */
    if (look(channel, AWAKE_NS))
        return hear(channel, m, 0);
    long early = period / EARLY_SHARE < EARLY_NS ? period / EARLY_SHARE : EARLY_NS;
    if (period < LONGEST_NS && !doze(channel, began + period - early - now_ns()))
        look(channel, 2 * early);
    int heard = hear(channel, m, 0);
    long since = now_ns() - began;
    if (since > period / SAME_SHARE) {
        period = since < LONGEST_NS ? since : LONGEST_NS;
        began += since;
    }
    return heard;
}

/* The engine calls functions at each sample, one after the other. */
void shim_serve(int channel)
{
    struct message m;
    served = channel;
    int on = hear(channel, &m, 0);
    while (on) {
        obey(&m);
        on = say(channel, &m, SHIM_BRIEF) && hear_next(channel, &m);
    }
}

/* Async-signal-safe. In a function that the engine waits for, it has to be told that nothing will come of it. */
void shim_close(void)
{
    if (served >= 0)
        shutdown(served, SHUT_RDWR);
    shutdown(foreground, SHUT_WR);
}

/* Async-signal-safe. The engine closes its end when it has let go of the arm. */
void shim_wait_closed(int timeout_ms)
{
    struct message m;
    struct pollfd wanted = {foreground, POLLIN, 0};
    while (poll(&wanted, 1, timeout_ms) > 0 && recv(foreground, &m, sizeof m, 0) > 0)
        ;
}
