/* The emulated TRC004 board as a C or C++ program sees a real one: sixteen words to read, sixteen to write.
 *
 *     struct trc004 board;
 *     if (trc004_open(&board, "puma") != 0) ...        a `qrobot board` of that arm must run
 *     int counts = (int16_t)trc004_inw(&board, TRC004_ENC_COUNT + 2 * joint);
 *     trc004_outw(&board, TRC004_DAC + 2 * joint, 0x800);
 *
 * It stands for inw(base + offset) and outw(value, base + offset) on the ISA card, trc004_inb and trc004_outb for the
 * byte accesses that boards of revision E and before want. What is written takes effect in the order of the calls, at
 * the board's next sample (a quarter of a millisecond); a read waits until everything written before has taken effect.
 * One controller at a time: beside a running servo, another such program, or a board that `--serve` serves to others,
 * trc004_open says no.
 * C99 or C++11 with gcc or clang, on Linux; no library is needed, and compiled is with -I qrobot/wire/c.
 *
 * SPDX-License-Identifier: Apache-2.0
 */
#ifndef TRC004_H
#define TRC004_H

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
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
#define TRC004_STATUS_ADC_BUSY 0x4000
#define TRC004_STATUS_ESTOP_OK 0x0001
#define TRC004_DISCRETE_POWER 0x0001
#define TRC004_DISCRETE_CALIBRATED 0x0040
#define TRC004_DISCRETE_HAND_RELAXED 0x0006
#define TRC004_DISCRETE_ADC 0x4000
#define TRC004_DAC_ZERO 0x800

/* The board memory, in words of 64 bits; they follow from the types in qrobot/hwif/board_memory.py, and a test compares them. */
#define TRC004_MAGIC 0x51524F424F54
#define TRC004_LAYOUT 7
#define TRC004_IMAGE_SEQ 24
#define TRC004_IMAGE_START 32
#define TRC004_IMAGE_COUNT 1
#define TRC004_IMAGE_INPUTS 2
#define TRC004_IMAGE_WORDS 18
#define TRC004_LANE 2120
#define TRC004_LANE_FORGET 1
#define TRC004_LANE_TAIL 8
#define TRC004_LANE_RING 16
#define TRC004_LANE_CAPACITY 512
#define TRC004_N_INPUT_WORDS 16
#define TRC004_OP_READ 0
#define TRC004_OP_WRITE 1
#define TRC004_LANE_FIELDS 4
#define TRC004_OP_KIND 0
#define TRC004_OP_OFFSET 1
#define TRC004_OP_VALUE 2
#define TRC004_OP_COUNTS_NS 3

#define TRC004_TIMEOUT_NS 500000000 /* a board that shows nothing new for so long is gone */

struct trc004 {
    int64_t *words;
    size_t bytes;
    int fd;          /* holds the claim on the board */
    int64_t image[TRC004_IMAGE_WORDS];
    int64_t seen_ns; /* when an image was new */
    int pending;     /* something was posted since the last wait */
    int held;        /* operations that are posted together with the next one */
    int lost;        /* the board has stopped: reads give 0xFFFF, as an empty slot does, and what is written waits */
};

static inline int64_t trc004_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

static inline void trc004_pause(void)
{
    struct timespec a_while = {0, 20000};
    nanosleep(&a_while, NULL);
}

static inline void trc004_close(struct trc004 *board)
{
    if (board->words != NULL)
        munmap((void *)board->words, board->bytes);
    if (board->fd >= 0)
        close(board->fd);
    board->words = NULL;
    board->fd = -1;
}

/* Be the board's one controller until `fd` is closed: a record lock on the first byte, as `SharedMemory.claim` takes it. */
static inline int trc004_claim(int fd)
{
    struct flock first;

    memset(&first, 0, sizeof first);
    first.l_type = F_WRLCK;
    first.l_whence = SEEK_SET;
    first.l_len = 1;
    return fcntl(fd, F_SETLK, &first);
}

static inline void trc004_look(struct trc004 *board, int64_t since_ns);

