/* The cycle of a task that has a robot (Figure 4 of the paper), from power-up to release: what the command says that
 * answers a state. It knows no clock and no link. As qrobot/rci/robot_cycle.py and power.py, where it is explained. */
#include "inside.h"

#include <math.h>

#define START_S 0.5      /* for the servo to follow a stream that began */
#define PATIENCE_S 6.0   /* twice what the servo itself waits for power */
#define REACTION_S 0.15  /* for the servo to answer a request */
#define SAME_AGAIN_S 1.0 /* with the event that stood there before: until then it may not have heard the request */
#define MOST_STARTS 5    /* streams that begin one after another, because the arm has not moved in the one before */
#define STREAM_LOST 28
#define POWER_STOPPED 81
#define ARRIVED 1e-6     /* rad or m */
#define ROUNDING (1.0 + 1e-9)
#define LET_GO "no fault; somebody took its power away"
#define STOPPED_BY_HAND "no fault; somebody told it to, or took its power away"

static __thread char why[TEXT_BYTES];

static const char *because(const char *format, ...) __attribute__((format(printf, 1, 2)));

static const char *because(const char *format, ...)
{
    va_list values;

    va_start(values, format);
    vsnprintf(why, sizeof why, format, values);
    va_end(values);
    return why;
}

/* `without_fault` is the reason when the servo reported nothing, by default (NULL) its mode. */
static const char *gave_up_or(const struct qrobot_state *s, const char *what, const char *without_fault)
{
    int code = s->fault ? s->fault : s->event;

    if (code && code == s->event && s->event_joint >= 0)
        return because("%s: %s, on joint %d", what, qrobot_fault_text(code), s->event_joint + 1);
    if (code || without_fault != NULL)
        return because("%s: %s", what, code ? qrobot_fault_text(code) : without_fault);
    return because("%s: the servo is in mode %d", what, s->mode);
}

static const char *gave_up(const struct qrobot_state *s, const char *what)
{
    return gave_up_or(s, what, NULL);
}

void rci_cycle_begin(struct cycle *c, double period_s)
{
    memset(c, 0, sizeof *c);
    c->period_s = period_s;
    c->asked_s = -1.0;
}

/* Begin a controlled stop from whatever phase; the arm holds its position then, or loses power. */
void rci_cycle_stop(struct cycle *c, int power_off)
{
    if (c->phase != STOPPING && c->phase != LEFT) {
        c->stopping_s = 0.0;
        c->stopped = 0;
        c->phase = STOPPING;
        memset(c->said.modes, 0, sizeof c->said.modes);
    }
    if (power_off && !c->power_off && c->phase == STOPPING)
        c->stopping_s = 0.0;
    c->power_off = c->power_off || power_off;
}

/* Post the newest state in td->how; samples that nobody heard are wake-ups that were missed. */
void rci_cycle_hear(RCI_TASK *td)
{
    struct cycle *c = &td->inside->cycle;
    const struct qrobot_state *s = &c->state;
    RCI_HOW *how = &td->how;
    size_t size = (size_t)s->joints * sizeof(double);

    how->n = s->joints;
    how->time = (double)s->t_ns * 1e-9;
    memcpy(how->q, s->q, size);
    memcpy(how->v, s->v, size);
    memcpy(how->tau, s->tau, size);
    memcpy(how->q_setpoint, s->q_setpoint, size);
    memcpy(how->force, s->force, sizeof how->force);
    how->mode = s->mode;
    how->fault = s->fault;
    how->event = s->event;
    how->event_joint = s->event_joint;
    how->flags = s->flags;
    how->inputs = s->inputs;
    how->outputs = s->outputs;
    how->hand = s->hand;
    if (!c->has_state) { /* what the hand holds stays held */
        c->said.hand = s->hand;
        c->said.outputs = s->outputs;
    }
    c->has_state = 1;
    c->heard++;
}

/* The servo carries the arm, or brings it to rest. */
static int carries(const struct qrobot_state *s)
{
    return s->mode == QROBOT_MODE_HOLDING || s->mode == QROBOT_MODE_TRACKING || s->mode == QROBOT_MODE_STOPPING;
}

