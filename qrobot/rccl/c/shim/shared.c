/* shared.c - the memory that program and engine share: the global variables of rccl.h, then transforms and positions.
 *
 * Every word has one writer at a time: the engine writes what it reports, the program what it asks. Event counts, which
 * both change, are changed in this process alone, by atomic instructions.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "shim.h"

#define ARENA_BYTES (64 << 20) /* takes memory only as far as it is used */

static VECT x_axis = {1, 0, 0}, y_axis = {0, 1, 0}, z_axis = {0, 0, 1};
VECT_PTR xunit = &x_axis, yunit = &y_axis, zunit = &z_axis;
char *mess = NULL;

struct variables {
    struct shim_cell shim_cell;
    volatile int nextmove __attribute__((aligned(64))); /* not in the cache line of the cell, where both sides wait */
    volatile event completed;
    volatile int nbrequest, terminate;
    volatile struct rccl_how how;
    volatile struct rccl_chg chg;
    TRSF last_link;
    POS park, present;
};

static SHARED WHOLE_PAGES(struct variables) variables = {
    .of = {.completed = 1,
           .last_link = {"T6", NULL, 0, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}},
           .park = {"park", 0, 0, 0},
           .present = {"there", 0, 0, 0}},
};
TRSF_PTR t6 = &variables.of.last_link;
POS_PTR park = &variables.of.park, there = &variables.of.present;

/* Those that others declare get names of their own here, in assembly; the function is never called. */
#define NAMED(variable) \
    __asm__ volatile(".globl " #variable "\n\t.set " #variable ", variables + %c0" \
                     : \
                     : "i"(offsetof(struct variables, variable)))

__attribute__((used)) static void name_variables(void)
{
    NAMED(shim_cell);
    NAMED(nextmove);
    NAMED(completed);
    NAMED(nbrequest);
    NAMED(terminate);
    NAMED(how);
    NAMED(chg);
}

extern char __start_rccl_shared[], __stop_rccl_shared[]; /* the linker's names for the section's ends */

/* Names lie with what they name: who looks for leaks does not look into shared memory for pointers. */
struct slot {
    union {
        TRSF transform;
        POS position;
        struct slot *next;
        char room[SHIM_ROOM];
    } of;
    char name[SHIM_NAME];
    int used;
};

static char *first_page, *arena;
static ptrdiff_t pages;
static struct slot *unused, *fresh;
static pthread_mutex_t allocating = PTHREAD_MUTEX_INITIALIZER;

/* Byte by byte and unseen by sanitizers, who rightly wonder at a copy across neighbouring variables. */
__attribute__((no_sanitize("address", "undefined"))) static void copy_pages(char *to, const char *from, size_t size)
{
    for (size_t i = 0; i < size; i++)
        ((volatile char *) to)[i] = ((const volatile char *) from)[i];
}

/* The pages of the variables become pages of a file with the same content. What handlers of signals write to them
 * meanwhile would be lost: so they wait. */
static int share_pages(void)
{
    uintptr_t page = (uintptr_t) sysconf(_SC_PAGESIZE);
    char *first = (char *) ((uintptr_t) __start_rccl_shared / page * page);
    size_t size = ((uintptr_t) __stop_rccl_shared + page - 1) / page * page - (uintptr_t) first;
    int file = memfd_create("rccl", MFD_CLOEXEC);
    if (file < 0 || TEMP_FAILURE_RETRY(ftruncate(file, (off_t) size + ARENA_BYTES)))
        shim_die("no memory to share with the motion engine");
    char *whole = mmap(NULL, size + ARENA_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (whole == MAP_FAILED)
        shim_die("cannot share memory with the motion engine");
    copy_pages(whole, first, size);
    first_page = first;
    pages = (ptrdiff_t) size;
    arena = whole + size;
    fresh = (struct slot *) arena;
    if (mmap(first, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED, file, 0) == MAP_FAILED)
        shim_die("cannot share the variables with the motion engine");
    return file;
}

int shim_share(void)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int file = share_pages();
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return file;
}

