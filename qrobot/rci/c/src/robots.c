/* The data base of robots at joint level: the table that `qrobot cc` makes of the robot files, and other names for them. */
#include "inside.h"

#include <math.h>

#define OTHER_NAMES 32
#define DAC_ZERO 0x800
#define DAC_MAX 0xFFF

static struct other_name {
    char name[NAME_BYTES + 1], address[NAME_BYTES + 1];
    const RCI_ROBOT *robot;
} others[OTHER_NAMES];
static int n_others;

static const RCI_ROBOT *in_table(const char *name)
{
    for (int i = 0; i < rci_robot_count; i++)
        if (strcmp(rci_robot_table[i].name, name) == 0 || strcmp(rci_robot_table[i].file, name) == 0)
            return &rci_robot_table[i];
    return NULL;
}

/* The robot that tasks of a name are connected to, 0 for none, and where its bridge is: "" for that of the program. */
const RCI_ROBOT *rci_find_robot(const char *name, char *address)
{
    address[0] = '\0';
    for (int i = 0; i < n_others; i++)
        if (strcmp(others[i].name, name) == 0) {
            strcpy(address, others[i].address);
            return others[i].robot;
        }
    return in_table(name);
}

void rci_forget_robots(void)
{
    n_others = 0;
}

int rci_robot(const char *name, const char *file, const char *bridge)
{
    const RCI_ROBOT *robot = file ? in_table(file) : NULL;
    struct other_name *other;
    int index = 0;

    rci_begin();
    if (robot == NULL)
        return rci_fail("rci_robot: this program knows no robot \"%s\"; compile it with `qrobot cc --robot FILE`",
                        file ? file : "");
    if (name == NULL || name[0] == '\0' || strlen(name) > NAME_BYTES || (bridge && strlen(bridge) > NAME_BYTES))
        return rci_fail("rci_robot: a name and an address of at most %d bytes are needed", NAME_BYTES);
    while (index < n_others && strcmp(others[index].name, name) != 0)
        index++; /* a name that is given anew is that of the newest call */
    if (index == OTHER_NAMES)
        return rci_fail("rci_robot: at most %d other names", OTHER_NAMES);
    other = &others[index];
    strcpy(other->name, name);
    strcpy(other->address, bridge ? bridge : "");
    other->robot = robot;
    n_others += index == n_others;
    return 0;
}

static int is_robot(const RCI_ROBOT *robot, const char *call)
{
    return robot != NULL || rci_fail("%s: the task has no robot", call) == 0;
}

/* Encoder counts at joint positions, offset included: the nearest. */
int rci_angtoenc(const RCI_ROBOT *robot, const double *q, long *counts)
{
    if (!is_robot(robot, "rci_angtoenc"))
        return -1;
    for (int i = 0; i < robot->n; i++) {
        double turned = 0.0;
        for (int j = 0; j < robot->n; j++)
            turned += robot->coupling[i * robot->n + j] / robot->rad_per_count[i] * (q[j] - robot->q_offset[j]);
        counts[i] = (long)floor(turned + 0.5) + robot->count_offset[i];
    }
    return 0;
}

/* Joint positions at encoder counts. */
int rci_enctoang(const RCI_ROBOT *robot, const long *counts, double *q)
{
    if (!is_robot(robot, "rci_enctoang"))
        return -1;
    for (int j = 0; j < robot->n; j++) {
        q[j] = robot->q_offset[j];
        for (int i = 0; i < robot->n; i++)
            q[j] += robot->uncoupling[j * robot->n + i] * robot->rad_per_count[i] *
                    (double)(counts[i] - robot->count_offset[i]);
    }
    return 0;
}

static long dac_word(double steps)
{
    if (isnan(steps))
        return DAC_ZERO;
    if (steps >= DAC_MAX - DAC_ZERO)
        return DAC_MAX;
    return steps <= -DAC_ZERO ? 0 : (long)steps + DAC_ZERO;
}

/* DAC words that exert joint torques: 12-bit offset binary. Motor torques are uncoupling' tau. */
int rci_tortodac(const RCI_ROBOT *robot, const double *tau, long *dac)
{
    if (!is_robot(robot, "rci_tortodac"))
        return -1;
    for (int i = 0; i < robot->n; i++) {
        double motor = 0.0;
        for (int j = 0; j < robot->n; j++)
            motor += robot->uncoupling[j * robot->n + i] * tau[j];
        dac[i] = dac_word(motor * robot->dac_per_Nm[i]);
    }
    return 0;
}

/* Joint torques that DAC words exert. */
int rci_dactotor(const RCI_ROBOT *robot, const long *dac, double *tau)
{
    if (!is_robot(robot, "rci_dactotor"))
        return -1;
    for (int j = 0; j < robot->n; j++) {
        tau[j] = 0.0;
        for (int i = 0; i < robot->n; i++)
            tau[j] += robot->coupling[i * robot->n + j] * (double)(dac[i] - DAC_ZERO) / robot->dac_per_Nm[i];
    }
    return 0;
}
