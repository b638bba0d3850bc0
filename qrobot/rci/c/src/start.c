/* Starting, releasing and waiting, in the planning program. */
#include "inside.h"

#define START_LEAD_S 0.01  /* [A] in which every processor hears that its tasks begin at one tick */

/* ------------------------------------------------------------------------------------------------------- let it pass */

/* Go to the next event of virtual time: a tick, or the sample of a robot. */
static void advance(void)
{
    struct program *p = &rci_program;
    int64_t tick_ns = rci_time_of(p->tick + 1), next_ns = tick_ns;

    for (int i = 0; i < p->n_tasks; i++)
        if (p->tasks[i]->inside->link != NULL && p->tasks[i]->inside->next_ns < next_ns)
            next_ns = p->tasks[i]->inside->next_ns;
    p->now_ns = next_ns;
    p->tick += next_ns == tick_ns;
}

/* What is due at this instant of virtual time, in the order in which processors were created. */
static void virtual_round(void)
{
    struct processor *in_order[RCI_TASKS + 1];
    int count = 0;

    for (struct processor *each = rci_program.processors; each != NULL && count <= RCI_TASKS; each = each->next)
        in_order[count++] = each;
    while (count-- > 0)
        if (in_order[count]->seat != NULL)
            rci_round(in_order[count]->seat);
}

/* Let time pass: a millisecond, or up to the next event of virtual time. The lock is not held. */
void rci_let_pass(void)
{
    const struct timespec moment = {0, 1000000};

    if (!rci_program.virtual_time) {
        nanosleep(&moment, NULL);
        return;
    }
    rci_lock();
    advance();
    virtual_round();
    rci_unlock();
}

/* ------------------------------------------------------------------------------------------------------------- start */

/* A function of it was given up, and has not come back yet: it would write into what the new run reads. */
static int has_lost_function(const RCI_TASK *td)
{
    for (const struct seat *seat = rci_program.lost_seats; seat != NULL; seat = seat->next_lost)
        if (seat->running == td && !seat->ended)
            return 1;
    return 0;
}

static const char *cannot_start(const RCI_TASK *td)
{
    const struct rci_inside *in = td->inside;

    if (in->control1 == NULL)
        return "has no functions: call rci_control()";
    if (in->state == RCI_ATTACHING || in->state == RCI_READY || in->state == RCI_ACTIVE)
        return "is active already";
    if (has_lost_function(td))
        return "has a function that was given up and has not come back yet";
    return NULL;
}

/* Each task of a mask, one after the other. */
static RCI_TASK *next_of(unsigned long mask, int *index)
{
    while (*index < rci_program.n_tasks) {
        RCI_TASK *td = rci_program.tasks[(*index)++];

        if (td->bit & mask)
            return td;
    }
    return NULL;
}

/* Wait until every task of a mask has come as far as `far` says. Returns -1 when one has ended instead. */
static int wait_for(unsigned long mask, int (*far)(const struct rci_inside *))
{
    for (;;) {
        int all = 1, ended = 0, index = 0;
        RCI_TASK *td;

        rci_lock();
        while ((td = next_of(mask, &index)) != NULL) {
            all = all && far(td->inside);
            ended = ended || td->inside->state == RCI_ENDED;
        }
        rci_unlock();
        if (ended || all)
            return ended ? -1 : 0;
        rci_let_pass();
    }
}

static int has_started_up(const struct rci_inside *in)
{
    return in->started_up;
}

static int is_ready(const struct rci_inside *in)
{
    return in->state == RCI_READY;
}

static int has_no_link(const struct rci_inside *in)
{
    return in->link == NULL;
}

static void wait_for_links(unsigned long mask)
{
    int all = 0;

    while (!all) {
        RCI_TASK *td;
        int index = 0;

        all = 1;
        rci_lock();
        while ((td = next_of(mask, &index)) != NULL)
            all = all && has_no_link(td->inside);
        rci_unlock();
        if (!all)
            rci_let_pass();
    }
}

/* Let the processors of some tasks look again; on virtual time no time passes. */
static void wake_all(unsigned long mask)
{
    RCI_TASK *td;
    int index = 0;

    while ((td = next_of(mask, &index)) != NULL)
        rci_processor_wake(td->inside->processor);
    if (rci_program.virtual_time) {
        rci_lock();
        virtual_round();
        rci_unlock();
    }
}

/* Start-up functions first, then the robots: a robot waits for nobody's start-up. */
static int attach(unsigned long mask)
{
    RCI_TASK *td;
    int index = 0;

    wake_all(mask);
    if (wait_for(mask, has_started_up) < 0)
        return -1;
    while ((td = next_of(mask, &index)) != NULL) {
        if (td->robot != NULL && rci_link_open(td, 0, "rci_start") < 0)
            return -1;
        if (td->robot == NULL) {
            rci_lock();
            if (td->inside->state == RCI_ATTACHING)
                td->inside->state = RCI_READY;
            rci_unlock();
        }
    }
    wake_all(mask);
    return wait_for(mask, is_ready);
}

static void activate(unsigned long mask)
{
    struct program *p = &rci_program;
    RCI_TASK *td;
    int index = 0;
    int64_t after;

    rci_lock();
    after = p->virtual_time ? p->tick : rci_tick_at(qrobot_now_ns()) + 1 + (int64_t)(START_LEAD_S * (double)p->rate_hz);
    while ((td = next_of(mask, &index)) != NULL) {
        struct rci_inside *in = td->inside;

        if (in->state != RCI_READY)
            continue;
        in->served = in->woken;
        in->active_from = after + 1;
        in->asked = after;
        if (in->clock.interval)
            in->clock.next = rci_entry_first(&in->clock, after);
        if (in->trigger_clock.interval)
            in->trigger_clock.next = rci_entry_first(&in->trigger_clock, after);
        in->state = RCI_ACTIVE;
    }
    rci_unlock();
    wake_all(mask);
}

