/* The program: its tasks, from the first call to rci_close. */
#include "inside.h"

#include <ctype.h>
#include <sched.h>

struct program rci_program;
__thread RCI_TASK *rci_current; /* whose function runs in this thread; 0 in the planning program */
static pthread_once_t once = PTHREAD_ONCE_INIT;
static __thread int blocked;          /* a thread of ours, which has all signals blocked */
static __thread int holding;          /* this thread has the lock */
static __thread sigset_t mask_before; /* what this thread had blocked when it took the lock */
static __thread char last_error[TEXT_BYTES];

/* Say on stderr what went wrong, and keep it for rci_error. Returns -1. */
int rci_fail(const char *format, ...)
{
    va_list values;

    va_start(values, format);
    vsnprintf(last_error, sizeof last_error, format, values);
    va_end(values);
    rci_say("rci: %s", last_error);
    return -1;
}

const char *rci_error(void)
{
    return last_error;
}

void rci_signals_are_blocked(void)
{
    blocked = 1;
}

void rci_block_signals(sigset_t *before)
{
    sigset_t all;

    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, before);
}

/* A handler of the planning program would wait for ever for a lock that the program itself has: signals wait. */
void rci_lock(void)
{
    if (!blocked)
        rci_block_signals(&mask_before);
    pthread_mutex_lock(&rci_program.lock);
    holding = 1;
}

void rci_unlock(void)
{
    holding = 0;
    pthread_mutex_unlock(&rci_program.lock);
    if (!blocked)
        pthread_sigmask(SIG_SETMASK, &mask_before, NULL);
    rci_say_the_unsaid();
}

int rci_may_not_wait(void)
{
    return blocked || holding;
}

static void close_in_parent(void)
{
    if (rci_program.begun && pthread_equal(pthread_self(), rci_program.parent_thread) && rci_current == NULL)
        rci_close();
    rci_tell_all(); /* of a task that has called exit() */
}

/* Before main, so that the program's own handlers of exit() still have its tasks. For RCCL, which comes before. */
__attribute__((constructor)) void rci_close_at_exit(void)
{
    static int registered;

    if (!registered)
        atexit(close_in_parent);
    registered = 1;
}

/* For RCCL and ARCL: let all arms begin to come to rest, and wait for none. */
void rci_begin_stop(void)
{
    if (!rci_program.begun)
        return;
    rci_lock();
    for (int i = 0; i < rci_program.n_tasks; i++)
        rci_begin_release(rci_program.tasks[i], 0);
    rci_unlock();
}

void rci_make_lock(pthread_mutex_t *lock)
{
    pthread_mutexattr_t attributes;

    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(lock, &attributes);
    pthread_mutexattr_destroy(&attributes);
}

/* A child of the program has none of its threads, lost ones included, so none of its tasks once these have them. It
 * keeps nothing open of what they have: a bridge is to miss the program when that is killed. The lock is held. */
static void forget_in_child(void)
{
    static struct program parents; /* reachable, for those who look for leaks */

    if (rci_program.sealed || rci_program.lost_seats != NULL)
        parents = rci_program;
    rci_program.lost_seats = NULL;
    if (rci_program.sealed) {
        rci_links_leave();
        rci_processors_leave();
        memset(&rci_program, 0, sizeof rci_program);
        rci_current = NULL;
    }
    rci_make_lock(&rci_program.lock); /* which a child cannot let go: it was taken by a thread of its parent's */
    rci_tell_begin();
    holding = 0;
    if (!blocked)
        pthread_sigmask(SIG_SETMASK, &mask_before, NULL);
    blocked = 0;
}

/* What is done once in a process. */
static void prepare(void)
{
    rci_make_lock(&rci_program.lock);
    rci_tell_begin();
    pthread_atfork(rci_lock, rci_unlock, forget_in_child);
}

/* The first call begins a program: its clock and its parent task. */
void rci_begin(void)
{
    const char *kind = getenv("QROBOT_RCI_TIME");
    struct program *p = &rci_program;

    pthread_once(&once, prepare);
    if (p->begun)
        return;
    p->begun = 1;
    p->virtual_time = kind != NULL && strcmp(kind, "virtual") == 0;
    p->rate_hz = FALLBACK_HZ;
    p->tick = -1;
    p->epoch_ns = p->virtual_time ? 0 : qrobot_now_ns();
    p->parent_thread = pthread_self();
    p->parent.name = "parent";
    p->parent.bit = RCI_PARENT;
    p->parent.processor = "host";
    p->parent.inside = &p->parent_inside;
    p->parent_inside.mailbox = rci_parents_mailbox();
}

/* 1 for a task of this program; otherwise 0, and says so. */
int rci_is_task(const RCI_TASK *td, const char *call)
{
    for (int i = 0; rci_program.begun && i < rci_program.n_tasks; i++)
        if (rci_program.tasks[i] == td)
            return 1;
    rci_fail("%s: that is no task of this program; rci_create() makes them, rci_close() forgets them", call);
    return 0;
}

unsigned long rci_known(void)
{
    unsigned long known = 0;

    for (int i = 0; rci_program.begun && i < rci_program.n_tasks; i++)
        known |= rci_program.tasks[i]->bit;
    return known;
}

/* 1 for a mask that names tasks, and the program if it likes; otherwise 0, and says so. */
int rci_are_tasks(unsigned long mask, const char *call)
{
    unsigned long known = rci_known();

    if ((mask & known) != 0 && (mask == RCI_ALL || (mask & ~(known | RCI_PARENT)) == 0))
        return 1;
    rci_fail("%s: mask %#lx names no task, or has bits of none; there are %#lx", call, mask, known);
    return 0;
}

