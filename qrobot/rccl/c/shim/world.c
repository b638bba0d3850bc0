/* world.c - transforms and position equations. */
#include <stdarg.h>
#include <string.h>

#include "shim.h"

#define TRANSFORM "a transform"
#define VECTOR "a vector"

enum { FUNCTION = 0, MOST_KINDS = 3 };
enum { WORDS = 4 }; /* EQ, TL and TRANS are 1, 2 and 3 */

/* `word` is what the program has written: the cast of newtrans makes 0 of const. */
static TRSF_PTR new_transform(char *name, int (*kind)(), const char *word)
{
    struct message m = shim_message(OP_NEWTRANS, name);
    if (!strcmp(word, "const"))
        kind = rccl_const;
    shim_need((void *) kind, "newtrans", "const, varb, hold or a function");
    int functional = (intptr_t) kind < 0 || (intptr_t) kind > MOST_KINDS;
    shim_start();
    TRSF_PTR t = shim_new_transform(name);
    t->fn = functional ? kind : NULL;
    t->kind = functional ? FUNCTION : (int) (intptr_t) kind;
    m.n = t->kind;
    m.refs[0] = shim_ref(t);
    shim_call(&m);
    return t;
}

API TRSF_PTR rccl_newtrans(char *name, int (*kind)(), char *word)
{
    return new_transform(name, kind, word);
}

API int freetrans(TRSF_PTR t)
{
    struct message m = shim_message(OP_FREETRANS, "");
    m.refs[0] = shim_ref(t);
    shim_call(&m);
    shim_free(t);
    return YES;
}

/* A transform goes along as its place, and as twelve numbers in case it lies in the program's own memory. */
static void send_transform(struct message *m, int i, const TRSF *t)
{
    const real *field = &t->n.x;
    m->refs[i] = shim_ref(t);
    for (int k = 0; k < 12; k++)
        m->numbers[12 * i + k] = field[k];
}

static TRSF_PTR receive_transform(struct message *m, TRSF_PTR t)
{
    real *field = &t->n.x;
    shim_call(m);
    for (int k = 0; k < 12; k++)
        field[k] = (real) m->numbers[k];
    return t;
}

/* The engine makes a transform as `how` says. */
static TRSF_PTR make(TRSF_PTR t, const char *how, int count, const double *values)
{
    struct message m = shim_message(OP_MAKE, how);
    shim_need(t, how, TRANSFORM);
    shim_start();
    m.refs[0] = shim_ref(t);
    m.n = count;
    memcpy(m.numbers, values, (size_t) count * sizeof *values);
    return receive_transform(&m, t);
}

#define MAKE(t, how, ...) make(t, how, RCCL_VALUES(__VA_ARGS__))
#define NEW(how, ...) MAKE(new_transform(name, rccl_const, ""), how, __VA_ARGS__)

API TRSF_PTR gentr_trsl(char *name, double px, double py, double pz)
{
    return NEW("trsl", px, py, pz);
}

API TRSF_PTR gentr_rot(char *name, double px, double py, double pz, VECT_PTR v, double a)
{
    shim_need(v, "gentr_rot", VECTOR);
    return NEW("rot", px, py, pz, v->x, v->y, v->z, a);
}

API TRSF_PTR gentr_eul(char *name, double px, double py, double pz, double phi, double theta, double psi)
{
    return NEW("eul", px, py, pz, phi, theta, psi);
}

API TRSF_PTR gentr_rpy(char *name, double px, double py, double pz, double roll, double pitch, double yaw)
{
    return NEW("rpy", px, py, pz, roll, pitch, yaw);
}

API TRSF_PTR gentr_pao(char *name, double px, double py, double pz, double ax, double ay, double az, double ox,
                       double oy, double oz)
{
    return NEW("pao", px, py, pz, ax, ay, az, ox, oy, oz);
}

API TRSF_PTR rot(TRSF_PTR t, VECT_PTR v, double angle)
{
    shim_need(v, "rot", VECTOR);
    return MAKE(t, "rot", 0, 0, 0, v->x, v->y, v->z, angle);
}

API TRSF_PTR trsl(TRSF_PTR t, double px, double py, double pz)
{
    return MAKE(t, "trsl", px, py, pz);
}

API TRSF_PTR eul(TRSF_PTR t, double phi, double theta, double psi)
{
    return MAKE(t, "eul", 0, 0, 0, phi, theta, psi);
}

API TRSF_PTR rpy(TRSF_PTR t, double roll, double pitch, double yaw)
{
    return MAKE(t, "rpy", 0, 0, 0, roll, pitch, yaw);
}

