/* motion.c - motions, their parameters, and waiting for them. */
#include <string.h>

#include "shim.h"

static int ask(enum op op, const char *text, double first, double second)
{
    struct message m = shim_message(op, text);
    m.numbers[0] = first;
    m.numbers[1] = second;
    shim_call(&m);
    return YES;
}

static int control_with(int (*first)(), int (*second)())
{
    struct message m = shim_message(OP_CONTROL, "");
    m.refs[0] = (intptr_t) first;
    m.refs[1] = (intptr_t) second;
    shim_call(&m);
    return YES;
}

int shim_control(void)
{
    return control_with(NULL, NULL);
}

API int rccl_control(int (**functions)())
{
    return control_with(functions[0], functions[1]);
}

API int (control)(void)
{
    return shim_control();
}

static int release_saying(const char *said)
{
    struct message m = shim_message(OP_RELEASE, "");
    shim_call(&m);
    if (said)
        printf("%s\n", said);
    fflush(stdout);
    shim_say("release", m.text);
    shim_say_mess();
    return YES;
}

API int rccl_release(char **said)
{
    return release_saying(said[0]);
}

API int (release)(void)
{
    return release_saying(NULL);
}

API int move(POS_PTR p)
{
    struct message m = shim_message(OP_MOVE, "");
    shim_start();
    m.refs[0] = shim_ref(p);
    shim_call(&m);
    return YES;
}

API int stop(double ms)
{
    return ask(OP_STOP, "", ms, 0);
}

API int setvel(double tv, double rv)
{
    return ask(OP_SETVEL, "", tv, rv);
}

/* A letter or a word, as either was written. */
API int rccl_setmode(long mode)
{
    char letter[2] = {(char) mode, 0};
    return ask(OP_SETMODE, mode > 0 && mode < 256 ? letter : (char *) mode, 0, 0);
}

API int setconf(char *letters)
{
    return ask(OP_SETCONF, letters, 0, 0);
}

API int sample(double ms)
{
    return ask(OP_SAMPLE_PERIOD, "", ms, 0);
}

API int setime(double ta, double ts)
{
    return ask(OP_SETIME, "", ta, ts);
}

API int evalfn(int (*fn)())
{
    struct message m = shim_message(OP_EVALFN, "");
    m.refs[0] = (intptr_t) shim_need((void *) fn, "evalfn", "a function");
    shim_call(&m);
    return YES;
}

static int name_directions(enum op op, char *names, int count, const double *values)
{
    struct message m = shim_message(op, names);
    m.n = count < SHIM_NUMBERS ? count : SHIM_NUMBERS;
    memcpy(m.numbers, values, (size_t) m.n * sizeof *values);
    shim_call(&m);
    return YES;
}

API int rccl_distance(char *spec, int count, double *values)
{
    return name_directions(OP_DISTANCE, spec, count, values);
}

API int rccl_limit(char *spec, int count, double *values)
{
    return name_directions(OP_LIMIT, spec, count, values);
}

API int rccl_comply(char *dirs, int count, double *values)
{
    return name_directions(OP_COMPLY, dirs, count, values);
}

API int lock(char *dirs)
{
    return ask(OP_LOCK, dirs, 0, 0);
}

API void rccl_open_hand(void)
{
    ask(OP_HAND, "open", 0, 0);
}

API void rccl_close_hand(void)
{
    ask(OP_HAND, "close", 0, 0);
}

API int rccl_analog(int output, double volts)
{
    return ask(OP_ANALOG, "", output, volts);
}

/* ------------------------------------------------------------------------- speed, and going on after a stop */

API int rccl_override(double percent)
{
    return ask(OP_OVERRIDE, "", percent, 0);
}

API int rccl_pause(void)
{
    return ask(OP_PAUSE, "", 0, 0);
}

API int rccl_resume(void)
{
    return ask(OP_RESUME, "", 0, 0);
}