static int is_powered(struct cycle *c, const struct qrobot_state *s, const char **failed)
{
    c->waited_s += c->period_s;
    if (c->waited_s > PATIENCE_S)
        *failed = gave_up(s, "the arm did not come to hold within 6 s");
    else if (c->carried && !carries(s)) /* not asked for anew where somebody has taken power away */
        *failed = gave_up_or(s, "the servo has let go of the arm before it followed", LET_GO);
    else if (s->mode == QROBOT_MODE_FAULT)
        *failed = gave_up(s, "the servo is in a fault");
    else if (s->mode == QROBOT_MODE_UNCALIBRATED)
        *failed = because("the arm has power but is not calibrated: its joint angles are unknown until `qrobot calibrate`");
    else if (s->mode != QROBOT_MODE_OFF) {
        c->power = 1; /* powering, or coming to rest after another program */
        c->powering = c->powering || s->mode == QROBOT_MODE_POWERING;
    } else if (c->powering && s->event == POWER_STOPPED) /* not asked for anew against somebody's stop */
        *failed = gave_up(s, "no arm power");
    else if (c->asked_s < 0.0 || !c->power) { /* power comes on a request that is raised while it is off: low at first */
        c->power = c->asked_s >= 0.0;
        c->asked_s = c->waited_s;
        c->event_before = s->event;
    } else if (s->event && c->waited_s - c->asked_s > (s->event == c->event_before ? SAME_AGAIN_S : REACTION_S))
        *failed = gave_up(s, "no arm power");
    c->carried = c->carried || s->mode == QROBOT_MODE_HOLDING;
    return *failed == NULL && s->mode == QROBOT_MODE_HOLDING;
}

/* The arm stays where it stands, as a stream of setpoints that the task goes on with. */
static void stay(RCI_TASK *td, const struct qrobot_state *s)
{
    struct cycle *c = &td->inside->cycle;

    for (int j = 0; j < s->joints; j++) {
        c->said.modes[j] = RCI_POSITION;
        c->said.setpoints[j] = s->q_setpoint[j];
    }
    td->chg = c->said;
}

static void power_down(struct cycle *c, const struct qrobot_state *s)
{
    c->stopping_s += c->period_s;
    if (!c->stopped || s->mode == QROBOT_MODE_TRACKING) {
        c->command.requests |= QROBOT_REQUEST_STOP;
        c->stopped = 1;
    }
    c->power = c->power && !c->power_off;
    if (s->mode == (c->power_off ? QROBOT_MODE_OFF : QROBOT_MODE_HOLDING) || s->mode == QROBOT_MODE_FAULT ||
        s->mode == QROBOT_MODE_OFF || c->stopping_s > PATIENCE_S)
        c->phase = LEFT;
}

/* The stream was lost while the arm stood where it began, and another one may begin. */
static int lost_at_rest(const struct cycle *c, const struct qrobot_state *s)
{
    if (s->event != STREAM_LOST || (s->mode != QROBOT_MODE_STOPPING && s->mode != QROBOT_MODE_HOLDING) ||
        c->starts >= MOST_STARTS)
        return 0;
    for (int j = 0; j < s->joints; j++)
        if (fabs(s->q_setpoint[j] - c->said.setpoints[j]) > ARRIVED)
            return 0;
    return 1;
}

/* Whether somebody has asked for a stop since the arm was taken; then it is not to move. */
static int was_stopped(struct cycle *c, const struct qrobot_state *s, const char **failed)
{
    int halted = (s->flags & QROBOT_FLAG_HALTED) != 0;

    if (halted && c->heeds_stops && carries(s))
        *failed = gave_up_or(s, "somebody has stopped the arm before it moved", STOPPED_BY_HAND);
    else if (s->mode == QROBOT_MODE_HOLDING || c->phase != POWERING)
        /* It may tell of an older one: what comes after an answer without any is news. The first may be older itself. */
        c->heeds_stops = c->heard > 1 && !halted;
    return *failed != NULL;
}

