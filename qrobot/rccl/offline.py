"""An arm that is not there: it follows every setpoint exactly, one sample later, on virtual time.

`use(OfflineLink)` runs a program off line (Hayward & Paul 1986, section 4: the setpoint function called in a loop). No
servo, no board and no bytes are involved, and nothing stands around the arm: it exerts no forces. Hand and outputs are
as they are asked for, and no input answers them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.config.outputs import ALL_OUTPUTS
from qrobot.errors import LinkError, MotionError
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics, with_payload
from qrobot.model.payload_judge import PayloadJudge
from qrobot.motion.force.external_torque import DriveFriction
from qrobot.motion.path.setpoint_history import DEPTH, motion_of
from qrobot.rci.client import Beside, ServoLoss
from qrobot.units import NS_PER_US
from qrobot.wire import ClientRole, Command, Hello, JointMode, Mode, Payload, RobotFlag, RobotState, State, Welcome
from qrobot.wire.packets import UNKNOWN_FORCE
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US, LONGEST_PERIOD_US, SHORTEST_PERIOD_US

START_POSE: Final = "park"
_READY: Final = RobotFlag.POWERED | RobotFlag.CALIBRATED | RobotFlag.ESTOP_OK


class _Torques:
    """Torques of an arm that follows its setpoints and touches nothing."""

    def __init__(self, robot: Robot, period_s: float) -> None:
        self._dynamics, self._work = dynamics_params(robot), dynamics_work(robot.n)
        self._friction = DriveFriction(robot)
        self._period_s = period_s
        self._bare, self._flange = self._dynamics, np.array([0.0, 0.0, robot.geometry.flange_m])
        self._references: deque[tuple[int, Floats]] = deque(maxlen=DEPTH)

    def carry(self, load: Payload) -> None:
        """Reckon with a payload from now on."""
        self._dynamics = with_payload(self._bare, load.mass, self._flange + load.centre, np.array(load.inertia))

    def at(self, tick: int, q: Floats) -> tuple[Floats, Floats]:
        """Velocities and torques at sample `tick`. Shapes (n,)."""
        self._references.append((tick, q))
        _, v, a = motion_of(list(self._references), self._period_s)
        tau = np.empty(q.size)
        inverse_dynamics(q, v, a, self._dynamics, self._work, tau)
        return v, tau + self._friction.torque(v)


class OfflineLink:
    """A `Link` to an ideal arm in this process.

    Args:
        hello: how the program greets; its robot must be a packaged one, or be given.
        robot: the arm.
        start: where it stands, rad or m, shape (n,); its park pose if left out.
        period_us: sample period where the program asks for none.

    Raises:
        ConfigError: no such robot.
    """

    virtual_time = True

    def __init__(
        self,
        hello: Hello,
        robot: Robot | None = None,
        start: Floats | None = None,
        period_us: int = DEFAULT_PERIOD_US,
    ) -> None:
        self._robot = robot or load_robot(hello.robot)
        self._period_us = hello.period_us or period_us
        self._load, self._refusal = Payload(0.0), ""
        self._began_ns = 0  # when the first sample would have been
        q = self._robot.poses[START_POSE] if start is None else start
        still = (0.0,) * self._robot.n
        place = tuple(map(float, q))
        waits = RobotState(
            t_ns=0, mode=Mode.OFF, q=place, v=still, tau=still, q_setpoint=place, flags=_READY, force=UNKNOWN_FORCE
        )
        self._state = State(0, waits, you_command=True)
        self._torques = _Torques(self._robot, self._period_us * 1e-6)

    def open(self) -> Welcome:
        """Greet; see `Link.open`. Raises LinkError: no such sample period."""
        if not SHORTEST_PERIOD_US <= self._period_us <= LONGEST_PERIOD_US:
            raise LinkError(f"the sample period must be 1 to 100 ms, not {self._period_us / 1000:g}")
        return Welcome(ClientRole.COMMANDER, self._robot.name, self._robot.n, self._period_us)

    def reopen(self, period_us: int) -> Welcome:
        """See `Link.reopen`. Raises LinkError: no such sample period."""
        self._began_ns = self.now_ns() - self._state.seq * period_us * NS_PER_US
        self._period_us = period_us
        self._torques = _Torques(self._robot, period_us * 1e-6)
        self._torques.carry(self._load)
        return self.open()

    def exchange(self, command: Command | None) -> State:
        """Obey, and let one sample pass; see `Link.exchange`. Raises MotionError: joints are to give way."""
        before = self._state
        mode, q = before.robot.mode, before.robot.q
        if command is not None:
            mode = _next_mode(mode, command)
            q = command.setpoints if mode == Mode.TRACKING else q
        seq = before.seq + 1
        v, tau = self._torques.at(seq, np.array(q))
        robot = replace(
            before.robot, t_ns=self._began_ns + seq * self._period_us * NS_PER_US, mode=mode, q=q, v=tuple(v.tolist()),
            tau=tuple(tau.tolist()), q_setpoint=q, hand=0 if command is None else command.hand,
            outputs=0 if command is None else command.outputs & ALL_OUTPUTS,
        )  # fmt: skip
        self._state = replace(before, seq=seq, robot=robot)
        return self._state

    def tell(self, packet: Beside) -> None:
        """Carry a payload, unless the arm could not; the rest has no one to hear it."""
        if isinstance(packet, Payload):
            self._refusal = self._payloads.objection(packet)
            if not self._refusal:
                self._load = packet
                self._torques.carry(packet)
                self._state = replace(self._state, robot=replace(self._state.robot, payload_mass=packet.mass))

    @cached_property
    def _payloads(self) -> PayloadJudge:
        return PayloadJudge(self._robot)

    def take_servo_loss(self) -> ServoLoss:
        """See `Link.take_servo_loss`: there is none to be lost."""
        return ServoLoss.NONE

    def refusal(self, kind: type[Beside]) -> str:
        """See `Link.refusal`."""
        return self._refusal if kind is Payload else ""

    def now_ns(self) -> int:
        """Virtual time of the newest sample."""
        return self._state.robot.t_ns

    def close(self, reason: str = "") -> None:
        """Do nothing: an off-line arm has no peer to say goodbye to."""


def _next_mode(mode: int, command: Command) -> int:
    """Next mode of a servo that has nothing to wait for."""
    if JointMode.TORQUE in command.modes:
        raise MotionError("off line nothing gives way: there is nothing around the arm; try `qrobot run --lockstep`")
    if not command.power:
        return Mode.OFF
    if mode == Mode.OFF or command.stop:
        return Mode.HOLDING
    return Mode.TRACKING if JointMode.POSITION in command.modes else mode
