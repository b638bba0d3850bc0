/* A task of RCI in C whose device's far end is closed while something is left to read: a pipe, a pair of sockets, or a
 * pair of which the far end still hears ("half"). The second word "asked" has a wake-up function asked by the device. A
 * "file" or folder is none; its name is the second word. */
#include "rci.h"
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static RCI_TASK *td;
static int ends[2], letters, empty, asked;

static int take(void)
{
    char letter;

    if (read(ends[0], &letter, 1) == 1)
        return __atomic_add_fetch(&letters, 1, __ATOMIC_RELEASE);
    empty++;
    return 0;
}
static void read_letter(RCI_TASK *td)
{
    (void)td;
    if (!asked)
        take();
}
static int forever(void) { return 0; }
static int three(void) { return __atomic_load_n(&letters, __ATOMIC_ACQUIRE) == 3 && rci_runCount(td) == 0; }

static int make_ends(const char *kind, const char *place)
{
    if (strcmp(kind, "file") == 0)
        return (ends[0] = open(place, O_RDONLY)) < 0;
    return strcmp(kind, "pipe") == 0 ? pipe(ends) : socketpair(AF_UNIX, SOCK_STREAM, 0, ends);
}

int main(int n, char **words)
{
    const char *kind = n > 1 ? words[1] : "";

    asked = n > 2 && strcmp(words[2], "asked") == 0;
    if (make_ends(kind, words[n - 1]) || (td = rci_create("device", "")) == 0 || rci_control(td, read_letter, 0, 0))
        return 1;
    if (rci_deviceInterrupt(td, ends[0]) || (asked && rci_onfunction(td, take)))
        return 2;
    if (write(ends[1], "ab", 2) != 2 || (strcmp(kind, "half") == 0 ? shutdown(ends[1], SHUT_WR) : close(ends[1])))
        return 3;
    if (rci_start(td->bit) || rci_wait(forever) == 0) /* both letters are read first */
        return 4;
    printf("%s; %d letters, %d reads of none\n", rci_taskError(td), letters, empty);
    close(ends[0]);
    if (make_ends(kind, words[n - 1]) || rci_deviceInterrupt(td, ends[0]) || rci_start(td->bit)) /* with another one */
        return 5;
    return write(ends[1], "c", 1) != 1 || rci_wait(three) || rci_close();
}
