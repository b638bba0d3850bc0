/* arcl_call.h - between the calls of arcl.h and their messages. */
#ifndef ARCL_CALL_H
#define ARCL_CALL_H

#include "arcl.h"
#include "channel.h"

/* Kinds of values; mirrored in qrobot/arcl/c/values.py. */
enum kind {
    INTEGER = 'i',
    REAL = 'd',
    TEXT = 's',
    WORDS = 'a',
    NOTHING = 'z',
    OBJECT = 'o',
    MARK_EQ = 'E',
    MARK_TL = 'L',
    LAST_LINK = '6',
    VECTOR = 'V',
    SIX = 'D',
    QUATERNION = 'Q',
    POSE = 'W',
    JOINTS = 'J',
    ANSWERING = 'f',
    SILENT = 'v',
    STRANGE = '?'
};

#define LIST(...) (int) (sizeof((arcl_value[]) {__VA_ARGS__}) / sizeof(arcl_value)), ((arcl_value[]) {__VA_ARGS__})

/* Ask the engine for `call` with these values; `result` is the object that it makes. Ends the program on an error. */
struct message arcl_call(const char *call, void *result, int count, const arcl_value *values);
/* The same; an error is in the message. */
struct message arcl_try(const char *call, void *result, int count, const arcl_value *values);
arcl_value arcl_numbers(enum kind kind, const void *numbers);

/* A new object that begins with its name. */
void *arcl_named(const char *name);
/* What arcl_free does: that is weak, as all functions of arcl.h are, and may be the program's own. */
void arcl_give_back(void *object);

#endif
