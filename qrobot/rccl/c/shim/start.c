/* start.c - how a program comes to its motion engine, and how both end. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "shim.h"

#define ENGINE "QROBOT_ENGINE" /* two channels, when somebody has started an engine for this program: "3,4" */
#define PYTHON "QROBOT_PYTHON" /* another Python than that of `qrobot cc` */
#define MOST_FILES 65536
#define PATIENCE_MS 10000      /* for an arm that comes to rest */
#define FAVOURED_NICENESS (-10) /* that of qrobot/realtime/setup.py */

static pid_t owner = 0; /* a child of the program has no arm */
static int channels[2] = {-1, -1}; /* foreground and background */
static pthread_t background;
static volatile sig_atomic_t reached = 0; /* the engine */
static volatile sig_atomic_t over = 0;   /* the program ends, in the thread `ender` */
static volatile sig_atomic_t parted = 0; /* and nothing can be asked any more */
static volatile pthread_t ender;
static volatile sig_atomic_t interrupts = 0;

static void begin_to_end(void)
{
    ender = pthread_self();
    over = 1;
}

/* At a bad end no arm goes on until that of another library rests. Safe in a handler: whoever holds the lock of the tasks
 * has all signals blocked. */
static void stop_tasks(void)
{
    if (rci_begin_stop)
        rci_begin_stop();
}

/* The engine brings the arm to rest from now on, and tasks theirs, whatever holds up what is said. Async-signal-safe. */
static void part(void)
{
    begin_to_end();
    parted = 1;
    shim_close();
    stop_tasks();
}

/* A function of samples is still answered, so that its sample can be finished. */
int shim_parted(void)
{
    return parted && pthread_equal(pthread_self(), ender);
}

/* Async-signal-safe. */
static void end_now(void)
{
    part();
    shim_say_mess();
    shim_wait_closed(PATIENCE_MS);
    shim_say_rest();
}

void shim_stay(void)
{
    if (!parted || pthread_equal(pthread_self(), ender))
        return;
    if (shim_serving()) {
        shim_close();
        pthread_exit(NULL); /* leave() joins it */
    }
    for (;;)
        pause();
}

void shim_die(const char *text)
{
    shim_stay(); /* it fails because the program ends */
    stop_tasks();
    shim_flush_output();
    shim_say_now(program_invocation_short_name);
    shim_say_now(": ");
    shim_say_now(text);
    shim_say_now("\n");
    shim_say_mess();
    if (over && !pthread_equal(pthread_self(), ender))
        _exit(1);
    if (over && reached && owner == getpid())
        end_now();
    begin_to_end(); /* there is nobody to let go of the arm in an orderly way */
    exit(1);        /* in a handler of exit() too: those that are left follow */
}

void *shim_need(void *given, const char *call, const char *what)
{
    char text[SHIM_TEXT];
    snprintf(text, sizeof text, "%s: %s is needed, and a null pointer was given", call, what);
    if (!given)
        shim_die(text);
    return given;
}

/* With status 0 when the motions that wait are done. False when another thread asks, for which an arm does not wait after
 * an error. */
static int let_go(int status)
{
    struct message m = shim_message(OP_RELEASE, "");
    char who[32];
    if (status != 0)
        stop_tasks();
    begin_to_end();
    m.n = status == 0;
    if (!shim_call_last(&m, status == 0))
        return 0;
    part();
    shim_wait_closed(PATIENCE_MS);
    pthread_join(background, NULL);
    fflush(stdout);
    snprintf(who, sizeof who, "ended with status %d", status);
    shim_say(who, m.text);
    shim_say_mess();
    shim_say_rest();
    return 1;
}

/* At exit: whoever has an arm lets go of it first; with status 0 when the motions that wait are done (Hayward and Paul's
 * programs end with a `move`). After an error a function may hang, so nobody waits for its thread; nor for another
 * thread that asks. In a function that is called at a sample, and in a handler that has interrupted a call, nothing can
 * be asked. Then the arm comes to rest at once. */
static void leave(int status, void *unused)
{
    int asks = !over && !shim_serving() && !shim_calling();
    (void) unused;
    pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, NULL);
    if (!reached || owner != getpid())
        shim_say_rest();
    else if (!asks || !let_go(status))
        end_now();
}

