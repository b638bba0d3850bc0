"""A servo that tracks perfectly and remembers what it was asked: a `RobotPort` for the tests of the bridge."""

from __future__ import annotations

import time
from dataclasses import replace

from qrobot.errors import LinkError
from qrobot.rccl_bridge import RobotState, SetpointFrame
from qrobot.units import NS_PER_S
from qrobot.wire import AnalogOutputs, Collision, JointMode, Mode, Payload, RobotFlag
from tests.support.packets import resting


class FakePort:
    """Powered by the level of the frames, at each frame's position setpoints at once; stops where it stands."""

    def __init__(self, n: int = 6, robot_name: str = "puma560") -> None:
        self.robot_name = self.arm = robot_name
        self.n = n
        self.frames: list[SetpointFrame] = []
        self.requests: list[SetpointFrame] = []
        self.stops = self.power_offs = 0
        self.mismatch = ""
        self.servo = 1
        self.names: tuple[str, ...] = ()
        self.running = True
        self.slipped = self._untold = self.blind = 0  # the last: looks in which it seems to be away
        self._told_at = ""
        self.collision_told = False
        self.state = resting((0.0,) * n, mode=Mode.OFF, flags=RobotFlag.ESTOP_OK | RobotFlag.CALIBRATED)

    def stall(self, seconds: float, told_at: str) -> None:
        """The whole machine stands still; the arm tells of it as soon as this is `asked`, or its state `read`."""
        time.sleep(seconds)
        self._untold, self._told_at = round(seconds * NS_PER_S), told_at

    def _tell(self, at: str) -> None:
        if self._told_at == at:
            self.slipped, self._untold = self.slipped + self._untold, 0

    def alive(self) -> bool:
        self.blind, seen = max(0, self.blind - 1), self.blind == 0
        return self.running and seen

    def slipped_ns(self) -> int:
        return self.slipped

    def stalled(self) -> bool:
        asleep = self._untold != 0
        self._tell("asked")
        return asleep

    def read_state(self) -> RobotState:
        if not self.running:
            raise LinkError("the fake servo is away")
        self._tell("read")
        return self.state

    def write_setpoint(self, frame: SetpointFrame) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.frames.append(frame)
        followed = zip(self.state.q, frame.setpoints, frame.modes, strict=True)
        q = tuple(to if mode == JointMode.POSITION else at for at, to, mode in followed)
        powered = RobotFlag.POWERED if frame.power else 0
        flags = self.state.flags & ~RobotFlag.POWERED | powered
        self.state = replace(
            self.state, t_ns=frame.t_ns, q=q, q_setpoint=q, flags=flags, hand=frame.hand,
            mode=Mode.TRACKING if frame.power else Mode.OFF,
        )  # fmt: skip

    def write_requests(self, frame: SetpointFrame) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.requests.append(frame)

    def request_stop(self) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.stops += 1

    def request_power_off(self) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.power_offs += 1

    def name_signals(self, names: tuple[str, ...]) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.names = names

    def judge_payload(self, payload: Payload) -> str:
        return "" if 0 <= payload.mass <= 5 else f"{payload.mass} kg is no load for this arm"

    def write_payload(self, payload: Payload) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.state = replace(self.state, payload_mass=payload.mass)

    def judge_collision(self, collision: Collision) -> str:
        return "" if max(collision.thresholds) <= 50 else "more than unexplained_torque"

    def write_collision(self, collision: Collision) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.collision, self.collision_told = collision, True

    def forget_collision(self) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        if self.collision_told:
            self.collision, self.collision_told = Collision((0.0,) * 6), False

    def judge_analog(self, analog: AnalogOutputs) -> str:
        return "" if not max(analog.volts) > 5 else "more than this output shows"

    def write_analog(self, analog: AnalogOutputs) -> None:
        if not self.running:
            raise LinkError("the fake servo is away")
        self.analog = analog

    def restart(self) -> None:
        """As after `kill -9` and a new start: no power, nothing moves."""
        self.servo += 1  # first: a bridge may look at any time
        self.state = replace(self.state, mode=Mode.OFF, flags=RobotFlag.ESTOP_OK | RobotFlag.CALIBRATED)
        self.running = True