int rci_clock(long rate_hz)
{
    rci_begin();
    if (rci_current != NULL || rci_program.sealed)
        return rci_fail("rci_clock: choose the rate before the first rci_start()");
    if (rate_hz < 1 || rate_hz > FASTEST_HZ)
        return rci_fail("rci_clock: %ld Hz; whole numbers from 1 to %d are allowed", rate_hz, FASTEST_HZ);
    rci_program.rate_hz = rate_hz;
    return 0;
}

/* Why a task of that name cannot be made, 0 when it can. */
static const char *refusal(const char *name)
{
    if (rci_current != NULL)
        return "only the planning program creates tasks";
    if (rci_program.sealed)
        return "all tasks are created before the first rci_start()";
    if (name == NULL || name[0] == '\0' || strlen(name) > NAME_BYTES)
        return "a name of 1 to 64 bytes is needed";
    if (rci_program.n_tasks == RCI_TASKS)
        return "a program has at most 30 tasks";
    for (int i = 0; i < rci_program.n_tasks; i++)
        if (strcmp(rci_program.tasks[i]->name, name) == 0)
            return "there is a task of that name already";
    return NULL;
}

static RCI_TASK *new_task(const char *name, struct processor *processor)
{
    RCI_TASK *td = calloc(1, sizeof *td);
    struct rci_inside *in = calloc(1, sizeof *in);

    if (td == NULL || in == NULL || (in->mailbox = rci_mailbox()) == NULL) {
        free(td);
        free(in);
        rci_fail("rci_create: no memory");
        return NULL;
    }
    snprintf(in->name, sizeof in->name, "%s", name);
    td->inside = in;
    td->name = in->name;
    td->processor = processor->name;
    td->robot = rci_find_robot(name, in->address);
    in->processor = processor;
    in->device = -1;
    in->allowed_ns = ALLOWED_NS;
    in->clock.next = in->trigger_clock.next = NEVER;
    td->how.n = td->robot ? td->robot->n : 0;
    return td;
}

RCI_TASK *rci_create(const char *name, const char *proc)
{
    const char *why;
    struct processor *processor;
    RCI_TASK *td;

    rci_begin();
    if ((why = refusal(name)) != NULL) {
        rci_fail("rci_create(\"%s\"): %s", name ? name : "", why);
        return NULL;
    }
    if ((processor = rci_processor(proc)) == NULL || (td = new_task(name, processor)) == NULL)
        return NULL;
    rci_lock();
    td->bit = RCI_PARENT << (rci_program.n_tasks + 1);
    rci_program.tasks[rci_program.n_tasks++] = td;
    rci_unlock();
    return td;
}

int rci_control(RCI_TASK *td, RCI_FUNCTION control1, RCI_FUNCTION control2, RCI_FUNCTION startup)
{
    if (!rci_is_task(td, "rci_control"))
        return -1;
    if (control1 == NULL)
        return rci_fail("rci_control: task %s needs a first control function", td->name);
    rci_lock();
    td->inside->control1 = control1;
    td->inside->control2 = control2;
    td->inside->startup = startup;
    rci_unlock();
    return 0;
}

int rci_priority(RCI_TASK *td, int priority)
{
    if (!rci_is_task(td, "rci_priority"))
        return -1;
    rci_lock();
    td->inside->priority = priority;
    rci_unlock();
    return 0;
}

static void forget(RCI_TASK *td)
{
    rci_mailbox_free(td->inside->mailbox);
    free(td->inside->link);
    free(td->inside);
    free(td);
}

/* A thread that never came back may still use what it knows: then tasks and memory are kept for it. */
static void forget_all(int lost)
{
    struct program *p = &rci_program;

    for (int i = 0; i < p->n_tasks && !lost; i++)
        forget(p->tasks[i]);
    if (!lost)
        rci_areas_free();
    p->n_tasks = p->begun = p->sealed = 0;
    p->areas = NULL;
    memset(&p->parent_inside, 0, sizeof p->parent_inside);
    rci_forget_robots();
}

static int untold(void)
{
    int count = 0;

    for (int i = 0; i < rci_program.n_tasks; i++) {
        struct rci_inside *in = rci_program.tasks[i]->inside;

        count += in->error[0] != '\0' && !in->told;
    }
    return count;
}

int rci_close(void)
{
    static RCI_TASK **kept; /* by threads that never came back: reachable, for those who look for leaks */
    unsigned long mask = rci_known();
    sigset_t before;
    int failed, lost;

    if (!rci_program.begun)
        return 0;
    if (rci_current != NULL)
        return rci_fail("rci_close: only the planning program may do that");
    if (mask != 0 && rci_program.sealed)
        rci_release(mask);
    rci_processors_end();
    rci_block_signals(&before); /* a handler may end the program, whose tasks are either there or not */
    rci_watch_end();
    lost = rci_processors_forget();
    rci_lock();
    failed = untold();
    rci_unlock();
    if (lost && (kept = malloc(sizeof rci_program.tasks)) != NULL)
        memcpy(kept, rci_program.tasks, sizeof rci_program.tasks);
    forget_all(lost);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    rci_tell_end();
    return failed ? -1 : 0;
}

RCI_TASK *rci_descriptor(const char *name)
{
    for (int i = 0; rci_program.begun && name != NULL && i < rci_program.n_tasks; i++)
        if (strcmp(rci_program.tasks[i]->name, name) == 0)
            return rci_program.tasks[i];
    rci_fail("rci_descriptor: there is no task \"%s\"", name ? name : "");
    return NULL;
}

RCI_TASK *rci_self(void)
{
    rci_begin();
    return rci_current ? rci_current : &rci_program.parent;
}