/* Before main, so that the program's own handlers of exit() run while the arm is still its own. Tasks of RCI are closed
 * behind it, which takes time. */
__attribute__((constructor)) static void leave_at_exit(void)
{
    if (rci_close_at_exit)
        rci_close_at_exit();
    on_exit(leave, NULL);
}

/* SIGINT, SIGHUP, SIGTERM: the engine brings the arm to rest while we wait; a second signal ends at once, but SIGHUP, of
 * which kernel and shell both tell when a terminal is closed. */
static void on_signal(int number)
{
    if (owner == getpid() && number == SIGHUP && interrupts)
        return;
    if (owner == getpid() && ++interrupts == 1) {
        if (number == SIGHUP)
            signal(SIGHUP, SIG_IGN); /* it interrupts nothing that the end has to ask */
        part(); /* before anything is said: a held terminal holds up no stop */
        shim_say_now(number == SIGINT ? "\n" : "");
        shim_say_now(program_invocation_short_name);
        shim_say_now(": interrupted; the arm is brought to rest\n");
        end_now();
    }
    _exit(128 + number);
}

static void catch_signals(void)
{
    const int numbers[] = {SIGINT, SIGHUP, SIGTERM};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        struct sigaction action;
        sigaction(numbers[i], NULL, &action);
        if (action.sa_handler != SIG_DFL)
            continue; /* the program has its own mind */
        action.sa_handler = on_signal;
        action.sa_flags = SA_NODEFER;
        sigaction(numbers[i], &action, NULL);
    }
}

/* A sample waits for the functions of the program that it calls, so their thread waits for few others, where that is
 * allowed. */
static void *serve(void *channel)
{
    setpriority(PRIO_PROCESS, (id_t) gettid(), FAVOURED_NICENESS);
    shim_serve((int) (intptr_t) channel);
    return NULL;
}

/* Functions of the program run on a thread of their own, which gets no signals: those interrupt the foreground. */
static void start_serving(int channel)
{
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    if (pthread_create(&background, NULL, serve, (void *) (intptr_t) channel))
        shim_die("cannot start a thread for background functions");
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

static const char *engine_module(void)
{
    if (arcl_obey)
        return "qrobot.arcl.c";
    return rccl_has_manipulators ? "qrobot.multi_rccl.c" : "qrobot.rccl.c";
}

/* All but the standard streams: whoever reads a pipe of the program's would wait for the end of the engine too. */
static void close_files_on_exec(void)
{
    const unsigned first = STDERR_FILENO + 1;
#ifdef CLOSE_RANGE_CLOEXEC
    if (!close_range(first, ~0U, CLOSE_RANGE_CLOEXEC))
        return;
#endif
    for (int fd = (int) first; fd < MOST_FILES; fd++) /* Linux before 5.11 */
        fcntl(fd, F_SETFD, FD_CLOEXEC);
}

static void become_engine(const int *theirs)
{
    char foreground[12], background[12];
    const char *python = getenv(PYTHON) ? getenv(PYTHON) : QROBOT_PYTHON;
    int nothing = open("/dev/null", O_RDONLY);
    setsid(); /* what interrupts the program must not interrupt whoever brings the arm to rest */
    signal(SIGPIPE, SIG_DFL);
    close_files_on_exec();
    fcntl(theirs[0], F_SETFD, 0);
    fcntl(theirs[1], F_SETFD, 0);
    dup2(nothing, STDIN_FILENO);
    snprintf(foreground, sizeof foreground, "%d", theirs[0]);
    snprintf(background, sizeof background, "%d", theirs[1]);
    execlp(python, python, "-m", engine_module(), foreground, background, (char *) NULL);
    fprintf(stderr, "cannot start %s: %s; name the Python that has qrobot in " PYTHON "\n", python, strerror(errno));
    _exit(127);
}

/* The engine is no child of the program, which may wait for all of its children. */
static void start_engine(int *ours)
{
    int first[2], second[2];
    if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, first)
        || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, second))
        shim_die("no channel to the motion engine");
    pid_t between = fork();
    if (between < 0)
        shim_die("cannot start the motion engine");
    if (between == 0) {
        if (fork() == 0)
            become_engine((int[2]) {first[1], second[1]});
        _exit(0);
    }
    while (waitpid(between, NULL, 0) < 0 && errno == EINTR)
        ;
    close(first[1]);
    close(second[1]);
    ours[0] = first[0];
    ours[1] = second[0];
}

