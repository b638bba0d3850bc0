"""The servo process: owns the servo memory, runs the loop in a thread of its own, tells people what happens.

The loop never returns to Python while it runs; the main thread only sleeps, watches for mode changes worth a line, and
turns signals into an orderly shutdown: controlled stop, torque off, power off, memory removed.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from types import FrameType
from typing import Any

from qrobot.config import Robot
from qrobot.errors import LinkError, QRobotError
from qrobot.faultcodes import explain
from qrobot.hwif.memory import Lane, attach_board_memory, discard_operations, local_board_memory
from qrobot.realtime.segment import Segment, Words
from qrobot.realtime.setup import Step, hold_dma_latency, prepare_loop_thread
from qrobot.servo.control import Controls
from qrobot.servo.control_socket import ControlSocket
from qrobot.servo.law import Law, find_law
from qrobot.servo.loop import ENDED, MARGIN_MAX_NS, one_cycle, run
from qrobot.servo.mailbox import (
    COMMAND_SHUTDOWN,
    INFO_READY,
    STATE_EVENT,
    STATE_JOINT,
    STATE_MODE,
    ServoMailbox,
    create_servo_memory,
    describe_choices,
    local_servo_memory,
)
from qrobot.servo.modes import mode_name
from qrobot.servo.parameters import ServoParameters, servo_parameters
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import ServoState, make_state
from qrobot.servo.swap import SwapState
from qrobot.servo.telemetry import SMALLEST_RING

BOARD_AWAY_NS = 1_000_000_000
POLL_S = 0.05

Report = Callable[[str], None]


def warm_up(robot: Robot, settings: ServoSettings) -> None:
    """Compile, or load from the cache, everything the loop calls, on memory of its own."""
    params, law = servo_parameters(robot, settings), find_law(settings.law)
    mail = local_servo_memory(robot.name, settings.law, robot.n, settings.period_ns, SMALLEST_RING)
    board = local_board_memory()
    one_cycle(params, make_state(params, law), mail, board, settings.period_ns, 0)
    mail[COMMAND_SHUTDOWN] = 1
    run(params, make_state(params, law), mail, board, 0, BOARD_AWAY_NS)


@dataclass
class ServoProcess:
    """One running servo: its memory, its parameters and its loop."""

    arm: str
    robot: Robot
    settings: ServoSettings
    report: Report
    memory: Segment
    board: Segment
    params: ServoParameters
    state: ServoState
    law: Law
    law_name: str
    require_realtime: bool = False
    steps: tuple[Step, ...] = ()
    error: BaseException | None = None

    def loop(self) -> None:
        """Body of the loop thread: set it up, then stay compiled until shutdown or until the board goes away."""
        try:
            with hold_dma_latency() as idle:
                self.steps = (*prepare_loop_thread(self.settings.cpu, self.settings.priority), idle)
                self._insist_on_realtime()
                self.memory.words[INFO_READY] = 1
                while self._run_once() != ENDED:
                    self._find_board_again()
        except BaseException as error:  # the thread's only way to tell the main one
            self.error = error

    def _run_once(self) -> int:
        margin_ns = MARGIN_MAX_NS // 2 if self.settings.spin else 0
        return int(run(self.params, self.state, self.memory.words, self.board.words, margin_ns, BOARD_AWAY_NS))

    def _insist_on_realtime(self) -> None:
        refused = [step for step in self.steps if not step.ok]
        for step in refused:
            self.report(f"real time: {step.name}: {step.detail}; {step.remedy}")
        if refused and self.require_realtime:
            raise QRobotError(f"real time was required, but: {', '.join(step.name for step in refused)}")

    def _find_board_again(self) -> None:
        if self.board.is_current:
            return
        with contextlib.suppress(LinkError):
            successor = attach_board_memory(self.arm)
            self.board.close()
            self.board = successor
            self.report("the board is back: its memory is mapped anew")

    @cached_property
    def mailbox(self) -> ServoMailbox:
        """The servo memory, from the commander's side."""
        return ServoMailbox(self.memory.words)

    @property
    def swap(self) -> SwapState:
        """Where another law is asked for."""
        return self.state.swap

    def say(self, message: str) -> None:
        """Tell people."""
        self.report(message)

    @property
    def told(self) -> tuple[int, int, int]:
        """Mode, newest event and its joint, as last published."""
        block = self.state.block
        return int(block[STATE_MODE]), int(block[STATE_EVENT]), int(block[STATE_JOINT])


def _announce(process: ServoProcess, before: tuple[int, int, int], now: tuple[int, int, int]) -> None:
    if now[0] != before[0]:
        process.report(f"{mode_name(before[0])} -> {mode_name(now[0])}")
    if now[1] != before[1] and now[1] != 0:
        process.report(f"joint {now[2] + 1}: {explain(now[1])}" if now[2] else explain(now[1]))


@contextlib.contextmanager
def shutdown_on_signals(words: Words) -> Iterator[None]:
    """SIGTERM and SIGINT ask the loop for an orderly end."""

    def ask(_signal: int, _frame: FrameType | None) -> None:
        words[COMMAND_SHUTDOWN] = 1

    before = {number: signal.signal(number, ask) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def serve(
    arm: str,
    robot: Robot,
    settings: ServoSettings,
    require_realtime: bool,
    report: Report,
    started: Callable[[], Any],
) -> None:
    """Run the servo of `arm` until SIGTERM or SIGINT.

    Args:
        started: called once the servo memory exists and the loop is about to run (to start the guardian).

    Raises:
        LinkError: no board serves this arm.
        LinkBusy: another servo runs this arm.
    """
    attach_board_memory(arm).close()  # say so at once when there is none: compiling takes a while
    warm_up(robot, settings)
    board = attach_board_memory(arm)
    with create_servo_memory(
        arm, robot.name, settings.law, robot.n, settings.period_ns, settings.telemetry_capacity
    ) as memory:
        describe_choices(memory.words, settings.velocity, settings.interpolation)
        discard_operations(board.words, int(Lane.SERVO))
        params, law = servo_parameters(robot, settings), find_law(settings.law)
        process = ServoProcess(
            arm,
            robot,
            settings,
            report,
            memory,
            board,
            params,
            make_state(params, law),
            law,
            settings.law,
            require_realtime,
        )
        with shutdown_on_signals(memory.words):
            started()
            _run_and_watch(process)
    process.board.close()


def _run_and_watch(process: ServoProcess) -> None:
    """Run the loop in its thread, and answer the control interface beside it."""
    controls = Controls(process)
    with ControlSocket(process.arm, controls.answer, controls.farewell) as control:
        thread = threading.Thread(target=process.loop, name="servo-loop", daemon=True)
        thread.start()
        before = process.told
        while thread.is_alive():
            control.serve(POLL_S)
            now = process.told
            _announce(process, before, now)
            before = now
    if process.error is not None:
        raise process.error
