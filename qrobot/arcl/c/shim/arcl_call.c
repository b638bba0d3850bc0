/* arcl_call.c - calls of arcl.h as messages, and functions of the program that the engine calls. */
#define _GNU_SOURCE
#include <stdio.h>
#include <string.h>

#include "arcl_call.h"

#define SEPARATOR '\x1f'

/* Where the engine says which function it wants called, and the function answers; mirrored in qrobot/arcl/c/cell.py. */
struct cell {
    int64_t form, function, first, second, answer;
    double time; /* ms, of the robot that was opened last */
    char text[SHIM_TEXT];
    Feedback feedback;
};
ARCL_LAYOUT(struct cell, time, 40);
ARCL_LAYOUT(struct cell, feedback, 304);

enum form { OF_TRANSFORM = 1, OF_EVENT, OF_END, OF_FEEDBACK, OF_ERROR, OF_PREDICATE, OF_PLACE };

static SHARED WHOLE_PAGES(struct cell) pages = {{0}};
#define arcl_cell pages.of

int64_t arcl_cell_place(void)
{
    return shim_ref(&arcl_cell);
}

/* -------------------------------------------------------------------------------------------------------- values */

arcl_value arcl_integer(long long number)
{
    return (arcl_value) {INTEGER, (double) number, NULL};
}

arcl_value arcl_real(double number)
{
    return (arcl_value) {REAL, number, NULL};
}

static arcl_value at(enum kind kind, const void *pointer)
{
    return (arcl_value) {pointer ? (int) kind : NOTHING, 0, pointer};
}

arcl_value arcl_text(const char *text)
{
    return at(TEXT, text);
}

arcl_value arcl_words(char **words)
{
    return at(WORDS, words);
}

arcl_value arcl_nothing(const void *pointer)
{
    return (arcl_value) {pointer ? STRANGE : NOTHING, 0, NULL};
}

arcl_value arcl_trans_value(const Trans *t)
{
    return t == EQ ? at(MARK_EQ, t) : t == TL ? at(MARK_TL, t) : t == T6 ? at(LAST_LINK, t) : at(OBJECT, t);
}

arcl_value arcl_object(const void *p)
{
    return at(OBJECT, p);
}

arcl_value arcl_vector_value(const Vector *v)
{
    return at(VECTOR, v);
}

arcl_value arcl_numbers(enum kind kind, const void *numbers)
{
    return at(kind, numbers);
}

arcl_value arcl_answering(int (*function)())
{
    return at(ANSWERING, (const void *) (intptr_t) function);
}

arcl_value arcl_silent(void (*function)())
{
    return at(SILENT, (const void *) (intptr_t) function);
}

arcl_value arcl_itself(arcl_value value)
{
    return value;
}

arcl_value arcl_strange()
{
    return (arcl_value) {STRANGE, 0, NULL};
}

arcl_value arcl_joints_value(int count, const double *numbers)
{
    return (arcl_value) {JOINTS, count, numbers};
}

/* ------------------------------------------------------------------------------------------------------ messages */

struct packing {
    struct message *m;
    const char *call;
    int refs, numbers;
    size_t text;
};

static void too_much(const struct packing *p, const char *what)
{
    char text[SHIM_TEXT];
    snprintf(text, sizeof text, "%s: %s than one call can have", p->call, what);
    shim_die(text);
}

static void put_ref(struct packing *p, int64_t ref)
{
    if (p->refs == SHIM_REFS)
        too_much(p, "more objects and functions");
    p->m->refs[p->refs++] = ref;
}

static void put_numbers(struct packing *p, const double *numbers, int count)
{
    if (count < 0 || count > SHIM_NUMBERS - p->numbers)
        too_much(p, "more numbers");
    if (count)
        memcpy(p->m->numbers + p->numbers, numbers, (size_t) count * sizeof *numbers);
    p->numbers += count;
}

static void put_text(struct packing *p, const char *text)
{
    size_t size = strlen(text);
    if (p->text + size + 1 >= SHIM_TEXT)
        too_much(p, "longer texts, or more values,");
    if (strchr(text, SEPARATOR))
        shim_die("a text has the character 31 in it, which stands between the texts of a message");
    p->m->text[p->text++] = SEPARATOR;
    memcpy(p->m->text + p->text, text, size);
    p->text += size;
}

