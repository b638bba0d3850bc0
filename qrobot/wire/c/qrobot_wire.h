/* The client's end of QRobot's wire protocol, version 3: everything a controller in C needs to command a robot.
 *
 *     #include "qrobot_wire.h"                            before any system header
 *
 *     struct qrobot_hello hello = {QROBOT_ROLE_COMMANDER, "puma560", "my program", 0, 0, 0};
 *     struct qrobot_link link;
 *     struct qrobot_state state;
 *     struct qrobot_command command;
 *
 *     if (qrobot_connect(&link, NULL, &hello) || qrobot_exchange(&link, NULL, &state))
 *         fprintf(stderr, "%s\n", link.error);
 *     while (working) {
 *         qrobot_answer(&command, &state);                a command that changes nothing
 *         ...                                             what this sample period is to change
 *         if (qrobot_exchange(&link, &command, &state))   sends it, and waits for the next state: the clock
 *             break;
 *     }
 *     qrobot_disconnect(&link, "done");
 *
 * Two layers. What has a `const char *address` or waits for something uses a TCP socket of its own. Below it
 * qrobot_begin, qrobot_put_..., qrobot_feed and qrobot_next only turn packets into bytes and back, for those who have
 * a transport and a loop already. No memory is allocated, nothing is global: a link belongs to one thread at a time.
 *
 * ISO C99 and POSIX.1-2008, any byte order. Units are SI (rad or m, N m or N); joint angles are those of the robot's
 * controller. The protocol is explained, byte by byte, in docs/reference/wire-protocol.md; the tables in here are
 * generated from qrobot/wire by docs/refresh.py, and a test compares them.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef QROBOT_WIRE_H
#define QROBOT_WIRE_H

#if defined(__STRICT_ANSI__) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200809L
#endif

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#ifdef __linux__
#include "qrobot_runtime.h" /* beside this header: where the token of a bridge on this machine is */
#endif

#ifndef AI_PASSIVE
#error "include qrobot_wire.h before the system's headers, or compile with -D_POSIX_C_SOURCE=200809L"
#endif

/* generated: constants */
#define QROBOT_MAGIC "QROB"
#define QROBOT_VERSION 3
#define QROBOT_DEFAULT_PORT 5600
#define QROBOT_MAX_JOINTS 32
#define QROBOT_NO_JOINT -1
#define QROBOT_SHORTEST_PERIOD_US 1000
#define QROBOT_LONGEST_PERIOD_US 100000
#define QROBOT_LARGEST_SETPOINT 1e+06
#define QROBOT_SIGNALS 8
#define QROBOT_ANALOG_OUTPUTS 8
#define QROBOT_LONGEST_SIGNAL 31
#define QROBOT_MAX_PACKET 4096
#define QROBOT_HEADER_BYTES 24
#define QROBOT_NAME_BYTES 64

enum {
    QROBOT_KIND_HELLO = 1, QROBOT_KIND_WELCOME = 2, QROBOT_KIND_COMMAND = 3, QROBOT_KIND_STATE = 4,
    QROBOT_KIND_ERROR = 5, QROBOT_KIND_BYE = 6, QROBOT_KIND_STOP = 7, QROBOT_KIND_SIGNALS = 8,
    QROBOT_KIND_PAYLOAD = 9, QROBOT_KIND_COLLISION = 10, QROBOT_KIND_ANALOG = 11
};
enum {
    QROBOT_ROLE_COMMANDER = 1, QROBOT_ROLE_OBSERVER = 2
};
enum {
    QROBOT_JOINT_HOLD = 0, QROBOT_JOINT_POSITION = 1, QROBOT_JOINT_TORQUE = 2
};
enum {
    QROBOT_HAND_RELAXED = 0, QROBOT_HAND_OPEN = 1, QROBOT_HAND_CLOSED = 2
};
enum {
    QROBOT_REACTION_STOP = 0, QROBOT_REACTION_COMPLY = 1
};
enum {
    QROBOT_MODE_OFF = 0, QROBOT_MODE_POWERING = 1, QROBOT_MODE_UNCALIBRATED = 2, QROBOT_MODE_CALIBRATING = 3,
    QROBOT_MODE_HOLDING = 4, QROBOT_MODE_TRACKING = 5, QROBOT_MODE_STOPPING = 6, QROBOT_MODE_FAULT = 7
};
enum {
    QROBOT_HELLO_FLAG_IN_STEP = 1
};
enum {
    QROBOT_FLAG_POWERED = 1, QROBOT_FLAG_CALIBRATED = 2, QROBOT_FLAG_ESTOP_OK = 4, QROBOT_FLAG_GUARDED = 8,
    QROBOT_FLAG_AT_REST = 16, QROBOT_FLAG_HALTED = 32, QROBOT_FLAG_PAUSED = 64, QROBOT_FLAG_NO_TORQUES = 128,
    QROBOT_FLAG_YOU_COMMAND = 256, QROBOT_FLAG_COMMANDED = 512, QROBOT_FLAG_PATH_WAITS = 1024,
    QROBOT_FLAG_IN_STEP = 2048
};
enum {
    QROBOT_REQUEST_POWER = 1, QROBOT_REQUEST_CLEAR_FAULT = 2, QROBOT_REQUEST_STOP = 4,
    QROBOT_REQUEST_HOLD_TO_RUN = 8, QROBOT_REQUEST_KEY_HELD = 16, QROBOT_REQUEST_PATH_WAITS = 32
};
enum {
    QROBOT_ERROR_MALFORMED = 1, QROBOT_ERROR_VERSION = 2, QROBOT_ERROR_WRONG_ROBOT = 3,
    QROBOT_ERROR_COMMANDER_BUSY = 4, QROBOT_ERROR_BAD_PERIOD = 5, QROBOT_ERROR_AUTHENTICATION = 6,
    QROBOT_ERROR_FULL = 7, QROBOT_ERROR_TIMEOUT = 8, QROBOT_ERROR_SERVO_GONE = 9,
    QROBOT_ERROR_INVALID_SETPOINT = 10, QROBOT_ERROR_SLOW_READER = 11, QROBOT_ERROR_PAYLOAD_REFUSED = 12,
    QROBOT_ERROR_COLLISION_REFUSED = 13, QROBOT_ERROR_ANALOG_REFUSED = 14, QROBOT_ERROR_SERVO_NEW = 15
};