/* Pages of our own with the same content. */
static void own(char *at, size_t size)
{
    char *copy = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (copy != MAP_FAILED) {
        copy_pages(copy, at, size);
        copy = mremap(copy, size, size, MREMAP_MAYMOVE | MREMAP_FIXED, at);
    }
    if (copy != MAP_FAILED)
        return;
    shim_say_now("a child of the program has no memory to keep its variables apart from the motion engine\n");
    _exit(EXIT_FAILURE);
}

/* A child makes no transforms and positions: what is not in use yet it does without. */
void shim_unshare(void)
{
    if (!arena)
        return;
    size_t page = (size_t) sysconf(_SC_PAGESIZE), used = (size_t) ((char *) fresh - arena);
    used = (used + page - 1) / page * page;
    own(first_page, (size_t) pages);
    if (used)
        own(arena, used);
    munmap(arena + used, ARENA_BYTES - used);
}

int64_t shim_ref(const volatile void *p)
{
    const volatile char *at = p;
    if (at >= first_page && at < first_page + pages)
        return at - first_page;
    if (at >= arena && at < arena + ARENA_BYTES)
        return pages + (at - arena);
    return -1;
}

void *shim_at(int64_t ref)
{
    return ref < pages ? first_page + ref : arena + (ref - pages);
}

static struct slot *take_slot(void)
{
    struct slot *slot = NULL;
    pthread_mutex_lock(&allocating);
    if (unused) {
        slot = unused;
        unused = slot->of.next;
    } else if ((char *) (fresh + 1) <= arena + ARENA_BYTES) {
        slot = fresh++;
    }
    pthread_mutex_unlock(&allocating);
    return slot;
}

void *shim_new(const char *name, char **kept)
{
    struct slot *slot = take_slot();
    if (!slot)
        shim_die("too many transforms and positions: free those of no more use (freetrans and freepos, or arcl_free)");
    memset(slot, 0, sizeof *slot);
    strncpy(slot->name, name ? name : "", SHIM_NAME - 1);
    slot->used = 1;
    *kept = slot->name;
    return slot;
}

TRSF_PTR shim_new_transform(const char *name)
{
    char *kept;
    TRSF_PTR t = shim_new(name, &kept);
    t->name = kept;
    return t;
}

POS_PTR shim_new_position(const char *name)
{
    char *kept;
    POS_PTR p = shim_new(name, &kept);
    p->name = kept;
    return p;
}

int shim_used(const void *p)
{
    ptrdiff_t place = (const char *) p - arena;
    return arena && place >= 0 && place < (char *) fresh - arena && place % (ptrdiff_t) sizeof(struct slot) == 0
        && ((const struct slot *) p)->used;
}

void shim_free(void *p)
{
    struct slot *slot = p;
    pthread_mutex_lock(&allocating);
    slot->used = 0;
    slot->of.next = unused;
    unused = slot;
    pthread_mutex_unlock(&allocating);
}

/* The order is that of message.py. */
void shim_globals(int64_t *refs)
{
    const volatile void *places[] = {&nextmove, &completed, &nbrequest, &terminate, &how, &chg, t6, park, there};
    size_t count = sizeof places / sizeof *places;
    for (size_t i = 0; i < count; i++)
        refs[i] = shim_ref(places[i]);
    refs[count++] = offsetof(TRSF, n);
    refs[count++] = offsetof(POS, code);
    refs[count++] = offsetof(POS, scal);
    refs[count++] = offsetof(POS, end);
    refs[count++] = shim_ref(&shim_cell);
    refs[count++] = arcl_obey ? 1 : rccl_has_manipulators ? 2 : 0; /* the language: RCCL, ARCL, Multi-RCCL */
    refs[count++] = arcl_obey ? arcl_cell_place() : 0;
    refs[count] = getpid();
}
