/* A program in C whose thread forks children while rci_start connects to an arm: as its link has just been zeroed, and
 * as its socket begins to connect. Prints for each what it has: its standard streams, and sockets of the program. */
#define _GNU_SOURCE
#include "rci.h"
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define LINK_BYTES 8192 /* nothing smaller is a link */

static RCI_TASK *arm;
static int connects, has_child;

static int look(void)
{
    struct stat found;
    int fd, streams = 0, sockets = 0;

    for (fd = 0; fd < 256; fd++)
        if (fstat(fd, &found) == 0) {
            streams += fd <= STDERR_FILENO;
            sockets += fd > STDERR_FILENO && S_ISSOCK(found.st_mode);
        }
    return 16 * streams + sockets;
}

static void have_child(const char *where)
{
    int child, status = 0;

    if (!connects || has_child)
        return;
    has_child = 1;
    if ((child = fork()) == 0)
        _exit(look());
    if (waitpid(child, &status, 0) != child || !WIFEXITED(status))
        _exit(9);
    printf("%s: %d streams, %d sockets\n", where, WEXITSTATUS(status) / 16, WEXITSTATUS(status) % 16);
    has_child = 0;
}

void *memset(void *at, int value, size_t size)
{
    size_t i;

    for (i = 0; i < size; i++)
        ((volatile char *)at)[i] = (char)value;
    if (size >= LINK_BYTES)
        have_child("zeroed");
    return at;
}

int connect(int fd, const struct sockaddr *address, socklen_t size)
{
    int (*real)(int, const struct sockaddr *, socklen_t);

    *(void **)&real = dlsym(RTLD_NEXT, "connect");
    have_child("connects");
    return real(fd, address, size);
}

static void stay(RCI_TASK *td) { rci_goto(td, td->how.q_setpoint); }
static int moved(void) { return rci_runs(arm) > 5; }

int main(void)
{
    if ((arm = rci_create("puma560", "")) == 0 || rci_control(arm, stay, 0, 0))
        return 1;
    connects = 1;
    if (rci_start(arm->bit))
        return 2;
    connects = 0;
    return rci_wait(moved) || rci_close();
}
