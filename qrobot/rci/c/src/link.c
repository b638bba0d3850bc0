/* The way from a task to its robot. */
#include "inside.h"

#define SEND_MS 20 /* a bridge that takes no more for so long is gone */
#define MOST_READS 64 /* of what has come, one after another: some seconds of samples */
#define VIRTUAL_MS 600000 /* of real time, in which an emulated arm may compile itself before a sample */

static uint32_t period_us(const RCI_TASK *td)
{
    return (uint32_t)(td->inside->clock.interval * 1000000 / rci_program.rate_hz);
}

/* Greet the arm of a task; on virtual time the relay of `qrobot run` has all of them. Returns QROBOT_OK, or a status
 * with link->error. */
static int greet(const RCI_TASK *td, struct qrobot_link *link)
{
    struct qrobot_hello hello = {QROBOT_ROLE_COMMANDER, td->robot->name, td->name, period_us(td),
                                 rci_program.virtual_time ? VIRTUAL_MS : 0, 0};
    struct arm arm;
    int status;

    if ((status = rci_find_arm(td, link, &arm)) != QROBOT_OK)
        return status;
    if (!rci_program.virtual_time)
        return qrobot_connect(link, arm.address[0] ? arm.address : NULL, &hello);
    hello.program = arm.name;
    return qrobot_connect(link, getenv("QROBOT_RCI_RELAY"), &hello);
}

static void set_greeting(struct qrobot_link *link)
{
    rci_lock();
    rci_program.greeting = link;
    rci_unlock();
}

static void refuse(struct qrobot_link *link, const char *reason)
{
    qrobot_disconnect(link, reason);
    set_greeting(NULL);
    free(link);
}

/* Greet the robot of a task, in the planning program, which may wait; to switch its power off, or to move it. Returns
 * 0 or -1, `call` in the text. */
int rci_link_open(RCI_TASK *td, int power_off, const char *call)
{
    struct rci_inside *in = td->inside;
    struct qrobot_link *link;

    if (rci_program.virtual_time && getenv("QROBOT_RCI_RELAY") == NULL)
        return rci_fail("%s: task %s: on virtual time `qrobot run --offline` or --lockstep has the robot", call,
                        td->name);
    if ((link = calloc(1, sizeof *link)) == NULL)
        return rci_fail("%s: no memory", call);
    qrobot_begin(link);
    set_greeting(link);
    if (greet(td, link) != QROBOT_OK || link->joints != td->robot->n) {
        if (link->fd >= 0)
            rci_fail("%s: task %s: %s has %d joints, its file says %d", call, td->name, link->peer, link->joints,
                     td->robot->n);
        else
            rci_fail("%s: task %s: %s", call, td->name, link->error);
        refuse(link, "not the robot that was asked for");
        return -1;
    }
    link->timeout_ms = rci_program.virtual_time ? link->timeout_ms : SEND_MS;
    rci_lock();
    if (in->processor->seat == NULL) {
        rci_unlock();
        refuse(link, "its processor has no thread");
        return rci_fail("%s: task %s: its processor has no thread any more", call, td->name);
    }
    rci_cycle_begin(&in->cycle, link->period_us * 1e-6);
    if (power_off)
        rci_cycle_stop(&in->cycle, 1);
    in->link = link;
    rci_program.greeting = NULL;
    in->heard_ns = rci_now_ns();
    in->next_ns = in->heard_ns + link->period_us * INT64_C(1000);
    rci_unlock();
    return 0;
}

/* Say goodbye without waiting for anything: the arm has been stopped, or the bridge stops it. */
void rci_link_close(RCI_TASK *td, const char *reason)
{
    struct qrobot_link *link = td->inside->link;
    unsigned char out[QROBOT_MAX_PACKET];
    int size;

    if (link == NULL)
        return;
    if (link->fd >= 0 && (size = qrobot_put_bye(link, reason, qrobot_now_ns(), out)) > 0 &&
        send(link->fd, out, (size_t)size, MSG_NOSIGNAL) == size)
        shutdown(link->fd, SHUT_WR);
    qrw_close(link);
    free(link);
    td->inside->link = NULL;
}

/* In a child of the program: close its copies of all links, without a word. A link that is about to connect has been
 * zeroed just now, or has no socket; one that connects has one, which is above the standard streams. */
void rci_links_leave(void)
{
    for (int i = 0; i < rci_program.n_tasks; i++)
        if (rci_program.tasks[i]->inside->link != NULL)
            qrw_close(rci_program.tasks[i]->inside->link);
    if (rci_program.greeting != NULL && rci_program.greeting->fd > STDERR_FILENO)
        qrw_close(rci_program.greeting);
}

/* Read what has come; of several states the newest counts. Returns 1 for a new one, 0, or -1 with link->error. */
int rci_link_hear(RCI_TASK *td)
{
    struct qrobot_link *link = td->inside->link;
    struct cycle *c = &td->inside->cycle;
    uint32_t before = c->state.seq;
    int heard, status, found = 0, reads = 0;

    do {
        status = qrw_read(link);
        while ((heard = qrobot_next(link, &c->state)) > 0)
            found = found || heard == QROBOT_KIND_STATE;
        if (heard < 0 || status < 0)
            return -1;
    } while (++reads < MOST_READS && qrw_wait(link->fd, POLLIN, 0));
    if (found && c->has_state) {
        long left_out = (long)(uint32_t)(c->state.seq - before - 1);

        td->inside->missed += left_out;
        td->inside->woken += left_out;
    }
    return found;
}