/* Take in a state. Returns NULL, or why the robot cannot be had any longer. */
const char *rci_cycle_step(RCI_TASK *td, int64_t now_ns)
{
    struct cycle *c = &td->inside->cycle;
    const struct qrobot_state *s = &c->state;
    const char *failed = NULL;

    qrobot_answer(&c->command, s);
    switch (c->phase) {
    case POWERING:
        if (!was_stopped(c, s, &failed) && is_powered(c, s, &failed)) {
            c->stream = (uint32_t)(now_ns >> 20) ^ s->seq << 12; /* unlike that of a run before */
            stay(td, s);
            c->start_s = 0.0;
            c->starts++;
            c->phase = STARTING;
        }
        break;
    case STARTING:
        c->start_s += c->period_s;
        if (was_stopped(c, s, &failed))
            break;
        if (s->mode == QROBOT_MODE_TRACKING)
            c->phase = FOLLOWING;
        else if ((s->mode == QROBOT_MODE_STOPPING || c->start_s > START_S) && lost_at_rest(c, s))
            c->phase = POWERING; /* another stream, when the arm holds */
        else if (s->mode != QROBOT_MODE_HOLDING || c->start_s > START_S)
            failed = gave_up(s, "the servo does not follow the setpoints");
        break;
    case FOLLOWING:
        if (s->mode != QROBOT_MODE_TRACKING && (td->inside->state == RCI_ACTIVE || !lost_at_rest(c, s)))
            failed = gave_up_or(s, "the servo stopped the arm", STOPPED_BY_HAND);
        else if (!was_stopped(c, s, &failed) && s->mode != QROBOT_MODE_TRACKING)
            c->phase = POWERING;
        break;
    case STOPPING:
        power_down(c, s);
        break;
    case LEFT:
        break;
    }
    return failed;
}

static const char *objection_to_joint(const RCI_TASK *td, int j)
{
    const RCI_ROBOT *robot = td->robot;
    const struct cycle *c = &td->inside->cycle;
    const double x = td->chg.setpoints[j];
    int mode = td->chg.modes[j];

    if (mode != RCI_HOLD && mode != RCI_POSITION && mode != RCI_TORQUE)
        return because("chg.modes[%d] is %d; 0 to 2 exist", j, mode);
    if (!isfinite(x))
        return because("chg.setpoints[%d] is no finite number", j);
    if (mode == RCI_POSITION && (x < robot->q_min[j] || x > robot->q_max[j]))
        return because("joint %d at %.4g is outside %.4g to %.4g", j + 1, x, robot->q_min[j], robot->q_max[j]);
    if (mode == RCI_TORQUE && fabs(x) > robot->tau_max[j])
        return because("%.4g on joint %d, at most %.4g allowed", x, j + 1, robot->tau_max[j]);
    if (mode == RCI_POSITION && c->said.modes[j] == RCI_POSITION &&
        fabs(x - c->said.setpoints[j]) > robot->v_max[j] * c->period_s * ROUNDING)
        return because("joint %d at %.4g per second, at most %.4g allowed: make smaller steps from sample to sample",
                       j + 1, (x - c->said.setpoints[j]) / c->period_s, robot->v_max[j]);
    return NULL;
}

/* Judge what the control function asks for, and ask for it. Returns NULL, or what is wrong with it. */
const char *rci_cycle_ask(RCI_TASK *td)
{
    struct cycle *c = &td->inside->cycle;
    const char *objection = NULL;

    if (td->chg.hand < 0 || td->chg.hand > RCI_CLOSED || td->chg.outputs > 0xFFFF)
        return because("hand %d and outputs %#lx; 0 to 2 and 16 bits exist", td->chg.hand, td->chg.outputs);
    for (int j = 0; j < td->robot->n && objection == NULL; j++)
        objection = objection_to_joint(td, j);
    if (objection == NULL)
        c->said = td->chg;
    return objection;
}

/* The command that answers the newest state. */
void rci_cycle_answer(RCI_TASK *td)
{
    struct cycle *c = &td->inside->cycle;

    c->command.requests &= QROBOT_REQUEST_STOP;
    c->command.requests |= c->power ? QROBOT_REQUEST_POWER : 0;
    c->command.stream = c->stream;
    c->command.hand = c->said.hand;
    c->command.outputs = (uint32_t)c->said.outputs;
    for (int j = 0; j < c->state.joints; j++) {
        c->command.mode[j] = c->phase == STARTING || c->phase == FOLLOWING ? c->said.modes[j] : QROBOT_JOINT_HOLD;
        c->command.setpoint[j] = c->said.setpoints[j];
    }
}

void rci_goto(RCI_TASK *td, const double *q)
{
    for (int j = 0; td->robot != NULL && j < td->robot->n; j++) {
        td->chg.modes[j] = RCI_POSITION;
        td->chg.setpoints[j] = q[j];
    }
}

void rci_drive(RCI_TASK *td, const double *setpoints, const int *torque)
{
    rci_goto(td, setpoints);
    for (int j = 0; td->robot != NULL && j < td->robot->n; j++)
        td->chg.modes[j] = torque[j] ? RCI_TORQUE : RCI_POSITION;
}

void rci_hold(RCI_TASK *td)
{
    memset(td->chg.modes, 0, sizeof td->chg.modes);
}
