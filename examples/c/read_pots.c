/* Read the eight channels of a TRC004's converter, by the sequence that the board's revision wants.
 *
 *     cc -O2 -I qrobot/wire/c -o read_pots examples/c/read_pots.c     # or c++ -x c++
 *     qrobot board &                                    # the emulated board of the arm puma560
 *     ./read_pots puma560 F
 *
 * Nothing moves: no torque, no power. On revision F one word selects a channel and starts it; on E and before the
 * channel is a byte, *reading* ADC_START starts it, and the done mask follows.
 */
#include "trc004.h"

#define CHANNELS 8
#define POLLS 10000 /* a conversion takes 20 us; the vendor's driver polls without end */

/* Wait for the done flag. Returns 0, or -1 when it does not come. */
static int wait_done(struct trc004 *board)
{
    for (int polls = 0; polls < POLLS && !board->lost; polls++)
        if (!(trc004_inw(board, TRC004_STATUS) & TRC004_STATUS_ADC_BUSY))
            return 0;
    return -1;
}

/* Volts of a channel on revision F: 12 bits of +-10 V, left-justified. */
static int read_f(struct trc004 *board, int channel, int discrete, double *volts)
{
    trc004_outw(board, TRC004_DISCRETE, discrete);
    trc004_outw(board, TRC004_DISCRETE, discrete | TRC004_DISCRETE_ADC);
    trc004_outw(board, TRC004_ADC_MUX, channel << 7 | 0x50);
    if (wait_done(board) != 0)
        return -1;
    *volts = (int16_t)(trc004_inw(board, TRC004_ADC_VALUE) & 0xFFF0) * 20.0 / 65536.0;
    trc004_outw(board, TRC004_DISCRETE, discrete);
    return 0;
}

/* Volts of a channel on revision E and before: a byte of 0 to 5 V. */
static int read_e(struct trc004 *board, int channel, int discrete, double *volts)
{
    trc004_outw(board, TRC004_DISCRETE, discrete);
    trc004_outb(board, TRC004_ADC_MUX, channel);
    (void)trc004_inb(board, TRC004_ADC_START); /* starts the conversion; what it gives means nothing */
    trc004_outw(board, TRC004_DISCRETE, discrete | TRC004_DISCRETE_ADC);
    if (wait_done(board) != 0)
        return -1;
    *volts = trc004_inb(board, TRC004_ADC_VALUE) * 5.0 / 255.0;
    trc004_outw(board, TRC004_DISCRETE, discrete);
    return 0;
}

int main(int argc, char **argv)
{
    struct trc004 board;
    int discrete, failed = 0;

    if (argc != 3 || (argv[2][0] != 'E' && argv[2][0] != 'F')) {
        fprintf(stderr, "usage: %s ARM E|F\n", argv[0]);
        return 2;
    }
    if (trc004_open(&board, argv[1]) != 0)
        return 1;
    discrete = (trc004_inw(&board, TRC004_STATUS) & TRC004_DISCRETE_CALIBRATED) | TRC004_DISCRETE_HAND_RELAXED;
    for (int channel = 0; channel < CHANNELS && !failed; channel++) {
        double volts = 0.0;

        failed = (argv[2][0] == 'F' ? read_f : read_e)(&board, channel, discrete, &volts);
        if (failed)
            fprintf(stderr, "channel %d is not done: is it revision %s?\n", channel, argv[2][0] == 'F' ? "E" : "F");
        else
            printf("%d %.3f\n", channel, volts);
    }
    trc004_close(&board);
    return failed ? 1 : 0;
}