/* The engine that waits for us, or else one of our own. */
static void find_engine(int *ours)
{
    const char *waiting = getenv(ENGINE);
    if (waiting && sscanf(waiting, "%d,%d", &ours[0], &ours[1]) == 2) {
        fcntl(ours[0], F_SETFD, FD_CLOEXEC);
        fcntl(ours[1], F_SETFD, FD_CLOEXEC);
        unsetenv(ENGINE);
    } else {
        start_engine(ours);
    }
}

/* The first message carries the file of the shared memory. The program's own signals may interrupt us. */
static void greet(int channel, int file)
{
    union {
        struct cmsghdr header;
        char room[CMSG_SPACE(sizeof(int))];
    } control = {0};
    struct message m = shim_message(OP_HELLO, program_invocation_short_name);
    struct iovec part = {&m, sizeof m};
    struct msghdr packet = {.msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    m.n = SHIM_VERSION;
    shim_globals(m.refs);
    control.header.cmsg_level = SOL_SOCKET;
    control.header.cmsg_type = SCM_RIGHTS;
    control.header.cmsg_len = CMSG_LEN(sizeof(int));
    memcpy(CMSG_DATA(&control.header), &file, sizeof file);
    if (TEMP_FAILURE_RETRY(sendmsg(channel, &packet, MSG_NOSIGNAL)) < 0
        || TEMP_FAILURE_RETRY(recv(channel, &m, sizeof m, 0)) != sizeof m)
        shim_die("the motion engine did not start");
    if (m.op == OP_ERROR)
        shim_die(m.text);
    close(file);
}

/* For rci.h: 1 when this process has an engine. */
int shim_has_engine(void)
{
    return owner == getpid();
}

static __thread sigset_t before_fork;

/* Handlers of signals may set what a child shares until it has parted. */
static void block_signals(void)
{
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_fork);
}

static void let_signals_in(void)
{
    pthread_sigmask(SIG_SETMASK, &before_fork, NULL);
}

/* The engine sees the end of the program, though a child of it lives on, and nothing that the child sets. */
static void part_in_child(void)
{
    shim_forget_unsaid();
    shim_unshare();
    shim_open(-1);
    for (int i = 0; i < 2; i++) {
        if (channels[i] >= 0)
            close(channels[i]);
        channels[i] = -1;
    }
    let_signals_in();
}

/* Standard streams that the program was started without would be the numbers of its channels: what it prints is no
 * message. */
static void fill_standard_streams(void)
{
    int fd;
    do
        fd = open("/dev/null", O_RDWR); /* the engine has them too */
    while (fd >= 0 && fd <= STDERR_FILENO);
    if (fd >= 0)
        close(fd);
}

static void reach_engine(void)
{
    if (rci_is_virtual && rci_is_virtual())
        shim_die("tasks of RCI are active on virtual time, which would not pass for an arm of RCCL or ARCL; run the program "
                 "without --lockstep and --offline, against `qrobot up`");
    owner = getpid();
    fill_standard_streams();
    pthread_atfork(block_signals, let_signals_in, part_in_child);
    int file = shim_share();
    find_engine(channels);
    greet(channels[0], file);
    shim_open(channels[0]);
    start_serving(channels[1]);
    catch_signals();
    __atomic_store_n(&reached, 1, __ATOMIC_RELEASE);
}

static void start_once(void)
{
    static pthread_mutex_t starting = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&starting);
    if (!reached)
        reach_engine();
    pthread_mutex_unlock(&starting);
}

/* Threads whose first calls overlap wait for the one that is first. One that is cancelled meanwhile is afterwards. */
void shim_start(void)
{
    static __thread volatile sig_atomic_t in_start;
    int cancelling;
    if (owner && owner != getpid())
        shim_die("a child of the program has no arm: whoever made the first call makes the others");
    if (__atomic_load_n(&reached, __ATOMIC_ACQUIRE))
        return;
    if (in_start)
        shim_die(SHIM_IN_HANDLER);
    in_start = 1;
    pthread_setcancelstate(PTHREAD_CANCEL_DISABLE, &cancelling);
    start_once();
    pthread_setcancelstate(cancelling, NULL);
    in_start = 0;
}
