"""The servo process: owns the servo memory, runs the loop in a thread of its own, tells people what happens.

The loop never returns to Python while it runs; the main thread only sleeps, watches for mode changes worth a line, and
turns signals into an orderly shutdown: controlled stop, torque off, power off, memory removed. The control interface
has a thread of its own, which neither of the two can keep waiting, by a full disk or a terminal that is held.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from types import FrameType
from typing import Any

from qrobot.arrays import Floats, Words
from qrobot.config import Robot
from qrobot.errors import ConfigError, LinkError, QRobotError
from qrobot.faultcodes import NO_JOINT, FaultCode, explain
from qrobot.hwif.board_memory import BoardSegment, Lane, attach_board_memory, command_board_memory, local_board_memory
from qrobot.hwif.bus import check_encoders
from qrobot.hwif.isa.bus import PortBus
from qrobot.hwif.isa.card import CARD_BASE, CARD_KIND, CARD_READ_ONLY, CARD_WITHHELD, NO_CARD, REAL_CARD, make_card
from qrobot.hwif.isa.owner import own_board_memory
from qrobot.hwif.isa.permission import require_ports
from qrobot.hwif.lanes import discard_operations
from qrobot.modecodes import Mode, mode_name
from qrobot.realtime.deadline import Deadline
from qrobot.realtime.machine import throttled_to
from qrobot.realtime.page_faults import FaultWatch
from qrobot.realtime.setup import SetupStep, hold_dma_latency, insist_on, leave_fifo, prepare_loop_thread
from qrobot.realtime.shared_memory import segment_path
from qrobot.realtime.signals import ending_signals, handled, interrupted_by_sigterm
from qrobot.realtime.startup_order import await_turn, turn_is_awaited
from qrobot.report import QueuedReport, Report
from qrobot.servo.checks.monitor_state import check_exchanges
from qrobot.servo.emulated_board import insist_on_emulated
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.law_swap import SwapState
from qrobot.servo.laws.names import law_label
from qrobot.servo.laws.stability import check_gains
from qrobot.servo.laws.trial_process import tried_law
from qrobot.servo.memory.commander_lock import Authority
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import (
    ServoFront,
    ServoSegment,
    create_servo_memory,
    describe_analog_outputs,
    describe_choices,
    local_servo_memory,
)
from qrobot.servo.memory.stop_record import Incident, read_incident
from qrobot.servo.memory.telemetry import SMALLEST_RING, Rows, TelemetryLayout, fitting_capacity
from qrobot.servo.operator.requests import Controls
from qrobot.servo.operator.sockets import ControlSocket
from qrobot.servo.parameters import ServoParameters, servo_parameters
from qrobot.servo.process.loop import ENDED, run
from qrobot.servo.process.loop_priority import LoopPriority
from qrobot.servo.process.neighbour_look import looking
from qrobot.servo.process.rate_test import RATE, RT_BUDGET, judge_budget, judge_pace
from qrobot.servo.process.rate_trial import RateTrial, first_margin, has_fifo, spin_share
from qrobot.servo.process.sole_servo import sole_servo
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import ServoState, make_state

BOARD_AWAY_NS = 1_000_000_000
POLL_S = 0.05
KEPT_PROBLEMS = 8
HUNG_S = 5.0  # [A] without a cycle, once the end was asked for: the loop does not come back
PAGEFAULT = int(FaultCode.PAGEFAULT)

Look = Callable[[ServoMailbox, Incident | None, bool], None]  # at the newest incident; True once the loop has ended


def warm_up(robot: Robot, settings: ServoSettings) -> Law:
    """Compile, or load from the cache, everything the loop calls, on memory of its own. The law, tried."""
    params, law = servo_parameters(robot, settings), tried_law_of(robot, settings)
    words = local_servo_memory(robot.name, law_label(settings.law), robot.n, settings.period_ns, SMALLEST_RING)
    mailbox, board = ServoMailbox(words), local_board_memory()
    mailbox.memory.command.shutdown = 1
    run(params, make_state(params, law), mailbox.memory, mailbox.ring, board, make_card(NO_CARD), 0, BOARD_AWAY_NS)
    return law


def tried_law_of(robot: Robot, settings: ServoSettings) -> Law:
    """The law of the deployment, which has passed its trial. Raises ConfigError when it did not."""
    return tried_law(settings.law, robot, settings.law_settings, settings.period_ns)


@dataclass
class ServoProcess:
    """One running servo: its memory, its parameters and its loop."""

    arm: str
    robot: Robot
    settings: ServoSettings
    report: QueuedReport
    memory: ServoSegment
    board: BoardSegment
    card: Words
    params: ServoParameters
    state: ServoState
    law: Law
    law_name: str
    require_realtime: bool = False
    steps: tuple[SetupStep, ...] = ()
    error: BaseException | None = None
    trial: RateTrial | None = None
    faults: FaultWatch = field(default_factory=FaultWatch)

    def loop(self) -> None:
        """Body of the loop thread: set it up, then stay compiled until shutdown or until the board goes away."""
        try:
            if self.card[CARD_KIND] == REAL_CARD:  # ports are granted to a thread
                require_ports(int(self.card[CARD_BASE]))
            self.trial = RateTrial(self.robot, self.settings, self.law)  # before this thread keeps others from running
            with hold_dma_latency() as idle:
                self.steps = (*prepare_loop_thread(self.settings.cpu, self.settings.priority), idle)
                insist_on(self.steps, self.require_realtime, self.report)
                self._insist_on_the_rate(self.trial.window)
                self.faults.begin(threading.get_native_id())
                self.memory.front.info.ready = 1
                while self._run_once() != ENDED:
                    self._find_board_again()
        except BaseException as error:  # the thread's only way to tell the main one
            self.error = error
        finally:
            leave_fifo()

    def _run_once(self) -> int:
        mailbox = self.mailbox
        memories = mailbox.memory, mailbox.ring, self.board.memory, self.card
        return int(run(self.params, self.state, *memories, first_margin(self.settings), BOARD_AWAY_NS))

    def _insist_on_the_rate(self, run_window: Callable[[], Rows]) -> None:
        """Let the loop run by itself for a moment. Raises QRobotError where its rate has to be kept."""
        pace = judge_pace(run_window, self.settings.rate_hz)
        budget = judge_budget(self._spin_share(), throttled_to()) if self._has_fifo() else None
        judged = [(RATE, pace)] + ([(RT_BUDGET, budget)] if budget else [])
        for code, step in judged:
            self.steps += (step,)
            self.report(f"{step.name}: {step.detail}" if step.ok else _complaint(code, step))
            insists = self.require_realtime or not self.settings.emulated
            if not step.ok and insists and not self.settings.unchecked_rate:
                raise QRobotError(_complaint(code, step))

    def _spin_share(self) -> float:
        return spin_share(self.settings)

    def _has_fifo(self) -> bool:
        return has_fifo(self.steps)

    def check_board(self) -> None:
        """Raise ConfigError when the board that is to be emulated has turned out to be another one."""
        if self.settings.emulated:
            insist_on_emulated(self.board.memory, self.arm)

    def _find_board_again(self) -> None:
        if self.board.is_current:
            return
        with contextlib.suppress(LinkError):
            successor = command_board_memory(self.arm)
            self.board.close()
            self.board = successor
            self.report("the board is back: its memory is mapped anew")

    @cached_property
    def mailbox(self) -> ServoMailbox:
        """The servo memory, from the commander's side."""
        return ServoMailbox(self.memory.words)

    @property
    def swap(self) -> SwapState:
        """State of the law swap, through which another law is asked for."""
        return self.state.swap

    @property
    def volts(self) -> Floats:
        """Volts at the converter's channels."""
        return self.state.sensors  # type: ignore[no-any-return]

    @property
    def force_zero(self) -> Floats:
        """Volts of the force sensor without a load."""
        return self.state.force_zero  # type: ignore[no-any-return]

    @property
    def beat_ns(self) -> int:
        """Instant of the loop's newest cycle, those of its self-test among them; 0 before the first."""
        own_ns = int(self.memory.front.heartbeat.t_ns)
        return own_ns if own_ns or self.trial is None else self.trial.beat_ns

    @property
    def page_faults(self) -> int:
        """Page faults of the loop's thread since it began."""
        return self.faults.count

    def say(self, message: str) -> None:
        """Tell people."""
        self.report(message)

    @property
    def incident(self) -> Incident | None:
        """The newest incident."""
        return read_incident(self.state.watch.incident)


