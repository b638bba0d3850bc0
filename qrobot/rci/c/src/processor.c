/* Processors: threads that run tasks, one thread for each name. */
#include "inside.h"

#include <sched.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>

#define PRIORITY 20            /* of qrobot/rci/host_thread.py: behind bridge and servo, ahead of ordinary programs */
#define SILENT_NS (2 * NS)     /* a robot that says nothing for so long is gone */
#define LOOK_NS (NS / 10)

/* The number behind a prefix: -1 without one, -2 when that is not what the name is. */
static int number_of(const char *name, const char *prefix)
{
    size_t length = strlen(prefix);
    char *end;
    long number;

    if (strncmp(name, prefix, length) != 0)
        return -2;
    if (name[length] == '\0')
        return -1;
    number = strtol(name + length, &end, 10);
    return name[length] >= '0' && name[length] <= '9' && *end == '\0' && number < CPU_SETSIZE ? (int)number : -2;
}

static int is_allowed_cpu(int cpu)
{
    cpu_set_t allowed;

    return cpu >= 0 && sched_getaffinity(0, sizeof allowed, &allowed) == 0 && CPU_ISSET(cpu, &allowed);
}

/* A pipe above the standard streams, which may be closed: what the program prints is no order. Returns 0, or -1. */
static int make_pipe(int ends[2])
{
    int low[2], error = 0;

    if (pipe2(low, O_CLOEXEC | O_NONBLOCK) != 0)
        return -1;
    for (int i = 0; i < 2; i++) {
        ends[i] = fcntl(low[i], F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
        error = ends[i] < 0 ? errno : error;
        close(low[i]);
    }
    if (error == 0)
        return 0;
    for (int i = 0; i < 2; i++)
        if (ends[i] >= 0)
            close(ends[i]);
    errno = error;
    return -1;
}

static struct processor *new_processor(const char *name, int cpu)
{
    struct processor *made = calloc(1, sizeof *made);

    if (made == NULL || make_pipe(made->wake) != 0) {
        rci_fail("rci_create: processor %s: %s", name, strerror(errno));
        free(made);
        return NULL;
    }
    snprintf(made->name, sizeof made->name, "%s", name);
    made->cpu = cpu;
    made->next = rci_program.processors;
    rci_program.processors = made;
    return made;
}

/* The processor of a name; its thread starts with the first rci_start. NULL: there is none. */
struct processor *rci_processor(const char *name)
{
    const char *wanted = name != NULL && name[0] != '\0' ? name : "host";
    int cpu = number_of(wanted, "cpu");

    for (struct processor *each = rci_program.processors; each != NULL; each = each->next)
        if (strcmp(each->name, wanted) == 0)
            return each;
    if (strlen(wanted) <= NAME_BYTES &&
        (strcmp(wanted, "host") == 0 || number_of(wanted, "aux") > -2 ||
         (cpu >= 0 && (rci_program.virtual_time || is_allowed_cpu(cpu)))))
        return new_processor(wanted, cpu >= 0 ? cpu : -1);
    rci_fail("rci_create: no processor \"%s\"; there are host, aux, aux1 ..., and cpu0 ... as many as this program may "
             "use", wanted);
    return NULL;
}

void rci_processor_wake(struct processor *processor)
{
    if (!rci_program.virtual_time && write(processor->wake[1], "", 1) < 0 && errno != EAGAIN)
        rci_fail("processor %s: %s", processor->name, strerror(errno));
}

/* Ask for SCHED_FIFO; without the right to it the thread runs as others do. */
void rci_take_fifo(struct seat *seat, int above)
{
    struct sched_param wanted;

    memset(&wanted, 0, sizeof wanted);
    wanted.sched_priority = PRIORITY + above;
    seat->real_time = pthread_setschedparam(pthread_self(), SCHED_FIFO, &wanted) == 0;
    prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
}

/* ------------------------------------------------------------------------------------------------------- one round */

static void start_up(struct seat *seat)
{
    RCI_TASK *td;
    int index = 0;

    while ((td = rci_task_of(seat->processor, &index)) != NULL)
        if (td->inside->state == RCI_ATTACHING && !td->inside->started_up) {
            if (rci_call(seat, td, td->inside->startup) < 0)
                return;
            td->inside->started_up = 1;
        }
}

/* Its arm has been stopped, or the link is of no use any more. */
void rci_let_go(RCI_TASK *td)
{
    rci_link_close(td, td->inside->state == RCI_ENDED ? td->inside->error : "released");
    if (td->inside->state == RCI_RELEASING)
        td->inside->state = RCI_RELEASED;
}

static int hear_in_virtual_time(RCI_TASK *td)
{
    struct rci_inside *in = td->inside;
    struct cycle *c = &in->cycle;
    int status;

    if (rci_program.now_ns < in->next_ns)
        return 0;
    in->next_ns += in->link->period_us * INT64_C(1000);
    rci_unlock(); /* an emulated arm may take long: signals come meanwhile */
    status = qrobot_exchange(in->link, c->has_state ? &c->command : NULL, &c->state);
    rci_lock();
    return status == QROBOT_OK ? 1 : -1;
}

static void hear_robots(struct seat *seat)
{
    RCI_TASK *td;
    int index = 0;

    while ((td = rci_task_of(seat->processor, &index)) != NULL && !seat->given_up) {
        struct rci_inside *in = td->inside;
        int heard = in->link == NULL              ? 0
                    : rci_program.virtual_time ? hear_in_virtual_time(td)
                                               : rci_link_hear(td);

        if (heard < 0 || (in->link != NULL && rci_now_ns() - in->heard_ns > SILENT_NS)) {
            rci_end_task(td, "%s", heard < 0 ? in->link->error : "its bridge has fallen silent");
            in->cycle.phase = LEFT;
        } else if (heard > 0 && rci_sample(seat, td) < 0)
            return;
        if (in->link != NULL && in->cycle.phase == LEFT)
            rci_let_go(td);
    }
}

/* Everything that is due now. */
void rci_round(struct seat *seat)
{
    start_up(seat);
    if (!seat->given_up)
        hear_robots(seat);
    if (!seat->given_up) {
        rci_wake_tasks(seat->processor, rci_program.virtual_time ? rci_program.tick : rci_tick_at(qrobot_now_ns()));
        rci_ask_functions(seat);
    }
    while (!seat->given_up && rci_run_tasks(seat) > 0)
        if (!rci_program.virtual_time)
            break;
}

/* --------------------------------------------------------------------------------------------------------- waiting */

static int is_behind(const RCI_TASK *td)
{
    return td->inside->state == RCI_ACTIVE && td->robot == NULL && td->inside->woken != td->inside->served;
}

/* When to look again, whatever happens. */
static int64_t next_instant(const struct processor *processor, int64_t now_ns)
{
    int64_t next = now_ns + LOOK_NS, tick = rci_tick_at(now_ns);
    RCI_TASK *td;
    int index = 0;

    while ((td = rci_task_of(processor, &index)) != NULL) {
        const struct rci_inside *in = td->inside;
        int64_t at = NEVER;

        if (in->state != RCI_ACTIVE)
            continue;
        if (td->robot == NULL)
            at = in->clock.next;
        if (in->trigger_clock.next < at)
            at = in->trigger_clock.next;
        if (in->wakeup != NULL && in->device < 0 && tick + 1 < at)
            at = tick + 1;
        if (is_behind(td))
            next = now_ns;
        else if (at != NEVER && rci_time_of(at) < next)
            next = rci_time_of(at);
    }
    return next;
}

/* What to wait for: orders, robots, devices. Returns how many. */
static int gather(const struct processor *processor, struct pollfd *fds, RCI_TASK **tasks)
{
    RCI_TASK *td;
    int index = 0, count = 1;

    fds[0].fd = processor->wake[0];
    while ((td = rci_task_of(processor, &index)) != NULL) {
        int fd = td->inside->link != NULL ? td->inside->link->fd : td->inside->device;

        if (fd >= 0 && (td->inside->link != NULL || td->inside->state == RCI_ACTIVE)) {
            tasks[count] = td;
            fds[count++].fd = fd;
        }
    }
    for (int i = 0; i < count; i++) {
        fds[i].events = POLLIN | POLLRDHUP;
        fds[i].revents = 0;
    }
    return count;
}

/* Of descriptors whose far end was closed, and of which everything was read: those stay readable for ever. */
static void note_ends(struct pollfd *fds, int count)
{
    for (int i = 1; i < count; i++) {
        int left = 0;

        if ((fds[i].revents & (POLLHUP | POLLRDHUP)) && (ioctl(fds[i].fd, FIONREAD, &left) != 0 || left == 0))
            fds[i].revents = POLLHUP;
    }
}

static void note_devices(const struct pollfd *fds, RCI_TASK **tasks, int count)
{
    for (int i = 1; i < count; i++) {
        struct rci_inside *in = tasks[i]->inside;

        if (in->link != NULL || in->device != fds[i].fd || in->state != RCI_ACTIVE)
            continue;
        if (fds[i].revents & POLLIN)
            in->device_ready = 1;
        else if (fds[i].revents != 0)
            rci_end_task(tasks[i], "its device was closed");
    }
}

static void wait_for_more(struct seat *seat)
{
    struct pollfd fds[RCI_TASKS + 1];
    RCI_TASK *tasks[RCI_TASKS + 1];
    int count = gather(seat->processor, fds, tasks);
    int64_t now_ns = qrobot_now_ns(), left_ns = next_instant(seat->processor, now_ns) - now_ns;
    struct timespec left = {0, left_ns > 0 ? (long)left_ns : 0};
    char unread[64];

    rci_unlock();
    if (ppoll(fds, (nfds_t)count, &left, NULL) > 0 && fds[0].revents)
        while (read(fds[0].fd, unread, sizeof unread) == (ssize_t)sizeof unread)
            continue;
    note_ends(fds, count);
    rci_lock();
    if (!seat->given_up)
        note_devices(fds, tasks, count);
}

/* What the thread of a seat does. */
void *rci_run_processor(void *argument)
{
    struct seat *seat = argument;
    cpu_set_t one;

    rci_signals_are_blocked();
    rci_lock();
    if (seat->processor->cpu >= 0) {
        CPU_ZERO(&one);
        CPU_SET(seat->processor->cpu, &one);
        pthread_setaffinity_np(pthread_self(), sizeof one, &one);
    }
    rci_take_fifo(seat, 0);
    while (!seat->given_up && !seat->processor->over) {
        rci_round(seat);
        if (!seat->given_up)
            wait_for_more(seat);
    }
    seat->ended = 1;
    rci_unlock();
    return NULL;
}
