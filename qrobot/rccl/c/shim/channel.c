/* channel.c - messages to the motion engine and from it. */
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
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
#define SPINS 50               /* some 1 us */

#if defined __x86_64__ || defined __i386__
#define PAUSE() __builtin_ia32_pause()
#elif defined __aarch64__
#define PAUSE() __asm__ volatile("yield")
#else
#define PAUSE() ((void) 0)
#endif

enum heard { NOTHING = -1, END = 0, HEARD = 1 };

static int foreground = -1;
static pthread_mutex_t turns = PTHREAD_MUTEX_INITIALIZER; /* a program may have threads of its own */
static pthread_cond_t turn_over = PTHREAD_COND_INITIALIZER;
static unsigned long turn, turns_taken; /* whose it is, and how many have been taken */
static __thread volatile sig_atomic_t in_call; /* of the foreground, or of a thread of the program's own */
static __thread int served = -1; /* in functions that the engine calls: its channel */
static int by_message;           /* the call under way is to be answered by a message */
static int64_t newest;           /* number of the newest call that was obeyed, or is being */
static cpu_set_t allowed;        /* for the thread that serves calls */
static int processors;           /* so many */

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
static int hear(int channel, struct message *m)
{
    ssize_t got;
    do
        got = recv(channel, m, sizeof *m, 0);
    while (got < 0 && errno == EINTR);
    return got >= (ssize_t) SHIM_BRIEF;
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

static void obey(struct message *m)
{
    TRSF_PTR t = shim_at(m->refs[0]);
    if (m->op == OP_CALL_TRANSFORM && t->fn)
        t->fn(t);
    else if (m->op == OP_CALL_FUNCTION)
        ((int (*)()) (intptr_t) m->refs[0])();
    else if (m->op == OP_SIGNAL)
        __atomic_fetch_add((event *) t, 1, __ATOMIC_ACQ_REL);
    else if (m->op == OP_CALL_ARCL && arcl_obey)
        arcl_obey();
}

/* A call may come twice: in the cell, and by a message when the engine has waited for a while. Number 0 is no number: it
 * comes by a message alone. */
static int is_new(const struct message *m)
{
    return m->n == 0 || m->n != newest;
}

/* Obey it once. False when nobody listens any more. */
static int serve(int channel, struct message *m)
{
    if (is_new(m)) {
        newest = m->n ? m->n : newest;
        obey(m);
        __atomic_store_n(&shim_cell.asking, 0, __ATOMIC_RELAXED); /* numbers come round */
        __atomic_store_n(&shim_cell.done, newest, __ATOMIC_RELEASE);
    }
    m->op = OP_REPLY;
    return !by_message || say(channel, m, SHIM_BRIEF);
}

/* The engine asks the person at the terminal; the end of the input is an answer with n = 0. */
static void ask_person(struct message *m)
{
    printf("%s", m->text);
    fflush(stdout);
    m->n = shim_read_line(m->text, SHIM_TEXT);
}

/* Not the answer yet: the engine talks to the person at the terminal, needs another function for it, or repeats the call
 * that we are in. */
static int is_between(const struct message *m)
{
    return m->op == OP_SAY || m->op == OP_ASK || (m->op >= OP_CALL_TRANSFORM && m->op <= OP_CALL_ARCL);
}

/* The engine answers a function soon, and to wake us would cost as much as the answer. */
static int hear_answer(int channel, struct message *m)
{
    long until = now_ns() + (channel == served && processors > 1 ? AWAKE_NS : 0);
    while (now_ns() < until && !doze(channel, 0))
        ;
    return hear(channel, m);
}

/* Until the engine has answered. */
static void converse(int channel, struct message *m)
{
    int heard = say(channel, m, sizeof *m) && hear_answer(channel, m);
    while (heard && is_between(m)) {
        if (m->op == OP_SAY) {
            printf("%s\n", m->text);
        } else if (m->op == OP_ASK) {
            ask_person(m);
            heard = say(channel, m, sizeof *m);
        } else if (is_new(m)) {
            heard = serve(channel, m);
        }
        heard = heard && hear_answer(channel, m);
    }
    if (!heard)
        shim_die(GONE);
}

int shim_serving(void)
{
    return served >= 0;
}

int shim_calling(void)
{
    return in_call;
}

/* A call that waits for its arm sees it, and gives way. */
static void show_waiting(void)
{
    unsigned long asking = turns_taken - turn;
    __atomic_store_n(&shim_cell.waiting, asking > 1 ? (int64_t) asking - 1 : 0, __ATOMIC_RELEASE);
}

/* Threads ask in the order in which they come: one that asks again and again lets the others in. False when somebody
 * else has the turn, and we do not wait. */
static int take_turn(int wait)
{
    pthread_mutex_lock(&turns);
    unsigned long ours = turns_taken;
    int taken = wait || turn == ours;
    turns_taken += (unsigned long) taken;
    show_waiting();
    while (taken && turn != ours)
        pthread_cond_wait(&turn_over, &turns);
    pthread_mutex_unlock(&turns);
    return taken;
}

static void end_turn(void)
{
    pthread_mutex_lock(&turns);
    turn++;
    show_waiting();
    pthread_cond_broadcast(&turn_over);
    pthread_mutex_unlock(&turns);
}

static void ask_in_turn(struct message *m)
{
    in_call = 1;
    take_turn(1);
    converse(foreground, m);
    end_turn();
    in_call = 0;
}

/* A function asks on the channel on which it was called. */
static void ask_in_function(struct message *m)
{
    by_message = 1;
    __atomic_store_n(&shim_cell.asking, newest, __ATOMIC_RELEASE);
    converse(served, m);
}

/* Until it is answered: a call that has given way to another thread's is asked again. */
static void ask_until_answered(struct message *m)
{
    const struct message asked = *m;
    do {
        *m = asked;
        ask_in_turn(m);
        shim_stay(); /* then it is no answer */
    } while (m->op == OP_AGAIN);
}

/* A thread that is cancelled meanwhile would keep its turn, so it is afterwards. */
struct message *shim_ask(struct message *m)
{
    int cancelling;
    if (shim_parted())
        shim_die("nothing can be asked any more: the program ends, and lets go of its arm");
    if (in_call)
        shim_die(SHIM_IN_HANDLER);
    pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &cancelling);
    shim_start();
    if (served >= 0)
        ask_in_function(m);
    else
        ask_until_answered(m);
    pthread_setcancelstate(cancelling, NULL);
    pthread_testcancel();
    return m;
}