/* Where the fields lie; n joints. */
enum {
    QROBOT_AT_VERSION = 4, QROBOT_AT_KIND = 5, QROBOT_AT_LENGTH = 6, QROBOT_AT_SEQ = 8, QROBOT_AT_ACK = 12,
    QROBOT_AT_T_NS = 16
};
enum {
    QROBOT_AT_HELLO_ROLE = 24, QROBOT_AT_HELLO_FLAGS = 25, QROBOT_AT_HELLO_AUTH_LENGTH = 26,
    QROBOT_AT_HELLO_PERIOD_US = 28, QROBOT_AT_HELLO_ROBOT = 32, QROBOT_AT_HELLO_PROGRAM = 96,
    QROBOT_AT_HELLO_AUTH = 160
};
#define QROBOT_HELLO_BYTES 164
enum {
    QROBOT_AT_WELCOME_ROLE = 24, QROBOT_AT_WELCOME_JOINTS = 25, QROBOT_AT_WELCOME_PERIOD_US = 28,
    QROBOT_AT_WELCOME_ROBOT = 32
};
#define QROBOT_WELCOME_BYTES 100
enum {
    QROBOT_AT_COMMAND_JOINTS = 24, QROBOT_AT_COMMAND_HAND = 25, QROBOT_AT_COMMAND_REQUESTS = 26,
    QROBOT_AT_COMMAND_STREAM = 28, QROBOT_AT_COMMAND_OUTPUTS = 32, QROBOT_AT_COMMAND_SIGNALS = 40,
    QROBOT_AT_COMMAND_SETPOINT = 104
};
#define QROBOT_AT_COMMAND_MODE(n) (104 + 8 * (size_t)(n))
#define QROBOT_COMMAND_BYTES(n) ((104 + 9 * (size_t)(n) + 3) / 4 * 4 + 4)
enum {
    QROBOT_AT_STATE_JOINTS = 24, QROBOT_AT_STATE_MODE = 25, QROBOT_AT_STATE_FAULT = 26, QROBOT_AT_STATE_EVENT = 28,
    QROBOT_AT_STATE_EVENT_JOINT = 30, QROBOT_AT_STATE_FLAGS = 32, QROBOT_AT_STATE_LATE_CYCLES = 36,
    QROBOT_AT_STATE_MISSED_FRAMES = 40, QROBOT_AT_STATE_DROPPED = 44, QROBOT_AT_STATE_INPUTS = 48,
    QROBOT_AT_STATE_HAND = 52, QROBOT_AT_STATE_OUTPUTS = 54, QROBOT_AT_STATE_Q = 56
};
#define QROBOT_AT_STATE_V(n) (56 + 8 * (size_t)(n))
#define QROBOT_AT_STATE_TAU(n) (56 + 16 * (size_t)(n))
#define QROBOT_AT_STATE_Q_SETPOINT(n) (56 + 24 * (size_t)(n))
#define QROBOT_AT_STATE_FORCE(n) (56 + 32 * (size_t)(n))
#define QROBOT_AT_STATE_SPEED_LIMIT(n) (104 + 32 * (size_t)(n))
#define QROBOT_AT_STATE_TOOL_SPEED_LIMIT(n) (112 + 32 * (size_t)(n))
#define QROBOT_AT_STATE_OVERRIDE(n) (120 + 32 * (size_t)(n))
#define QROBOT_AT_STATE_PAYLOAD_MASS(n) (128 + 32 * (size_t)(n))
#define QROBOT_AT_STATE_SENSORS(n) (136 + 32 * (size_t)(n))
#define QROBOT_STATE_BYTES(n) ((200 + 32 * (size_t)(n) + 3) / 4 * 4 + 4)
enum {
    QROBOT_AT_ERROR_CODE = 24, QROBOT_AT_ERROR_FATAL = 26, QROBOT_AT_ERROR_TEXT = 28
};
#define QROBOT_ERROR_BYTES 32
enum {
    QROBOT_AT_BYE_TEXT = 24
};
#define QROBOT_BYE_BYTES 28
enum {
    QROBOT_AT_STOP_POWER_OFF = 24
};
#define QROBOT_STOP_BYTES 32
enum {
    QROBOT_AT_SIGNALS_NAMES = 24
};
#define QROBOT_SIGNALS_BYTES 284
enum {
    QROBOT_AT_PAYLOAD_MASS = 24, QROBOT_AT_PAYLOAD_CENTRE = 32, QROBOT_AT_PAYLOAD_INERTIA = 56
};
#define QROBOT_PAYLOAD_BYTES 108
enum {
    QROBOT_AT_COLLISION_JOINTS = 24, QROBOT_AT_COLLISION_REACTION = 25, QROBOT_AT_COLLISION_THRESHOLD = 32
};
#define QROBOT_COLLISION_BYTES(n) ((32 + 8 * (size_t)(n) + 3) / 4 * 4 + 4)
enum {
    QROBOT_AT_ANALOG_VOLT = 24
};
#define QROBOT_ANALOG_BYTES 92

/* What a fault or an event is, for people. */
static inline const char *qrobot_fault_text(int code)
{
    switch (code) {
    case 0: return "NONE: no fault";
    case 1: return "ENC_STUCK: an encoder counts nothing although its motor is driven";
    case 2: return "ENC_JUMP: encoder counts jumped further than the joint can move";
    case 3: return "ENC_SIGN: a joint accelerates against its torque";
    case 5: return "CAL_MISMATCH: a potentiometer contradicts the counters or the calibration table, or does not answer";
    case 6: return "CAL_VOTE: the readings of a potentiometer do not agree on one place in the calibration table";
    case 7: return "CAL_INDEX: an index pulse was missing, or came where none can be";
    case 8: return "ENC_LOSS: an encoder has lost or gained counts: an index pulse came elsewhere than it must";
    case 9: return "BOARD_GONE: the board does not answer or its data are stale";
    case 10: return "VEL_LIMIT: a joint moved faster than its limit";
    case 11: return "DAC_STUCK: a torque nobody commanded outlasted a controlled stop: the arm is held or pushed, or a motor does not obey";
    case 12: return "RUNAWAY: a joint runs away from its command";
    case 14: return "POWER_LOST: arm power dropped while in use";
    case 15: return "POWER_NO_ACK: arm power did not come on in time";
    case 16: return "BRAKE_STUCK: a driven joint has not moved since power came on, as encoder and potentiometer say: its brake did not release";
    case 17: return "BRAKE_SLIP: the arm moved with closed brakes";
    case 18: return "SATURATED: torque stayed at its limit for too long, or while its joint fell behind its setpoints";
    case 19: return "COLLISION: something pushes a joint harder than its model can explain";
    case 21: return "OVERRUN: too many cycles were late or skipped";
    case 22: return "GUARD_TRIP: the guardian cut the torque because the servo's heartbeat stopped";
    case 25: return "RT_BUDGET: the loop would use more processor time than the kernel leaves real-time threads";
    case 26: return "PAGEFAULT: the loop had to wait for a page of memory";
    case 28: return "STREAM_LOST: setpoints stopped arriving, or no way led back to them after a lost one";
    case 36: return "GUARD_LOST: the guardian is gone";
    case 39: return "MOVING_AT_START: the arm moves although it should be at rest";
    case 41: return "LAW_NAN: the control law returned no finite torque";
    case 42: return "LAW_SLOW: the cycle with its law took more than half its period (a warning) or all of it (a stop with the built-in law)";
    case 44: return "CFG_GAIN: gains outside the range in which the loop is stable at this rate";
    case 46: return "RATE: this machine does not keep the servo rate";
    case 47: return "ESTOP: the emergency stop is pressed";
    case 49: return "RESET_DENIED: the cause of the fault persists";
    case 50: return "START_POSE: the first setpoint is far from where the arm stands";
    case 51: return "HOLD_TO_RUN: the key that lets the arm move was released, or its signal stayed away";
    case 52: return "T1_LIMIT: the tool would move faster than the reduced speed allows";
    case 53: return "SP_INVALID: a setpoint was not a finite number";
    case 54: return "SP_LIMIT: a setpoint lies outside the joint's range";
    case 55: return "SP_STEP: a setpoint asks for more speed or acceleration than the joint has";
    case 65: return "JOINT_LIMIT: a joint left its range";
    case 66: return "FOLLOWING: a joint lags behind its setpoint by more than allowed";
    case 70: return "CAL_BLOCKED: a joint needed too much torque to creep";
    case 71: return "CAL_ROOM: a joint came to the end of its range while it was calibrated";
    case 72: return "CAL_STOPPED: the calibration was stopped on request, or `qrobot calibrate` was killed";
    case 73: return "CAL_MOVED: the arm did not stay at rest while its counters were loaded";
    case 74: return "CAL_NO_TABLE: the servo has no calibration table";
    case 75: return "IO_LOST: a remote module beside the board does not answer, its inputs read as safe; or a sensor's CAN interface fails";
    case 78: return "LAW_BOUNDS: the control law wrote past the end of an array";
    case 79: return "FENCE: the arm would enter a fence of the deployment file, or come too near another arm, or one that is not heard of";
    case 80: return "BOARD_JOINTS: the board has fewer encoder channels than the robot has joints";
    case 81: return "POWER_STOPPED: somebody stopped the arm before its power was on";
    case 82: return "BOARD_CLOCK: the clock of the board's time stamps goes faster than ours, so that its joints seem slower than they are";
    default: return "a code that is not known here";
    }
}
/* end */

#define QROBOT_CONNECT_MS 3000
#define QRW_HOST_BYTES 128
#ifndef QROBOT_LINGER_MS
#define QROBOT_LINGER_MS 500 /* a bridge that does not close its end after our goodbye is left after this */
#endif
#define QROBOT_ANSWER_MS 2000 /* far beyond the longest sample period */
#define QROBOT_TOKEN_BYTES 128
#define QROBOT_TEXT_BYTES 512 /* of a text for people; longer ones are cut */

