"""All the bridge knows of the servo: where setpoints go and where the state comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from qrobot.wire import AnalogOutputs, Collision, Payload, RobotState
from qrobot.wire.packets import NO_SIGNALS

__all__ = ["RobotPort", "RobotState", "SetpointFrame"]


@dataclass(frozen=True, slots=True)
class SetpointFrame:
    """The commander's wishes for one sample period.

    Attributes:
        stream: names one run of setpoints; grows with every new one, also across sessions and restarts of the bridge.
        seq: counts sample periods; a gap within a stream means missing frames. Never repeats, never wraps.
        t_ns: time of arrival, on the arm's clock: CLOCK_MONOTONIC less what slipped.
        period_ns: sample period of the stream.
        modes: values of `qrobot.wire.JointMode`. Shape (n,).
        setpoints: rad or m in position mode, N m or N in torque mode; finite. Shape (n,).
        power: level of the request for arm power.
        clear_fault, stop: true only in the frame that raises the request.
        hand: 0 relaxed, 1 open, 2 closed.
        outputs: bits of the binary outputs.
        hold_to_run: the stream moves the arm only while a key is held. key_held: it is held now.
        signals: numbers that the program tells, NaN for none. Shape (8,).
        path_waits: the program waits for somebody to confirm that the arm may go back to its path.
    """

    stream: int
    seq: int
    t_ns: int
    period_ns: int
    modes: tuple[int, ...]
    setpoints: tuple[float, ...]
    power: bool
    clear_fault: bool
    stop: bool
    hand: int
    outputs: int
    hold_to_run: bool = False
    key_held: bool = False
    signals: tuple[float, ...] = NO_SIGNALS
    path_waits: bool = False


class RobotPort(Protocol):
    """The way to the servo. None of its methods waits."""

    @property
    def robot_name(self) -> str:
        """Name of the robot, as clients have to give it."""

    @property
    def arm(self) -> str:
        """Name of the arm, for people."""

    @property
    def n(self) -> int:
        """Number of joints."""

    @property
    def mismatch(self) -> str:
        """Reason for which a servo that runs counts as away, "" for none; as `alive` found last."""

    @property
    def servo(self) -> int:
        """Number of the servo, as `alive` found it last: a restarted one has another."""

    def alive(self) -> bool:
        """The servo runs, drives this robot, and its state is fresh.

        After a restart this has to have been False for at least one sample period (100 ms at most): the bridge must
        notice, so that a power request still standing does not power the arm.
        """

    def slipped_ns(self) -> int:
        """Delay of the arm's time behind CLOCK_MONOTONIC; only an emulated arm has one."""

    def stalled(self) -> bool:
        """An emulated arm's servo has not run of late: `slipped_ns` may be about to change."""

    def read_state(self) -> RobotState:
        """Newest state of the robot, of `n` joints. Raises LinkError when the servo is gone."""

    def write_setpoint(self, frame: SetpointFrame) -> None:
        """Hand a frame and its requests to the servo. Raises LinkError when the servo is gone."""

    def write_requests(self, frame: SetpointFrame) -> None:
        """Hand over what a frame requests, without its setpoints; it may take power away, but not ask for it.

        Raises LinkError when the servo is gone.
        """

    def request_stop(self) -> None:
        """Ask for a controlled stop on the path. Raises LinkError when the servo is gone."""

    def request_power_off(self) -> None:
        """Take arm power away after a controlled stop. Raises LinkError when the servo is gone."""

    def name_signals(self, names: tuple[str, ...]) -> None:
        """Names of the program's numbers from now on; there are none yet. Raises LinkError when the servo is gone."""

    def judge_payload(self, payload: Payload) -> str:
        """Reason for which the arm cannot carry `payload`; "" when it can."""

    def write_payload(self, payload: Payload) -> None:
        """Reckon with `payload` from now on. Raises LinkError when the servo is gone."""

    def judge_collision(self, collision: Collision) -> str:
        """Reason for which the arm does not take such thresholds; "" when it does."""

    def write_collision(self, collision: Collision) -> None:
        """Tell collisions so from now on. Raises LinkError when the servo is gone."""

    def forget_collision(self) -> None:
        """Let the robot file's thresholds count again where a program told others. Raises LinkError: no servo."""

    def judge_analog(self, analog: AnalogOutputs) -> str:
        """Reason for which the arm's analogue outputs cannot be so; "" when they can."""

    def write_analog(self, analog: AnalogOutputs) -> None:
        """Let analogue outputs be so from now on. Raises LinkError when the servo is gone."""