API int rccl_keep_path(int keep, double way_back_mm, double way_back_deg)
{
    struct message m = shim_message(OP_KEEP_PATH, "");
    m.n = keep;
    m.numbers[0] = way_back_mm;
    m.numbers[1] = way_back_deg;
    shim_call(&m);
    return YES;
}

API int rccl_retract(double mm)
{
    return ask(OP_RETRACT, "", mm, 0);
}

/* Of the arm, which is taken for that if need be. A program may have written to `how`. */
static int joints(void)
{
    if (!how.n)
        shim_control();
    int n = how.n;
    if (n < 0 || n > RCCL_JOINTS)
        shim_die("how.n is no number of joints any more: the program has written to how, which is for reading");
    return n;
}

API int rccl_collision(char *reaction, double mm, double *thresholds)
{
    struct message m = shim_message(OP_COLLISION, shim_need(reaction, "rccl_collision", "a reaction"));
    int n = joints();
    m.n = thresholds ? n : 0;
    m.numbers[0] = mm;
    if (thresholds)
        memcpy(m.numbers + 1, thresholds, (size_t) n * sizeof *thresholds);
    shim_call(&m);
    return YES;
}

void shim_load(struct message *m, double kg, const double *centre, const double *inertia)
{
    m->numbers[0] = kg;
    if (centre)
        memcpy(m->numbers + 1, centre, 3 * sizeof *centre);
    if (inertia)
        memcpy(m->numbers + 4, inertia, 6 * sizeof *inertia);
}

API int rccl_setload(double kg, double *centre, double *inertia)
{
    struct message m = shim_message(OP_SETLOAD, "");
    shim_load(&m, kg, centre, inertia);
    shim_call(&m);
    return YES;
}

/* Each thread has its own text, until it asks again. */
API char *rccl_kept(void)
{
    static __thread char text[SHIM_TEXT];
    struct message m = shim_message(OP_KEPT, "");
    shim_call(&m);
    memcpy(text, m.text, sizeof text);
    return text;
}

/* --------------------------------------------------------------------------------------------------- waiting */

static int let_a_sample_pass(const char *wanted)
{
    return ask(OP_NEXT_SAMPLE, wanted, 0, 0);
}

API void rccl_sample(void)
{
    let_a_sample_pass("");
}

API int suspendfg(void)
{
    return let_a_sample_pass("");
}

/* Events of the program's own are signalled by its background functions, who knows when. */
API void rccl_waitfor(volatile event *e)
{
    shim_start();
    while (!shim_take(e, e == &completed)) /* which stays true until the next motion */
        let_a_sample_pass(shim_ref(e) < 0 ? "" : e == &completed ? "completed" : "end");
}

API int stepmode(void)
{
    return ask(OP_STEPMODE, "", 0, 0);
}

API int adcopen(int channel)
{
    return ask(OP_ADCOPEN, "", channel, 0);
}

API int enctoang(real *angles, int *counts)
{
    struct message m = shim_message(OP_ENCTOANG, "");
    shim_need(angles, "enctoang", "an array for the result");
    shim_need(counts, "enctoang", "an array");
    int n = joints();
    for (int j = 0; j < n; j++)
        m.numbers[j] = counts[j];
    shim_call(&m);
    for (int j = 0; j < m.n; j++)
        angles[j] = (real) m.numbers[j];
    return YES;
}

API int angtoenc(int *counts, real *angles)
{
    struct message m = shim_message(OP_ANGTOENC, "");
    shim_need(counts, "angtoenc", "an array for the result");
    shim_need(angles, "angtoenc", "an array");
    int n = joints();
    for (int j = 0; j < n; j++)
        m.numbers[j] = angles[j];
    shim_call(&m);
    for (int j = 0; j < m.n; j++) {
        if (!(m.numbers[j] > -2147483649. && m.numbers[j] < 2147483648.))
            shim_die("angtoenc: an angle is no number, or its counts are more than fit into an int");
        counts[j] = (int) m.numbers[j];
    }
    return YES;
}