/* What ended tasks and was not told yet: to stderr, and for rci_error. Returns -1 when there was something. */
static int tell(unsigned long mask)
{
    RCI_TASK *td;
    int index = 0, told = 0;
    char text[TEXT_BYTES];

    while ((td = next_of(mask, &index)) != NULL) {
        rci_lock();
        snprintf(text, sizeof text, "%s", td->inside->error);
        told = td->inside->told;
        td->inside->told = 1;
        rci_unlock();
        if (text[0] != '\0' && !told)
            return rci_fail("%s", text);
    }
    return 0;
}

/* Tasks whose processor did not start may be started another time. Returns -1. */
static int give_up_start(unsigned long mask)
{
    RCI_TASK *td;
    int index = 0;

    rci_lock();
    while ((td = next_of(mask, &index)) != NULL)
        td->inside->state = RCI_CREATED;
    rci_unlock();
    return -1;
}

static int prepare_start(unsigned long mask)
{
    RCI_TASK *td;
    int index = 0;
    const char *why;

    while ((td = next_of(mask, &index)) != NULL) {
        rci_lock();
        why = cannot_start(td);
        rci_unlock();
        if (why != NULL)
            return rci_fail("rci_start: task %s %s", td->name, why);
    }
    wait_for_links(mask); /* of tasks that have ended */
    index = 0;
    rci_lock();
    while ((td = next_of(mask, &index)) != NULL) {
        td->inside->error[0] = '\0';
        td->inside->told = 0;
        td->inside->state = RCI_ATTACHING;
    }
    rci_unlock();
    index = 0;
    rci_program.sealed = 1;
    if (!rci_program.virtual_time && rci_tell_start() < 0)
        return give_up_start(mask);
    while ((td = next_of(mask, &index)) != NULL)
        if (rci_processor_start(td->inside->processor) < 0)
            return give_up_start(mask);
    return rci_watch_start() < 0 ? give_up_start(mask) : 0;
}

/* For rccl.h and arcl.h: 1 when tasks have been active on virtual time. */
int rci_is_virtual(void)
{
    return rci_program.begun && rci_program.sealed && rci_program.virtual_time;
}

int rci_start(unsigned long mask)
{
    if (rci_program.virtual_time && shim_has_engine && shim_has_engine())
        return rci_fail("rci_start: on virtual time a program in C has an arm of RCCL or ARCL, or tasks of RCI; run it "
                        "without --lockstep and --offline, against `qrobot up`");
    if (rci_current != NULL)
        return rci_fail("rci_start: only the planning program may do that");
    if (!rci_are_tasks(mask, "rci_start") || prepare_start(mask) < 0)
        return -1;
    if (attach(mask) < 0) {
        tell(mask);
        rci_release(mask);
        return -1;
    }
    activate(mask);
    return 0;
}

/* ----------------------------------------------------------------------------------------------------------- release */

/* The lock is held. */
void rci_begin_release(RCI_TASK *td, int power_off)
{
    struct rci_inside *in = td->inside;

    in->clock.next = in->trigger_clock.next = NEVER;
    in->served = in->woken;
    if (in->link != NULL)
        rci_cycle_stop(&in->cycle, power_off);
    if (in->state != RCI_ENDED && in->state != RCI_CREATED)
        in->state = in->link != NULL ? RCI_RELEASING : RCI_RELEASED;
}

/* A robot without link that had power, or was about to have it, when it was heard last. */
static int is_left_with_power(const RCI_TASK *td)
{
    const struct rci_inside *in = td->inside;

    return td->robot != NULL && in->link == NULL && in->cycle.has_state && td->how.mode != QROBOT_MODE_OFF &&
           td->how.mode != QROBOT_MODE_FAULT;
}

/* Greet robots that were let go with power, to switch it off. Returns -1 when one of them cannot be had. */
static int power_off_left(unsigned long mask, const char *call)
{
    RCI_TASK *td;
    int index = 0, status = 0;

    while ((td = next_of(mask, &index)) != NULL) {
        int left;

        rci_lock();
        left = is_left_with_power(td);
        rci_unlock();
        if (left && (rci_processor_start(td->inside->processor) < 0 || rci_link_open(td, 1, call) < 0))
            status = -1;
    }
    wake_all(mask);
    wait_for_links(mask);
    return status;
}

static int release(unsigned long mask, int power_off, const char *call)
{
    RCI_TASK *td;
    int index = 0, status;

    if (rci_current != NULL)
        return rci_fail("%s: only the planning program may do that", call);
    if (!rci_are_tasks(mask, call))
        return -1;
    rci_lock();
    while ((td = next_of(mask, &index)) != NULL)
        rci_begin_release(td, power_off);
    rci_unlock();
    wake_all(mask);
    wait_for_links(mask);
    status = power_off ? power_off_left(mask, call) : 0; /* of tasks that had ended, or were released before */
    return tell(mask) < 0 ? -1 : status;
}

int rci_release(unsigned long mask)
{
    return release(mask, 0, "rci_release");
}

int rci_powerOff(unsigned long mask)
{
    return release(mask, 1, "rci_powerOff");
}

/* -------------------------------------------------------------------------------------------------------------- wait */

int rci_wait(RCI_WAKEUP predicate)
{
    if (rci_current != NULL)
        return rci_fail("rci_wait: a control function must not wait: let it signal the program, or come again");
    if (predicate == NULL)
        return rci_fail("rci_wait: a function is needed");
    rci_begin();
    while (!predicate()) {
        if (tell(RCI_ALL) < 0)
            return -1;
        rci_let_pass();
    }
    return 0;
}
