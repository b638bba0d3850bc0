/* Shared memory, shared data, messages, signals, and what tasks have instead of the system's calls. */
#include "inside.h"

#include <signal.h>

#define MAILBOX_BYTES 16384

struct area {
    char label[NAME_BYTES + 1];
    unsigned long mask;
    void *memory;
    struct area *next;
};

struct message {
    unsigned long sender;
    long size;
};

/* Messages of one receiver, one behind the other. */
struct mailbox {
    long used;
    unsigned char bytes[MAILBOX_BYTES];
};

/* That of the planning program, empty. It needs no memory that there may not be. */
struct mailbox *rci_parents_mailbox(void)
{
    static struct mailbox one;

    one.used = 0;
    return &one;
}

struct mailbox *rci_mailbox(void)
{
    return calloc(1, sizeof(struct mailbox));
}

void rci_mailbox_free(struct mailbox *mailbox)
{
    free(mailbox);
}

void rci_areas_free(void)
{
    struct area *each = rci_program.areas, *next;

    for (; each != NULL; each = next) {
        next = each->next;
        free(each->memory);
        free(each);
    }
}

static const char *no_area(const char *label, unsigned long size)
{
    if (rci_current != NULL || rci_program.sealed)
        return "all memory is made by the planning program before the first rci_start()";
    if (label == NULL || label[0] == '\0' || strlen(label) > NAME_BYTES)
        return "a label of 1 to 64 bytes is needed";
    if (size == 0 || size > 1UL << 30)
        return "a size of 1 byte to 1 GiB is needed";
    for (struct area *each = rci_program.areas; each != NULL; each = each->next)
        if (strcmp(each->label, label) == 0)
            return "there is memory of that label already";
    return NULL;
}

void *rci_sharedMemory(const char *label, unsigned long size, RCI_TASK *hostTd, unsigned long accessMask)
{
    const char *why;
    struct area *area = NULL;
    void *memory = NULL;

    rci_begin();
    if (hostTd != NULL && !rci_is_task(hostTd, "rci_sharedMemory"))
        return NULL;
    if ((why = no_area(label, size)) != NULL)
        rci_fail("rci_sharedMemory(\"%s\"): %s", label ? label : "", why);
    else if ((area = calloc(1, sizeof *area)) == NULL || (memory = calloc(1, size)) == NULL)
        rci_fail("rci_sharedMemory(\"%s\"): no memory", label);
    if (memory == NULL) {
        free(area);
        return NULL;
    }
    strcpy(area->label, label);
    area->mask = accessMask | (hostTd ? hostTd->bit : 0) | RCI_PARENT;
    area->memory = memory;
    area->next = rci_program.areas;
    rci_program.areas = area;
    return memory;
}

void *rci_getMemory(const char *label)
{
    for (struct area *each = rci_program.areas; label != NULL && each != NULL; each = each->next)
        if (strcmp(each->label, label) == 0) {
            if (each->mask & rci_self()->bit)
                return each->memory;
            rci_fail("rci_getMemory(\"%s\"): task %s may not reach it; its mask is %#lx", label, rci_self()->name,
                     each->mask);
            return NULL;
        }
    rci_fail("rci_getMemory(\"%s\"): there is none; rci_sharedMemory() makes it", label ? label : "");
    return NULL;
}

/* Tasks are threads, so they share static data anyway; the call is kept for programs that say so. */
int rci_sharedData(unsigned long accessMask, void *addr, unsigned long size)
{
    if (addr == NULL || size == 0 || (accessMask & ~RCI_ALL) != 0)
        return rci_fail("rci_sharedData: an address, a size and a mask of tasks are needed");
    return 0;
}

static struct mailbox *mailbox_of(unsigned long bit)
{
    if (bit == RCI_PARENT)
        return rci_program.parent_inside.mailbox;
    for (int i = 0; i < rci_program.n_tasks; i++)
        if (rci_program.tasks[i]->bit == bit)
            return rci_program.tasks[i]->inside->mailbox;
    return NULL;
}

static long room_for(long size)
{
    return (long)sizeof(struct message) + size;
}

/* 1 when every task of the mask exists and has room, 0 when one has none, -1 when one does not exist. */
static int can_take(unsigned long mask, long size)
{
    int room = mask != 0;

    for (unsigned long bit = 1; bit != 0 && bit <= mask; bit <<= 1) {
        struct mailbox *box = mask & bit ? mailbox_of(bit) : NULL;

        if ((mask & bit) && box == NULL)
            return -1;
        if (box != NULL && box->used + room_for(size) > MAILBOX_BYTES)
            room = 0;
    }
    return room;
}

