/* arcl_motion.c - robots and their motions. */
#include <stdio.h>
#include <string.h>

#include "arcl_call.h"

#define RING 256  /* motions that are told of at a time */
#define WORDS_MAX SHIM_NUMBERS

/* ---------------------------------------------------------------------------------------------- the command line */

static const arcl_value *words_among(int count, const arcl_value *values)
{
    for (int i = 0; i < count; i++)
        if (values[i].kind == WORDS)
            return &values[i];
    return NULL;
}

/* The words go before the call, one by one; no more than `argc` says, and not beyond the null pointer. */
static int send_words(char **argv, const arcl_value *argc)
{
    int count = 0, most = argc->kind == INTEGER && argc->number <= WORDS_MAX ? (int) argc->number : 0;
    for (; count < most && argv[count]; count++) {
        struct message m = shim_message(OP_ARCL_WORD, argv[count]);
        if (strlen(argv[count]) >= SHIM_TEXT)
            shim_die("arcl_open: a word of the command line is too long");
        m.n = count;
        shim_call(&m);
    }
    return count;
}

/* The engine says which words are no switches of ours. */
static void keep_words(char **argv, int count, const double *kept)
{
    int place = 0;
    for (int i = 0; i < count; i++)
        if (kept[i] > 0)
            argv[place++] = argv[i];
    if (place < count)
        argv[place] = NULL;
}

API ROBOT *arcl_list_open(int count, const arcl_value *values)
{
    ROBOT *rp = arcl_named("");
    const arcl_value *words = words_among(count, values);
    char **argv = words ? (char **) words->pointer : NULL;
    int sent = words && words > values ? send_words(argv, words - 1) : 0;
    struct message m = arcl_try("arcl_open", rp, count, values);
    if (m.op == OP_ERROR) {
        shim_say("arcl_open", m.text);
        shim_free(rp);
        return NULL;
    }
    memcpy(rp->name, m.text, SHIM_NAME - 1);
    keep_words(argv, sent, m.numbers);
    return rp;
}

API void arcl_close(ROBOT *rp)
{
    arcl_call("arcl_close", NULL, LIST(arcl_object(rp)));
}

API void arcl_skip(ROBOT *rp)
{
    arcl_call("arcl_skip", NULL, LIST(arcl_object(rp)));
}

API void arcl_override(ROBOT *rp, double percent)
{
    arcl_call("arcl_override", NULL, LIST(arcl_object(rp), arcl_real(percent)));
}

API void arcl_keep_path(ROBOT *rp, int keep, double way_back_mm, double way_back_deg)
{
    arcl_call("arcl_keep_path", NULL,
              LIST(arcl_object(rp), arcl_integer(keep), arcl_real(way_back_mm), arcl_real(way_back_deg)));
}

API void arcl_retract(ROBOT *rp, double mm)
{
    arcl_call("arcl_retract", NULL, LIST(arcl_object(rp), arcl_real(mm)));
}

API char *arcl_kept(ROBOT *rp)
{
    static __thread char text[SHIM_TEXT];
    struct message m = arcl_call("arcl_kept", NULL, LIST(arcl_object(rp)));
    memcpy(text, m.text, sizeof text);
    return text;
}

API void arcl_pause(ROBOT *rp)
{
    arcl_call("arcl_pause", NULL, LIST(arcl_object(rp)));
}

API void arcl_resume(ROBOT *rp)
{
    arcl_call("arcl_resume", NULL, LIST(arcl_object(rp)));
}

API void arcl_setload(ROBOT *rp, double kg, const Vector *centre, const double *inertia)
{
    arcl_call("arcl_setload", NULL,
              LIST(arcl_object(rp), arcl_real(kg), arcl_vector_value(centre), arcl_numbers(SIX, inertia)));
}

API void arcl_collision(ROBOT *rp, const char *reaction, int joints, const double *thresholds)
{
    arcl_call("arcl_collision", NULL,
              LIST(arcl_object(rp), arcl_text(reaction),
                   thresholds ? arcl_joints_value(joints, thresholds) : arcl_nothing(NULL)));
}

API int arcl_errproc(int (*function)(Event, ROBOT *, const char *))
{
    arcl_call("arcl_errproc", NULL, LIST(arcl_answering((int (*)()) function)));
    return OK;
}

API int arcl_teach(ROBOT *rp, int (*function)(Trans *, ROBOT *))
{
    Trans *t = arcl_named("T6");
    int presses = (int) arcl_call("teach", t, LIST(arcl_object(rp), arcl_answering((int (*)()) function))).numbers[0];
    arcl_give_back(t);
    return presses;
}

API Trans *where(ROBOT *rp)
{
    Trans *t = arcl_named("HERE");
    arcl_call("where", t, LIST(arcl_object(rp)));
    return t;
}

/* ------------------------------------------------------------------------------------------------------- motions */

static Motion *next_motion(void)
{
    static Motion *ring[RING];
    static unsigned newest;
    Motion **m = &ring[__atomic_fetch_add(&newest, 1, __ATOMIC_RELAXED) % RING];
    if (!*m)
        *m = arcl_named("");
    return *m;
}

API Motion *arcl_list_move(int count, const arcl_value *values)
{
    Motion *motion = next_motion();
    motion->t0 = 0;
    motion->code = 0;
    struct message m = arcl_call("move", motion, count, values);
    memcpy(motion->name, m.text, SHIM_NAME - 1);
    return motion;
}

API void arcl_list_stop(int count, const arcl_value *values)
{
    arcl_call("stop", NULL, count, values);
}

API void arcl_list_gripper(int count, const arcl_value *values)
{
    arcl_call("gripper", NULL, count, values);
}

API void arcl_list_wait(int count, const arcl_value *values)
{
    arcl_call("arcl_wait", NULL, count, values);
}
