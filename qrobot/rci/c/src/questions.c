/* What anybody may ask of a task: the planning program, its handlers of signals, other tasks. */
#include "inside.h"

static long ask(RCI_TASK *td, long (*what)(const struct rci_inside *), const char *call)
{
    long answer;

    if (!rci_is_task(td, call))
        return -1;
    rci_lock();
    answer = what(td->inside);
    rci_unlock();
    return answer;
}

static long state_of(const struct rci_inside *in)
{
    return in->state;
}

static long runs_of(const struct rci_inside *in)
{
    return in->runs;
}

static long run_count_of(const struct rci_inside *in)
{
    return in->woken - in->served;
}

static long missed_of(const struct rci_inside *in)
{
    return in->missed;
}

static long longest_of(const struct rci_inside *in)
{
    return (long)in->longest_ns;
}

static long real_time_of(const struct rci_inside *in)
{
    return in->processor->seat != NULL && in->processor->seat->real_time;
}

enum rci_state rci_state(RCI_TASK *td)
{
    long state = ask(td, state_of, "rci_state");
    return state < 0 ? RCI_ENDED : (enum rci_state)state;
}

long rci_runs(RCI_TASK *td)
{
    return ask(td, runs_of, "rci_runs");
}

long rci_runCount(RCI_TASK *td)
{
    return ask(td, run_count_of, "rci_runCount");
}

long rci_missed(RCI_TASK *td)
{
    return ask(td, missed_of, "rci_missed");
}

double rci_longest(RCI_TASK *td)
{
    return (double)ask(td, longest_of, "rci_longest") * 1e-9;
}

int rci_realTime(RCI_TASK *td)
{
    return (int)ask(td, real_time_of, "rci_realTime");
}

/* Why a task ended before its time, "" when it did not. The text stays until the task is started again. */
const char *rci_taskError(RCI_TASK *td)
{
    return rci_is_task(td, "rci_taskError") ? td->inside->error : "";
}

/* A copy of what the robot of a task said last. */
int rci_how(RCI_TASK *td, RCI_HOW *how)
{
    if (!rci_is_task(td, "rci_how"))
        return -1;
    if (td->robot == NULL || !td->inside->cycle.has_state)
        return rci_fail("rci_how: task %s has heard of no robot", td->name);
    rci_lock();
    *how = td->how;
    rci_unlock();
    return 0;
}
