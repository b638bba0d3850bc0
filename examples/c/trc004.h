/* The emulated TRC004 board as a C program sees a real one: sixteen words to read, sixteen to write.
 *
 *     struct trc004 board;
 *     if (trc004_open(&board, "puma") != 0) ...        a `qrobot board` of that arm must run
 *     int counts = (int16_t)trc004_inw(&board, TRC004_ENC_COUNT + 2 * joint);
 *     trc004_outw(&board, TRC004_DAC + 2 * joint, 0x800);
 *
 * It stands for inw(base + offset) and outw(value, base + offset) on the ISA card. What is written takes effect in the
 * order of the calls, at the board's next sample (a quarter of a millisecond); a read waits until everything written
 * before has taken effect. One program at a time: it has the board's tool lane. GNU C11 and Linux; no library is needed,
 * and compiled is with -I qrobot/wire/c.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef TRC004_H
#define TRC004_H

#include <fcntl.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "qrobot_runtime.h" /* of qrobot/wire/c: where the board's memory is */

/* Registers: byte offsets from the base. */
#define TRC004_ENC_INDEX 0x00
#define TRC004_STATUS 0x0C
#define TRC004_ENC_COUNT 0x10
#define TRC004_ADC_VALUE 0x1C
#define TRC004_ADC_START 0x1E
#define TRC004_ENC_LOAD 0x20
#define TRC004_ADC_MUX 0x2C
#define TRC004_DISCRETE 0x2E
#define TRC004_DAC 0x30

#define TRC004_STATUS_POWER 0x8000
#define TRC004_STATUS_ESTOP_OK 0x0001
#define TRC004_DISCRETE_POWER 0x0001
#define TRC004_DISCRETE_CALIBRATED 0x0040
#define TRC004_DISCRETE_HAND_RELAXED 0x0006
#define TRC004_DAC_ZERO 0x800

/* The board memory, in words of 64 bits; the numbers are those of qrobot/hwif/memory.py, and a test compares them. */
#define TRC004_MAGIC 0x51524F424F54
#define TRC004_LAYOUT 3
#define TRC004_IMAGE_SEQ 16
#define TRC004_IMAGE_START 24
#define TRC004_IMAGE_COUNT 1
#define TRC004_IMAGE_INPUTS 2
#define TRC004_IMAGE_WORDS 18
#define TRC004_LANE 1600
#define TRC004_LANE_TAIL 8
#define TRC004_LANE_RING 16
#define TRC004_LANE_CAPACITY 512
#define TRC004_OP_READ 0
#define TRC004_OP_WRITE 1
#define TRC004_OP_FIELDS 3

#define TRC004_TIMEOUT_NS 500000000 /* a board that shows nothing new for so long is gone */

struct trc004 {
    _Atomic int64_t *words;
    size_t bytes;
    int64_t image[TRC004_IMAGE_WORDS];
    int64_t seen_ns; /* when an image was new */
    int pending;     /* something was posted since the last wait */
    int lost;        /* the board has stopped: reads give 0xFFFF, as an empty slot does, and writes are dropped */
};

static int64_t trc004_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

static void trc004_pause(void)
{
    struct timespec a_while = {0, 20000};
    nanosleep(&a_while, NULL);
}

static inline void trc004_close(struct trc004 *board)
{
    if (board->words != NULL)
        munmap((void *)board->words, board->bytes);
    board->words = NULL;
}

