/* What a processor does with its tasks: wake them, run them, end them. As qrobot/rci/task_runner.py.
 *
 * The lock is held; it is let go while a function of the program runs. */
#include "inside.h"

/* The next task of a processor from *index on, NULL behind the last; by priority, then by creation. */
RCI_TASK *rci_task_of(const struct processor *processor, int *index)
{
    while (*index < rci_program.n_tasks) {
        RCI_TASK *td = rci_program.tasks[(*index)++];

        if (td->inside->processor == processor)
            return td;
    }
    return NULL;
}

/* A task is over before its time. Its arm comes to a controlled stop, and its link is let go behind that. */
void rci_end_task(RCI_TASK *td, const char *format, ...)
{
    struct rci_inside *in = td->inside;
    char reason[TEXT_BYTES - NAME_BYTES - 16];
    va_list values;

    va_start(values, format);
    vsnprintf(reason, sizeof reason, format, values);
    va_end(values);
    snprintf(in->error, sizeof in->error, "task %s: %s", td->name, reason);
    in->told = 0;
    in->state = RCI_ENDED;
    in->clock.next = in->trigger_clock.next = NEVER;
    in->served = in->woken;
    if (in->link != NULL)
        rci_cycle_stop(&in->cycle, 0);
}

static void begin_call(struct seat *seat, RCI_TASK *td)
{
    seat->running = td;
    seat->began_ns = qrobot_now_ns();
    rci_current = td;
    rci_unlock();
}

static int end_call(struct seat *seat, RCI_TASK *td)
{
    int64_t took_ns;

    rci_lock();
    rci_current = NULL;
    if (seat->given_up)
        return -1;
    took_ns = qrobot_now_ns() - seat->began_ns;
    if (!rci_program.virtual_time && took_ns > td->inside->longest_ns)
        td->inside->longest_ns = took_ns;
    seat->running = NULL;
    return 0;
}

/* Call a function of the program. Returns 0, or -1 when it has been given up meanwhile: nothing may be touched then. */
int rci_call(struct seat *seat, RCI_TASK *td, RCI_FUNCTION function)
{
    if (function == NULL)
        return 0;
    begin_call(seat, td);
    function(td);
    return end_call(seat, td);
}

static void wake(RCI_TASK *td, long times)
{
    struct rci_inside *in = td->inside;

    in->missed += in->woken != in->served ? times : times - 1;
    in->woken += times;
}

/* Count the ticks that have passed. Returns how many tasks were due. */
int rci_wake_tasks(struct processor *processor, int64_t tick)
{
    RCI_TASK *td;
    int index = 0, due = 0;

    while ((td = rci_task_of(processor, &index)) != NULL) {
        long times = td->inside->state == RCI_ACTIVE ? rci_entry_take(&td->inside->clock, tick) : 0;

        if (times > 0 && td->robot == NULL) {
            wake(td, times);
            due++;
        }
    }
    return due;
}

/* Ask the functions that wake tasks, at every tick or when their device says something, and call triggers. */
void rci_ask_functions(struct seat *seat)
{
    RCI_TASK *td;
    int index = 0;

    while ((td = rci_task_of(seat->processor, &index)) != NULL) {
        struct rci_inside *in = td->inside;
        int ready = in->device_ready, woken = ready;
        int64_t tick = rci_program.virtual_time ? rci_program.tick : rci_tick_at(qrobot_now_ns());

        in->device_ready = 0;
        if (in->state != RCI_ACTIVE || tick < in->active_from)
            continue;
        if (in->trigger != NULL && rci_entry_take(&in->trigger_clock, tick) > 0 && rci_call(seat, td, in->trigger) < 0)
            return;
        if (in->wakeup != NULL && (in->device < 0 ? tick > in->asked : ready)) {
            RCI_WAKEUP wakeup = in->wakeup;
            int answer;

            in->asked = tick;
            begin_call(seat, td);
            answer = wakeup();
            if (end_call(seat, td) < 0)
                return;
            woken = answer != 0;
        } else if (in->wakeup != NULL)
            woken = 0;
        if (woken && in->state == RCI_ACTIVE)
            wake(td, 1);
    }
}

/* Both functions of a task without robot, back to back. */
static int run_plain(struct seat *seat, RCI_TASK *td)
{
    RCI_FUNCTION second = td->inside->control2;

    if (rci_call(seat, td, td->inside->control1) < 0 || rci_call(seat, td, second) < 0)
        return -1;
    td->inside->runs++;
    td->inside->served++;
    return 0;
}

static RCI_TASK *most_urgent(const struct processor *processor, const long *done)
{
    RCI_TASK *td, *best = NULL;
    int index = 0;

    while ((td = rci_task_of(processor, &index)) != NULL) {
        const struct rci_inside *in = td->inside;

        if (in->state == RCI_ACTIVE && td->robot == NULL && in->woken != in->served && !done[index - 1] &&
            (best == NULL || in->priority > best->inside->priority))
            best = td;
    }
    return best;
}

/* One round: each task that is due gets one run. Returns how many ran, -1 when the thread is to end. */
int rci_run_tasks(struct seat *seat)
{
    long done[RCI_TASKS] = {0};
    int count = 0;
    RCI_TASK *td;

    while ((td = most_urgent(seat->processor, done)) != NULL) {
        for (int i = 0; i < rci_program.n_tasks; i++)
            done[i] |= rci_program.tasks[i] == td;
        if (run_plain(seat, td) < 0)
            return -1;
        count++;
    }
    return count;
}

/* The first control function of a task with a robot, between reading and sending. */
static int run_first(struct seat *seat, RCI_TASK *td)
{
    struct rci_inside *in = td->inside;
    const char *objection;

    in->woken++;
    if (rci_call(seat, td, in->control1) < 0)
        return -1;
    in->runs++;
    if (in->state == RCI_ACTIVE && (objection = rci_cycle_ask(td)) != NULL)
        rci_end_task(td, "%s", objection);
    return 0;
}

/* Answer the newest state of a robot. Returns 0, or -1 when the thread is to end. */
int rci_sample(struct seat *seat, RCI_TASK *td)
{
    struct rci_inside *in = td->inside;
    const char *failed;
    int active;

    rci_cycle_hear(td);
    in->heard_ns = rci_now_ns();
    if ((failed = rci_cycle_step(td, in->heard_ns)) != NULL) {
        rci_end_task(td, "%s", failed);
        rci_cycle_step(td, in->heard_ns);
    }
    active = in->state == RCI_ACTIVE && in->cycle.phase == FOLLOWING && rci_tick_at(in->heard_ns) >= in->active_from;
    if (active && run_first(seat, td) < 0)
        return -1;
    if (in->cycle.phase == STOPPING && in->state != RCI_ACTIVE && active)
        rci_cycle_step(td, in->heard_ns);
    rci_cycle_answer(td);
    if (!rci_program.virtual_time && qrobot_send(in->link, &in->cycle.command) != QROBOT_OK) {
        rci_end_task(td, "%s", in->link->error);
        in->cycle.phase = LEFT;
    }
    if (active && in->state == RCI_ACTIVE && rci_call(seat, td, in->control2) < 0)
        return -1;
    in->served = in->woken;
    if (in->state == RCI_ATTACHING && in->cycle.phase == FOLLOWING)
        in->state = RCI_READY;
    return 0;
}
