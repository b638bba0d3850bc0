/* The common clock: one instant and a rate, and at which ticks what is due. As qrobot/rci/schedule.py. */
#include "inside.h"

int64_t rci_now_ns(void)
{
    return rci_program.virtual_time ? rci_program.now_ns : qrobot_now_ns();
}

/* The newest tick at an instant. */
int64_t rci_tick_at(int64_t now_ns)
{
    int64_t passed = now_ns - rci_program.epoch_ns;

    return passed / NS * rci_program.rate_hz + passed % NS * rci_program.rate_hz / NS;
}

/* The instant of a tick, to the next whole nanosecond; NEVER when that is centuries away. */
int64_t rci_time_of(int64_t tick)
{
    int64_t rate = rci_program.rate_hz;

    if (tick / rate >= (NEVER - rci_program.epoch_ns) / NS - 1)
        return NEVER;
    return rci_program.epoch_ns + tick / rate * NS + (tick % rate * NS + rate - 1) / rate;
}

long rci_ticks(void)
{
    rci_begin();
    return (long)(rci_program.virtual_time ? rci_program.tick : rci_tick_at(qrobot_now_ns()));
}

/* What is left of a whole number, 0 to interval - 1. */
static int64_t modulo(int64_t number, int64_t interval)
{
    int64_t left = number % interval;

    return left < 0 ? left + interval : left;
}

static int64_t later(int64_t tick, int64_t ticks)
{
    return tick > 0 && ticks > NEVER - tick ? NEVER : tick + ticks;
}

/* The first tick behind `after` for which (ticks - offset) % interval == 0. */
int64_t rci_entry_first(const struct clock_entry *entry, int64_t after)
{
    int64_t interval = entry->interval;
    int64_t ahead = modulo(entry->offset, interval) - modulo(after + 1, interval);

    return later(after + 1, modulo(ahead, interval));
}

/* How often it was due since it was looked at last, `tick` included. */
long rci_entry_take(struct clock_entry *entry, int64_t tick)
{
    long times;

    if (entry->interval == 0 || entry->next > tick)
        return 0;
    times = (long)((tick - entry->next) / entry->interval + 1);
    entry->next = later(entry->next + (int64_t)(times - 1) * entry->interval, entry->interval);
    return times;
}

static int set_entry(RCI_TASK *td, struct clock_entry *entry, long interval, long offset, const char *call)
{
    if (interval < 1)
        return rci_fail("%s: interval %ld of task %s; 1 or more clock ticks are needed", call, interval, td->name);
    entry->interval = interval;
    entry->offset = offset;
    if (td->inside->state == RCI_ACTIVE)
        entry->next = rci_entry_first(entry, rci_program.virtual_time ? rci_program.tick : rci_tick_at(qrobot_now_ns()));
    return 0;
}

/* Sample period of a robot at so many ticks, us; -1 when it can have none. */
static int check_period(const RCI_TASK *td, long interval)
{
    double us = 1e6 * (double)interval / (double)rci_program.rate_hz;

    if (td->inside->link != NULL)
        return rci_fail("rci_onclock: task %s holds its robot; release it to change its sample period", td->name);
    if (interval < 1)
        return 0; /* set_entry() refuses it */
    if (us < QROBOT_SHORTEST_PERIOD_US || us > QROBOT_LONGEST_PERIOD_US)
        return rci_fail("rci_onclock: %ld ticks of %ld Hz are %g ms; a robot has sample periods of 1 to 100 ms",
                        interval, rci_program.rate_hz, us / 1000.0);
    if (interval * 1000000 % rci_program.rate_hz != 0)
        return rci_fail("rci_onclock: %ld ticks of %ld Hz are no whole number of microseconds", interval,
                        rci_program.rate_hz);
    return 0;
}

int rci_onclock(RCI_TASK *td, long interval, long offset)
{
    int status;

    if (!rci_is_task(td, "rci_onclock"))
        return -1;
    rci_lock();
    status = td->robot ? check_period(td, interval) : 0;
    if (status == 0)
        status = set_entry(td, &td->inside->clock, interval, offset, "rci_onclock");
    rci_unlock();
    rci_processor_wake(td->inside->processor);
    return status;
}

int rci_trigger(RCI_TASK *td, long interval, long offset, RCI_FUNCTION trigger)
{
    int status;

    if (!rci_is_task(td, "rci_trigger"))
        return -1;
    if (trigger == NULL)
        return rci_fail("rci_trigger: task %s needs a function", td->name);
    rci_lock();
    status = set_entry(td, &td->inside->trigger_clock, interval, offset, "rci_trigger");
    if (status == 0)
        td->inside->trigger = trigger;
    rci_unlock();
    rci_processor_wake(td->inside->processor);
    return status;
}

int rci_onfunction(RCI_TASK *td, RCI_WAKEUP wakeup)
{
    if (!rci_is_task(td, "rci_onfunction"))
        return -1;
    if (wakeup == NULL || td->robot != NULL)
        return rci_fail("rci_onfunction: task %s %s", td->name, wakeup ? "is woken by its robot" : "needs a function");
    rci_lock();
    td->inside->wakeup = wakeup;
    rci_unlock();
    rci_processor_wake(td->inside->processor);
    return 0;
}

int rci_deviceInterrupt(RCI_TASK *td, int descriptor)
{
    struct stat found;

    if (!rci_is_task(td, "rci_deviceInterrupt"))
        return -1;
    if (td->robot != NULL)
        return rci_fail("rci_deviceInterrupt: task %s is woken by its robot", td->name);
    if (fstat(descriptor, &found) != 0)
        return rci_fail("rci_deviceInterrupt: task %s: %d is no open device, socket or pipe", td->name, descriptor);
    if (S_ISREG(found.st_mode) || S_ISDIR(found.st_mode))
        return rci_fail("rci_deviceInterrupt: task %s: %d is a file or folder of a disk, which is always readable; a "
                        "device, socket or pipe is needed", td->name, descriptor);
    rci_lock();
    td->inside->device = descriptor;
    rci_unlock();
    rci_processor_wake(td->inside->processor);
    return 0;
}

int rci_timeout(RCI_TASK *td, double seconds)
{
    if (!rci_is_task(td, "rci_timeout"))
        return -1;
    if (!(seconds >= 0.001 && seconds <= 3600.0))
        return rci_fail("rci_timeout: %g s for task %s; 0.001 to 3600 s are allowed", seconds, td->name);
    rci_lock();
    td->inside->allowed_ns = (int64_t)(seconds * 1e9);
    rci_unlock();
    return 0;
}