/* What every call gives back. After all but QROBOT_TIMEOUT and QROBOT_INVALID the connection is over. */
enum qrobot_status {
    QROBOT_OK = 0,
    QROBOT_TIMEOUT = -1, /* the bridge says nothing; one may go on waiting */
    QROBOT_LOST = -2,    /* nobody is there, or the connection broke, or has been closed */
    QROBOT_REFUSED = -3, /* the bridge ended it: link.refusal is the code of its ERROR, 0 for a BYE */
    QROBOT_BROKEN = -4,  /* the far end does not speak the protocol */
    QROBOT_INVALID = -5  /* what was asked for cannot be sent, and was not */
};

/* Where a conversation stands. */
enum qrobot_phase { QROBOT_GREETING, QROBOT_ANSWERING, QROBOT_COMMANDING, QROBOT_OBSERVING, QROBOT_ENDED };

struct qrobot_hello {
    int role;             /* QROBOT_ROLE_COMMANDER: one at a time; QROBOT_ROLE_OBSERVER */
    const char *robot;    /* its name; an observer may leave it empty, or NULL */
    const char *program;  /* this client, for people; empty or NULL without a name */
    uint32_t period_us;   /* wanted sample period, 0 takes the server's */
    int timeout_ms;       /* for an answer of the bridge, 0 takes QROBOT_ANSWER_MS */
    int in_step;          /* 1: states of the same seq of several arms are of one instant, see QROBOT_FLAG_IN_STEP */
};

struct qrobot_command {
    uint32_t seq, ack;    /* those of the state it answers */
    int64_t t_ns;         /* this end's clock; qrobot_send fills it in */
    uint32_t stream;      /* names one run of setpoints; after any stop the arm follows only a new one */
    uint32_t outputs;     /* binary outputs, output 1 in bit 0 */
    int requests;         /* QROBOT_REQUEST_... */
    int hand;             /* QROBOT_HAND_... */
    int mode[QROBOT_MAX_JOINTS];        /* QROBOT_JOINT_... */
    double setpoint[QROBOT_MAX_JOINTS]; /* rad or m, N m or N, as the mode says */
    double signals[QROBOT_SIGNALS];     /* numbers that the program tells, see qrobot_put_signals; NAN for none */
};

struct qrobot_payload {
    double mass;          /* kg; 0 for nothing */
    double centre[3];     /* its centre of mass in the frame of the flange, m */
    double inertia[6];    /* about that centre, along the axes of the flange, kg m2: xx yy zz xy xz yz */
};

struct qrobot_collision {
    int reaction;                        /* QROBOT_REACTION_... */
    double threshold[QROBOT_MAX_JOINTS]; /* torque that nobody commanded, N m or N; 0 for the robot file's */
};

struct qrobot_analog {
    double volt[QROBOT_ANALOG_OUTPUTS]; /* analogue outputs 1 to 8; NAN for one that stays as it is */
};

struct qrobot_state {
    uint32_t seq, ack;    /* number of the sample period; newest command that was taken */
    int64_t t_ns;         /* when it was sampled, on the server's clock */
    /* generated: state */
    int joints; /* n of WELCOME */
    int mode; /* of the servo (see Modes) */
    int fault; /* code of the fault mode, also while a stop ends in it; 0 for none */
    int event; /* newest code of any kind, 0 for none */
    int event_joint; /* joint the event speaks of, from 0; -1 for none */
    uint32_t flags; /* see Flags */
    uint32_t late_cycles; /* servo cycles that came late, since it started; wraps */
    uint32_t missed_frames; /* sample periods without a usable COMMAND, since the servo started; wraps */
    uint32_t dropped; /* COMMANDs of this connection that were refused: repeated, out of order or invalid; wraps */
    uint32_t inputs; /* binary inputs */
    int hand; /* 0 relaxed, 1 open, 2 closed */
    uint32_t outputs; /* binary outputs in force: a stop may have switched some off that are asked for */
    double q[QROBOT_MAX_JOINTS]; /* rad or m: measured joint positions */
    double v[QROBOT_MAX_JOINTS]; /* rad/s or m/s: measured joint velocities */
    double tau[QROBOT_MAX_JOINTS]; /* N m or N: commanded joint torques */
    double q_setpoint[QROBOT_MAX_JOINTS]; /* rad or m: where the servo wants the joints at this instant */
    double force[6]; /* N, N m: on the wrist sensor in its frame: fx fy fz mx my mz; NaN where it is not known */
    double speed_limit; /* share of the joints' greatest speeds that a program may plan; below 1 at reduced speed */
    double tool_speed_limit; /* m/s: most of the tool's tip; 0 where the limits of the joints are the only ones */
    double override; /* operator's speed override, 0 to 1; 1 is the speed as programmed */
    double payload_mass; /* kg: mass of the payload that the servo reckons with */
    double sensors[8]; /* V: at the channels of the board's converter that the servo samples; NaN where one does not answer */
    /* end */
};

struct qrobot_link {
    enum qrobot_phase phase;
    int joints;                          /* from here to `robot`: what the WELCOME said, 0 before */
    int role;
    uint32_t period_us;
    char robot[QROBOT_NAME_BYTES + 1];
    int refusal;                         /* code of the fatal ERROR that ended the conversation */
    char error[QROBOT_TEXT_BYTES + 256]; /* why the last call failed, for people */
    char warning[QROBOT_TEXT_BYTES + 1]; /* newest complaint of the bridge that ended nothing */
    int complaint;                       /* its QROBOT_ERROR_..., 0 before there is one */
    char peer[160];                      /* the bridge, for people */
    char token[QROBOT_TOKEN_BYTES + 1];  /* that its HELLO shows; found by qrobot_connect */
    int fd;                              /* the socket, for poll and the like; -1 when there is none */
    int timeout_ms;
    uint32_t sent, received;             /* newest sequence numbers */
    int has_sent, has_received;
    size_t waiting;                      /* bytes in `buffer` */
    unsigned char buffer[2 * QROBOT_MAX_PACKET];
};

/* ------------------------------------------------------------------------------------------- numbers, sums, texts */

static inline int qrw_fail(struct qrobot_link *link, int status, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    vsnprintf(link->error, sizeof link->error, format, values);
    va_end(values);
    if (status == QROBOT_BROKEN || status == QROBOT_REFUSED)
        link->phase = QROBOT_ENDED;
    return status;
}

static inline uint64_t qrw_get(const unsigned char *at, int bytes)
{
    uint64_t value = 0;
    while (bytes-- > 0)
        value = value << 8 | at[bytes];
    return value;
}

static inline void qrw_put(unsigned char *at, int bytes, uint64_t value)
{
    for (int i = 0; i < bytes; i++, value >>= 8)
        at[i] = (unsigned char)(value & 0xFF);
}

static inline void qrw_get_doubles(const unsigned char *at, int count, double *numbers)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits = qrw_get(at + 8 * i, 8);
        memcpy(&numbers[i], &bits, sizeof bits);
    }
}

static inline void qrw_put_doubles(unsigned char *at, int count, const double *numbers)
{
    for (int i = 0; i < count; i++) {
        uint64_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        qrw_put(at + 8 * i, 8, bits);
    }
}

/* CRC-32 of IEEE 802.3, a bit at a time: some microseconds for the longest packet there is. */
static inline uint32_t qrw_crc(const unsigned char *data, size_t size)
{
    uint32_t crc = 0xFFFFFFFF;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320 : 0);
    }
    return ~crc;
}

/* Bytes of the UTF-8 character at `at` (RFC 3629), 0 when none begins there or it is cut off. */
static inline size_t qrw_character(const unsigned char *at, size_t size)
{
    unsigned first = at[0], low = 0x80, high = 0xBF;
    size_t length = first < 0x80 ? 1 : first < 0xC2 ? 0 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : first < 0xF5 ? 4 : 0;

    if (first == 0xE0 || first == 0xF0) /* shorter forms exist */
        low = first == 0xE0 ? 0xA0 : 0x90;
    if (first == 0xED || first == 0xF4) /* surrogates; beyond the last code point */
        high = first == 0xED ? 0x9F : 0x8F;
    if (length > size || (length > 1 && (at[1] < low || at[1] > high)))
        return 0;
    for (size_t i = 2; i < length; i++)
        if ((at[i] & 0xC0) != 0x80)
            return 0;
    return length;
}

