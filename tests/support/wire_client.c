/* The C client as the tests see it: one mode judges bytes, one makes packets, one talks to a server. */
#include "qrobot_wire.h"

#include <math.h>

static void print_hex(const char *name, const unsigned char *data, size_t size)
{
    printf("%s ", name);
    for (size_t i = 0; i < size; i++)
        printf("%02x", data[i]);
    putchar('\n');
}

static void print_doubles(const double *numbers, int count)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        printf(" %016llx", (unsigned long long)bits);
    }
}

static void print_state(const struct qrobot_state *state)
{
    printf("state %lu %lu %lld %d %d %d %d %d %lu %lu %lu %lu %lu %d %lu", (unsigned long)state->seq,
           (unsigned long)state->ack, (long long)state->t_ns, state->joints, state->mode, state->fault, state->event,
           state->event_joint, (unsigned long)state->flags, (unsigned long)state->late_cycles,
           (unsigned long)state->missed_frames, (unsigned long)state->dropped, (unsigned long)state->inputs, state->hand,
           (unsigned long)state->outputs);
    print_doubles(state->q, state->joints);
    print_doubles(state->v, state->joints);
    print_doubles(state->tau, state->joints);
    print_doubles(state->q_setpoint, state->joints);
    print_doubles(state->force, 6);
    print_doubles(&state->speed_limit, 1);
    print_doubles(&state->tool_speed_limit, 1);
    print_doubles(&state->override, 1);
    print_doubles(&state->payload_mass, 1);
    print_doubles(state->sensors, 8);
    putchar('\n');
}

/* One thing that the far end said. */
static void print_event(const struct qrobot_link *link, int heard, const struct qrobot_state *state)
{
    const char *text = strstr(link->error, ": ");

    if (heard == QROBOT_KIND_WELCOME)
        printf("welcome %d %d %lu ", link->role, link->joints, (unsigned long)link->period_us);
    if (heard == QROBOT_KIND_WELCOME)
        print_hex("robot", (const unsigned char *)link->robot, strlen(link->robot));
    else if (heard == QROBOT_KIND_STATE)
        print_state(state);
    else if (heard == QROBOT_KIND_ERROR && printf("complaint %d ", link->complaint) > 0)
        print_hex("warning", (const unsigned char *)link->warning, strlen(link->warning));
    else if (heard == QROBOT_REFUSED)
        print_hex(link->refusal ? "refused" : "over", (const unsigned char *)text + 2, strlen(text + 2));
    else
        puts(heard == QROBOT_BROKEN ? "broken" : "ended");
}

/* Records of stdin: phase, joints, size (two bytes), data. Each goes to a conversation of its own, in that phase. */
static int judge(void)
{
    static unsigned char data[1 << 16];
    unsigned char head[4];

    while (fread(head, 1, sizeof head, stdin) == sizeof head) {
        size_t size = head[2] | (size_t)head[3] << 8, taken = 0;
        struct qrobot_link link;
        struct qrobot_state state;
        int heard = 0;

        if (fread(data, 1, size, stdin) != size)
            return 1;
        qrobot_begin(&link);
        link.phase = (enum qrobot_phase)head[0];
        link.joints = head[1];
        while (heard >= 0 && taken < size) {
            taken += qrobot_feed(&link, data + taken, size - taken);
            while ((heard = qrobot_next(&link, &state)) > 0)
                print_event(&link, heard, &state);
        }
        if (heard < 0)
            print_event(&link, heard, &state);
        puts(".");
    }
    return 0;
}

static void welcomed(struct qrobot_link *link, int joints)
{
    qrobot_begin(link);
    link->phase = QROBOT_COMMANDING;
    link->joints = joints;
}

/* "joints seq ack t_ns stream outputs requests hand", a mode and a setpoint for each joint, then the signals. */
static int make_commands(void)
{
    unsigned char out[QROBOT_MAX_PACKET];
    struct qrobot_command command;
    struct qrobot_link link;
    int joints, size;
    long long t_ns;
    unsigned seq, ack, stream, outputs;

    while (scanf("%d %u %u %lld %u %u %d %d", &joints, &seq, &ack, &t_ns, &stream, &outputs, &command.requests,
                 &command.hand) == 8) {
        command.seq = seq, command.ack = ack, command.t_ns = t_ns, command.stream = stream, command.outputs = outputs;
        for (int i = 0; i < joints; i++)
            if (scanf("%d %lf", &command.mode[i], &command.setpoint[i]) != 2)
                return 1;
        for (int i = 0; i < QROBOT_SIGNALS; i++)
            if (scanf("%lf", &command.signals[i]) != 1)
                return 1;
        welcomed(&link, joints);
        size = qrobot_put_command(&link, &command, out);
        if (size < 0)
            printf("refused %s\n", link.error);
        else
            print_hex("made", out, (size_t)size);
    }
    return 0;
}

