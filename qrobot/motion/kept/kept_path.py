"""A path that outlives a stop of the servo: its motions wait on it, and the arm is led back when that is confirmed.

the servo stops the arm        the generator's path time stands where it is
somebody confirms              fault cleared, power, a stream from where the arm stands
the way back                   a joint motion at reduced speed to the last setpoint of the path
there                          path time goes on from rest, as after a pause: the same places in the same order

An arm that stayed with a goal that moves, as one that holds an object with others, goes back to where that goal is by
then, once it stands (followed_goal.py).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LinkError, MotionError, ServoFault
from qrobot.motion.event import EventKind, Termination
from qrobot.motion.generator import Generator
from qrobot.motion.kept.followed_goal import FollowedGoal, followed_goal
from qrobot.motion.request import MoveRequest, SpeedShare
from qrobot.motion.world.kinematics import ArmKinematics

WAY_BACK_SHARE: Final = 0.1  # [A] of the joints' greatest speeds, on the way back
_PAUSED: Final = "the program has paused the arm on the way back to its path, and it alone lets it go on"
THERE: Final = 1e-6  # rad or m: of an arm that is with the goal it followed


class KeptPath:
    """The path of a program whose arm the servo has stopped, or whose bridge has gone away.

    Args:
        generator: of the path; stands still on it from now on.
        tick: newest sample.
        fault: that the program is told when it gives the path up.
        followed: the goal that the arm stayed with, None for an arm on a path.

    Attributes:
        generator: of what is to come; another one when the arm is back at a goal that it followed.
        fault: as given, or what has stopped the arm since.
        refusal: why the arm was not led back when that was confirmed last; None when it was not refused.
        confirmed: the arm may be led back.
        given_up: the program wants to stop, so the path is of no use any more.
    """

    def __init__(
        self, generator: Generator, tick: int, fault: ServoFault | LinkError, followed: FollowedGoal | None = None
    ) -> None:
        if followed is None:
            generator.stand_still(tick)
        self.fault, self.generator, self._followed = fault, generator, followed
        self.refusal: MotionError | None = None
        self.confirmed = self.given_up = False
        self._back: Generator | None = None
        self._goal = generator.newest
        self._paused = False

    def hear(self, paused: bool, tick: int) -> None:
        """Look whether the operator confirms: a pause of theirs ends; and where what was followed is at this sample."""
        if self._followed is not None:
            self._followed.look(tick)
        self.confirmed = self.confirmed or (self._paused and not paused)
        self._paused = paused

    def wait_again(self, fault: ServoFault | LinkError) -> None:
        """Wait for somebody to confirm, as the servo has stopped the arm, or stopped it once more, with `fault`.

        A pause that was heard before does not count: that it is gone may come from a servo that has started anew.
        """
        self.fault, self.refusal, self.confirmed, self._back = fault, None, False, None
        self._paused = False

    @property
    def reason(self) -> Exception:
        """Reason for which the arm stands off its path."""
        return self.fault if self.refusal is None else self.refusal

    def waits(self, paused: bool) -> Exception | None:
        """Reason for which the arm stands off its path, and waits for somebody; None while it is led back.

        Args:
            paused: the program lets it stand still on its way.
        """
        if not self.confirmed:
            return self.reason
        return MotionError(_PAUSED) if paused else None

    def judge(self, objection_to: Callable[[Floats], MotionError | None]) -> bool:
        """Whether an arm that may go back is near enough to its goal, which stands; else it waits for another word."""
        self.refusal = self._objection() or objection_to(self._goal)
        self.confirmed = self.refusal is None
        return self.confirmed

    def _objection(self) -> MotionError | None:
        """Reason for which nobody knows where to go back to."""
        if self._followed is None:
            return None
        if not self._followed.still:
            return MotionError("what the arm stayed with still moves: let it come to rest, and confirm again")
        try:
            self._goal = self._followed.q
        except MotionError as error:
            return error
        return None

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
        self._go_to_goal(self._back)

    def _go_to_goal(self, back: Generator) -> None:
        back.push(MoveRequest("the way back to the path", self._goal, SpeedShare(WAY_BACK_SHARE)))

    def way_back(self, tick: int, override: float) -> Floats:
        """Setpoint (n,) of a sample on the way back. Raises MotionError: it ended elsewhere; ServoFault: given up."""
        if self._back is None:
            raise self.fault
        if self._followed is not None:
            self._followed.look(tick)
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
        if self._followed is None:
            self.generator.stand_still(tick)
            return True
        return self._joined(self._back, self._followed)

    def _joined(self, back: Generator, followed: FollowedGoal) -> bool:
        """Whether what the arm stayed with stands where the arm is, which follows it then; else it goes there."""
        if followed.still:
            before, self._goal = self._goal, followed.q
            if np.abs(self._goal - before).max() < THERE:
                self.generator = followed.hand_over(back)
                return True
            self._go_to_goal(back)
        return False


def kept_path(
    generator: Generator, kinematics: ArmKinematics | None, tick: int, fault: ServoFault | LinkError
) -> KeptPath | None:
    """The path of an arm that the servo has stopped, None when it cannot be come back to."""
    if generator.stopping:
        return None
    if generator.keepable:
        return KeptPath(generator, tick, fault)
    followed = followed_goal(generator, kinematics, tick)
    return None if followed is None else KeptPath(generator, tick, fault, followed)