def _complaint(code: int, step: SetupStep) -> str:
    return f"{FaultCode(code).name}: {step.detail}; {step.remedy}"


class _Herald:
    """Tells people what became of the servo since it was last looked at."""

    def __init__(self, process: ServoProcess) -> None:
        self._process, self._number, self._faults_told = process, 0, 0
        self._told, self._told_tick = (int(Mode.OFF), int(FaultCode.NONE), NO_JOINT), 0

    def _published(self) -> tuple[int, int, int]:
        """Mode, newest event and its joint, of one cycle; what was told when nothing newer has been published."""
        with contextlib.suppress(LinkError):  # the loop was interrupted while it wrote: the next look will do
            state = self._process.mailbox.snapshot()
            if state.tick >= self._told_tick:
                return state.mode, state.event, state.event_joint
        return self._told

    def announce(self, incident: Incident | None) -> None:
        """A line for a new incident, then for any other change of mode and any other event."""
        if incident is not None and incident.number > self._number:
            self._number = incident.number
            self._process.report(incident.line(self._process.robot.prismatic))
            self._told, self._told_tick = (incident.mode_to, incident.code, incident.joint), incident.tick
        before, self._told = self._told, self._published()
        mode, event, joint = self._told
        if mode != before[0]:
            self._process.report(f"{mode_name(before[0])} -> {mode_name(mode)}")
        if event != before[1] and event != 0:
            self._process.report(explain(event, joint))
        self._announce_faults()

    def _announce_faults(self) -> None:
        """The first page fault of the loop, and then twice as many each time: they may come in floods."""
        faults = self._process.faults
        faults.look()
        if faults.count > 2 * self._faults_told:
            self._faults_told = faults.count
            self._process.report(f"{explain(PAGEFAULT)} ({faults.count} since the loop began)")


