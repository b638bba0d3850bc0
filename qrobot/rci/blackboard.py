"""The command blackboard of RCI: a program changes `chg`, and what it says goes out at the next sample.

Its counterpart `how`, the robot as it was heard last, is simply the newest `RobotState`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from qrobot.config.outputs import N_OUTPUTS
from qrobot.errors import MotionError
from qrobot.rci.arguments import shown
from qrobot.wire import Command, JointMode, State
from qrobot.wire.packets import NO_SIGNALS, Values


@dataclass
class Chg:
    """The next command. Fields mean what they mean in `wire.Command`.

    `clear_fault`, `stop` and `key_held` go out once and are lowered again. Once `hold_to_run` was said, the
    arm moves only while `key_held` is: a program that jogs sets it at each sample from its key. Output 1 is bit 0 of
    `outputs`. `signals` are numbers for the arm's log, NaN for none.
    """

    n: int
    modes: tuple[int, ...] = field(init=False)
    setpoints: Values = field(init=False)
    power: bool = False
    clear_fault: bool = False
    stop: bool = False
    stream: int = 0
    hand: int = 0
    outputs: int = 0
    hold_to_run: bool = False
    key_held: bool = False
    signals: Values = NO_SIGNALS
    path_waits: bool = False

    def __post_init__(self) -> None:
        self.hold()

    def hold(self) -> None:
        """All joints stay where they are."""
        self.modes, self.setpoints = (JointMode.HOLD,) * self.n, (0.0,) * self.n

    def go_to(self, q: Values) -> None:
        """All joints follow the position `q` (n numbers, rad or m)."""
        self.modes, self.setpoints = (JointMode.POSITION,) * self.n, q

    def drive(self, setpoints: Values, torque: tuple[bool, ...]) -> None:
        """Joints exert a torque (N m or N) where `torque` is true, and go to a position on the others."""
        self.modes = tuple(JointMode.TORQUE if exerts else JointMode.POSITION for exerts in torque)
        self.setpoints = setpoints

    def signal(self, *lines: int) -> None:
        """Switch outputs, as VAL's SIGNAL does: `signal(3, -4)` switches output 3 on and output 4 off.

        Raises:
            MotionError: there is no such output.
        """
        for line in lines:
            if not 1 <= abs(line) <= N_OUTPUTS:
                raise MotionError(f"signal {shown(line)}: outputs are 1 to {N_OUTPUTS}, negative to switch one off")
        for line in lines:
            bit = 1 << (abs(line) - 1)
            self.outputs = self.outputs | bit if line > 0 else self.outputs & ~bit

    def command(self, state: State, t_ns: int) -> Command:
        """The command that answers `state`; what a thread of the program raises meanwhile goes with the next one."""
        command = Command(
            state.seq, self.modes, self.setpoints, self.power, self.clear_fault, self.stop, self.stream, self.hand,
            self.outputs, state.seq, t_ns, self.hold_to_run, self.key_held, self.signals,
            self.path_waits,
        )  # fmt: skip
        self.clear_fault &= not command.clear_fault
        self.stop &= not command.stop
        self.key_held &= not command.key_held
        return command