/* True for a character that a terminal or a log would obey: the ranges of qrobot/printable.py, as UTF-8. */
static inline int qrw_is_control(const unsigned char *at, size_t length)
{
    if (length == 1)
        return at[0] < 0x20 || at[0] == 0x7F;
    if (length == 2)
        return at[0] == 0xC2 && at[1] < 0xA0;
    return length == 3 && at[0] == 0xE2 &&
           ((at[1] == 0x80 && at[2] >= 0xA8 && at[2] <= 0xAE) || (at[1] == 0x81 && at[2] >= 0xA6 && at[2] <= 0xA9));
}

/* Text up to the first 0, with a question mark for each control character, cut after a whole character where it is too
 * long. Returns 0, or -1 when it is not UTF-8. */
static inline int qrw_get_text(const unsigned char *at, size_t size, char *text, size_t room)
{
    size_t end = 0, step, length;
    int full = 0;

    for (size_t i = 0; i < size && at[i] != 0; i += step) {
        step = qrw_character(at + i, size - i);
        if (step == 0)
            return -1;
        length = qrw_is_control(at + i, step) ? 1 : step;
        full = full || end + length >= room;
        if (!full)
            memcpy(text + end, length == step && !qrw_is_control(at + i, step) ? at + i : (const unsigned char *)"?",
                   length);
        end += full ? 0 : length;
    }
    text[end] = '\0';
    return 0;
}

/* ---------------------------------------------------------------------------------------------- packets to bytes */

/* Header and checksum around a payload that is in place already. */
static inline size_t qrw_seal(unsigned char *out, int kind, size_t size, uint32_t seq, uint32_t ack, int64_t t_ns)
{
    memcpy(out, QROBOT_MAGIC, 4);
    qrw_put(out + QROBOT_AT_VERSION, 1, QROBOT_VERSION);
    qrw_put(out + QROBOT_AT_KIND, 1, (uint64_t)kind);
    qrw_put(out + QROBOT_AT_LENGTH, 2, size);
    qrw_put(out + QROBOT_AT_SEQ, 4, seq);
    qrw_put(out + QROBOT_AT_ACK, 4, ack);
    qrw_put(out + QROBOT_AT_T_NS, 8, (uint64_t)t_ns);
    qrw_put(out + size - 4, 4, qrw_crc(out, size - 4));
    return size;
}

/* A fresh conversation without a socket. */
static inline void qrobot_begin(struct qrobot_link *link)
{
    memset(link, 0, sizeof *link);
    link->fd = -1;
    link->timeout_ms = QROBOT_ANSWER_MS;
    strcpy(link->peer, "the bridge");
}

/* The HELLO as bytes, with link->token. Returns how many, or QROBOT_INVALID. */
static inline int qrobot_put_hello(struct qrobot_link *link, const struct qrobot_hello *hello, int64_t t_ns,
                                   unsigned char out[QROBOT_MAX_PACKET])
{
    const char *robot = hello->robot != NULL ? hello->robot : "";
    const char *program = hello->program != NULL ? hello->program : "";
    size_t token = strlen(link->token);

    if (link->phase != QROBOT_GREETING)
        return qrw_fail(link, QROBOT_INVALID, "HELLO is the first packet of a connection and comes once");
    if (hello->role != QROBOT_ROLE_COMMANDER && hello->role != QROBOT_ROLE_OBSERVER)
        return qrw_fail(link, QROBOT_INVALID, "unknown role %d", hello->role);
    if (strlen(robot) > QROBOT_NAME_BYTES || strlen(program) > QROBOT_NAME_BYTES)
        return qrw_fail(link, QROBOT_INVALID, "names have at most %d bytes", QROBOT_NAME_BYTES);
    memset(out, 0, QROBOT_HELLO_BYTES + QROBOT_TOKEN_BYTES);
    qrw_put(out + QROBOT_AT_HELLO_ROLE, 1, (uint64_t)hello->role);
    qrw_put(out + QROBOT_AT_HELLO_FLAGS, 1, hello->in_step ? QROBOT_HELLO_FLAG_IN_STEP : 0);
    qrw_put(out + QROBOT_AT_HELLO_PERIOD_US, 4, hello->period_us);
    memcpy(out + QROBOT_AT_HELLO_ROBOT, robot, strlen(robot));
    memcpy(out + QROBOT_AT_HELLO_PROGRAM, program, strlen(program));
    qrw_put(out + QROBOT_AT_HELLO_AUTH_LENGTH, 2, token);
    memcpy(out + QROBOT_AT_HELLO_AUTH, link->token, token);
    link->phase = QROBOT_ANSWERING;
    return (int)qrw_seal(out, QROBOT_KIND_HELLO, QROBOT_HELLO_BYTES + (token + 3) / 4 * 4, 0, 0, t_ns);
}

static inline int qrw_is_newer(uint32_t seq, uint32_t newest, int has_newest)
{
    return !has_newest || (seq != newest && seq - newest < 0x80000000); /* RFC 1982 */
}

/* What is wrong with a command: NULL, or why it cannot be sent. Impossible setpoints beside a stop or a power-off are
 * left to the bridge to refuse, for the sake of what must get through. */
static inline const char *qrw_objection(const struct qrobot_link *link, const struct qrobot_command *command)
{
    int takes_away = (command->requests & QROBOT_REQUEST_STOP) != 0 || (command->requests & QROBOT_REQUEST_POWER) == 0;

    if (link->phase != QROBOT_COMMANDING)
        return "only a commander that was welcomed may send COMMAND";
    if (!qrw_is_newer(command->seq, link->sent, link->has_sent))
        return "its seq is not newer than that of the command before it";
    if (command->hand < 0 || command->hand > QROBOT_HAND_CLOSED)
        return "there is no such state of the hand";
    if (command->requests < 0 || command->requests > 0xFFFF)
        return "requests have 16 bits";
    for (int i = 0; i < link->joints; i++) {
        if (command->mode[i] < 0 || command->mode[i] > QROBOT_JOINT_TORQUE)
            return "there is no such joint mode";
        if (!takes_away &&
            !(command->setpoint[i] >= -QROBOT_LARGEST_SETPOINT && command->setpoint[i] <= QROBOT_LARGEST_SETPOINT))
            return "a setpoint is not a number of sane size";
    }
    return NULL;
}

/* A COMMAND as bytes. Returns how many, or QROBOT_INVALID; nothing has changed then. */
static inline int qrobot_put_command(struct qrobot_link *link, const struct qrobot_command *command,
                                     unsigned char out[QROBOT_MAX_PACKET])
{
    const char *objection = qrw_objection(link, command);
    int n = link->joints;

    if (objection != NULL)
        return qrw_fail(link, QROBOT_INVALID, "command %lu: %s", (unsigned long)command->seq, objection);
    memset(out, 0, QROBOT_COMMAND_BYTES(n));
    qrw_put(out + QROBOT_AT_COMMAND_JOINTS, 1, (uint64_t)n);
    qrw_put(out + QROBOT_AT_COMMAND_HAND, 1, (uint64_t)command->hand);
    qrw_put(out + QROBOT_AT_COMMAND_REQUESTS, 2, (uint64_t)command->requests);
    qrw_put(out + QROBOT_AT_COMMAND_STREAM, 4, command->stream);
    qrw_put(out + QROBOT_AT_COMMAND_OUTPUTS, 4, command->outputs);
    qrw_put_doubles(out + QROBOT_AT_COMMAND_SIGNALS, QROBOT_SIGNALS, command->signals);
    qrw_put_doubles(out + QROBOT_AT_COMMAND_SETPOINT, n, command->setpoint);
    for (int i = 0; i < n; i++)
        qrw_put(out + QROBOT_AT_COMMAND_MODE(n) + i, 1, (uint64_t)command->mode[i]);
    link->sent = command->seq;
    link->has_sent = 1;
    return (int)qrw_seal(out, QROBOT_KIND_COMMAND, QROBOT_COMMAND_BYTES(n), command->seq, command->ack, command->t_ns);
}