static int numbers_of(const arcl_value *v)
{
    switch (v->kind) {
    case VECTOR:
        return 3;
    case QUATERNION:
        return 4;
    case SIX:
        return 6;
    case POSE:
        return 7;
    default:
        return 0;
    }
}

static void put(struct packing *p, const arcl_value *v)
{
    if (v->kind == INTEGER || v->kind == REAL || v->kind == JOINTS)
        put_numbers(p, &v->number, 1);
    if (v->kind == JOINTS)
        put_numbers(p, v->pointer, (int) v->number);
    else if (v->kind == TEXT)
        put_text(p, v->pointer);
    else if (v->kind == OBJECT)
        put_ref(p, shim_ref(v->pointer));
    else if (v->kind == ANSWERING || v->kind == SILENT)
        put_ref(p, (intptr_t) v->pointer);
    else
        put_numbers(p, v->pointer, numbers_of(v));
}

/* name, kinds and texts stand in the text, one behind the other. */
static void pack(struct message *m, const char *call, void *result, int count, const arcl_value *values)
{
    struct packing p = {m, call, 0, 0, 0};
    char kinds[SHIM_NUMBERS + SHIM_REFS + 1] = {0};
    if (count >= (int) sizeof kinds)
        too_much(&p, "more values");
    for (int i = 0; i < count; i++)
        kinds[i] = (char) values[i].kind;
    p.text = strlen(m->text);
    put_text(&p, kinds);
    put_ref(&p, shim_ref(result));
    for (int i = 0; i < count; i++)
        put(&p, &values[i]);
}

void *arcl_named(const char *name)
{
    char *kept;
    shim_start();
    void *p = shim_new(name, &kept);
    *(char **) p = kept;
    return p;
}

/* What the program prints stands between the engine's traces; a function for which samples wait does not wait for that. */
static void keep_order(void)
{
    if (shim_serving())
        shim_flush_output();
    else
        fflush(stdout);
}

struct message arcl_try(const char *call, void *result, int count, const arcl_value *values)
{
    struct message m = shim_message(OP_ARCL_CALL, call);
    keep_order();
    shim_start();
    pack(&m, call, result, count, values);
    shim_ask(&m);
    return m;
}

struct message arcl_call(const char *call, void *result, int count, const arcl_value *values)
{
    struct message m = arcl_try(call, result, count, values);
    if (m.op == OP_ERROR)
        shim_die(m.text);
    return m;
}

/* ----------------------------------------------------------------------------------------------------- functions */

static void *object(int64_t place)
{
    return place < 0 ? NULL : shim_at(place);
}

/* A function that is called outside of any motion finds one that never began. */
static Motion *motion(int64_t place)
{
    static Motion none = {"", 0, 0};
    return place < 0 ? &none : shim_at(place);
}

/* What a function returns that returns nothing is not looked at. */
static int call_function(const struct cell *c)
{
    intptr_t function = (intptr_t) c->function;
    char text[SHIM_TEXT];
    switch ((enum form) c->form) {
    case OF_TRANSFORM:
        ((void (*)(Trans *, Motion *)) function)(object(c->first), motion(c->second));
        return 0;
    case OF_EVENT:
        return ((int (*)(Event, ROBOT *)) function)((Event) c->first, object(c->second));
    case OF_END:
        ((void (*)(ROBOT *, Motion *)) function)(object(c->first), motion(c->second));
        return 0;
    case OF_FEEDBACK:
        return ((int (*)(Feedback *)) function)(&arcl_cell.feedback);
    case OF_ERROR:
        memcpy(text, c->text, sizeof text);
        return ((int (*)(Event, ROBOT *, const char *)) function)((Event) c->first, object(c->second), text);
    case OF_PREDICATE:
        return ((int (*)(void)) function)();
    case OF_PLACE:
        return ((int (*)(Trans *, ROBOT *)) function)(object(c->first), object(c->second));
    }
    return 0;
}

/* A function may ask what takes another one: its own answer comes last. */
void arcl_obey(void)
{
    int64_t answer = call_function(&arcl_cell);
    keep_order();
    arcl_cell.answer = answer;
}

double arcl_list_treal(int count, const arcl_value *values)
{
    if (!count && shim_serving())
        return arcl_cell.time;
    return arcl_call("ami_treal", NULL, count, values).numbers[0];
}
