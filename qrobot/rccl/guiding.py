"""Hand guiding: an arm that is led by a hand while a key is held, and what it did as recordings.

Each press of the key is a stream of its own. While it lasts all joints are driven by a torque of nothing, and the servo
carries gravity and most of the friction, damps, and keeps to speeds and range (`servo.stages.guiding`). When the key is
let go the servo is asked for a stop; when nobody says that it is held, the servo stops the arm by itself within 70 ms.
Either way the arm stays where it came to rest until the key is pressed anew: a key that was never seen released begins
nothing.
"""

from __future__ import annotations

from types import TracebackType
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.errors import LinkError, MotionError
from qrobot.rccl.setpoints import Setpoints
from qrobot.rci import Chg, LinkFactory, RobotData, TaskDescriptor, hello_for
from qrobot.rci.descriptor import AREA_WORDS
from qrobot.rci.robot_cycle import CyclePhase, RobotCycle
from qrobot.wire import Command, Mode, RobotState, State

GUIDE_PERIOD_US: Final = 28_000  # the servo must hear of the key every 70 ms
FEWEST_SAMPLES: Final = 3  # of a recording; a shorter press has led the arm nowhere


class GuidedArm:
    """Leads one arm by hand, sample by sample; a context manager that says goodbye at its end.

    Args:
        factory: the way to the arm. name: of its robot.

    Attributes:
        robot: the arm. how: the robot as it was heard last, None before the first sample.
        recordings: what each press of the key did, from rest to rest, oldest first; of one during which the link was
            lost, what it did until then.

    Raises:
        LinkError, LinkBusy: nobody is there, or somebody else commands the arm.
        MotionError: the sample period is too long for hold-to-run.
    """

    def __init__(self, factory: LinkFactory, name: str) -> None:
        self.robot: Robot = load_robot(name)
        self.how: RobotState | None = None
        self.recordings: list[Setpoints] = []
        self._link = factory(hello_for(self.robot.name, GUIDE_PERIOD_US))
        welcome = self._link.open()
        if welcome.period_us > GUIDE_PERIOD_US:
            self._link.close("too slow")
            raise MotionError(f"samples of {welcome.period_us / 1e3:g} ms are too slow to lead an arm: 28 ms at most")
        self._period_us = welcome.period_us
        self._data, self._idle = RobotData(self.robot), Chg(self.robot.n)
        self._task = TaskDescriptor(self.robot.name, 1, "host", np.zeros(AREA_WORDS, dtype=np.int64), self._data)
        self._cycle: RobotCycle | None = None
        self._command: Command | None = None
        self._released = False
        self._places: list[Floats] = []

    @property
    def led(self) -> bool:
        """The arm follows the hand now; otherwise it is held, or on its way to rest."""
        return self._cycle is not None and self._cycle.phase is CyclePhase.FOLLOWING

    def step(self, held: bool) -> RobotState:
        """One sample: tell the servo whether the key is held, and wait for the next state.

        Raises:
            ServoFault: the servo stopped the arm, for example with HOLD_TO_RUN after samples that came late. The arm is
                held where it stopped; `step` may go on, and leads again once the key was seen released.
            LinkError: the link is lost.
        """
        state = self._link.exchange(self._command)
        self.how, now_ns = state.robot, self._link.now_ns()
        self._begin_or_end(held)
        if self._cycle is None:
            self._command = self._keep_in_touch(state, now_ns)
            return state.robot
        try:
            self._command = self._cycle.step(state, now_ns, self._lead)
        except Exception:
            self._command = self._keep_in_touch(state, now_ns)
            self._finish()
            raise
        if self._cycle.phase in (CyclePhase.FOLLOWING, CyclePhase.STOPPING):
            self._places.append(np.array(state.robot.q))
        if self._cycle.phase is CyclePhase.LEFT:
            self._finish()
        return state.robot

    def close(self) -> None:
        """Let the arm come to rest and say goodbye; it goes on holding. A second call does nothing.

        Raises what `step` raises.
        """
        try:
            while self._cycle is not None:
                self.step(False)
        finally:
            if self._cycle is not None:
                self._finish()
            self._link.close()

    def __enter__(self) -> GuidedArm:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except (LinkError, MotionError):
            if error is None:
                raise

    def _begin_or_end(self, held: bool) -> None:
        """Begin a stream for a key that is pressed anew; end it when the key is let go."""
        if not held:
            self._released = True
            if self._cycle is not None:
                self._cycle.stop()
        elif self._cycle is None and self._released:
            self._released, self._places = False, []
            self._cycle = RobotCycle(self._task, self._data, self._period_us * 1e-6)

    def _lead(self) -> None:
        chg = self._task.chg
        chg.hold_to_run = chg.key_held = True
        chg.drive((0.0,) * self.robot.n, (True,) * self.robot.n)

    def _keep_in_touch(self, state: State, now_ns: int) -> Command:
        """A command that leaves everything as it is."""
        idle, robot = self._idle, state.robot
        idle.power = robot.mode not in (Mode.OFF, Mode.FAULT)
        idle.hand, idle.outputs = robot.hand, robot.outputs
        return idle.command(state, now_ns)

    def _finish(self) -> None:
        """The press is over: keep what it did."""
        self._cycle = None
        self._task.chg.hold_to_run = False
        if len(self._places) >= FEWEST_SAMPLES:
            self.recordings.append(Setpoints(self.robot.name, self._period_us, np.array(self._places)))
        self._places = []
