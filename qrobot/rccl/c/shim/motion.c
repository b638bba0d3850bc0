/* motion.c - motions, their parameters, and waiting for them. */
#include <string.h>

#include "shim.h"

static struct message ask(enum op op, const char *text, double first, double second)
{
    struct message m = shim_message(op, text);
    m.numbers[0] = first;
    m.numbers[1] = second;
    shim_call(&m);
    return m;
}

API int rccl_control(int (**functions)())
{
    struct message m = shim_message(OP_CONTROL, "");
    m.refs[0] = (intptr_t) functions[0];
    m.refs[1] = (intptr_t) functions[1];
    shim_call(&m);
    return YES;
}

API void rccl_release(char **said)
{
    ask(OP_RELEASE, "", 0, 0);
    if (said[0])
        printf("%s\n", said[0]);
    fflush(stdout);
    shim_say_mess();
}

API void move(POS_PTR p)
{
    struct message m = shim_message(OP_MOVE, "");
    shim_start();
    m.refs[0] = shim_ref(p);
    shim_call(&m);
}

API void stop(double ms)
{
    ask(OP_STOP, "", ms, 0);
}

API void setvel(double tv, double rv)
{
    ask(OP_SETVEL, "", tv, rv);
}

/* A letter or a word, as either was written. */
API void rccl_setmode(long mode)
{
    char letter[2] = {(char) mode, 0};
    ask(OP_SETMODE, mode > 0 && mode < 256 ? letter : (char *) mode, 0, 0);
}

API void setconf(char *letters)
{
    ask(OP_SETCONF, letters, 0, 0);
}

API void sample(double ms)
{
    ask(OP_SAMPLE_PERIOD, "", ms, 0);
}

API void setime(double ta, double ts)
{
    ask(OP_SETIME, "", ta, ts);
}

API void evalfn(int (*fn)())
{
    struct message m = shim_message(OP_EVALFN, "");
    m.refs[0] = (intptr_t) fn;
    shim_call(&m);
}

static void name_directions(enum op op, char *names, int count, const double *values)
{
    struct message m = shim_message(op, names);
    m.n = count < SHIM_NUMBERS ? count : SHIM_NUMBERS;
    memcpy(m.numbers, values, (size_t) m.n * sizeof *values);
    shim_call(&m);
}

API void rccl_distance(char *spec, int count, double *values)
{
    name_directions(OP_DISTANCE, spec, count, values);
}

API void rccl_limit(char *spec, int count, double *values)
{
    name_directions(OP_LIMIT, spec, count, values);
}

API void rccl_comply(char *dirs, int count, double *values)
{
    name_directions(OP_COMPLY, dirs, count, values);
}

API void lock(char *dirs)
{
    ask(OP_LOCK, dirs, 0, 0);
}

API void rccl_open_hand(void)
{
    ask(OP_HAND, "open", 0, 0);
}

API void rccl_close_hand(void)
{
    ask(OP_HAND, "close", 0, 0);
}

/* --------------------------------------------------------------------------------------------------- waiting */

static void let_a_sample_pass(const char *wanted)
{
    ask(OP_NEXT_SAMPLE, wanted, 0, 0);
}

API void rccl_sample(void)
{
    let_a_sample_pass("");
}

API void suspendfg(void)
{
    let_a_sample_pass("");
}

/* Use up one signal, if there is one; `completed` stays true until the next motion. */
static int take(volatile event *e)
{
    event count = __atomic_load_n(e, __ATOMIC_ACQUIRE);
    while (count > 0)
        if (e == &completed
            || __atomic_compare_exchange_n(e, &count, count - 1, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE))
            return 1;
    return 0;
}

/* Events of the program's own are signalled by its background functions, who knows when. */
API void rccl_waitfor(volatile event *e)
{
    shim_start();
    while (!take(e))
        let_a_sample_pass(shim_ref(e) < 0 ? "" : e == &completed ? "completed" : "end");
}

API void stepmode(void)
{
    ask(OP_STEPMODE, "", 0, 0);
}

API void adcopen(int channel)
{
    ask(OP_ADCOPEN, "", channel, 0);
}

API void enctoang(real *angles, int *counts)
{
    struct message m = shim_message(OP_ENCTOANG, "");
    if (!how.n)
        control();
    for (int j = 0; j < how.n; j++)
        m.numbers[j] = counts[j];
    shim_call(&m);
    for (int j = 0; j < m.n; j++)
        angles[j] = (real) m.numbers[j];
}

API void angtoenc(int *counts, real *angles)
{
    struct message m = shim_message(OP_ANGTOENC, "");
    if (!how.n)
        control();
    for (int j = 0; j < how.n; j++)
        m.numbers[j] = angles[j];
    shim_call(&m);
    for (int j = 0; j < m.n; j++)
        counts[j] = (int) m.numbers[j];
}