struct message *shim_call(struct message *m)
{
    if (shim_ask(m)->op == OP_ERROR)
        shim_die(m->text);
    return m;
}

/* The turn is never ended, so whatever this thread asks from now on would wait for ever: it is in this call for good. */
int shim_call_last(struct message *m, int wait)
{
    in_call = 1;
    if (!take_turn(wait))
        return 0;
    converse(foreground, m);
    if (m->op == OP_ERROR)
        shim_die(m->text);
    return 1;
}

static int hear_call(int channel, struct message *m)
{
    by_message = 1;
    return hear(channel, m);
}

/* True when there is a new call in the cell. */
static int take_call(struct message *m)
{
    int64_t called = __atomic_load_n(&shim_cell.called, __ATOMIC_ACQUIRE);
    if (called == newest)
        return 0;
    m->op = (int32_t) shim_cell.op;
    m->n = (int32_t) called;
    m->refs[0] = shim_cell.ref;
    by_message = 0;
    return 1;
}

/* Stay awake for `ns`, on a second processor: on a single one the engine would wait for us. */
static enum heard look(int channel, struct message *m, long ns)
{
    long until = now_ns() + ns;
    while (processors > 1 && now_ns() < until) {
        for (int i = 0; i < SPINS; i++) {
            if (take_call(m))
                return HEARD;
            PAUSE();
        }
        if (doze(channel, 0))
            return hear_call(channel, m) ? HEARD : END;
    }
    return NOTHING;
}

static enum heard look_and_say_so(int channel, struct message *m, long ns)
{
    __atomic_store_n(&shim_cell.looking, 1, __ATOMIC_RELEASE);
    enum heard heard = look(channel, m, ns);
    __atomic_store_n(&shim_cell.looking, 0, __ATOMIC_RELEASE);
    return heard;
}

/* Linux may put who is woken on the processor of who wakes, though another one is idle. Two that both stay awake would
 * wait there for each other, so we leave the engine's. */
static void keep_apart(void)
{
    int theirs = (int) shim_cell.processor;
    if (processors < 2 || !newest || theirs != sched_getcpu()) /* calls without numbers do not say where they are made */
        return;
    cpu_set_t others = allowed;
    CPU_CLR(theirs, &others);
    sched_setaffinity(0, sizeof others, &others); /* of this thread; where that is refused, calls take longer */
}

/* To wake us would cost the engine more than the call itself, and in the middle of a sample. So we stay awake between
 * the calls of one sample, and wake up by ourselves shortly before the next one is due. */
static int hear_next(int channel, struct message *m)
{
    static long began = 0, period = LONGEST_NS; /* of the newest sample */
    enum heard heard = look_and_say_so(channel, m, AWAKE_NS);
    if (heard != NOTHING)
        return heard;
    long early = period / EARLY_SHARE < EARLY_NS ? period / EARLY_SHARE : EARLY_NS;
    if (period < LONGEST_NS && !doze(channel, began + period - early - now_ns()))
        heard = look_and_say_so(channel, m, 3 * early);
    if (heard == NOTHING)
        heard = hear_call(channel, m);
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
    if (!sched_getaffinity(0, sizeof allowed, &allowed))
        processors = CPU_COUNT(&allowed);
    int on = hear_call(channel, &m);
    while (on) {
        on = serve(channel, &m);
        keep_apart();
        on = on && hear_next(channel, &m);
    }
}

/* Async-signal-safe. In a function that the engine waits for, it has to be told that nothing will come of it. */
void shim_close(void)
{
    if (served >= 0)
        shutdown(served, SHUT_RDWR);
    shutdown(foreground, SHUT_WR);
}

/* Async-signal-safe. The engine closes its end when it has let go of the arm. Signals of the program may interrupt this. */
void shim_wait_closed(int timeout_ms)
{
    struct message m;
    struct pollfd wanted = {foreground, POLLIN, 0};
    long left, until = now_ns() + timeout_ms * 1000000L;
    while (foreground >= 0 && (left = until - now_ns()) > 0) {
        int ready = poll(&wanted, 1, (int) (left / 1000000 + 1));
        if (ready == 0 || (ready < 0 && errno != EINTR))
            return;
        ssize_t got = ready > 0 ? recv(foreground, &m, sizeof m, MSG_DONTWAIT) : 1; /* another thread may hear it first */
        if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR))
            return;
    }
}
