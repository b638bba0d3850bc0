/* A library to preload: the wall clock of a process and of its children goes SCALED_CLOCK times as fast.
 *
 * Clocks start at the origin that SCALED_CLOCK_ORIGIN names, CLOCK_MONOTONIC and CLOCK_REALTIME in ns, so that they agree
 * between processes. Sleeps and time-outs are shortened alike. CPU time, file times and timers with signals stay.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/select.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const int64_t SECOND = 1000000000;
static double scale;
static int64_t origin[2]; /* of CLOCK_MONOTONIC, of CLOCK_REALTIME */

static void read_environment(void)
{
    const char *text = getenv("SCALED_CLOCK"), *from = getenv("SCALED_CLOCK_ORIGIN");
    long long monotonic = 0, realtime = 0;

    if (scale != 0.)
        return;
    if (from)
        sscanf(from, "%lld,%lld", &monotonic, &realtime);
    origin[0] = monotonic;
    origin[1] = realtime;
    scale = text && from ? atof(text) : 1.;
}

static int64_t ns_of(const struct timespec *t) { return t->tv_sec * SECOND + t->tv_nsec; }

static struct timespec timespec_of(int64_t ns)
{
    return (struct timespec){ns > 0 ? ns / SECOND : 0, ns > 0 ? ns % SECOND : 0};
}

static int is_realtime(clockid_t clock) { return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE; }

static int is_cpu_time(clockid_t clock)
{
    return clock < 0 || clock == CLOCK_PROCESS_CPUTIME_ID || clock == CLOCK_THREAD_CPUTIME_ID;
}

static int64_t scaled(clockid_t clock, int64_t ns)
{
    int64_t from = origin[is_realtime(clock)];
    return from + (int64_t)((ns - from) * scale);
}

static struct timespec unscaled(clockid_t clock, const struct timespec *t)
{
    int64_t from = origin[is_realtime(clock)];
    return timespec_of(from + (int64_t)((ns_of(t) - from) / scale));
}

static struct timespec shortened(const struct timespec *t)
{
    read_environment();
    return timespec_of((int64_t)(ns_of(t) / scale));
}

static int shortened_ms(int ms)
{
    read_environment();
    return ms <= 0 ? ms : (int)(ms / scale) + 1;
}

/* ------------------------------------------------------------------------------------------------------------ clocks */

int clock_gettime(clockid_t clock, struct timespec *now)
{
    int status = (int)syscall(SYS_clock_gettime, clock, now);

    read_environment();
    if (status == 0 && !is_cpu_time(clock))
        *now = timespec_of(scaled(clock, ns_of(now)));
    return status;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec t;

    (void)zone;
    clock_gettime(CLOCK_REALTIME, &t);
    *now = (struct timeval){t.tv_sec, t.tv_nsec / 1000};
    return 0;
}

time_t time(time_t *now)
{
    struct timespec t;

    clock_gettime(CLOCK_REALTIME, &t);
    return now ? (*now = t.tv_sec) : t.tv_sec;
}

/* ------------------------------------------------------------------------------------------------------------ sleeps */

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *until, struct timespec *left)
{
    struct timespec t;

    read_environment();
    t = flags & TIMER_ABSTIME ? unscaled(clock, until) : shortened(until);
    return syscall(SYS_clock_nanosleep, clock, flags, &t, left) == 0 ? 0 : errno;
}

int nanosleep(const struct timespec *duration, struct timespec *left)
{
    int error = clock_nanosleep(CLOCK_MONOTONIC, 0, duration, left);

    errno = error ? error : errno;
    return error ? -1 : 0;
}

int usleep(useconds_t us)
{
    struct timespec t = timespec_of((int64_t)us * 1000);
    return nanosleep(&t, NULL);
}

unsigned int sleep(unsigned int seconds)
{
    struct timespec t = {seconds, 0};
    return nanosleep(&t, NULL) ? 1 : 0;
}

/* ------------------------------------------------------------------------------------------------- waits with a bound */

#define NEXT(function) ((__typeof__(&function))dlsym(RTLD_NEXT, #function))

int poll(struct pollfd *fds, nfds_t count, int ms)
{
    struct timespec t = timespec_of((int64_t)shortened_ms(ms) * 1000000);
    return (int)syscall(SYS_ppoll, fds, count, ms < 0 ? NULL : &t, NULL, 8);
}

int ppoll(struct pollfd *fds, nfds_t count, const struct timespec *bound, const sigset_t *mask)
{
    struct timespec t = bound ? shortened(bound) : (struct timespec){0, 0};
    return (int)syscall(SYS_ppoll, fds, count, bound ? &t : NULL, mask, 8);
}

int select(int count, fd_set *in, fd_set *out, fd_set *error, struct timeval *bound)
{
    struct timespec given = bound ? (struct timespec){bound->tv_sec, bound->tv_usec * 1000} : (struct timespec){0, 0};
    struct timespec t = shortened(&given);
    return (int)syscall(SYS_pselect6, count, in, out, error, bound ? &t : NULL, NULL);
}

int epoll_wait(int epoll, struct epoll_event *events, int most, int ms)
{
    return NEXT(epoll_wait)(epoll, events, most, shortened_ms(ms));
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const struct timespec *until)
{
    struct timespec t;

    read_environment();
    t = unscaled(clock, until);
    return NEXT(sem_clockwait)(semaphore, clock, &t);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until)
{
    struct timespec t;

    read_environment();
    t = unscaled(CLOCK_REALTIME, until);
    return NEXT(sem_timedwait)(semaphore, &t);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock, const struct timespec *until)
{
    struct timespec t;

    read_environment();
    t = unscaled(clock, until);
    return NEXT(pthread_cond_clockwait)(condition, mutex, clock, &t);
}

/* Its clock is an attribute of the condition: a time in this century is that of CLOCK_REALTIME. */
int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until)
{
    struct timespec t;

    read_environment();
    t = unscaled(until->tv_sec > 946684800 ? CLOCK_REALTIME : CLOCK_MONOTONIC, until);
    return NEXT(pthread_cond_timedwait)(condition, mutex, &t);
}
