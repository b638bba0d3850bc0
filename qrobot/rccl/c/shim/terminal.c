/* terminal.c - what the library says to the person at the program's terminal, and hears. A held terminal (Ctrl-S) and a
 * full pipe hold up no stop of an arm.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdio_ext.h>
#include <string.h>
#include <unistd.h>

#include "shim.h"

static char unsaid[4 * SHIM_TEXT]; /* on stderr, which was not ready */

/* A held terminal and a full pipe take nothing. */
static int is_ready(int stream)
{
    struct pollfd wanted = {stream, POLLOUT, 0};
    return poll(&wanted, 1, 0) > 0 && wanted.revents == POLLOUT;
}

/* On stderr; what would have to wait is said when all arms rest. Async-signal-safe. */
void shim_say_now(const char *text)
{
    size_t before = strlen(unsaid);
    if (!*unsaid && is_ready(STDERR_FILENO) && write(STDERR_FILENO, text, strlen(text)) >= 0)
        return;
    strncpy(unsaid + before, text, sizeof unsaid - 1 - before);
}

/* No arm waits for us any more: we wait for the terminal, unless it is gone. */
void shim_say_rest(void)
{
    struct pollfd wanted = {STDERR_FILENO, POLLOUT, 0};
    if (*unsaid && TEMP_FAILURE_RETRY(poll(&wanted, 1, -1)) > 0 && wanted.revents == POLLOUT
        && write(STDERR_FILENO, unsaid, strlen(unsaid)) >= 0)
        *unsaid = 0;
}

void shim_forget_unsaid(void)
{
    *unsaid = 0;
}

/* What the program has printed stands before what we say, where it can without waiting: for another thread that prints,
 * for a terminal that is held, or for a pipe that is full. */
void shim_flush_output(void)
{
    if (ftrylockfile(stdout))
        return;
    if (__fpending(stdout) <= PIPE_BUF && is_ready(fileno_unlocked(stdout))) /* so much a pipe that is ready takes */
        fflush_unlocked(stdout);
    funlockfile(stdout);
}

/* Once: a program may release its arm and end a good while later. */
void shim_say_mess(void)
{
    static volatile sig_atomic_t said = 0;
    if (!mess || said)
        return;
    said = 1;
    shim_say_now(mess);
    shim_say_now("\n");
}

void shim_say(const char *who, const char *text)
{
    if (*text)
        fprintf(stderr, "%s: %s: %s\n", program_invocation_short_name, who, text);
}

/* A line of the standard input, or what fits of it; false at its end. A handler of a signal may interrupt this, and does
 * not end the input, unless the program is to be terminated. */
int shim_read_line(char *line, size_t room)
{
    size_t read = 0;
    int c = 0;
    while (read + 1 < room && c != '\n') {
        errno = 0;
        c = getc(stdin);
        if (c != EOF) {
            line[read++] = (char) c;
        } else if (ferror(stdin) && errno == EINTR && !terminate) {
            clearerr(stdin);
        } else {
            break;
        }
    }
    line[read] = 0;
    return read > 0;
}