/* A STOP as bytes, which observers may send too: the arm stops on its path and holds, with `power_off` loses its power.
 * Returns how many, or QROBOT_INVALID. */
static inline int qrobot_put_stop(struct qrobot_link *link, int power_off, int64_t t_ns,
                                  unsigned char out[QROBOT_MAX_PACKET])
{
    if (link->phase != QROBOT_COMMANDING && link->phase != QROBOT_OBSERVING)
        return qrw_fail(link, QROBOT_INVALID, "only a client that was welcomed may send STOP");
    memset(out, 0, QROBOT_STOP_BYTES);
    qrw_put(out + QROBOT_AT_STOP_POWER_OFF, 1, power_off != 0);
    return (int)qrw_seal(out, QROBOT_KIND_STOP, QROBOT_STOP_BYTES, 0, 0, t_ns);
}

/* True when the first of `names` stands among those behind it. */
static inline int qrw_is_named_again(const char *names)
{
    size_t length = strcspn(names, " ");

    for (const char *other = names + length; *other == ' '; other += 1 + strcspn(other + 1, " "))
        if (strcspn(other + 1, " ") == length && memcmp(other + 1, names, length) == 0)
            return 1;
    return 0;
}

/* True for up to QROBOT_SIGNALS names of letters, digits and underscores, no two alike, with one blank between two. */
static inline int qrw_are_names(const char *names)
{
    int count = 0, length = 0;

    for (; *names != '\0'; names++) {
        int letter = (*names >= 'a' && *names <= 'z') || (*names >= 'A' && *names <= 'Z') || *names == '_';

        if (*names == ' ' && length > 0 && names[1] != '\0') {
            length = 0;
            continue;
        }
        if (length == 0 && (++count > QROBOT_SIGNALS || qrw_is_named_again(names)))
            return 0;
        if (!letter && !(*names >= '0' && *names <= '9' && length > 0))
            return 0;
        if (++length > QROBOT_LONGEST_SIGNAL)
            return 0;
    }
    return 1;
}

/* The names of command.signals from now on as bytes, such as "pressure depth". Returns how many, or QROBOT_INVALID. */
static inline int qrobot_put_signals(struct qrobot_link *link, const char *names, int64_t t_ns,
                                     unsigned char out[QROBOT_MAX_PACKET])
{
    if (link->phase != QROBOT_COMMANDING)
        return qrw_fail(link, QROBOT_INVALID, "only a commander that was welcomed may send SIGNALS");
    if (!qrw_are_names(names))
        return qrw_fail(link, QROBOT_INVALID, "signals \"%s\": at most %d names of letters, digits and _, no two alike, "
                        "with one blank between two, at most %d bytes each", names, QROBOT_SIGNALS, QROBOT_LONGEST_SIGNAL);
    memset(out, 0, QROBOT_SIGNALS_BYTES);
    memcpy(out + QROBOT_AT_SIGNALS_NAMES, names, strlen(names));
    return (int)qrw_seal(out, QROBOT_KIND_SIGNALS, QROBOT_SIGNALS_BYTES, 0, 0, t_ns);
}

/* A PAYLOAD as bytes. Returns how many, or QROBOT_INVALID; whether the arm can carry it, STATE's payload_mass says. */
static inline int qrobot_put_payload(struct qrobot_link *link, const struct qrobot_payload *payload, int64_t t_ns,
                                     unsigned char out[QROBOT_MAX_PACKET])
{
    if (link->phase != QROBOT_COMMANDING)
        return qrw_fail(link, QROBOT_INVALID, "only a commander that was welcomed may send PAYLOAD");
    memset(out, 0, QROBOT_PAYLOAD_BYTES);
    qrw_put_doubles(out + QROBOT_AT_PAYLOAD_MASS, 1, &payload->mass);
    qrw_put_doubles(out + QROBOT_AT_PAYLOAD_CENTRE, 3, payload->centre);
    qrw_put_doubles(out + QROBOT_AT_PAYLOAD_INERTIA, 6, payload->inertia);
    return (int)qrw_seal(out, QROBOT_KIND_PAYLOAD, QROBOT_PAYLOAD_BYTES, 0, 0, t_ns);
}

/* A COLLISION as bytes. Returns how many, or QROBOT_INVALID; thresholds that are refused come as link.warning. */
static inline int qrobot_put_collision(struct qrobot_link *link, const struct qrobot_collision *collision, int64_t t_ns,
                                       unsigned char out[QROBOT_MAX_PACKET])
{
    size_t size = QROBOT_COLLISION_BYTES(link->joints);

    if (link->phase != QROBOT_COMMANDING)
        return qrw_fail(link, QROBOT_INVALID, "only a commander that was welcomed may send COLLISION");
    if (collision->reaction != QROBOT_REACTION_STOP && collision->reaction != QROBOT_REACTION_COMPLY)
        return qrw_fail(link, QROBOT_INVALID, "reaction %d: 0 and 1 exist", collision->reaction);
    memset(out, 0, size);
    out[QROBOT_AT_COLLISION_JOINTS] = (unsigned char)link->joints;
    out[QROBOT_AT_COLLISION_REACTION] = (unsigned char)collision->reaction;
    qrw_put_doubles(out + QROBOT_AT_COLLISION_THRESHOLD, link->joints, collision->threshold);
    return (int)qrw_seal(out, QROBOT_KIND_COLLISION, size, 0, 0, t_ns);
}

/* An ANALOG as bytes. Returns how many, or QROBOT_INVALID; volts that are refused come as link.warning. */
static inline int qrobot_put_analog(struct qrobot_link *link, const struct qrobot_analog *analog, int64_t t_ns,
                                    unsigned char out[QROBOT_MAX_PACKET])
{
    if (link->phase != QROBOT_COMMANDING)
        return qrw_fail(link, QROBOT_INVALID, "only a commander that was welcomed may send ANALOG");
    memset(out, 0, QROBOT_ANALOG_BYTES);
    qrw_put_doubles(out + QROBOT_AT_ANALOG_VOLT, QROBOT_ANALOG_OUTPUTS, analog->volt);
    return (int)qrw_seal(out, QROBOT_KIND_ANALOG, QROBOT_ANALOG_BYTES, 0, 0, t_ns);
}

/* The BYE that ends a conversation, as bytes. Returns how many; 0 when it is over already. */
static inline int qrobot_put_bye(struct qrobot_link *link, const char *reason, int64_t t_ns,
                                 unsigned char out[QROBOT_MAX_PACKET])
{
    size_t length = strlen(reason) < QROBOT_TEXT_BYTES ? strlen(reason) : QROBOT_TEXT_BYTES;

    if (link->phase == QROBOT_ENDED)
        return 0;
    while (length > 0 && (reason[length] & 0xC0) == 0x80) /* not within a character */
        length--;
    memset(out, 0, QROBOT_AT_BYE_TEXT + QROBOT_TEXT_BYTES);
    memcpy(out + QROBOT_AT_BYE_TEXT, reason, length);
    link->phase = QROBOT_ENDED;
    return (int)qrw_seal(out, QROBOT_KIND_BYE, QROBOT_BYE_BYTES + (length + 3) / 4 * 4, 0, 0, t_ns);
}

/* ---------------------------------------------------------------------------------------------- bytes to packets */

