/* rccl_world.h - what both releases of RCCL have: transforms, positions, the data base. Programs include rccl.h.
 *
 * Millimetres, degrees; rccl.h says more.
 */
#ifndef RCCL_WORLD_H
#define RCCL_WORLD_H

#include <stdio.h> /* printr writes to a file */

#if !defined bool && !defined __cplusplus && !(defined __STDC_VERSION__ && __STDC_VERSION__ >= 202311L)
typedef int bool;
#endif
typedef float real;
typedef int event;

/* The motion engine and the library have to find a field where the program has it. */
#ifdef __cplusplus
#define RCCL_LAYOUT(type, field, place)
#else
#define RCCL_LAYOUT(type, field, place)                                                               \
    __extension__ _Static_assert(__builtin_offsetof(type, field) == (place),                          \
                                 "structures lie otherwise here than the motion engine reads them: "  \
                                 "compile for 64 bits, without options that change layouts, such as " \
                                 "-m32 or -fpack-struct")
#endif

#define YES 1
#define NO 0

/* ------------------------------------------------------------------------------------------------- transforms */

typedef struct vector {
    real x, y, z;
} VECT, *VECT_PTR;

typedef struct transform {
    char *name;
    int (*fn)(); /* of a functional one: called at every sample */
    int kind;
    VECT n, o, a, p; /* three axes, and a position in mm */
} TRSF, *TRSF_PTR;
RCCL_LAYOUT(TRSF, n, 20);

/* What is a macro here was a function, and may be declared as one: `TRSF_PTR newtrans();` declares, and does nothing else.
 * RCCL_CALL(f, g, ...) is f where there are arguments, and g where there are none. */
#define RCCL_FIRST(first, ...) first
#define RCCL_CALL(call, name, ...) RCCL_FIRST(__VA_OPT__(call, ) name, ~)

/* The kinds of newtrans: what is none of them is a function. What the gentr_ functions make is const. These three are for
 * functions of a program that take a kind themselves; const, hold and varb are known to newtrans alone, so that variables
 * may have such names. */
#define rccl_const ((int (*)()) 1)
#define rccl_varb ((int (*)()) 2)
#define rccl_hold ((int (*)()) 3)

/* `const` was an ordinary name when RCCL was written, and is a keyword now. So that it may stand where else a function
 * does, `(type) - 0` is written for it: with a function that is a difference, with const it casts 0 to a const int. */
#define newtrans(...) RCCL_CALL(RCCL_NEWTRANS, newtrans, __VA_ARGS__)(__VA_ARGS__)
#define RCCL_NEWTRANS(name, type)                                                                     \
    __extension__({                                                                                   \
        char *rccl_name = (name);                                                                     \
        enum { varb = 2, hold = 3 };                                                                  \
        _Pragma("GCC diagnostic push") _Pragma("GCC diagnostic ignored \"-Wimplicit-int\"")           \
        int (*rccl_kind)() = (int (*)()) (long) ((type) - 0);                                         \
        _Pragma("GCC diagnostic pop")                                                                 \
        rccl_newtrans(rccl_name, rccl_kind, #type);                                                   \
    })

extern VECT_PTR xunit, yunit, zunit;

TRSF_PTR newtrans();
TRSF_PTR rccl_newtrans(char *name, int (*kind)(), char *word);
TRSF_PTR gentr_trsl(char *name, double px, double py, double pz);
TRSF_PTR gentr_rot(char *name, double px, double py, double pz, VECT_PTR v, double a);
TRSF_PTR gentr_eul(char *name, double px, double py, double pz, double phi, double theta, double psi);
TRSF_PTR gentr_rpy(char *name, double px, double py, double pz, double roll, double pitch, double yaw);
TRSF_PTR gentr_pao(char *name, double px, double py, double pz, double ax, double ay, double az, double ox, double oy,
                   double oz);
int freetrans(TRSF_PTR t);

/* These change their first argument and return it. */
TRSF_PTR rot(TRSF_PTR t, VECT_PTR v, double angle);
TRSF_PTR trsl(TRSF_PTR t, double px, double py, double pz);
TRSF_PTR eul(TRSF_PTR t, double phi, double theta, double psi);
TRSF_PTR rpy(TRSF_PTR t, double roll, double pitch, double yaw);
TRSF_PTR assigntr(TRSF_PTR t, TRSF_PTR other);
TRSF_PTR trmult(TRSF_PTR t, TRSF_PTR left, TRSF_PTR right);
TRSF_PTR invert(TRSF_PTR t, TRSF_PTR other);
#define Rot (void) rot
#define Trsl (void) trsl
#define Eul (void) eul
#define Rpy (void) rpy
#define Assigntr (void) assigntr
#define Trmult (void) trmult
#define Invert (void) invert
int printr(TRSF_PTR t, FILE *file);

/* -------------------------------------------------------------------------------------------------- positions */

typedef struct position {
    char *name;
    volatile int code;   /* why the latest motion to it ended: -1 at its goal, or the number given to nextmove; 0 before */
    volatile float scal; /* 0 from `move` on, grows to 1 during the motion */
    volatile event end;  /* signalled at the end of each motion */
} POS, *POS_PTR;
RCCL_LAYOUT(POS, end, 16);

#define EQ ((TRSF_PTR) 1)
#define TL ((TRSF_PTR) 2)

extern POS_PTR there; /* always where the arm is, so that a move to it is an absolute stop */

int freepos(POS_PTR p);

/* How many numbers there are, and they themselves, integers among them made into floating point. */
#define RCCL_VALUES(...) ((int) (sizeof((double[]) {__VA_ARGS__}) / sizeof(double))), ((double[]) {__VA_ARGS__})

/* -------------------------------------------------------------------------------------------------- data base */

int makedb(char *file);
int getr(TRSF_PTR t);
int saver(TRSF_PTR t);
int dumpdb(void);

#define RCCL_JOINTS 32 /* of a robot, at most */

#endif