static void put(struct mailbox *box, unsigned long sender, const void *buffer, long size)
{
    struct message head = {sender, size};

    memcpy(box->bytes + box->used, &head, sizeof head);
    memcpy(box->bytes + box->used + sizeof head, buffer, (size_t)size);
    box->used += room_for(size);
}

/* Queue a message for each task of a mask. Returns the bytes queued: 0 when one of them has no room; -1 on a mistake. */
long rci_send(unsigned long sendcode, const void *buffer, long size)
{
    unsigned long sender = rci_self()->bit, asked = sendcode;
    int can;

    if (buffer == NULL || size < 1 || size > RCI_LONGEST_MESSAGE)
        return rci_fail("rci_send: %ld bytes; messages have 1 to %d", size, RCI_LONGEST_MESSAGE);
    if (sendcode == RCI_ALL) /* less the sender, as in Python */
        sendcode = (rci_known() | RCI_PARENT) & ~sender;
    rci_lock();
    can = sendcode != 0 ? can_take(sendcode, size) : -1;
    for (unsigned long bit = 1; can > 0 && bit != 0 && bit <= sendcode; bit <<= 1)
        if (sendcode & bit)
            put(mailbox_of(bit), sender, buffer, size);
    rci_unlock();
    if (can < 0)
        return rci_fail("rci_send: mask %#lx names no task, or has bits of none", asked);
    return can ? size : 0;
}

static RCI_TASK *task_of_bit(unsigned long bit)
{
    for (int i = 0; i < rci_program.n_tasks; i++)
        if (rci_program.tasks[i]->bit == bit)
            return rci_program.tasks[i];
    return &rci_program.parent;
}

/* Take the message at `at` out of a mailbox. Returns its size, or -1 when the buffer is too small: it stays. */
static long take(struct mailbox *box, long at, const struct message *head, void *buffer, long size)
{
    long whole = room_for(head->size);

    if (head->size > size)
        return -1;
    memcpy(buffer, box->bytes + at + sizeof *head, (size_t)head->size);
    memmove(box->bytes + at, box->bytes + at + whole, (size_t)(box->used - at - whole));
    box->used -= whole;
    return head->size;
}

/* The oldest message of any task of a mask. Returns its size; 0 when there is none, *sender is 0 then; -1 when `size`
 * is too small for it: it stays in the queue. */
long rci_receive(unsigned long getcode, void *buffer, long size, RCI_TASK **sender)
{
    struct mailbox *box = rci_self()->inside->mailbox;
    RCI_TASK *from = NULL;
    struct message head = {0, 0};
    long got = 0;

    rci_lock();
    for (long at = 0; at < box->used && from == NULL; at += room_for(head.size)) {
        memcpy(&head, box->bytes + at, sizeof head);
        if (head.sender & getcode) {
            from = task_of_bit(head.sender);
            got = take(box, at, &head, buffer, size);
        }
    }
    rci_unlock();
    if (sender != NULL)
        *sender = from;
    return got < 0 ? rci_fail("rci_receive: a message of %ld bytes for a buffer of %ld", head.size, size) : got;
}

/* Interrupt the planning program by a signal, for which it must have a handler. */
int rci_signal(int number)
{
    struct sigaction found;

    rci_begin();
    if (sigaction(number, NULL, &found) != 0)
        return rci_fail("rci_signal: there is no signal %d", number);
    if (!(found.sa_flags & SA_SIGINFO) && (found.sa_handler == SIG_DFL || found.sa_handler == SIG_IGN))
        return rci_fail("rci_signal: the program has no handler for signal %d", number);
    return pthread_kill(rci_program.parent_thread, number) == 0 ? 0 : -1;
}

/* Print a line to the console, with the task's name in front. */
int rci_print(const char *format, ...)
{
    char line[TEXT_BYTES];
    va_list values;

    va_start(values, format);
    vsnprintf(line, sizeof line, format, values);
    va_end(values);
    rci_say("[%s] %s", rci_self()->name, line);
    return (int)strlen(line);
}

void *rci_malloc(unsigned long size)
{
    return calloc(1, size);
}

void rci_free(void *memory)
{
    free(memory);
}

/* Set a word in one step; 1 when it was set before, and so belongs to somebody else. */
int rci_testAndSet(long *word)
{
    return __atomic_exchange_n(word, 1L, __ATOMIC_ACQ_REL) != 0;
}

void rci_clear(long *word)
{
    __atomic_store_n(word, 0L, __ATOMIC_RELEASE);
}
