/* manip.c - the calls of Multi-RCCL. Each message names its manipulator in refs[SHIM_MANIP]. */
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include "shim_world.h"
#include "../include/rccl.h"

#define MANIPULATOR "a manipulator, from rccl_open,"

/* One of them, in shared memory; the list of all. */
struct opened {
    MANIP of;
    struct opened *next;
};

_Static_assert(sizeof(struct opened) <= SHIM_ROOM, "a manipulator fits into a slot");

static struct opened *newest = NULL;

/* For channel.h. */
int rccl_has_manipulators(void)
{
    return 1;
}

static struct message call_of(enum op op, MANIP_PTR m, const char *call, const char *text)
{
    struct message message = shim_message(op, text);
    shim_need(m, call, MANIPULATOR);
    shim_start();
    message.refs[SHIM_MANIP] = shim_ref(m);
    return message;
}

static int ask(enum op op, MANIP_PTR m, const char *call, const char *text, double first, double second)
{
    struct message message = call_of(op, m, call, text);
    message.numbers[0] = first;
    message.numbers[1] = second;
    shim_call(&message);
    return YES;
}

/* `words`: name, robot, bridge; the last may be missing, and NULL stands behind them. */
API MANIP_PTR rccl_manip_open(char **words)
{
    char *kept;
    struct message m = shim_message(OP_MANIP_OPEN, "");
    const size_t fields[] = {offsetof(MANIP, n), offsetof(MANIP, trans.n), offsetof(MANIP, j6), offsetof(MANIP, force)};
    size_t length = 0;
    shim_need(words[0], "rccl_open", "a name");
    shim_start();
    struct opened *opened = shim_new(words[0], &kept);
    opened->of.name = opened->of.trans.name = kept;
    opened->of.completed = 1;
    m.refs[0] = shim_ref(opened);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++)
        m.refs[1 + i] = (int64_t) fields[i];
    m.refs[5] = shim_ref(&opened->of.trans);
    for (m.n = 0; m.n < 3 && words[m.n]; m.n++) {
        size_t size = strlen(words[m.n]) + 1;
        if (length + size > SHIM_TEXT)
            shim_die("rccl_open: a name, a robot and a bridge of more letters than fit");
        if (strchr(words[m.n], '\n')) /* which stands between them in the message */
            shim_die("rccl_open: a name, a robot or a bridge has a line break in it");
        memcpy(m.text + length, words[m.n], size);
        m.text[length + size - 1] = '\n';
        length += size;
    }
    m.text[length - 1] = 0;
    shim_call(&m);
    opened->next = newest;
    __atomic_store_n(&newest, opened, __ATOMIC_RELEASE);
    return &opened->of;
}

API int rccl_manip_control(MANIP_PTR m, double *period_ms)
{
    return ask(OP_CONTROL, m, "rccl_control", "", period_ms[0], 0);
}

API int rccl_manip_release(MANIP_PTR m)
{
    return ask(OP_RELEASE, m, "rccl_release", "", 0, 0);
}

/* -------------------------------------------------------------------------------------------------- positions */

static POS_PTR new_position(struct message *m, const char *name)
{
    POS_PTR p = shim_new_position(name);
    m->refs[0] = shim_ref(p);
    shim_call(m);
    memcpy(p->name, m->text, SHIM_NAME - 1); /* as the engine calls it */
    return p;
}

API POS_PTR rccl_make_position(TRSF_PTR unknown, ...)
{
    struct message m = shim_message(OP_MAKE_POSITION, "");
    va_list terms;
    TRSF_PTR t;
    shim_start();
    m.refs[1] = unknown ? shim_term(unknown) : 0;
    va_start(terms, unknown);
    while ((t = va_arg(terms, TRSF_PTR))) {
        if (m.n == SHIM_REFS - 2)
            shim_die("makePosition: an equation of more terms than fit");
        m.refs[2 + m.n++] = shim_term(t);
    }
    va_end(terms);
    return new_position(&m, "");
}

