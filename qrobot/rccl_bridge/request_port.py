"""Requests of a bridge to a servo and what it hears from it, through the mailbox of the servo."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Final

from qrobot.config.collision import threshold_objection, torque_objection
from qrobot.errors import LinkError
from qrobot.faultcodes import NO_JOINT
from qrobot.model.payload_judge import PayloadJudge
from qrobot.rccl_bridge.servo_interface import SetpointFrame
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.wire import AnalogOutputs, Collision, Payload, RobotState
from qrobot.wire.packets import NO_SIGNALS
from qrobot.wire.robot_state import rows_of

_MASKS: Final = {"B": 0xFF, "H": 0xFFFF, "I": 0xFFFFFFFF}  # by code of the field, as `struct` has it


class RequestPort(ABC):
    """The part of a `RobotPort` that goes through a mailbox; where that is, and whether, a subclass knows.

    Args:
        judge: of payloads; None takes each.
    """

    def __init__(self, judge: PayloadJudge | None = None) -> None:
        self._judge = judge

    @abstractmethod
    def _mailbox(self) -> ServoMailbox:
        """Mailbox of the servo, as it is now. Raises LinkError when there is none."""

    def read_state(self) -> RobotState:
        """Newest state of the robot. Raises LinkError when the servo is gone."""
        return _to_wire(self._mailbox())

    def write_setpoint(self, frame: SetpointFrame) -> None:
        """Hand a frame and its requests to the servo. Raises LinkError when the servo is gone."""
        _pass_on(self._mailbox(), frame)

    def write_requests(self, frame: SetpointFrame) -> None:
        """Hand over what a frame requests, without its setpoints. Raises LinkError when the servo is gone."""
        _pass_on_requests(self._mailbox(), frame)

    def request_stop(self) -> None:
        """Ask for a controlled stop on the path. Raises LinkError when the servo is gone."""
        self._mailbox().request_stop()

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop. Raises LinkError when the servo is gone."""
        self._mailbox().request_power_off()

    def name_signals(self, names: tuple[str, ...]) -> None:
        """Names of the program's numbers from now on; there are none yet. Raises LinkError when the servo is gone."""
        _name_signals(self._mailbox(), names)

    def judge_payload(self, payload: Payload) -> str:
        """Reason for which the arm cannot carry `payload`; "" when it can."""
        return "" if self._judge is None else self._judge.objection(payload)

    def write_payload(self, payload: Payload) -> None:
        """Reckon with `payload` from now on. Raises LinkError when the servo is gone."""
        self._mailbox().request_payload(payload)

    def judge_collision(self, collision: Collision) -> str:
        """Reason for which the arm does not take such thresholds, or such a reaction; "" when it does."""
        try:
            known = self._mailbox().snapshot().torques_known
        except LinkError as error:
            return str(error)
        if objection := torque_objection(collision.thresholds, collision.reaction, known):
            return objection
        return "" if self._judge is None else threshold_objection(self._judge.robot, collision.thresholds)

    def write_collision(self, collision: Collision) -> None:
        """Tell collisions so from now on. Raises LinkError when the servo is gone."""
        self._mailbox().request_collision(collision.thresholds, collision.reaction, by_program=True)

    def forget_collision(self) -> None:
        """Let the robot file's thresholds count again where a program told others. Raises LinkError: no servo."""
        self._mailbox().forget_collision()

    def judge_analog(self, analog: AnalogOutputs) -> str:
        """Reason for which the arm's analogue outputs cannot be so; "" when they can."""
        try:
            return self._mailbox().analog_objection(analog.volts)
        except LinkError as error:
            return str(error)

    def write_analog(self, analog: AnalogOutputs) -> None:
        """Let analogue outputs be so from now on. Raises LinkError when the servo is gone."""
        self._mailbox().request_analog(analog.volts)


def _name_signals(mailbox: ServoMailbox, names: tuple[str, ...]) -> None:
    mailbox.tell_signals(NO_SIGNALS)  # first: the old numbers must not stand under the new names
    mailbox.name_signals(names)


def _to_wire(mailbox: ServoMailbox) -> RobotState:
    """The state as packets carry it, cut to the width of its fields there: what stands in memory may be spoilt."""
    snapshot, told = mailbox.snapshot(), dict[str, Any]()
    for row in rows_of(RobotState):
        value = getattr(snapshot, row.name)
        if row.count != 1:
            told[row.name] = tuple(value.tolist())
        else:
            told[row.name] = value if row.code == "d" else value & _MASKS.get(row.code, -1)
    if not 0 <= told["event_joint"] < mailbox.info.n:
        told["event_joint"] = NO_JOINT
    return RobotState(**told)


def tell_key(mailbox: ServoMailbox, stream: int, held_ns: int | None) -> None:
    """Let `stream` move the arm only while a key is held; it was at `held_ns`, None when it is not.

    What moves is stopped when nothing has been said of the key for `servo.checks.hold_to_run.PATIENCE_NS`.
    """
    if held_ns is not None:
        mailbox.memory.command.held_ns = held_ns  # first: what begins now must not be judged by what was before
    mailbox.memory.command.held_stream = stream + 1


def _pass_on(mailbox: ServoMailbox, frame: SetpointFrame) -> None:
    mailbox.request_power(frame.power)
    if frame.hold_to_run:
        tell_key(mailbox, frame.stream, frame.t_ns if frame.key_held else None)
    _pass_on_requests(mailbox, frame)
    mailbox.tell_signals(frame.signals)
    mailbox.push_setpoint(frame.stream, frame.seq, frame.t_ns, frame.period_ns, frame.modes, frame.setpoints)


def _pass_on_requests(mailbox: ServoMailbox, frame: SetpointFrame) -> None:
    """Pass on the requests beside setpoints; power may be taken away, but not asked for."""
    if not frame.power:
        mailbox.request_power(False)
    mailbox.request_hand(frame.hand)
    mailbox.request_outputs(frame.outputs, frame.t_ns)
    mailbox.tell_path_waits(frame.t_ns if frame.path_waits else 0)
    if frame.clear_fault:
        mailbox.request_clear()
    if frame.stop:
        mailbox.request_stop()
