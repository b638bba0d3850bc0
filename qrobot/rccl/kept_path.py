"""A path that outlives a stop of the servo: its motions wait on it, and the arm is led back when that is confirmed.

the servo stops the arm        the generator's path time stands where it is
somebody confirms              fault cleared, power, a stream from where the arm stands
the way back                   a joint motion at reduced speed to the last setpoint of the path
there                          path time goes on from rest, as after a pause: the same places in the same order
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.arrays import Floats
from qrobot.errors import LinkError, MotionError, ServoFault
from qrobot.motion import EventKind, Generator, MoveRequest, SpeedShare, Termination
from qrobot.wire import RobotState

WAY_BACK_SHARE: Final = 0.1  # [A] of the joints' greatest speeds, on the way back


class KeptPath:
    """The path of a program whose arm the servo has stopped, or whose bridge has gone away.

    Args:
        generator: of the path; stands still on it from now on.
        tick: newest sample.
        fault: that the program is told when it gives the path up.

    Attributes:
        fault: as given, or what has stopped the arm since.
        refusal: why the arm was not led back when that was confirmed last; None when it was not refused.
        confirmed: the arm may be led back.
        given_up: the program wants to stop, so the path is of no use any more.
    """

    def __init__(self, generator: Generator, tick: int, fault: ServoFault | LinkError) -> None:
        generator.stand_still(tick)
        self.fault = fault
        self.refusal: MotionError | None = None
        self.confirmed = self.given_up = False
        self._generator = generator
        self._back: Generator | None = None
        self._paused = False

    def hear(self, robot: RobotState) -> None:
        """Look whether the operator confirms: a pause of theirs ends."""
        self.confirmed = self.confirmed or (self._paused and not robot.paused)
        self._paused = robot.paused

    def wait_again(self, fault: ServoFault | LinkError) -> None:
        """Wait for somebody to confirm, as the servo has stopped the arm, or stopped it once more, with `fault`."""
        self.fault, self.refusal, self.confirmed, self._back = fault, None, False, None

    @property
    def reason(self) -> Exception:
        """Reason for which the arm stands off its path."""
        return self.fault if self.refusal is None else self.refusal

    def judge(self, objection_to: Callable[[Floats], MotionError | None]) -> bool:
        """Whether an arm that may go back is near enough to the last setpoint; else it waits for another word."""
        self.refusal = objection_to(self._generator.newest)
        self.confirmed = self.refusal is None
        return self.confirmed

    def give_up(self, seconds: float) -> None:
        """Stop on the way back, in at least `seconds`; what waits on the path will not be done."""
        self.given_up = True
        if self._back is not None:
            self._back.stop(seconds)

    def lead_back(self, generator_at: Callable[[Floats], Generator], q: Floats) -> None:
        """Begin the way back from `q` (n,), where the arm is held.

        Raises:
            FenceCrossed, JointLimit: the way leads where the arm may not go.
            ServoFault: given up meanwhile.
        """
        if self.given_up:
            raise self.fault
        self._back = generator_at(q)
        self._back.push(MoveRequest("the way back to the path", self._generator.newest, SpeedShare(WAY_BACK_SHARE)))

    def way_back(self, tick: int, override: float) -> Floats:
        """Setpoint (n,) of a sample on the way back. Raises MotionError: it ended elsewhere; ServoFault: given up."""
        if self._back is None:
            raise self.fault
        self._back.override = override
        output = self._back.update(tick)
        for event in output.events:
            if event.kind is EventKind.ENDED and event.code != Termination.COMPLETED and not self.given_up:
                raise MotionError(f"the way back to the path ended: {Termination(event.code).name}")
        if self.given_up and not self._back.busy:
            raise self.fault
        return output.q

    def reached(self, tick: int) -> bool:
        """True once the arm is back; the path goes on from rest at the sample behind `tick`."""
        if self._back is None or self._back.busy:
            return False
        self._generator.stand_still(tick)
        return True