API POS_PTR rccl_manip_jposition(MANIP_PTR m, char *name, int count, double *degs)
{
    struct message message = call_of(OP_JPOSITION, m, "jposition", shim_need(name, "jposition", "a name"));
    message.n = count < SHIM_NUMBERS ? count : SHIM_NUMBERS;
    memcpy(message.numbers, degs, (size_t) message.n * sizeof *degs);
    return new_position(&message, name);
}

API POS_PTR rccl_pose(MANIP_PTR m, char *name)
{
    struct message message = call_of(OP_POSE, m, "rccl_pose", shim_need(name, "rccl_pose", "a name"));
    return new_position(&message, name);
}

/* ---------------------------------------------------------------------------------------------------- motions */

static int go(enum op op, MANIP_PTR m, const char *call, POS_PTR p)
{
    struct message message = call_of(op, m, call, "");
    message.refs[0] = shim_ref(shim_need(p, call, "a position"));
    shim_call(&message);
    return YES;
}

API int rccl_manip_move(MANIP_PTR m, POS_PTR p)
{
    return go(OP_MOVE, m, "move", p);
}

API int rccl_manip_stop(MANIP_PTR m, POS_PTR p, double ms)
{
    struct message message = call_of(OP_STOP, m, "stop", "");
    message.n = p != NULL;
    message.refs[0] = p ? shim_ref(p) : 0;
    message.numbers[0] = ms;
    shim_call(&message);
    return YES;
}

API int maintain(MANIP_PTR m, POS_PTR p)
{
    return go(OP_MAINTAIN, m, "maintain", p);
}

API int trackingMode(MANIP_PTR m)
{
    return ask(OP_TRACKING_MODE, m, "trackingMode", "", 0, 0);
}

API int rccl_cancel(MANIP_PTR m, double ms)
{
    return ask(OP_CANCEL, m, "rccl_cancel", "", ms, 0);
}

API int rccl_manip_setvel(MANIP_PTR m, double tv, double rv)
{
    return ask(OP_SETVEL, m, "setvel", "", tv, rv);
}

API int rccl_manip_setconf(MANIP_PTR m, char *letters)
{
    return ask(OP_SETCONF, m, "setconf", shim_need(letters, "setconf", "a word"), 0, 0);
}

API int rccl_manip_setime(MANIP_PTR m, double ta, double ts)
{
    return ask(OP_SETIME, m, "setime", "", ta, ts);
}

/* A letter or a word, as either was written. */
API int rccl_manip_setmode(MANIP_PTR m, long mode)
{
    char letter[2] = {(char) mode, 0};
    return ask(OP_SETMODE, m, "setmode", mode > 0 && mode < 256 ? letter : (char *) mode, 0, 0);
}

API int rccl_manip_evalfn(MANIP_PTR m, int (*fn)())
{
    struct message message = call_of(OP_EVALFN, m, "evalfn", "");
    message.refs[0] = (intptr_t) shim_need((void *) fn, "evalfn", "a function");
    shim_call(&message);
    return YES;
}

API int rccl_manip_lock(MANIP_PTR m, char *dirs)
{
    return ask(OP_LOCK, m, "lock", shim_need(dirs, "lock", "directions"), 0, 0);
}

static int name_directions(enum op op, MANIP_PTR m, const char *call, char *names, int count, const double *values)
{
    struct message message = call_of(op, m, call, shim_need(names, call, "directions"));
    message.n = count < SHIM_NUMBERS ? count : SHIM_NUMBERS;
    memcpy(message.numbers, values, (size_t) message.n * sizeof *values);
    shim_call(&message);
    return YES;
}

API int rccl_manip_distance(MANIP_PTR m, char *spec, int count, double *values)
{
    return name_directions(OP_DISTANCE, m, "distance", spec, count, values);
}

API int rccl_manip_limit(MANIP_PTR m, char *spec, int count, double *values)
{
    return name_directions(OP_LIMIT, m, "limit", spec, count, values);
}

API int rccl_manip_comply(MANIP_PTR m, char *dirs, int count, double *values)
{
    return name_directions(OP_COMPLY, m, "comply", dirs, count, values);
}