/* Find the board of an arm. Returns 0, or -1 with a line on stderr that says why not. */
static inline int trc004_open(struct trc004 *board, const char *arm)
{
    char name[128];
    struct stat file;
    int fd;

    *board = (struct trc004){0};
    snprintf(name, sizeof name, "%s-board", arm);
    if ((fd = qrobot_runtime_open(name, O_RDWR)) < 0 || fstat(fd, &file) != 0) {
        if (errno == ENOENT)
            fprintf(stderr, "no board of %s: start one with `qrobot board`\n", arm);
        else
            fprintf(stderr, "the board of %s is not this account's: %s\n", arm, strerror(errno));
        if (fd >= 0)
            close(fd);
        return -1;
    }
    if (file.st_size < (TRC004_LANE + TRC004_LANE_RING + TRC004_LANE_CAPACITY * TRC004_OP_FIELDS) * 8) {
        fprintf(stderr, "the board of %s is just starting: try again\n", arm);
        close(fd);
        return -1;
    }
    board->bytes = (size_t)file.st_size;
    board->words = mmap(NULL, board->bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    close(fd);
    if ((void *)board->words == MAP_FAILED) {
        board->words = NULL;
        perror(name);
        return -1;
    }
    if (board->words[0] != TRC004_MAGIC || board->words[1] != TRC004_LAYOUT) {
        fprintf(stderr, "the board of %s has another layout than this program: compile it anew\n", arm);
        trc004_close(board);
        return -1;
    }
    board->seen_ns = trc004_now_ns();
    return 0;
}

/* Copy the newest image, if it is whole: the sequence word is odd while the board writes one. */
static inline void trc004_fetch(struct trc004 *board)
{
    int64_t image[TRC004_IMAGE_WORDS];
    int64_t before = atomic_load_explicit(&board->words[TRC004_IMAGE_SEQ], memory_order_acquire);

    for (int i = 0; i < TRC004_IMAGE_WORDS; i++)
        image[i] = atomic_load_explicit(&board->words[TRC004_IMAGE_START + i], memory_order_relaxed);
    atomic_thread_fence(memory_order_acquire);
    if (before % 2 != 0 || atomic_load_explicit(&board->words[TRC004_IMAGE_SEQ], memory_order_relaxed) != before)
        return;
    if (image[TRC004_IMAGE_COUNT] != board->image[TRC004_IMAGE_COUNT])
        board->seen_ns = trc004_now_ns();
    for (int i = 0; i < TRC004_IMAGE_WORDS; i++)
        board->image[i] = image[i];
}

/* Wait for an image later than number `count`. */
static inline void trc004_await(struct trc004 *board, int64_t count)
{
    trc004_fetch(board);
    while (!board->lost && board->image[TRC004_IMAGE_COUNT] <= count) {
        board->lost = trc004_now_ns() - board->seen_ns > TRC004_TIMEOUT_NS;
        trc004_pause();
        trc004_fetch(board);
    }
}

/* Bring the newest image; after operations, one that shows what they did. */
static inline void trc004_settle(struct trc004 *board)
{
    int64_t head = atomic_load_explicit(&board->words[TRC004_LANE], memory_order_relaxed);

    trc004_fetch(board);
    if (!board->pending)
        board->lost = trc004_now_ns() - board->seen_ns > TRC004_TIMEOUT_NS;
    while (board->pending && !board->lost) { /* taken first, shown by the image after */
        if (atomic_load_explicit(&board->words[TRC004_LANE + TRC004_LANE_TAIL], memory_order_acquire) == head)
            board->pending = 0;
        trc004_fetch(board);
        trc004_await(board, board->image[TRC004_IMAGE_COUNT]);
    }
}

static inline void trc004_post(struct trc004 *board, int kind, int offset, int value)
{
    int64_t head = atomic_load_explicit(&board->words[TRC004_LANE], memory_order_relaxed);
    int64_t tail = atomic_load_explicit(&board->words[TRC004_LANE + TRC004_LANE_TAIL], memory_order_acquire);
    int64_t slot = TRC004_LANE + TRC004_LANE_RING + head % TRC004_LANE_CAPACITY * TRC004_OP_FIELDS;

    if (head - tail >= TRC004_LANE_CAPACITY) {
        board->lost = 1; /* it takes nothing any more */
        return;
    }
    atomic_store_explicit(&board->words[slot], kind, memory_order_relaxed);
    atomic_store_explicit(&board->words[slot + 1], offset, memory_order_relaxed);
    atomic_store_explicit(&board->words[slot + 2], value, memory_order_relaxed);
    board->pending = 1;
    atomic_store_explicit(&board->words[TRC004_LANE], head + 1, memory_order_release);
}

/* outw(value, base + offset) */
static inline void trc004_outw(struct trc004 *board, int offset, int value)
{
    if (!board->lost)
        trc004_post(board, TRC004_OP_WRITE, offset, value & 0xFFFF);
}

/* inw(base + offset) */
static inline int trc004_inw(struct trc004 *board, int offset)
{
    if (!board->lost) {
        if (offset == TRC004_ADC_START) /* on revision E the read itself starts a conversion */
            trc004_post(board, TRC004_OP_READ, offset, 0);
        trc004_settle(board);
    }
    return board->lost ? 0xFFFF : (int)board->image[TRC004_IMAGE_INPUTS + offset / 2];
}

#endif