/* Find the board of an arm, and its first image. Returns 0, or -1 with a line on stderr that says why not. */
static inline int trc004_open(struct trc004 *board, const char *arm)
{
    char name[128];
    struct stat file;
    int64_t since;
    int fd;

    memset(board, 0, sizeof *board);
    board->fd = -1;
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
    if (file.st_size < (TRC004_LANE + TRC004_LANE_RING + TRC004_LANE_CAPACITY * TRC004_LANE_FIELDS) * 8) {
        fprintf(stderr, "the board of %s is just starting: try again\n", arm);
        close(fd);
        return -1;
    }
    if (trc004_claim(fd) != 0) {
        fprintf(stderr,
                "the board of %s has a controller already, a servo or another program, or is served to one "
                "(`qrobot board --serve`): end that one first\n",
                arm);
        close(fd);
        return -1;
    }
    board->fd = fd;
    board->bytes = (size_t)file.st_size;
    board->words = (int64_t *)mmap(NULL, board->bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if ((void *)board->words == MAP_FAILED) {
        board->words = NULL;
        perror(name);
        trc004_close(board);
        return -1;
    }
    if (board->words[0] != TRC004_MAGIC || board->words[1] != TRC004_LAYOUT) {
        fprintf(stderr, "the board of %s has another layout than this program: compile it anew\n", arm);
        trc004_close(board);
        return -1;
    }
    since = board->seen_ns = trc004_now_ns();
    while (board->image[TRC004_IMAGE_COUNT] == 0) { /* it begins, or writes just now */
        trc004_look(board, since);
        if (board->lost) {
            fprintf(stderr, "the board of %s shows nothing: does it still run?\n", arm);
            trc004_close(board);
            return -1;
        }
        trc004_pause();
    }
    return 0;
}

static inline int64_t trc004_load(const struct trc004 *board, int word)
{
    return __atomic_load_n(&board->words[word], __ATOMIC_ACQUIRE);
}

static inline void trc004_store(struct trc004 *board, int64_t word, int64_t value)
{
    __atomic_store_n(&board->words[word], value, __ATOMIC_RELEASE);
}

/* How far the board, or whoever posted before us, is done with what was posted. */
static inline int64_t trc004_done(const struct trc004 *board)
{
    int64_t tail = trc004_load(board, TRC004_LANE + TRC004_LANE_TAIL);
    int64_t forget = trc004_load(board, TRC004_LANE + TRC004_LANE_FORGET);

    return tail < forget && forget <= board->words[TRC004_LANE] ? forget : tail;
}

static inline int trc004_full(const struct trc004 *board)
{
    return board->words[TRC004_LANE] + board->held - trc004_done(board) >= TRC004_LANE_CAPACITY;
}

/* Copy the newest image, if it is whole: the sequence word is odd while the board writes one. */
static inline void trc004_fetch(struct trc004 *board)
{
    int64_t image[TRC004_IMAGE_WORDS];
    int64_t before = trc004_load(board, TRC004_IMAGE_SEQ);

    for (int i = 0; i < TRC004_IMAGE_WORDS; i++)
        image[i] = __atomic_load_n(&board->words[TRC004_IMAGE_START + i], __ATOMIC_RELAXED);
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
    if (before % 2 != 0 || __atomic_load_n(&board->words[TRC004_IMAGE_SEQ], __ATOMIC_RELAXED) != before)
        return;
    if (image[TRC004_IMAGE_COUNT] != board->image[TRC004_IMAGE_COUNT])
        board->seen_ns = trc004_now_ns();
    memcpy(board->image, image, sizeof image);
}

/* Look at the board once; `lost` when it has shown nothing new for too long, or since `since_ns` has not done what it
 * was asked. It is lost no longer once it shows something new. */
static inline void trc004_look(struct trc004 *board, int64_t since_ns)
{
    int64_t now;

    trc004_fetch(board);
    now = trc004_now_ns();
    board->lost = now - board->seen_ns > TRC004_TIMEOUT_NS || now - since_ns > TRC004_TIMEOUT_NS;
}

/* Let the board have what was held back. */
static inline void trc004_hand_over(struct trc004 *board)
{
    if (board->held == 0)
        return;
    trc004_store(board, TRC004_LANE, board->words[TRC004_LANE] + board->held);
    board->held = 0;
}

/* Bring the newest image; after operations, one that shows what they did: they are taken, and shown two images later,
 * since the image being made while they are taken may lack them. */
static inline void trc004_settle(struct trc004 *board)
{
    int64_t since = trc004_now_ns(), head, shown;

    trc004_hand_over(board);
    head = board->words[TRC004_LANE];
    trc004_look(board, since);
    if (!board->pending)
        return;
    while (!board->lost && trc004_done(board) != head) {
        trc004_pause();
        trc004_look(board, since);
    }
    shown = board->image[TRC004_IMAGE_COUNT] + 2;
    while (!board->lost && board->image[TRC004_IMAGE_COUNT] < shown) {
        trc004_pause();
        trc004_look(board, since);
    }
    board->pending = board->lost;
}

/* Post an operation. `hold`: let the board have it together with the next one, unless the lane is full of those that
 * are held. A full lane is waited for. That of a
 * board which is lost loses its older half, so that the newest is there when the board goes on: zero torque, power off. */
static inline void trc004_post(struct trc004 *board, int kind, int offset, int value, int hold)
{
    int64_t since = trc004_now_ns(), head, slot;

    while (trc004_full(board)) {
        trc004_hand_over(board); /* or there would be nothing to take */
        trc004_look(board, since);
        if (board->lost)
            trc004_store(board, TRC004_LANE + TRC004_LANE_FORGET,
                         board->words[TRC004_LANE] - TRC004_LANE_CAPACITY / 2);
        trc004_pause(); /* the board may just be taking the oldest */
    }
    head = board->words[TRC004_LANE] + board->held;
    slot = TRC004_LANE + TRC004_LANE_RING + head % TRC004_LANE_CAPACITY * TRC004_LANE_FIELDS;
    trc004_store(board, slot + TRC004_OP_KIND, kind);
    trc004_store(board, slot + TRC004_OP_OFFSET, offset);
    trc004_store(board, slot + TRC004_OP_VALUE, value);
    trc004_store(board, slot + TRC004_OP_COUNTS_NS, 0); /* at once */
    board->pending = 1;
    board->held = hold ? board->held + 1 : 0;
    if (!hold)
        trc004_store(board, TRC004_LANE, head + 1);
}

/* outw(value, base + offset) */
static inline void trc004_outw(struct trc004 *board, int offset, int value)
{
    trc004_post(board, TRC004_OP_WRITE, offset, value & 0xFFFF, 0);
}

/* outb(value, base + offset): the converter's channel on revision E and before; no other register takes a byte. */
static inline void trc004_outb(struct trc004 *board, int offset, int value)
{
    trc004_outw(board, offset, value & 0xFF);
}

/* inw(base + offset); 0xFFFF where there is nothing to read: from 0x20 on, at odd offsets, and when the board is lost.
 *
 * On revision E and before reading ADC_START starts a conversion, which is over 20 us later: its done mask has to be
 * set meanwhile, so the board gets the start and the next write, or read, at once. */
static inline int trc004_inw(struct trc004 *board, int offset)
{
    if (offset < 0 || offset >= 2 * TRC004_N_INPUT_WORDS || offset % 2 != 0)
        return 0xFFFF;
    if (offset == TRC004_ADC_START)
        trc004_post(board, TRC004_OP_READ, offset, 0, 1);
    else
        trc004_settle(board);
    return board->lost ? 0xFFFF : (int)board->image[TRC004_IMAGE_INPUTS + offset / 2];
}

/* inb(base + offset): the low byte of a word at its offset, the high byte at the odd one behind it. */
static inline int trc004_inb(struct trc004 *board, int offset)
{
    int word = trc004_inw(board, offset & ~1);

    return offset & 1 ? word >> 8 & 0xFF : word & 0xFF;
}

#endif