API int rccl_manip_hand(MANIP_PTR m, int closed)
{
    return ask(OP_HAND, m, closed ? "GRASP" : "OPEN", closed ? "close" : "open", 0, 0);
}

API int rccl_manip_override(MANIP_PTR m, double percent)
{
    return ask(OP_OVERRIDE, m, "rccl_override", "", percent, 0);
}

API int rccl_manip_pause(MANIP_PTR m)
{
    return ask(OP_PAUSE, m, "rccl_pause", "", 0, 0);
}

API int rccl_manip_retract(MANIP_PTR m, double mm)
{
    return ask(OP_RETRACT, m, "rccl_retract", "", mm, 0);
}

API int rccl_manip_collision(MANIP_PTR m, char *reaction, double mm, double *thresholds)
{
    struct message message = call_of(OP_COLLISION, m, "rccl_collision", shim_need(reaction, "rccl_collision", "a reaction"));
    int n = m->n;
    if (n < 0 || n > RCCL_JOINTS)
        shim_die("rccl_collision: n of a manipulator is no number of joints any more: the program has written to it");
    message.n = thresholds ? n : 0;
    message.numbers[0] = mm;
    if (thresholds)
        memcpy(message.numbers + 1, thresholds, (size_t) n * sizeof *thresholds);
    shim_call(&message);
    return YES;
}

API int rccl_manip_setload(MANIP_PTR m, double kg, double *centre, double *inertia)
{
    struct message message = call_of(OP_SETLOAD, m, "rccl_setload", "");
    shim_load(&message, kg, centre, inertia);
    shim_call(&message);
    return YES;
}

static struct message with_transform(enum op op, MANIP_PTR m, const char *call, TRSF_PTR trans, POS_PTR p)
{
    struct message message = call_of(op, m, call, "");
    message.refs[0] = shim_ref(shim_need(trans, call, "a transform"));
    message.refs[1] = shim_ref(shim_need(p, call, "a position"));
    shim_call(&message);
    return message;
}

API int rccl_manip_update(MANIP_PTR m, TRSF_PTR trans, POS_PTR p)
{
    with_transform(OP_UPDATE, m, "update", trans, p);
    return YES;
}

API int rccl_manip_teach(MANIP_PTR m, TRSF_PTR trans, POS_PTR p)
{
    return with_transform(OP_TEACH, m, "teach", trans, p).n;
}

API int rccl_manip_keep_path(MANIP_PTR m, int keep, double way_back_mm, double way_back_deg)
{
    struct message message = call_of(OP_KEEP_PATH, m, "rccl_keep_path", "");
    message.n = keep;
    message.numbers[0] = way_back_mm;
    message.numbers[1] = way_back_deg;
    shim_call(&message);
    return YES;
}

API int rccl_manip_resume(MANIP_PTR m)
{
    return ask(OP_RESUME, m, "rccl_resume", "", 0, 0);
}

/* Each thread has its own text, until it asks again. */
API char *rccl_manip_kept(MANIP_PTR m)
{
    static __thread char text[SHIM_TEXT];
    struct message message = call_of(OP_KEPT, m, "rccl_kept", "");
    shim_call(&message);
    memcpy(text, message.text, sizeof text);
    return text;
}

/* --------------------------------------------------------------------------------------------------- waiting */

static void let_a_sample_pass(const char *wanted)
{
    struct message m = shim_message(OP_NEXT_SAMPLE, wanted);
    shim_call(&m);
}

API void rccl_manip_sample(void)
{
    let_a_sample_pass("");
}

/* The manipulator whose `completed` it is. */
static MANIP_PTR completed_of(const volatile event *e)
{
    for (struct opened *each = __atomic_load_n(&newest, __ATOMIC_ACQUIRE); each; each = each->next)
        if (e == &each->of.completed)
            return &each->of;
    return NULL;
}

/* Events of the program's own are signalled by its background functions, who knows when. */
API void rccl_manip_waitfor(volatile event *e)
{
    MANIP_PTR of = completed_of(e);
    shim_start();
    while (!shim_take(e, of != NULL))
        let_a_sample_pass(shim_ref(e) < 0 ? "" : of ? "completed" : "end");
}
