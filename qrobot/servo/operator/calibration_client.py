"""Have a running servo calibrate its arm, and follow it: the commander's side of `servo.calibration.procedure`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from qrobot.errors import ConfigError, LinkTimeout, ServoFault
from qrobot.faultcodes import FaultCode, explain
from qrobot.modecodes import Mode, mode_name
from qrobot.servo.calibration.state import FEWEST_INDEXES, IMPLAUSIBLE, MOST_INDEXES, PLAUSIBLE, UNJUDGED
from qrobot.servo.memory.mailbox import CalibrationProgress, ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, ServoSnapshot

POLL_S: Final = 0.05
POWER_PATIENCE_S: Final = 6.0  # the servo's own is 3 s
POTS_PATIENCE_S: Final = 3.0  # [A] a servo of 100 Hz reads them for one second
FORGET_S: Final = 0.2  # until the board shows that the calibrated bit is gone
POWERED: Final = (Mode.UNCALIBRATED, Mode.HOLDING)
BEGINNINGS: Final = (Mode.OFF, Mode.UNCALIBRATED, Mode.CALIBRATING)
SILENCE_S: Final = 1.0  # without a new tick the servo has died, or another one has taken its place
CALIBRATION_PATIENCE_S: Final = 600.0  # six joints take half a minute; fourteen pulses twice that

Wait = Callable[[float], None]
FollowCalibration = Callable[[CalibrationProgress], None]


@dataclass(frozen=True)
class CalibrationReport:
    """Results of a calibration, joint by joint.

    Attributes:
        was_calibrated: the counters were right already; nothing moved, and the lists are empty.
        indexes: index pulses used of each joint.
        misfit: mean distance from the table's rows, ADC units of 20 V / 65536; a row is about 150 of them.
        margin: by how much the second best place in the table is worse.
        votes: index pulses that agree with the place found.
    """

    was_calibrated: bool
    indexes: int
    misfit: list[float]
    margin: list[float]
    votes: list[int]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**self.__dict__}


ALREADY: Final = CalibrationReport(True, 0, [], [], [])


def run_calibration(
    mailbox: ServoMailbox, wait: Wait, indexes: int = 0, progress: FollowCalibration = lambda _: None
) -> CalibrationReport:
    """Power the arm if it has none, calibrate it, and leave power as it was.

    A calibration that is under way already is followed to its end. What goes wrong, and Ctrl-C, stop it.

    Args:
        mailbox: of the servo, which nobody else commands meanwhile.
        wait: lets so many seconds pass; virtual ones in lock-step.
        indexes: pulses a joint, 3 to 14; 0 for the servo's default. One that is under way keeps its own number.
        progress: called as the calibration goes on.

    Raises:
        ConfigError: that number of indexes is not possible.
        ServoFault: the servo refused, or is in a mode in which it would; its code, and what to do.
        LinkTimeout: the servo does not answer.
    """
    if indexes and not FEWEST_INDEXES <= indexes <= MOST_INDEXES:
        raise ConfigError(f"{indexes} index pulses: {FEWEST_INDEXES} to {MOST_INDEXES} are possible")
    halts = mailbox.halts
    before = _judged(mailbox, wait)
    if before.flags & FLAG_CALIBRATED and before.pots_verdict == PLAUSIBLE:
        return ALREADY
    if before.mode not in BEGINNINGS:
        raise ServoFault(before.fault, _refusal(before, f"the servo is in mode {mode_name(before.mode)}, not OFF"))
    had_power = before.mode != Mode.OFF
    try:
        if not had_power and _power_on(mailbox, wait, before, halts) == Mode.HOLDING:
            return ALREADY
        if before.mode != Mode.CALIBRATING:
            _ask(mailbox, halts, lambda: mailbox.request_calibration(indexes))
        found = _follow(mailbox, wait, progress)
    except BaseException:
        mailbox.request_stop()
        raise
    finally:
        if not had_power:
            mailbox.request_power(False)
    return CalibrationReport(
        False, found.wanted, found.misfit.tolist(), found.margin.tolist(), [int(votes) for votes in found.votes]
    )


def _ask(mailbox: ServoMailbox, halts: tuple[int, int], request: Callable[[], None]) -> None:
    """Make a request. Raises ServoFault when somebody has halted the arm since `halts` were counted.

    The second look finds a halt just before the request, which a cycle may have seen by itself. The servo obeys any
    that comes later.
    """
    _insist_on_no_halt(mailbox, halts)
    request()
    _insist_on_no_halt(mailbox, halts)


def _insist_on_no_halt(mailbox: ServoMailbox, halts: tuple[int, int]) -> None:
    """Raise ServoFault when somebody has asked for a stop, or for no power, since `halts` were counted."""
    if mailbox.halts != halts:
        raise ServoFault(FaultCode.CAL_STOPPED, f"not calibrated: {explain(FaultCode.CAL_STOPPED)}")


def _power_on(mailbox: ServoMailbox, wait: Wait, before: ServoSnapshot, halts: tuple[int, int]) -> int:
    """Leave OFF; returns the mode: UNCALIBRATED, or HOLDING when the counters are right after all.

    Counters that the potentiometers contradict are given up first.
    """
    if before.pots_verdict == IMPLAUSIBLE:
        mailbox.request_calibration()
    mailbox.request_power(False)
    wait(FORGET_S)
    _ask(mailbox, halts, lambda: mailbox.request_power(True))
    asked = mailbox.snapshot()  # behind the request, of which the next cycle but one has heard for certain
    state = _until(
        mailbox,
        wait,
        lambda state: state.mode in POWERED or (state.event != 0 and state.tick > asked.tick + 1),
        POWER_PATIENCE_S,
    )
    if state.mode not in POWERED:
        raise ServoFault(state.event, _refusal(state, "no arm power"))
    return state.mode


def _follow(mailbox: ServoMailbox, wait: Wait, progress: FollowCalibration) -> CalibrationProgress:
    asked = mailbox.snapshot()  # behind the request, of which the next cycle but one has heard for certain
    wait(POLL_S)

    def ended(state: ServoSnapshot) -> bool:
        progress(mailbox.calibration())
        return state.mode != Mode.CALIBRATING and state.tick > asked.tick + 1

    state = _until(mailbox, wait, ended, CALIBRATION_PATIENCE_S)
    if state.mode != Mode.HOLDING:
        raise ServoFault(state.event, _refusal(state, "not calibrated"))
    return mailbox.calibration()


def _until(
    mailbox: ServoMailbox, wait: Wait, reached: Callable[[ServoSnapshot], bool], patience_s: float
) -> ServoSnapshot:
    tick, silent_s = -1, 0.0
    for _ in range(round(patience_s / POLL_S)):
        state = mailbox.snapshot()
        if reached(state):
            return state
        silent_s = silent_s + POLL_S if state.tick == tick else 0.0
        if silent_s > SILENCE_S:
            raise LinkTimeout("the servo does not run any more: see `qrobot doctor`, then start it again")
        tick = state.tick
        wait(POLL_S)
    raise LinkTimeout(f"the servo stays in mode {mode_name(mailbox.snapshot().mode)}: is its arm free to move?")


def _judged(mailbox: ServoMailbox, wait: Wait) -> ServoSnapshot:
    """The state once the potentiometers have been judged, or too much time has passed: their board may be away."""
    for _ in range(round(POTS_PATIENCE_S / POLL_S)):
        if mailbox.snapshot().pots_verdict != UNJUDGED:
            break
        wait(POLL_S)
    return mailbox.snapshot()


def _refusal(state: ServoSnapshot, what: str) -> str:
    told = explain(state.event, state.event_joint) if state.event else explain(state.fault)
    return f"{what}: {told}"