static inline int qrw_take_welcome(struct qrobot_link *link, const unsigned char *frame, size_t size)
{
    int role = frame[QROBOT_AT_WELCOME_ROLE], joints = frame[QROBOT_AT_WELCOME_JOINTS];
    uint32_t period_us = (uint32_t)qrw_get(frame + QROBOT_AT_WELCOME_PERIOD_US, 4);

    if (size != QROBOT_WELCOME_BYTES || link->phase != QROBOT_ANSWERING)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a WELCOME of the wrong size or out of turn", link->peer);
    if (joints < 1 || joints > QROBOT_MAX_JOINTS || (role != QROBOT_ROLE_COMMANDER && role != QROBOT_ROLE_OBSERVER) ||
        period_us < QROBOT_SHORTEST_PERIOD_US || period_us > QROBOT_LONGEST_PERIOD_US ||
        qrw_get_text(frame + QROBOT_AT_WELCOME_ROBOT, QROBOT_NAME_BYTES, link->robot, sizeof link->robot) != 0)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a WELCOME that makes no sense", link->peer);
    link->role = role;
    link->joints = joints;
    link->period_us = period_us;
    link->phase = role == QROBOT_ROLE_COMMANDER ? QROBOT_COMMANDING : QROBOT_OBSERVING;
    return QROBOT_KIND_WELCOME;
}

static inline void qrw_decode_state(const unsigned char *frame, struct qrobot_state *state)
{
    int n = frame[QROBOT_AT_STATE_JOINTS];

    state->seq = (uint32_t)qrw_get(frame + QROBOT_AT_SEQ, 4);
    state->ack = (uint32_t)qrw_get(frame + QROBOT_AT_ACK, 4);
    state->t_ns = (int64_t)qrw_get(frame + QROBOT_AT_T_NS, 8);
    /* generated: decode */
    state->joints = (int)qrw_get(frame + QROBOT_AT_STATE_JOINTS, 1);
    state->mode = (int)qrw_get(frame + QROBOT_AT_STATE_MODE, 1);
    state->fault = (int)qrw_get(frame + QROBOT_AT_STATE_FAULT, 2);
    state->event = (int)qrw_get(frame + QROBOT_AT_STATE_EVENT, 2);
    state->event_joint = (int16_t)qrw_get(frame + QROBOT_AT_STATE_EVENT_JOINT, 2);
    state->flags = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_FLAGS, 4);
    state->late_cycles = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_LATE_CYCLES, 4);
    state->missed_frames = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_MISSED_FRAMES, 4);
    state->dropped = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_DROPPED, 4);
    state->inputs = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_INPUTS, 4);
    state->hand = (int)qrw_get(frame + QROBOT_AT_STATE_HAND, 1);
    state->outputs = (uint32_t)qrw_get(frame + QROBOT_AT_STATE_OUTPUTS, 2);
    qrw_get_doubles(frame + QROBOT_AT_STATE_Q, n, state->q);
    qrw_get_doubles(frame + QROBOT_AT_STATE_V(n), n, state->v);
    qrw_get_doubles(frame + QROBOT_AT_STATE_TAU(n), n, state->tau);
    qrw_get_doubles(frame + QROBOT_AT_STATE_Q_SETPOINT(n), n, state->q_setpoint);
    qrw_get_doubles(frame + QROBOT_AT_STATE_FORCE(n), 6, state->force);
    qrw_get_doubles(frame + QROBOT_AT_STATE_SPEED_LIMIT(n), 1, &state->speed_limit);
    qrw_get_doubles(frame + QROBOT_AT_STATE_TOOL_SPEED_LIMIT(n), 1, &state->tool_speed_limit);
    qrw_get_doubles(frame + QROBOT_AT_STATE_OVERRIDE(n), 1, &state->override);
    qrw_get_doubles(frame + QROBOT_AT_STATE_PAYLOAD_MASS(n), 1, &state->payload_mass);
    qrw_get_doubles(frame + QROBOT_AT_STATE_SENSORS(n), 8, state->sensors);
    /* end */
}

/* Returns QROBOT_KIND_STATE, 0 for one that is not newer than the one before, or QROBOT_BROKEN. */
static inline int qrw_take_state(struct qrobot_link *link, const unsigned char *frame, size_t size,
                                 struct qrobot_state *state)
{
    int n = size > QROBOT_HEADER_BYTES + 4 ? frame[QROBOT_AT_STATE_JOINTS] : 0;
    uint32_t seq = (uint32_t)qrw_get(frame + QROBOT_AT_SEQ, 4);

    if (link->phase != QROBOT_COMMANDING && link->phase != QROBOT_OBSERVING)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a STATE before its WELCOME", link->peer);
    if (n != link->joints || size != QROBOT_STATE_BYTES(n))
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a STATE of %d joints in %d bytes", link->peer, n, (int)size);
    if (!qrw_is_newer(seq, link->received, link->has_received))
        return 0;
    link->received = seq;
    link->has_received = 1;
    qrw_decode_state(frame, state);
    return QROBOT_KIND_STATE;
}

static inline int qrw_take_error(struct qrobot_link *link, const unsigned char *frame, size_t size)
{
    char text[QROBOT_TEXT_BYTES + 1];

    if (size < QROBOT_ERROR_BYTES ||
        qrw_get_text(frame + QROBOT_AT_ERROR_TEXT, size - QROBOT_ERROR_BYTES, text, sizeof text) != 0)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent an ERROR that cannot be read", link->peer);
    if (frame[QROBOT_AT_ERROR_FATAL] != 0) {
        link->refusal = (int)qrw_get(frame + QROBOT_AT_ERROR_CODE, 2);
        return qrw_fail(link, QROBOT_REFUSED, "%s refused: %s", link->peer, text);
    }
    if (link->phase != QROBOT_COMMANDING && link->phase != QROBOT_OBSERVING)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent an ERROR before its WELCOME", link->peer);
    memcpy(link->warning, text, sizeof text);
    link->complaint = (int)qrw_get(frame + QROBOT_AT_ERROR_CODE, 2);
    return QROBOT_KIND_ERROR;
}

static inline int qrw_take_bye(struct qrobot_link *link, const unsigned char *frame, size_t size)
{
    char text[QROBOT_TEXT_BYTES + 1];

    if (qrw_get_text(frame + QROBOT_AT_BYE_TEXT, size - QROBOT_BYE_BYTES, text, sizeof text) != 0)
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a BYE that cannot be read", link->peer);
    return qrw_fail(link, QROBOT_REFUSED, "%s said goodbye: %s", link->peer, text);
}

static inline int qrw_take(struct qrobot_link *link, const unsigned char *frame, size_t size,
                           struct qrobot_state *state)
{
    int kind = frame[QROBOT_AT_KIND], version = frame[QROBOT_AT_VERSION];

    if (qrw_crc(frame, size - 4) != qrw_get(frame + size - 4, 4))
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a packet with a wrong checksum", link->peer);
    if (version != QROBOT_VERSION && kind != QROBOT_KIND_ERROR)
        return qrw_fail(link, QROBOT_BROKEN, "%s speaks version %d of the protocol, this is version %d", link->peer,
                        version, QROBOT_VERSION);
    switch (kind) {
    case QROBOT_KIND_WELCOME:
        return qrw_take_welcome(link, frame, size);
    case QROBOT_KIND_STATE:
        return qrw_take_state(link, frame, size, state);
    case QROBOT_KIND_ERROR:
        return qrw_take_error(link, frame, size);
    case QROBOT_KIND_BYE:
        return qrw_take_bye(link, frame, size);
    default:
        return qrw_fail(link, QROBOT_BROKEN, "%s sent a packet of kind %d", link->peer, kind);
    }
}

/* Take bytes from the far end. Returns how many there was room for; the rest may be fed after qrobot_next. */
static inline size_t qrobot_feed(struct qrobot_link *link, const unsigned char *data, size_t size)
{
    size_t room = sizeof link->buffer - link->waiting;

    if (size > room)
        size = room;
    memcpy(link->buffer + link->waiting, data, size);
    link->waiting += size;
    return size;
}

/* The next thing the far end said: its QROBOT_KIND_..., 0 when that takes more bytes, or a negative status when the
 * conversation is over. A STATE is put into `state`; of an ERROR that ends nothing the text is in link.warning. */
