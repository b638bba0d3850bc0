/* Calls of RCI in C on virtual time, by what the papers say of them. Prints what went wrong, and nothing else. */
#include "rci.h"
#include <stdio.h>
#include <string.h>

#define CHECK(what) do { if (!(what)) { printf("line %d: %s\n", __LINE__, #what); failed++; } } while (0)
/* A macro that makes a primitive, as programs of the time had them. */
#define TASK(td, name, function) ((td) = rci_create(name, ""), rci_control(td, function, 0, 0))

static int failed, started, second, triggered, asked;
static RCI_TASK *a, *b, *c, *d, *e, *arm, *gone;
static char order[64];
static long heard;

static void run_a(RCI_TASK *td) { (void)td; strcat(order, "a"); rci_send(b->bit | RCI_PARENT, "hello", 6); }
static void prepare(RCI_TASK *td) { (void)td; second++; }
static void start_a(RCI_TASK *td) { started += rci_self() == td; }
static void run_b(RCI_TASK *td)
{
    char text[16];
    RCI_TASK *sender;

    (void)td;
    strcat(order, "b");
    while (rci_receive(a->bit, text, sizeof text, &sender) > 0)
        heard += sender == a && strcmp(text, "hello") == 0;
    CHECK(sender == 0);
    CHECK(rci_getMemory("for b") != 0);
    CHECK(rci_getMemory("for a") == 0);
    CHECK(rci_wait((RCI_WAKEUP)0) < 0 && rci_start(a->bit) < 0 && rci_create("late", "") == 0 && rci_close() < 0);
}
static void run_c(RCI_TASK *td) { (void)td; }
static void trigger_d(RCI_TASK *td) { (void)td; triggered++; }
static int wake_d(void) { asked++; return triggered == 2 && asked % 2; }
static void run_d(RCI_TASK *td) { (void)td; }
static void run_e(RCI_TASK *td) { (void)td; }
static int at_12(void) { return rci_ticks() >= 12; }
static int at_40(void) { return rci_ticks() >= 40; }

/* Of one name the newest call counts, and takes no other place. */
static int named_often(void)
{
    int again, all = 1;

    for (again = 0; again < 100; again++)
        all = all && rci_robot("another", "puma560", again % 2 ? "127.0.0.1:1" : 0) == 0;
    return all;
}

static void mistakes(void)
{
    CHECK(rci_create("", "") == 0 && rci_create("a", "") == 0);
    CHECK(rci_create("x", "cpu99999") == 0 && rci_create("x", "moon") == 0);
    CHECK(strstr(rci_error(), "no processor \"moon\"") != 0);
    CHECK(rci_clock(0) < 0 && rci_clock(1001) < 0 && rci_clock(100) == 0);
    CHECK(rci_control(a, 0, 0, 0) < 0 && rci_onclock(a, 0, 0) < 0 && rci_onclock((RCI_TASK *)0, 1, 0) < 0);
    CHECK(rci_onfunction(a, 0) < 0 && rci_deviceInterrupt(a, 9999) < 0 && rci_timeout(a, 0.0) < 0);
    CHECK(rci_start(0) < 0 && rci_start(RCI_PARENT) < 0 && rci_start(1UL << 29) < 0);
    CHECK(rci_sharedMemory("m", 0, 0, RCI_ALL) == 0 && rci_getMemory("nowhere") == 0);
    CHECK(rci_sharedData(RCI_ALL, 0, 8) < 0 && rci_sharedData(RCI_ALL, order, sizeof order) == 0);
    CHECK(rci_send(1UL << 29, "x", 1) < 0 && rci_send(a->bit, "x", RCI_LONGEST_MESSAGE + 1) < 0);
    CHECK(rci_signal(9999) < 0 && rci_signal(10) < 0); /* no such signal, no handler */
    CHECK(rci_onclock(arm, 0, 0) < 0 && rci_onclock(arm, 11, 0) < 0 && rci_onclock(arm, 10, 0) == 0); /* 100 ms at most */
    CHECK(rci_onfunction(arm, wake_d) < 0 && rci_deviceInterrupt(arm, 0) < 0); /* it is woken by its robot */
    CHECK(rci_start(arm->bit) < 0 && strstr(rci_error(), "has no functions") != 0);
    CHECK(rci_robot("arm", "no such robot", 0) < 0 && rci_descriptor("nobody") == 0);
    CHECK(named_often());
}

