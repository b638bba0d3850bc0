/* The robot driver of an RCI of your own, with QRobot's bridge in the place of the robot.
 *
 * RCI meets a robot through two blackboards, `how` (what the arm does) and `chg` (what it is to do; Hayward & Paul
 * 1986), and through a few functions per robot: start up, exchange them once a sample, release. RCCL's simulator driver
 * exchanged one packet per sample with the simulator over a socket, and the QRobot paper put its controller at the far
 * end of that socket (section 6). This is such a driver, over the wire protocol of this project. Rename and extend it as
 * your RCI wants it.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef RCI_DRIVER_H
#define RCI_DRIVER_H

#include "qrobot_wire.h"

struct how {
    int powered, calibrated, at_rest;
    int following;      /* the arm goes where chg wants it */
    int fault;          /* that latched: see qrobot_fault_text */
    double time;        /* s since startup, by the robot's clock */
    double angle[QROBOT_MAX_JOINTS];    /* rad or m, measured */
    double setpoint[QROBOT_MAX_JOINTS]; /* rad or m, where the servo wants the joints: begin a motion here */
    double force[6];    /* on the wrist sensor, N and N m; NaN where it is not known */
    int hand;
};

struct chg {
    int power;          /* a level: arm power comes when it is raised, and stays as long as it is set */
    int clear_fault;    /* once, then lowered by the driver */
    int move;           /* follow `angle`; lowered by the driver when the arm was stopped */
    double angle[QROBOT_MAX_JOINTS];
    int hand;           /* QROBOT_HAND_... */
};

struct driver {
    struct qrobot_link link;
    struct qrobot_state state;
    uint32_t stream;    /* number of this run of setpoints */
    int moved;          /* chg asked for motion at the sample before */
    int was_following;
};

/* What the newest packet says. A stop of the arm ends the run: setpoints that are still made for it are not sent. */
static inline void driver_fill(struct driver *driver, struct how *how, struct chg *chg)
{
    const struct qrobot_state *state = &driver->state;

    how->powered = (state->flags & QROBOT_FLAG_POWERED) != 0;
    how->calibrated = (state->flags & QROBOT_FLAG_CALIBRATED) != 0;
    how->at_rest = (state->flags & QROBOT_FLAG_AT_REST) != 0;
    how->following = state->mode == QROBOT_MODE_HOLDING || state->mode == QROBOT_MODE_TRACKING;
    how->fault = state->fault;
    how->time = state->seq * (driver->link.period_us * 1e-6);
    how->hand = state->hand;
    memcpy(how->angle, state->q, sizeof how->angle);
    memcpy(how->setpoint, state->q_setpoint, sizeof how->setpoint);
    memcpy(how->force, state->force, sizeof how->force);
    if (driver->was_following && state->mode != QROBOT_MODE_TRACKING)
        chg->move = driver->moved = 0; /* and when it moves again, that is a new run */
    driver->was_following = state->mode == QROBOT_MODE_TRACKING;
}

/* Command the robot of this name. Returns 0 or a status of qrobot_wire.h, with driver->link.error. */
static inline int driver_startup(struct driver *driver, const char *robot, const char *address, struct how *how,
                                 struct chg *chg)
{
    struct qrobot_hello hello = {QROBOT_ROLE_COMMANDER, robot, "RCI", 0, 0, 0};
    int status;

    memset(driver, 0, sizeof *driver);
    memset(how, 0, sizeof *how);
    memset(chg, 0, sizeof *chg);
    status = qrobot_connect(&driver->link, address, &hello);
    if (status == QROBOT_OK)
        status = qrobot_exchange(&driver->link, NULL, &driver->state);
    if (status != QROBOT_OK)
        return status;
    driver->stream = (uint32_t)driver->state.t_ns; /* unlike that of a program before us */
    driver_fill(driver, how, chg);
    chg->power = how->powered;
    chg->hand = how->hand;
    return QROBOT_OK;
}

/* Send what chg says and wait for the next sample: the clock of the control task. Returns 0 or a status. */
static inline int driver_exchange(struct driver *driver, struct how *how, struct chg *chg)
{
    struct qrobot_command command;
    int status;

    qrobot_answer(&command, &driver->state);
    command.requests = (chg->power ? QROBOT_REQUEST_POWER : 0) | (chg->clear_fault ? QROBOT_REQUEST_CLEAR_FAULT : 0);
    command.hand = chg->hand;
    if (chg->move && !driver->moved)
        driver->stream++;
    driver->moved = chg->move;
    command.stream = driver->stream;
    for (int i = 0; i < driver->link.joints && chg->move; i++) {
        command.mode[i] = QROBOT_JOINT_POSITION;
        command.setpoint[i] = chg->angle[i];
    }
    chg->clear_fault = 0;
    status = qrobot_exchange(&driver->link, &command, &driver->state);
    if (status == QROBOT_OK)
        driver_fill(driver, how, chg);
    return status;
}

/* Let the arm go. It stops on its path; power stays as it was. */
static inline void driver_release(struct driver *driver, const char *mess)
{
    qrobot_disconnect(&driver->link, mess);
}

#endif