static inline int qrobot_next(struct qrobot_link *link, struct qrobot_state *state)
{
    int heard = 0;

    while (heard == 0 && link->phase != QROBOT_ENDED && link->waiting >= 8) {
        size_t length = (size_t)qrw_get(link->buffer + QROBOT_AT_LENGTH, 2);

        if (memcmp(link->buffer, QROBOT_MAGIC, 4) != 0 || length % 4 != 0 || length > QROBOT_MAX_PACKET ||
            length < QROBOT_HEADER_BYTES + 4)
            return qrw_fail(link, QROBOT_BROKEN, "%s sent what is no packet", link->peer);
        if (length > link->waiting)
            return 0;
        heard = qrw_take(link, link->buffer, length, state);
        link->waiting -= length;
        memmove(link->buffer, link->buffer + length, link->waiting);
    }
    if (heard == 0 && link->phase == QROBOT_ENDED)
        return link->error[0] ? QROBOT_LOST : qrw_fail(link, QROBOT_LOST, "the conversation is over");
    return heard;
}

/* A command that answers `state` and changes nothing: joints hold, power, hand and outputs stay. */
static inline void qrobot_answer(struct qrobot_command *command, const struct qrobot_state *state)
{
    memset(command, 0, sizeof *command);
    for (int i = 0; i < QROBOT_SIGNALS; i++) {
        uint64_t quiet_nan = UINT64_C(0x7FF8000000000000); /* NAN wants <math.h> */
        memcpy(&command->signals[i], &quiet_nan, sizeof quiet_nan);
    }
    command->seq = command->ack = state->seq;
    command->requests = state->flags & QROBOT_FLAG_POWERED ? QROBOT_REQUEST_POWER : 0;
    command->hand = state->hand;
    command->outputs = state->outputs;
}

/* ------------------------------------------------------------------------------------------------- over a socket */

static inline int64_t qrobot_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

static inline void qrw_close(struct qrobot_link *link)
{
    int fd = link->fd;

    link->fd = -1; /* first: a child that is forked now closes what it sees here */
    if (fd >= 0)
        close(fd);
    link->phase = QROBOT_ENDED;
}

/* Wait until `events` is possible. Returns 1, or 0 when `until_ns` has come first. */
static inline int qrw_wait(int fd, short events, int64_t until_ns)
{
    struct pollfd socket_of_ours = {fd, events, 0};

    for (;;) {
        int64_t left_ms = (until_ns - qrobot_now_ns() + 999999) / 1000000;
        int ready = poll(&socket_of_ours, 1, left_ms > 0 ? (int)left_ms : 0);

        if (ready > 0 || (ready < 0 && errno != EINTR))
            return 1;
        if (ready == 0 && left_ms <= 0)
            return 0;
    }
}

/* Read what has come. Returns 0, or QROBOT_LOST. */
static inline int qrw_read(struct qrobot_link *link)
{
    size_t room = sizeof link->buffer - link->waiting;
    ssize_t size = recv(link->fd, link->buffer + link->waiting, room, 0);

    if (size > 0)
        link->waiting += (size_t)size;
    if (size > 0 || (size < 0 && (errno == EINTR || errno == EAGAIN || errno == EWOULDBLOCK)))
        return 0;
    return qrw_fail(link, QROBOT_LOST, "%s closed the connection%s%s", link->peer, size < 0 ? ": " : "",
                    size < 0 ? strerror(errno) : "");
}

/* Wait for the WELCOME, or for a state and leave none unread: of several the newest counts. */
static inline int qrw_await(struct qrobot_link *link, struct qrobot_state *state)
{
    int64_t until_ns = qrobot_now_ns() + link->timeout_ms * INT64_C(1000000);
    int found = 0, heard;

    for (;;) {
        while ((heard = qrobot_next(link, state)) > 0) {
            if (heard == QROBOT_KIND_WELCOME) /* states may lie behind it; they are for the first exchange */
                return QROBOT_OK;
            found = found || heard == QROBOT_KIND_STATE;
        }
        if (heard == 0 && !qrw_wait(link->fd, POLLIN, found ? 0 : until_ns))
            break;
        if (heard == 0 && found && qrobot_now_ns() > until_ns) /* it never stops talking */
            break;
        if (heard < 0 || (heard = qrw_read(link)) < 0) {
            qrw_close(link);
            return heard;
        }
    }
    if (found)
        return QROBOT_OK;
    return qrw_fail(link, QROBOT_TIMEOUT, "%s has fallen silent%s%s", link->peer,
                    link->warning[0] ? "; its last words: " : "", link->warning);
}

/* A server that refuses closes at once; why it did may still lie in the socket. */
static inline int qrw_last_words(struct qrobot_link *link, int error)
{
    struct qrobot_state state;
    int heard = 0;

    if (qrw_wait(link->fd, POLLIN, 0) && qrw_read(link) == 0)
        while ((heard = qrobot_next(link, &state)) > 0)
            continue;
    qrw_close(link);
    return heard < 0 ? heard : qrw_fail(link, QROBOT_LOST, "lost %s: %s", link->peer, strerror(error));
}

static inline int qrw_write(struct qrobot_link *link, const unsigned char *data, int size)
{
    int64_t until_ns = qrobot_now_ns() + link->timeout_ms * INT64_C(1000000);

    while (size > 0) {
        ssize_t sent = send(link->fd, data, (size_t)size, MSG_NOSIGNAL);

        if (sent < 0 && errno != EINTR && errno != EAGAIN && errno != EWOULDBLOCK)
            return qrw_last_words(link, errno);
        if (sent < 0 && !qrw_wait(link->fd, POLLOUT, until_ns))
            return qrw_last_words(link, ETIMEDOUT);
        if (sent > 0) {
            data += sent;
            size -= (int)sent;
        }
    }
    return QROBOT_OK;
}

#ifdef SOCK_CLOEXEC
#define QRW_CLOEXEC SOCK_CLOEXEC /* at once: another thread may start a program */
#else
#define QRW_CLOEXEC 0
#endif

/* One try. The socket is link->fd while it connects as well: a child that is forked meanwhile can close it. Where none
 * is left, link->fd is -1, and errno says why. */
static inline void qrw_open(struct qrobot_link *link, const struct addrinfo *where, int64_t until_ns)
{
    int fd = socket(where->ai_family, where->ai_socktype | QRW_CLOEXEC, where->ai_protocol), error = 0, yes = 1;
    socklen_t size = sizeof error;

    if (fd >= 0 && fd <= 2) { /* a standard stream that was closed: what the program prints is no packet */
        int higher = fcntl(fd, F_DUPFD_CLOEXEC, 3);

        close(fd);
        fd = higher;
    }
    if (fd < 0)
        return;
    link->fd = fd;
    if (fcntl(fd, F_SETFL, O_NONBLOCK) == 0 && fcntl(fd, F_SETFD, FD_CLOEXEC) == 0 &&
        (connect(fd, where->ai_addr, where->ai_addrlen) == 0 || errno == EINPROGRESS)) {
        if (!qrw_wait(fd, POLLOUT, until_ns))
            error = ETIMEDOUT;
        else
            getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
        if (error == 0 && setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes) == 0)
            return;
    }
    error = error ? error : errno;
    link->fd = -1;
    close(fd);
    errno = error;
}

/* Host and port of an address, as in qrobot_connect. */
static inline int qrw_split(struct qrobot_link *link, const char *address, char host[QRW_HOST_BYTES], int *port)
{
    const char *colon = strrchr(address, ':');
    size_t length = colon ? (size_t)(colon - address) : strlen(address);

    *port = colon && colon[1] ? atoi(colon + 1) : QROBOT_DEFAULT_PORT;
    if (length >= QRW_HOST_BYTES || *port < 1 || *port > 65535)
        return qrw_fail(link, QROBOT_INVALID, "\"%s\" is no address; host:port is needed, as in 127.0.0.1:%d", address,
                        QROBOT_DEFAULT_PORT);
    memcpy(host, length > 0 ? address : "127.0.0.1", length > 0 ? length : sizeof "127.0.0.1");
    host[length > 0 ? length : sizeof "127.0.0.1" - 1] = '\0';
    return QROBOT_OK;
}

#define QRW_BLANKS " \t\r\n" /* around a token in the environment */