@contextlib.contextmanager
def shutdown_on_signals(front: ServoFront) -> Iterator[None]:
    """SIGTERM, SIGINT, and SIGHUP of a terminal that is closed ask the loop for an orderly end."""

    def ask(_signal: int, _frame: FrameType | None) -> None:
        front.command.shutdown = 1

    with handled(dict.fromkeys(ending_signals(), ask)):
        yield


def serve(
    arm: str,
    robot: Robot,
    settings: ServoSettings,
    require_realtime: bool,
    report: QueuedReport,
    started: Callable[[], Any],
    look: Look = lambda _mailbox, _incident, _ended: None,
    card: Words | None = None,
) -> None:
    """Run the servo of `arm` until SIGTERM, SIGINT or SIGHUP.

    Args:
        report: takes lines for people, of `started` and `look` as well.
        started: called once the servo memory exists and the loop is about to run (to start the guardian).
        look: called some 20 times a second (for a flight recorder), and once more at the end.
        card: of a board on this machine's own bus: the loop reaches it itself, and this process owns the board memory.

    Raises:
        ConfigError: the robot has more joints than a board or this one, the card's ports are refused, or the gains by
            `servo.laws.stability`; a board behind a gateway is asked too seldom for the rate.
        LinkError: no board serves this arm, or no card answers.
        LinkBusy: another servo runs this arm.
    """
    check_encoders(robot.name, robot.n)
    check_gains(robot, settings)
    check_exchanges(settings)
    card = make_card(NO_CARD) if card is None else card
    board_comes_later = turn_is_awaited()
    if not board_comes_later:
        _insist_on_a_board(arm, card)  # say so at once when there is none: compiling takes a while
    law = warm_up(robot, settings)
    await_turn()
    if board_comes_later:
        _insist_on_a_board(arm, card)
    board = _board_memory(arm, card, robot, settings.period_ns)
    rows = _ring_rows(arm, robot, settings, report)
    with (
        interrupted_by_sigterm(),  # the loop is not there yet to be asked for an end
        create_servo_memory(arm, robot.name, law_label(settings.law), robot.n, settings.period_ns, rows) as memory,
        sole_servo(arm),
    ):
        describe_choices(memory.words, settings.velocity, settings.interpolation)
        describe_analog_outputs(memory.words, settings.analog_ranges)
        memory.front.heartbeat.slips = int(settings.board_slips)
        discard_operations(board.memory, int(Lane.SERVO))
        params = servo_parameters(robot, settings)
        process = ServoProcess(
            arm,
            robot,
            settings,
            report,
            memory,
            board,
            card,
            params,
            make_state(params, law),
            law,
            settings.law,
            require_realtime,
        )
        with shutdown_on_signals(memory.front):
            started()
            _run_and_watch(process, look)
        if card[CARD_READ_ONLY]:
            report(f"dry run: {int(card[CARD_WITHHELD])} accesses that would have changed something were withheld")
    process.board.close(unlink=process.board.owner)
    Authority(arm).clear()


