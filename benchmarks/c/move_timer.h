/* How long calls take: the times of many, and the middle one. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define TIMED_MAX 100000

static double timed_us[TIMED_MAX];
static int timed;
static struct timespec timed_since;

static void timer_begin(void)
{
    clock_gettime(CLOCK_MONOTONIC, &timed_since);
}

static void timer_end(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (timed < TIMED_MAX)
        timed_us[timed++] = (now.tv_sec - timed_since.tv_sec) * 1e6 + (now.tv_nsec - timed_since.tv_nsec) * 1e-3;
}

static int timer_order(const void *a, const void *b)
{
    double x = *(const double *) a, y = *(const double *) b;
    return (x > y) - (x < y);
}

/* Write the middle one to a file; 0 when that was done. */
static int timer_write(const char *path)
{
    FILE *file = fopen(path, "w");
    if (!file || !timed)
        return 1;
    qsort(timed_us, timed, sizeof *timed_us, timer_order);
    fprintf(file, "%.3f\n", timed_us[timed / 2]);
    return fclose(file);
}
