/* Drive one joint of a PUMA 560 by register reads and writes, as a program for the TRC004 board does.
 *
 *     cc -O2 -I qrobot/wire/c -o move_one_joint examples/c/move_one_joint.c -lm
 *     qrobot board &                                  # the emulated board of the arm puma560
 *     ./move_one_joint puma560
 *
 * Zero torque on all converters; arm power, which lifts the brakes; then a thousand times a second six counters in, a
 * spring and a damper on each motor, six torques out. Joint 6 turns by 1500 counts and back, the others are held.
 * However it ends - done, Ctrl-C, a board that is gone - torque and power are taken off.
 */
#include <math.h>
#include <signal.h>
#include <stdlib.h>

#include "trc004.h"

#define JOINTS 6
#define MOVED 5         /* joint 6 */
#define STROKE 1500     /* counts: some 14 degrees */
#define MOVE_S 2.0
#define FILTER_S 0.004
#define NEAR 100        /* counts that a joint may be off at the end */
#define FAR 800         /* counts off the path at which the program gives up */

/* DAC steps per count, and seconds of damping: the stiffness of the project's own servo (config/robots/puma560.toml). */
static const double spring[JOINTS] = {7.0, 3.2, 2.2, 3.4, 3.7, 7.6};
static const double damping_s[JOINTS] = {0.067, 0.067, 0.067, 0.04, 0.04, 0.04};

static volatile sig_atomic_t stopped;

static void stop(int number)
{
    (void)number;
    stopped = 1;
}

static void zero_torque(struct trc004 *board)
{
    for (int channel = 0; channel < 8; channel++)
        trc004_outw(board, TRC004_DAC + 2 * channel, TRC004_DAC_ZERO);
}

static void read_counts(struct trc004 *board, int counts[JOINTS])
{
    for (int joint = 0; joint < JOINTS; joint++)
        counts[joint] = (int16_t)trc004_inw(board, TRC004_ENC_COUNT + 2 * joint);
}

/* Torque zero first: at reset the all-zero word of a converter would be full torque. */
static int power_on(struct trc004 *board, int discrete)
{
    int64_t until = trc004_now_ns() + INT64_C(5000000000);

    zero_torque(board);
    trc004_outw(board, TRC004_DISCRETE, discrete | TRC004_DISCRETE_POWER);
    while (!(trc004_inw(board, TRC004_STATUS) & TRC004_STATUS_POWER)) {
        if (stopped || board->lost || trc004_now_ns() > until)
            return -1;
        trc004_pause();
    }
    return 0;
}

static void power_off(struct trc004 *board, int discrete)
{
    zero_torque(board);
    trc004_outw(board, TRC004_DISCRETE, discrete);
    (void)trc004_inw(board, TRC004_STATUS); /* waits until it has taken effect */
}

/* There and back on half a turn of a cosine each. */
static double path(double t)
{
    return STROKE * 0.5 * (1.0 - cos(M_PI * t / MOVE_S));
}

static int torque_word(double steps)
{
    int word = TRC004_DAC_ZERO + (int)steps;
    return word < 0 ? 0 : word > 0xFFF ? 0xFFF : word;
}

/* Returns 0 when the move was made, else -1. */
static int move(struct trc004 *board, const int start[JOINTS])
{
    int64_t begin = trc004_now_ns(), before = begin;
    double speed[JOINTS] = {0}, last[JOINTS];

    for (int joint = 0; joint < JOINTS; joint++)
        last[joint] = start[joint];
    for (;;) {
        int counts[JOINTS];
        int64_t now = trc004_now_ns();
        double t = (now - begin) * 1e-9, dt = (now - before) * 1e-9;

        read_counts(board, counts);
        if (stopped || board->lost || !(trc004_inw(board, TRC004_STATUS) & TRC004_STATUS_POWER))
            return -1;
        for (int joint = 0; joint < JOINTS; joint++) {
            double target = start[joint] + (joint == MOVED ? path(t) : 0.0), off = target - counts[joint];
            if (dt > 0.0)
                speed[joint] += dt / (FILTER_S + dt) * ((counts[joint] - last[joint]) / dt - speed[joint]);
            last[joint] = counts[joint];
            if (fabs(off) > FAR) {
                fprintf(stderr, "joint %d is %.0f counts off its path\n", joint + 1, off);
                return -1;
            }
            trc004_outw(board, TRC004_DAC + 2 * joint,
                        torque_word(spring[joint] * (off - damping_s[joint] * speed[joint])));
        }
        before = now;
        if (t > 2.0 * MOVE_S)
            return 0;
        while (trc004_now_ns() < now + 1000000)
            trc004_pause();
    }
}

int main(int argc, char **argv)
{
    struct trc004 board;
    int start[JOINTS], end[JOINTS], status, discrete, made;

    if (argc != 2) {
        fprintf(stderr, "usage: %s ARM\n", argv[0]);
        return 2;
    }
    if (trc004_open(&board, argv[1]) != 0)
        return 1;
    signal(SIGINT, stop);
    signal(SIGTERM, stop);

    status = trc004_inw(&board, TRC004_STATUS);
    discrete = (status & TRC004_DISCRETE_CALIBRATED) | TRC004_DISCRETE_HAND_RELAXED; /* what the board keeps for us */
    if (!(status & TRC004_STATUS_ESTOP_OK)) {
        fprintf(stderr, "the emergency stop is pressed\n");
        return 1;
    }
    read_counts(&board, start);
    made = power_on(&board, discrete) == 0 && move(&board, start) == 0;
    read_counts(&board, end);
    power_off(&board, discrete);
    printf("joint  counts before  after\n");
    for (int joint = 0; joint < JOINTS; joint++)
        printf("%5d  %13d  %5d\n", joint + 1, start[joint], end[joint]);
    if (board.lost)
        fprintf(stderr, "the board of %s has gone\n", argv[1]);
    for (int joint = 0; joint < JOINTS; joint++)
        made = made && abs(end[joint] - start[joint]) < NEAR;
    trc004_close(&board);
    return made ? 0 : 1;
}