def _insist_on_a_board(arm: str, card: Words) -> None:
    if card[CARD_KIND] == NO_CARD:
        attach_board_memory(arm).close()
    else:
        PortBus(card).connect()


def _board_memory(arm: str, card: Words, robot: Robot, period_ns: int) -> BoardSegment:
    """Attach the memory of a board process, or make one for a card. Raises ConfigError when it has too few channels."""
    if card[CARD_KIND] != NO_CARD:
        return own_board_memory(arm, card, robot.n, period_ns)
    board = command_board_memory(arm)
    channels = int(board.memory.facts.joints)
    if 0 < channels < robot.n:  # 0 of a gateway that looks for its board yet: one with too few gets no power
        board.close()
        raise ConfigError(f"{robot.name} has {robot.n} joints, its board tells of {channels} encoder channels")
    return board


def _ring_rows(arm: str, robot: Robot, settings: ServoSettings, report: Report) -> int:
    """Rows of the telemetry ring: as many as were chosen, or as there is room for."""
    wanted, folder = settings.telemetry_capacity, segment_path(f"{arm}-servo").parent
    rows = fitting_capacity(TelemetryLayout(robot.n).row_words, wanted, shutil.disk_usage(folder).free)
    if rows < wanted:
        kept = rows / settings.rate_hz
        report(
            f"the black box holds {kept:.0f} s in place of {settings.black_box_s:g} s: {folder} has room for no more"
        )
    return rows


def _run_and_watch(process: ServoProcess, look: Look) -> None:
    """Run the loop in its thread; beside it answer the control interface, in another one, and tell what happens."""
    controls, herald = Controls(process), _Herald(process)
    told = process.state.neighbour
    with (
        ControlSocket(process.arm, controls.begin, controls.farewell) as control,
        _served(control) as problems,
        looking(process.settings.neighbours, process.mailbox, told, process.say),
    ):
        thread = threading.Thread(target=process.loop, name="servo-loop", daemon=True)
        thread.start()
        running = _Running(process, thread)
        try:
            while running.goes_on():
                process.check_board()
                controls.note_fallback()
                controls.stop_abandoned_calibration()
                while problems:
                    process.say(problems.popleft())
                incident = process.incident
                herald.announce(incident)
                look(process.mailbox, incident, False)
        finally:  # whatever goes wrong here, the arm is stopped and let go of in good order first
            process.memory.front.command.shutdown = 1
            while running.goes_on():
                pass
    look(process.mailbox, process.incident, True)
    if process.error is not None:
        raise process.error


@contextlib.contextmanager
def _served(control: ControlSocket) -> Iterator[deque[str]]:
    """Serve the control interface in a thread that waits for nothing else; yields what went wrong there, to be told."""
    done, problems = threading.Event(), deque[str](maxlen=KEPT_PROBLEMS)

    def serve_visitors() -> None:
        while not done.is_set():
            try:
                control.serve(POLL_S)
            except BaseException:  # our mistake: the next request may be a stop
                problems.append(traceback.format_exc())
                done.wait(POLL_S)

    thread = threading.Thread(target=serve_visitors, name="servo-control", daemon=True)
    thread.start()
    try:
        yield problems
    finally:
        done.set()
        thread.join()


class _Running:
    """The loop's thread, which may be caught for ever in a law whose trial has shown nothing of it."""

    def __init__(self, process: ServoProcess, thread: threading.Thread) -> None:
        self._process, self._thread = process, thread
        self._beat, self._patience = 0, Deadline(HUNG_S)
        self._priority = LoopPriority(thread.native_id or 0, process.say)

    def goes_on(self) -> bool:
        """Wait a moment for the end of the loop; False once it has come.

        A loop that should end and runs no cycle is left, and with it this process: the guardian has the board by then.
        """
        front = self._process.memory.front
        self._thread.join(POLL_S)
        self._priority.look(self._process.beat_ns, time.monotonic_ns(), bool(front.guardian.takeover))
        if self._beat != front.heartbeat.t_ns or not front.command.shutdown:
            self._beat, self._patience = int(front.heartbeat.t_ns), Deadline(HUNG_S)
        if self._thread.is_alive() and self._patience.passed:
            self._process.report(f"the loop has run no cycle for {HUNG_S:g} s and is left where it hangs")
            self._process.report.close()
            os._exit(1)  # the thread holds on to all memory here: only an end as by `kill -9` is one
        return self._thread.is_alive()