/* refs[0] and the first numbers are the first operand's; refs[2] is where the result goes. */
static TRSF_PTR combine(enum op op, TRSF_PTR t, TRSF_PTR left, TRSF_PTR right)
{
    struct message m = shim_message(op, "");
    const char *call = op == OP_TRMULT ? "trmult" : "invert";
    shim_need(t, call, TRANSFORM);
    shim_need(left, call, TRANSFORM);
    shim_need(right, call, TRANSFORM);
    shim_start();
    send_transform(&m, 0, left);
    send_transform(&m, 1, right);
    m.refs[2] = shim_ref(t);
    return receive_transform(&m, t);
}

API TRSF_PTR trmult(TRSF_PTR t, TRSF_PTR left, TRSF_PTR right)
{
    return combine(OP_TRMULT, t, left, right);
}

API TRSF_PTR invert(TRSF_PTR t, TRSF_PTR other)
{
    return combine(OP_INVERT, t, other, other);
}

API TRSF_PTR assigntr(TRSF_PTR t, TRSF_PTR other)
{
    shim_need(t, "assigntr", TRANSFORM);
    shim_need(other, "assigntr", TRANSFORM);
    memcpy(&t->n, &other->n, 4 * sizeof(VECT));
    return t;
}

API int printr(TRSF_PTR t, FILE *file)
{
    shim_need(t, "printr", TRANSFORM);
    shim_need(file, "printr", "a file");
    const real *n = &t->n.x;
    fprintf(file, "%s:\n", t->name ? t->name : "");
    for (int row = 0; row < 3; row++)
        fprintf(file, "%8.3f %8.3f %8.3f %10.3f\n", n[row], n[row + 3], n[row + 6], n[row + 9]);
    return YES;
}

/* ------------------------------------------------------------------------------------------------- positions */

static POS_PTR new_position(struct message *m, char *name)
{
    POS_PTR p = shim_new_position(name);
    m->refs[0] = shim_ref(p);
    shim_call(m);
    return p;
}

/* The engine says what is wrong with the equation. */
int64_t shim_term(TRSF_PTR t)
{
    return (uintptr_t) t < WORDS ? -1 - (int64_t) (intptr_t) t : shim_ref(t);
}

API POS_PTR rccl_makeposition(char *name, ...)
{
    struct message m = shim_message(OP_MAKEPOSITION, name);
    va_list terms;
    TRSF_PTR t;
    shim_start();
    va_start(terms, name);
    while ((t = va_arg(terms, TRSF_PTR))) {
        if (m.n == SHIM_REFS - 1)
            shim_die("makeposition: an equation of more terms than fit");
        m.refs[++m.n] = shim_term(t);
    }
    va_end(terms);
    return new_position(&m, name);
}

API POS_PTR rccl_jposition(char *name, int count, double *degs)
{
    struct message m = shim_message(OP_JPOSITION, name);
    shim_start();
    m.n = count < SHIM_NUMBERS ? count : SHIM_NUMBERS;
    memcpy(m.numbers, degs, (size_t) m.n * sizeof *degs);
    return new_position(&m, name);
}

API int freepos(POS_PTR p)
{
    struct message m = shim_message(OP_FREEPOS, "");
    m.refs[0] = shim_ref(p);
    shim_call(&m);
    shim_free(p);
    return YES;
}

static int of_transform_and_position(enum op op, TRSF_PTR trans, POS_PTR pos)
{
    struct message m = shim_message(op, "");
    m.refs[0] = shim_ref(trans);
    m.refs[1] = shim_ref(pos);
    return shim_call(&m)->n;
}

API int update(TRSF_PTR trans, POS_PTR equa)
{
    of_transform_and_position(OP_UPDATE, trans, equa);
    return YES;
}

API int teach(TRSF_PTR trans, POS_PTR pos)
{
    return of_transform_and_position(OP_TEACH, trans, pos);
}

/* ------------------------------------------------------------------------------------------------- data base */

static int of_transform(enum op op, TRSF_PTR t)
{
    struct message m = shim_message(op, "");
    m.refs[0] = shim_ref(t);
    return shim_call(&m)->n;
}

API int makedb(char *file)
{
    struct message m = shim_message(OP_MAKEDB, shim_need(file, "makedb", "the name of a file"));
    if (strlen(file) >= SHIM_TEXT)
        shim_die("makedb: the name of the file is too long");
    shim_call(&m);
    return YES;
}

API int getr(TRSF_PTR t)
{
    return of_transform(OP_GETR, t);
}

API int saver(TRSF_PTR t)
{
    return of_transform(OP_SAVER, t);
}

API int dumpdb(void)
{
    struct message m = shim_message(OP_DUMPDB, "");
    shim_call(&m);
    return YES;
}