static void queues(void)
{
    char big[RCI_LONGEST_MESSAGE], small[2];
    RCI_TASK *sender = a;
    int sent = 0;

    memset(big, 7, sizeof big);
    CHECK(rci_receive(RCI_ALL, big, sizeof big, &sender) == 0 && sender == 0);
    while (rci_send(RCI_PARENT, big, sizeof big) == (long)sizeof big)
        sent++;
    CHECK(sent == 4);
    CHECK(rci_receive(RCI_ALL, small, sizeof small, &sender) < 0);
    CHECK(rci_receive(a->bit, big, sizeof big, &sender) == 0);
    while (rci_receive(RCI_PARENT, big, sizeof big, &sender) == (long)sizeof big)
        sent--;
    CHECK(sent == 0);
}

int main(void)
{
    long word = 0;
    long *memory;

    CHECK(TASK(a, "a", run_a) == 0 && TASK(b, "b", run_b) == 0 && TASK(c, "c", run_c) == 0 && TASK(d, "d", run_d) == 0);
    CHECK(TASK(e, "e", run_e) == 0 && (arm = rci_create("puma560", 0)) != 0 && arm->robot->n == 6 && a->robot == 0);
    CHECK(a->bit == 2 && b->bit == 4 && rci_descriptor("b") == b && rci_self()->bit == RCI_PARENT);
    mistakes();
    queues();
    memory = (long *)rci_sharedMemory("for b", 16, a, b->bit);
    CHECK(memory != 0 && memory[0] == 0 && rci_sharedMemory("for a", 8, a, 0) != 0);
    CHECK(rci_sharedMemory("for a", 8, a, 0) == 0);
    CHECK(!rci_testAndSet(&word) && rci_testAndSet(&word) && (rci_clear(&word), !rci_testAndSet(&word)));
    CHECK(rci_control(a, run_a, prepare, start_a) == 0);
    CHECK(rci_onclock(a, 4, 0) == 0 && rci_onclock(b, 4, 0) == 0 && rci_onclock(c, 3, -1) == 0);
    CHECK(rci_priority(b, 1) == 0);
    CHECK(rci_trigger(d, 10, 5, trigger_d) == 0 && rci_onfunction(d, wake_d) == 0);
    CHECK(rci_state(a) == RCI_CREATED && rci_runs(a) == 0);
    CHECK(rci_start(a->bit | b->bit | c->bit | d->bit) == 0 && started == 1 && rci_state(a) == RCI_ACTIVE);
    CHECK(rci_start(a->bit) < 0 && rci_clock(10) < 0);
    CHECK(rci_wait(at_12) == 0 && strcmp(order, "babababa") == 0); /* at 0, 4, 8 and 12; b goes first */
    CHECK(rci_runs(a) == 4 && second == 4 && heard == 3 && rci_runs(c) == 4); /* c at 2, 5, 8 and 11 */
    CHECK(triggered == 1 && rci_runs(d) == 0 && rci_state(e) == RCI_CREATED);
    CHECK(rci_release(a->bit | b->bit) == 0 && rci_state(a) == RCI_RELEASED);
    CHECK(rci_onclock(c, 7, 0) == 0); /* from now on at 14, 21, 28, 35 */
    CHECK(rci_wait(at_40) == 0 && rci_runs(c) == 8 && rci_runs(a) == 4);
    CHECK(asked == 41 && triggered == 4 && rci_runs(d) == 5); /* at 15 ... 24, every other tick */
    CHECK(rci_missed(a) == 0 && rci_runCount(c) == 0 && rci_taskError(a)[0] == '\0');
    CHECK(rci_start(a->bit) == 0 && started == 1 && rci_start(e->bit) == 0);
    gone = a;
    CHECK(rci_close() == 0 && rci_runs(gone) < 0 && rci_ticks() == -1);
    return failed != 0;
}