/* Arguments: names of signals, mass. Makes a STOP of each kind, SIGNALS, PAYLOAD, COLLISION and ANALOG, and a STOP as an observer. */
static int make_others(char **argument)
{
    struct qrobot_payload payload = {atof(argument[1]), {0.1, 0.2, 0.3}, {1, 2, 3, 4, 5, 6}};
    struct qrobot_collision collision = {QROBOT_REACTION_COMPLY, {30, 40, 20, 2, 2}}, odd = {2, {0}};
    struct qrobot_analog analog = {{NAN, 2.5, NAN, NAN, NAN, NAN, NAN, -1}};
    unsigned char out[QROBOT_MAX_PACKET];
    struct qrobot_link link;
    int size;

    welcomed(&link, 6);
    print_hex("made", out, (size_t)qrobot_put_stop(&link, 0, 1, out));
    print_hex("made", out, (size_t)qrobot_put_payload(&link, &payload, 3, out));
    print_hex("made", out, (size_t)qrobot_put_collision(&link, &collision, 5, out));
    print_hex("made", out, (size_t)qrobot_put_analog(&link, &analog, 6, out));
    if (qrobot_put_collision(&link, &odd, 5, out) != QROBOT_INVALID)
        return 1;
    if ((size = qrobot_put_signals(&link, argument[0], 2, out)) < 0)
        printf("refused %s\n", link.error);
    else
        print_hex("made", out, (size_t)size);
    link.phase = QROBOT_OBSERVING;
    print_hex("made", out, (size_t)qrobot_put_stop(&link, 1, 4, out));
    if (qrobot_put_payload(&link, &payload, 3, out) != QROBOT_INVALID ||
        qrobot_put_collision(&link, &collision, 3, out) != QROBOT_INVALID ||
        qrobot_put_analog(&link, &analog, 3, out) != QROBOT_INVALID ||
        qrobot_put_signals(&link, "", 3, out) != QROBOT_INVALID)
        return 1;
    link.phase = QROBOT_ANSWERING;
    return qrobot_put_stop(&link, 1, 4, out) != QROBOT_INVALID;
}

/* Arguments: role, robot, program, period in us, reason of the BYE, whether in step. */
static int greet(char **argument)
{
    const char *robot = *argument[1] ? argument[1] : NULL, *program = *argument[2] ? argument[2] : NULL;
    struct qrobot_hello hello = {atoi(argument[0]), robot, program, (uint32_t)atoi(argument[3]), 0, atoi(argument[5])};
    unsigned char out[QROBOT_MAX_PACKET];
    struct qrobot_link link;
    int size;

    qrobot_begin(&link);
    if ((size = qrobot_put_hello(&link, &hello, 7, out)) < 0)
        return printf("refused %s\n", link.error) < 0;
    print_hex("made", out, (size_t)size);
    size = qrobot_put_bye(&link, argument[4], 8, out);
    print_hex("made", out, (size_t)size);
    return qrobot_put_bye(&link, "again", 9, out);
}

/* Arguments: robot, periods, milliseconds of patience, whether in step. Holds the arm for so many periods of QROBOT_BRIDGE's robot. */
static int talk(char **argument)
{
    struct qrobot_hello hello = {QROBOT_ROLE_COMMANDER, argument[0], "talk", 5000, atoi(argument[2]),
                                 atoi(argument[3])};
    struct qrobot_command command;
    struct qrobot_state state = {0};
    struct qrobot_link link;
    int periods = atoi(argument[1]), status = qrobot_connect(&link, NULL, &hello);

    if (status == QROBOT_OK)
        status = qrobot_exchange(&link, NULL, &state);
    while (status == QROBOT_OK && periods-- > 0) {
        qrobot_answer(&command, &state);
        status = qrobot_exchange(&link, &command, &state);
    }
    printf("%d %d %lu %lu %s\n", status, link.refusal, (unsigned long)state.seq, (unsigned long)state.ack, link.error);
    qrobot_disconnect(&link, "done");
    qrobot_disconnect(&link, "twice");
    return qrobot_exchange(&link, NULL, &state) == QROBOT_LOST ? 0 : 1;
}

int main(int argc, char **argv)
{
    if (argc == 2 && strcmp(argv[1], "judge") == 0)
        return judge();
    if (argc == 2 && strcmp(argv[1], "commands") == 0)
        return make_commands();
    if (argc == 4 && strcmp(argv[1], "others") == 0)
        return make_others(argv + 2);
    if (argc == 8 && strcmp(argv[1], "greet") == 0)
        return greet(argv + 2);
    return argc == 6 && strcmp(argv[1], "talk") == 0 ? talk(argv + 2) : 2;
}
