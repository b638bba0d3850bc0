/* A task of RCI in C hangs beside that of an arm, and nothing is left for another thread of their processor: no thread
 * ("thread") or no memory ("memory"). Later there is again. With "full" no socket takes anything meanwhile. */
#define _GNU_SOURCE
#include "rci.h"
#include <dlfcn.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

static RCI_TASK *arm, *rogue;
static int no_thread, no_memory, fills, full, tried, waited, endless = 1;

#define IS_SET(word) __atomic_load_n(&(word), __ATOMIC_ACQUIRE)
#define SET(word, to) __atomic_store_n(&(word), to, __ATOMIC_RELEASE)

int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*start)(void *), void *given)
{
    int (*create)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);

    *(void **)&create = dlsym(RTLD_NEXT, "pthread_create");
    return IS_SET(no_thread) ? EAGAIN : create(thread, attr, start, given);
}

void *calloc(size_t count, size_t size)
{
    char *made = 0;
    size_t i;

    if (IS_SET(no_memory))
        errno = ENOMEM;
    else
        made = (char *)malloc(count * size);
    for (i = 0; made != 0 && i < count * size; i++)
        ((volatile char *)made)[i] = 0;
    return made;
}

ssize_t send(int fd, const void *data, size_t size, int flags)
{
    ssize_t (*real)(int, const void *, size_t, int);

    *(void **)&real = dlsym(RTLD_NEXT, "send");
    if (!IS_SET(full))
        return real(fd, data, size, flags);
    SET(tried, 1);
    errno = EAGAIN;
    return -1;
}

int poll(struct pollfd *fds, nfds_t count, int timeout_ms)
{
    int (*real)(struct pollfd *, nfds_t, int);

    *(void **)&real = dlsym(RTLD_NEXT, "poll");
    if (!IS_SET(full) || fds->events != POLLOUT)
        return real(fds, count, timeout_ms);
    if (timeout_ms != 0)
        __atomic_fetch_add(&waited, 1, __ATOMIC_RELEASE);
    return 0;
}

static void stay(RCI_TASK *td) { rci_goto(td, td->how.q_setpoint); }
static void hang(RCI_TASK *td)
{
    (void)td;
    SET(full, IS_SET(fills));
    while (IS_SET(endless))
        continue;
}
static int forever(void) { return 0; }
static int moved(void) { return rci_runs(arm) > 5; }

static void give_up(const char *lack)
{
    int told;

    SET(no_thread, strcmp(lack, "thread") == 0);
    SET(no_memory, strcmp(lack, "memory") == 0);
    rci_start(rogue->bit);
    for (told = 0; told < 2;) /* of both tasks, that they have ended; else the next call would fail by the second one */
        told += rci_wait(forever) < 0;
    printf("%s\n%s\n", rci_taskError(rogue), rci_taskError(arm));
    SET(no_thread, 0);
    SET(no_memory, 0);
    if (IS_SET(full))
        printf("%s to send, waited %d times\n", IS_SET(tried) ? "tried" : "did not try", IS_SET(waited));
    SET(full, 0);
}

int main(int n, char **words)
{
    if (n < 2 || (arm = rci_create("puma560", "")) == 0 || (rogue = rci_create("rogue", "")) == 0)
        return 1;
    if (rci_control(arm, stay, 0, 0) || rci_control(rogue, hang, 0, 0) || rci_onclock(rogue, 1, 0))
        return 1;
    if (rci_timeout(rogue, 0.05) || rci_start(arm->bit) || rci_wait(moved))
        return 2;
    SET(fills, n > 2 && strcmp(words[2], "full") == 0);
    give_up(words[1]);
    if (n > 2 ? rci_powerOff(arm->bit) : rci_start(arm->bit) || rci_wait(moved) || rci_release(arm->bit))
        return 3;
    SET(endless, 0);
    return rci_close();
}