/* What to show the bridge: QROBOT_TOKEN of the environment, or, on this machine, the file in the runtime folder. */
static inline void qrw_find_token(struct qrobot_link *link, const char *host, int port)
{
    const char *given = getenv("QROBOT_TOKEN");
    ssize_t size = 0;
    int fd = -1;
#ifdef __linux__
    char name[64];

    snprintf(name, sizeof name, "bridge-%d.token", port);
    if (given == NULL && (strncmp(host, "127.", 4) == 0 || strcmp(host, "localhost") == 0 || strcmp(host, "::1") == 0))
        fd = qrobot_runtime_open(name, O_RDONLY);
#else
    (void)host, (void)port;
#endif
    if (given != NULL) {
        given += strspn(given, QRW_BLANKS);
        snprintf(link->token, sizeof link->token, "%.*s", (int)strcspn(given, QRW_BLANKS), given);
    }
    if (fd >= 0) {
        size = read(fd, link->token, QROBOT_TOKEN_BYTES);
        close(fd);
        link->token[size > 0 ? size : 0] = '\0';
    }
}

/* Connect to the bridge. */
static inline int qrw_reach(struct qrobot_link *link, const char *host, int number)
{
    int64_t until_ns = qrobot_now_ns() + QROBOT_CONNECT_MS * INT64_C(1000000);
    char port[16];
    struct addrinfo hints, *found = NULL, *each;
    int unknown, error;

    snprintf(port, sizeof port, "%d", number);
    snprintf(link->peer, sizeof link->peer, "the bridge at %s:%s", host, port);
    memset(&hints, 0, sizeof hints);
    hints.ai_socktype = SOCK_STREAM;
    unknown = getaddrinfo(host, port, &hints, &found); /* why is in errno for EAI_SYSTEM alone (RFC 3493, 6.1) */
    if (unknown != 0)
        return qrw_fail(link, QROBOT_LOST, "no address of %s: %s", link->peer,
                        unknown == EAI_SYSTEM ? strerror(errno) : gai_strerror(unknown));
    errno = EHOSTUNREACH;
    for (each = found; each != NULL && link->fd < 0; each = each->ai_next)
        qrw_open(link, each, until_ns);
    error = errno;
    freeaddrinfo(found);
    if (link->fd >= 0)
        return QROBOT_OK;
    return qrw_fail(link, error == ETIMEDOUT ? QROBOT_TIMEOUT : QROBOT_LOST, "no answer of %s: %s%s", link->peer,
                    strerror(error), error == ECONNREFUSED ? "; start one with `qrobot up`" : "");
}

/* Wait until the far end closes; to close with unread input would take back what was sent (RFC 9293, 3.6.1). */
static inline void qrw_read_to_the_end(int fd)
{
    int64_t until_ns = qrobot_now_ns() + QROBOT_LINGER_MS * INT64_C(1000000);
    unsigned char unwanted[QROBOT_MAX_PACKET];
    ssize_t size = 1;

    while (size != 0 && qrw_wait(fd, POLLIN, until_ns) && qrobot_now_ns() < until_ns) {
        size = recv(fd, unwanted, sizeof unwanted, 0);
        if (size < 0 && errno != EINTR && errno != EAGAIN && errno != EWOULDBLOCK)
            return;
    }
}

/* Say goodbye, and close when the bridge has heard it: within QROBOT_LINGER_MS. The arm stops on its path; may be
 * called twice, and after any failure. */
static inline void qrobot_disconnect(struct qrobot_link *link, const char *reason)
{
    unsigned char out[QROBOT_MAX_PACKET];
    int size;

    if (link->fd >= 0 && (size = qrobot_put_bye(link, reason, qrobot_now_ns(), out)) > 0 &&
        send(link->fd, out, (size_t)size, MSG_NOSIGNAL) == size && shutdown(link->fd, SHUT_WR) == 0)
        qrw_read_to_the_end(link->fd);
    qrw_close(link);
}

/* Reach the bridge and be welcomed. `address` is "host:port", "host" or ":port"; NULL takes the environment's
 * QROBOT_BRIDGE, and without one 127.0.0.1 and the default port. Returns QROBOT_OK, or a status with link.error. */
static inline int qrobot_connect(struct qrobot_link *link, const char *address, const struct qrobot_hello *hello)
{
    unsigned char out[QROBOT_MAX_PACKET];
    char host[QRW_HOST_BYTES];
    int status, size, port;

    qrobot_begin(link);
    if (hello->timeout_ms > 0)
        link->timeout_ms = hello->timeout_ms;
    if (address == NULL)
        address = getenv("QROBOT_BRIDGE");
    if ((status = qrw_split(link, address ? address : "", host, &port)) != QROBOT_OK)
        return status;
    qrw_find_token(link, host, port);
    if ((size = qrobot_put_hello(link, hello, qrobot_now_ns(), out)) < 0)
        return size;
    if ((status = qrw_reach(link, host, port)) == QROBOT_OK &&
        (status = qrw_write(link, out, size)) == QROBOT_OK)
        status = qrw_await(link, NULL);
    if (status != QROBOT_OK)
        qrw_close(link);
    return status;
}

/* Send a command without waiting for anything. */
static inline int qrobot_send(struct qrobot_link *link, const struct qrobot_command *command)
{
    struct qrobot_command stamped = *command;
    unsigned char out[QROBOT_MAX_PACKET];
    int size;

    if (link->fd < 0)
        return qrw_fail(link, QROBOT_LOST, "the connection to %s is closed", link->peer);
    stamped.t_ns = qrobot_now_ns();
    if ((size = qrobot_put_command(link, &stamped, out)) < 0)
        return size;
    return qrw_write(link, out, size);
}

/* Send what a qrobot_put_... has made of `size` bytes, or hand its failure on. */
static inline int qrw_send(struct qrobot_link *link, const unsigned char *out, int size)
{
    if (link->fd < 0)
        return qrw_fail(link, QROBOT_LOST, "the connection to %s is closed", link->peer);
    return size < 0 ? size : qrw_write(link, out, size);
}

/* Ask for a stop, observers too; with `power_off` arm power is taken away as well. */
static inline int qrobot_stop(struct qrobot_link *link, int power_off)
{
    unsigned char out[QROBOT_MAX_PACKET];
    return qrw_send(link, out, qrobot_put_stop(link, power_off, qrobot_now_ns(), out));
}

/* Name the numbers in command.signals, such as "pressure depth"; they go into the log of the arm. */
static inline int qrobot_name_signals(struct qrobot_link *link, const char *names)
{
    unsigned char out[QROBOT_MAX_PACKET];
    return qrw_send(link, out, qrobot_put_signals(link, names, qrobot_now_ns(), out));
}

/* Tell what the arm carries. A refusal comes as link.warning of a later call; state.payload_mass is what is in force. */
static inline int qrobot_set_payload(struct qrobot_link *link, const struct qrobot_payload *payload)
{
    unsigned char out[QROBOT_MAX_PACKET];
    return qrw_send(link, out, qrobot_put_payload(link, payload, qrobot_now_ns(), out));
}

/* Tell how collisions are told, until this conversation ends. A refusal comes as link.warning of a later call. */
static inline int qrobot_set_collision(struct qrobot_link *link, const struct qrobot_collision *collision)
{
    unsigned char out[QROBOT_MAX_PACKET];
    return qrw_send(link, out, qrobot_put_collision(link, collision, qrobot_now_ns(), out));
}

/* Tell what analogue outputs are to be. A refusal comes as link.warning of a later call. */
static inline int qrobot_set_analog(struct qrobot_link *link, const struct qrobot_analog *analog)
{
    unsigned char out[QROBOT_MAX_PACKET];
    return qrw_send(link, out, qrobot_put_analog(link, analog, qrobot_now_ns(), out));
}

/* Send `command`, or nothing when it is NULL, and wait for the newest state: one sample period passes. */
static inline int qrobot_exchange(struct qrobot_link *link, const struct qrobot_command *command,
                                  struct qrobot_state *state)
{
    int status = command != NULL ? qrobot_send(link, command) : QROBOT_OK;

    if (status != QROBOT_OK)
        return status;
    if (link->fd < 0)
        return qrw_fail(link, QROBOT_LOST, "the connection to %s is closed", link->peer);
    return qrw_await(link, state);
}

#endif
