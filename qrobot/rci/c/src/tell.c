/* What people are told, on stderr. A terminal may be held (Ctrl-S) and a pipe full: while tasks run, a thread of its
 * own writes the lines, one after another, at the priority of an ordinary program, and no task waits for it. */
#include "inside.h"

#include <semaphore.h>

#define LINES 256                          /* that wait; what is told beyond them is lost, and counted */
#define LINE_BYTES (TEXT_BYTES + NAME_BYTES + 16)
#define ORDER_NS (NS / 10)                 /* so long the planning program waits for its line, to keep the order */
#define END_NS NS                          /* and at the end for all of them */

static struct {
    pthread_mutex_t lock;                  /* held while a line is copied, and while nothing is written */
    sem_t more;
    pthread_t thread;
    int running, over, noting;             /* the last: how many lines are missing is being written */
    long put, written, lost;               /* lines */
    long given_up;                         /* so many of them were waited for at an end, and are not again */
    char lines[LINES][LINE_BYTES];
} told;
static __thread char unsaid[LINE_BYTES];   /* while this thread has the lock of all tasks */

void rci_tell_begin(void)
{
    rci_make_lock(&told.lock);
    sem_init(&told.more, 0, 0);
    told.running = told.over = told.noting = 0;
    told.put = told.written = told.lost = told.given_up = 0;
    unsaid[0] = '\0';
}

/* Handlers of signals tell people as well. */
static void lock(sigset_t *before)
{
    rci_block_signals(before);
    pthread_mutex_lock(&told.lock);
}

static void unlock(const sigset_t *before)
{
    pthread_mutex_unlock(&told.lock);
    pthread_sigmask(SIG_SETMASK, before, NULL);
}

/* A whole line at once, whatever the stream makes of it. */
static void write_line(const char *text)
{
    struct pollfd wanted = {STDERR_FILENO, POLLOUT, 0};
    char line[LINE_BYTES + 1];
    size_t size = (size_t)snprintf(line, sizeof line, "%s\n", text), done = 0;

    while (done < size) {
        ssize_t count = write(STDERR_FILENO, line + done, size - done);

        if (count < 0 && errno == EAGAIN)
            poll(&wanted, 1, -1);
        else if (count < 0 && errno != EINTR)
            return;
        done += count > 0 ? (size_t)count : 0;
    }
}

enum next { NOTHING, LINE, NOTE, OVER };

/* The next line, or behind the last one a note of how many there was no room for. */
static enum next next_line(char line[LINE_BYTES])
{
    sigset_t before;
    enum next found = NOTHING;

    lock(&before);
    if (told.over) {
        found = OVER;
    } else if (told.written < told.put) {
        memcpy(line, told.lines[told.written % LINES], LINE_BYTES);
        found = LINE;
    } else if (told.lost > 0) {
        snprintf(line, LINE_BYTES, "rci: %ld lines are missing here: stderr took none", told.lost);
        told.lost = 0;
        told.noting = 1;
        found = NOTE;
    }
    unlock(&before);
    return found;
}

static void *write_lines(void *argument)
{
    char line[LINE_BYTES];
    struct sched_param none;
    sigset_t before;
    enum next found;

    rci_signals_are_blocked();
    memset(&none, 0, sizeof none);
    pthread_setschedparam(pthread_self(), SCHED_OTHER, &none); /* the planning program may have a priority */
    while ((found = next_line(line)) != OVER) {
        if (found == NOTHING) {
            sem_wait(&told.more);
            continue;
        }
        write_line(line);
        lock(&before);
        told.written += found == LINE;
        told.noting = 0;
        unlock(&before);
    }
    return argument;
}

/* Start the thread. Returns 0, or -1. */
int rci_tell_start(void)
{
    sigset_t before;
    int error;

    if (told.running)
        return 0;
    told.over = 0;
    rci_block_signals(&before);
    error = pthread_create(&told.thread, NULL, write_lines, NULL);
    told.running = error == 0;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return error == 0 ? 0 : rci_fail("rci_start: no thread: %s", strerror(error));
}

/* Whether so many lines were written, and nothing else is to be. told.lock is held. */
static int is_told(long number)
{
    return told.written >= number && told.lost == 0 && !told.noting;
}

/* Wait until a number of lines were written, or for so long. Returns whether they were. */
static int await(long number, int64_t longest_ns)
{
    const struct timespec moment = {0, 1000000};
    int64_t until_ns = qrobot_now_ns() + longest_ns;
    sigset_t before;
    int done;

    for (;;) {
        lock(&before);
        done = is_told(number);
        unlock(&before);
        if (done || qrobot_now_ns() >= until_ns)
            return done;
        nanosleep(&moment, NULL);
    }
}

/* Wait a second at most for what is still to be written, and never again for the same. Returns whether it was. */
int rci_tell_all(void)
{
    sigset_t before;
    long number, given_up;

    if (!told.running)
        return 1;
    lock(&before);
    number = told.put;
    given_up = told.given_up;
    told.given_up = number;
    unlock(&before);
    return await(number, number > given_up ? END_NS : 0);
}

/* End the thread, unless it is held: then it writes on when it can. */
void rci_tell_end(void)
{
    sigset_t before;
    int over;

    if (!told.running || !rci_tell_all())
        return;
    lock(&before);
    over = told.over = is_told(told.put); /* a function that was given up may have said more */
    unlock(&before);
    if (!over)
        return;
    sem_post(&told.more);
    pthread_join(told.thread, NULL);
    told.running = 0;
}

/* Put a line into the queue. Returns its number, 0 when there is no room: none until those before are told. */
static long put(const char *line)
{
    sigset_t before;
    long number = 0;
    int wakes; /* those behind the first that is lost are counted at the same look */

    lock(&before);
    wakes = told.lost == 0;
    if (told.lost == 0 && told.put - told.written < LINES) {
        snprintf(told.lines[told.put % LINES], LINE_BYTES, "%s", line);
        number = ++told.put;
    } else {
        told.lost++;
    }
    unlock(&before);
    if (wakes)
        sem_post(&told.more);
    return number;
}

/* Say a line on stderr. Only the planning program ever waits for the stream, and not while it has the lock of all
 * tasks; a thread of ours never does. */
void rci_say(const char *format, ...)
{
    char line[LINE_BYTES];
    va_list values;

    va_start(values, format);
    vsnprintf(line, sizeof line, format, values);
    va_end(values);
    if (told.running) {
        long number = put(line);

        if (number > 0 && !rci_may_not_wait())
            await(number, ORDER_NS);
    } else if (rci_may_not_wait()) {
        memcpy(unsaid, line, sizeof line);
    } else {
        fprintf(stderr, "%s\n", line);
    }
}

/* Say what was to be said while this thread had the lock. */
void rci_say_the_unsaid(void)
{
    char line[LINE_BYTES];

    if (unsaid[0] == '\0')
        return;
    memcpy(line, unsaid, sizeof line);
    unsaid[0] = '\0';
    rci_say("%s", line);
}
