"""Whether an arm is held by a pause while nobody is there who would see it move.

A pause asks the program to hold its motion. Tasks of RCI know none, and motions that follow something else do not obey
it; a servo that does not answer hands none on. What counts is what the servo tells of the arm.
"""

from __future__ import annotations

import math
from typing import Final

from qrobot.config import Robot
from qrobot.wire import State

REACH_S: Final = 2.0  # [A] until the pause is in force; what an arm follows comes to a standstill within it as well
RAMP: Final = 6.0  # v_max / a_stop of a joint: the longest way into a pause, see motion/trajectory/speed_override.py
MOVED: Final = 5e-3  # [A] rad or m; what an arm is moved that gives way a little to the forces on it is less


class PauseWatch:
    """Belongs to one arm. Knows no clock.

    Args:
        robot: of the arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._grace_s = REACH_S + RAMP * float((robot.limits.v_max / robot.guard.a_stop).max())
        self._asked_s = math.inf
        self._heard_s = -math.inf
        self._paused = self._path_waited = False  # at the newest sample
        self._begun = self._let_go_on = False  # heard of the pause since it was asked for
        self._stood: tuple[float, ...] | None = None  # setpoints that it is to stay with
        self._moved = False

    def ask(self, now_s: float) -> None:
        """A pause is asked for: from now on, but for a moment, the arm has to stand."""
        self._asked_s, self._stood, self._moved = now_s, None, False
        self._begun = self._let_go_on = False

    def hear(self, state: State, now_s: float) -> None:
        """A sample of the arm. Whoever ends the pause is there to look at the arm."""
        paused = state.robot.paused
        if self._paused and not paused:
            self._let_go_on |= self._is_a_word(state, now_s)
        elif paused and not self._paused and not self._due(now_s):
            self._begun, self._let_go_on = True, False
        if self._due(now_s):
            self._compare(state)
        self._heard_s, self._paused, self._path_waited = now_s, paused, state.path_waits

    def complaint(self, now_s: float) -> str:
        """Reason why the arm is not held, "" while it is, or need not be yet."""
        if not self._due(now_s) or self._let_go_on:
            return ""
        reasons = (
            (now_s - self._heard_s > REACH_S, "nothing is heard of it"),
            (not self._paused, "its servo has not heard of the pause"),
            (self._moved, "it moves in spite of the pause"),
        )
        return next((why for wrong, why in reasons if wrong), "")

    def _due(self, now_s: float) -> bool:
        return now_s >= self._asked_s + self._grace_s

    def _is_a_word(self, state: State, now_s: float) -> bool:
        """Whether somebody has ended, at this sample, the pause that was asked for.

        A word to go on that was under way then may still end a pause from before. A servo that has started anew has no
        pause either, and no power; a path that waited before still waits for a word behind it.
        """
        begun = self._begun or now_s >= self._asked_s + REACH_S
        return begun and (state.robot.powered or self._path_waited)

    def _compare(self, state: State) -> None:
        """An arm that nobody commands, or without power, is moved by no program."""
        if not (state.commanded and state.robot.powered):
            self._stood = None
            return
        here = tuple(state.robot.q_setpoint)
        self._stood = self._stood or here
        self._moved |= any(abs(now - then) > MOVED for now, then in zip(here, self._stood, strict=True))
