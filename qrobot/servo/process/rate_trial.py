"""The servo's loop by itself for a moment, on memory of its own: it sees no board, and nothing can be powered.

What the self-test of the rate judges (`servo.process.rate_test`), at the start of each servo and for `qrobot doctor`.
"""

from __future__ import annotations

import threading
from dataclasses import replace

from qrobot.config import Robot
from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.realtime.machine import throttled_to
from qrobot.realtime.setup import SetupStep, hold_dma_latency, prepare_loop_thread
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.names import law_label
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.servo_memory import local_servo_memory
from qrobot.servo.memory.telemetry import Rows, TelemetryReader
from qrobot.servo.parameters import servo_parameters
from qrobot.servo.process.loop import MARGIN_MAX_NS, longest_margin, run
from qrobot.servo.process.rate_test import WINDOW_NS, judge_budget, judge_pace
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import make_state


class RateTrial:
    """The loop on memory of its own, which is made before the loop's thread has any priority.

    To make it takes some ten milliseconds of Python, longer than the servo of another arm on the same processor can be
    kept waiting.
    """

    def __init__(self, robot: Robot, settings: ServoSettings, law: Law) -> None:
        n, period_ns = robot.n, settings.period_ns
        self._rows = 1 << (2 * WINDOW_NS // period_ns).bit_length()
        words = local_servo_memory(robot.name, law_label(settings.law), n, period_ns, self._rows)
        words += 0  # touches every page: the loop shall not wait for them
        self._params = servo_parameters(robot, replace(settings, board_slips=False))  # here is no board to wait for
        self._state, mailbox = make_state(self._params, law), ServoMailbox(words)
        self._memories = mailbox.memory, mailbox.ring, local_board_memory(), make_card(NO_CARD)
        self._margin_ns = first_margin(settings)
        base, capacity = mailbox.info.telemetry_base, mailbox.info.telemetry_capacity
        self._reader = TelemetryReader(words, base, capacity, n)

    @property
    def beat_ns(self) -> int:
        """Instant of the newest cycle, 0 before the first."""
        return int(self._memories[0].heartbeat.t_ns)

    def window(self) -> Rows:
        """Let the loop run for one window of the self-test: its telemetry, oldest row first."""
        run(self._params, self._state, *self._memories, self._margin_ns, WINDOW_NS)
        return self._reader.read(self._rows)


def first_margin(settings: ServoSettings) -> int:
    """The spin margin that the loop begins with, ns."""
    return MARGIN_MAX_NS // 2 if settings.spin else 0


def spin_share(settings: ServoSettings) -> float:
    """Most of a period that the loop spins."""
    return int(longest_margin(settings.period_ns)) / settings.period_ns if settings.spin else 0.0


def has_fifo(steps: list[SetupStep] | tuple[SetupStep, ...]) -> bool:
    """The loop's thread runs under SCHED_FIFO, as its set-up tells."""
    return any(step.name == "scheduler" and step.ok for step in steps)


def try_rate(robot: Robot, settings: ServoSettings, law: Law) -> list[SetupStep]:
    """Judge the rate as a servo started here would, in a thread that ends; the process stays set up for real time.

    What was refused of the set-up is not told again: whoever asks has looked at that.
    """
    judged: list[SetupStep] = []

    def attempt() -> None:
        trial = RateTrial(robot, settings, law)
        with hold_dma_latency():
            steps = prepare_loop_thread(settings.cpu, settings.priority)
            judged.append(judge_pace(trial.window, settings.rate_hz))
            if has_fifo(steps):
                judged.append(judge_budget(spin_share(settings), throttled_to()))

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    return judged
