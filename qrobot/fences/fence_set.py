"""The fences of one arm: made of robot file and deployment, asked for distances, and for whether a path is clear."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.deployment import DeployedArm
from qrobot.config.fences import MOST_SHAPES, Fence
from qrobot.config.robot import Robot
from qrobot.config.shape import Capsule
from qrobot.errors import ConfigError, FenceCrossed, MotionError
from qrobot.fences.clearance import clearances
from qrobot.fences.deployed import deployed_shapes, tool_capsule
from qrobot.fences.distance import BOX, CYLINDER, PLANE
from qrobot.fences.table import (
    CAPSULE_WORDS,
    CAPSULES,
    CHAIN,
    CHAIN_WORDS,
    LINKS,
    MOST_JOINTS,
    N_CAPSULES,
    N_JOINTS,
    N_PAIRS,
    N_ROWS,
    N_SHAPES,
    N_WORDS,
    N_WORK,
    PAIR_MARGIN,
    PAIRS,
    SHAPE_WORDS,
    SHAPES,
    TOOL,
)
from qrobot.model.chain import chain_params
from qrobot.model.transform import rpy
from qrobot.units import MM_PER_M, RAD_PER_DEG

ITSELF: Final = "itself"
RESOLUTION_M: Final = 0.002  # [A] no body moves further between two places of a path at which it was looked at
SLACK_M: Final = 1e-4  # [A] a fence this much nearer than the margin counts as not nearer
_KINDS: Final = {"plane": PLANE, "box": BOX, "cylinder": CYLINDER}
_BODIES: Final = {"all": LINKS | TOOL, "links": LINKS, "tool": TOOL}


@dataclass(frozen=True)
class Nearness:
    """The arm and one fence.

    Attributes:
        fence: its name; `itself` for the arm's own body.
        body: the capsule of the arm that is nearest.
        distance: m, below zero when the fence is entered.
        margin: distance that motions keep, m.
    """

    fence: str
    body: str
    distance: float
    margin: float


class FenceSet:
    """Fences of one arm.

    Args:
        robot: whose file tells its body.
        fences: in the base frame; a name each.
        self_collision: capsules keep apart as the robot file names them, by `self_margin`, m.
        tool: a capsule fixed to the last link, None for none.

    Attributes:
        robot: name in the robot file.
        words: see `fences.table`. Shape (N_WORDS,).
        margins: of each row of distances, m. Shape (m + 1,).
        self_collision: the arm keeps off its own body.

    Raises:
        ConfigError: the robot file tells no body, or there are too many of something.
    """

    def __init__(
        self,
        robot: Robot,
        fences: Sequence[Fence],
        self_collision: bool = False,
        self_margin: float = 0.0,
        tool: Capsule | None = None,
    ) -> None:
        if robot.shape is None:
            raise ConfigError(f"fences need the body of the arm: {robot.name} has no [shape] in its robot file")
        if robot.n > MOST_JOINTS or len(fences) > MOST_SHAPES:
            raise ConfigError(f"fences: up to {MOST_JOINTS} joints and {MOST_SHAPES} fences are possible")
        capsules = (*robot.shape.capsules, *((tool,) if tool else ()))
        self.bodies = tuple(capsule.name for capsule in capsules)
        self.names = (*(fence.name for fence in fences), ITSELF)
        self.fences = tuple(fences)
        self.robot = robot.name
        self.self_collision = self_collision
        self._zero = np.zeros(robot.n)
        self.margins = np.array([*(fence.margin_m for fence in fences), self_margin])
        self.words = np.zeros(N_WORDS)
        self._put_arm(robot, capsules)
        for k, fence in enumerate(fences):
            self._put_shape(k, fence)
        self._put_pairs(robot.shape.apart if self_collision else ())
        self.words[PAIR_MARGIN] = self_margin
        self._reach = _reaches(robot, capsules)
        self._work, self._rows, self._nearest = np.zeros(N_WORK), np.zeros(N_ROWS), np.zeros(N_ROWS)

    def _put_arm(self, robot: Robot, capsules: Sequence[Capsule]) -> None:
        words, chain = self.words, chain_params(robot)
        words[N_JOINTS], words[N_CAPSULES] = robot.n, len(capsules)
        table = (chain.cos_alpha, chain.sin_alpha, chain.a, chain.d, chain.theta, chain.prismatic)
        words[CHAIN : CHAIN + CHAIN_WORDS * robot.n] = np.column_stack(table).ravel()
        for i, capsule in enumerate(capsules):
            of_tool = float(capsule.link == robot.n)
            row = (capsule.link, *capsule.from_m, *capsule.to_m, capsule.radius_m, of_tool)
            words[CAPSULES + CAPSULE_WORDS * i :][:CAPSULE_WORDS] = row

    def _put_shape(self, k: int, fence: Fence) -> None:
        roll, pitch, yaw = (angle * RAD_PER_DEG for angle in fence.rpy_deg)
        axes = rpy(roll, pitch, yaw)
        half = np.array(fence.size_m or (0.0, 0.0, 0.0)) / 2
        if fence.shape == "cylinder":
            half = np.array([fence.radius_m or 0.0, 0.0, (fence.length_m or 0.0) / 2])
        row = (
            _KINDS[fence.shape], float(fence.keep == "in"), _BODIES[fence.bodies], fence.margin_m,
            *half, *axes.ravel(), *fence.position_m,
        )  # fmt: skip
        self.words[SHAPES + SHAPE_WORDS * k :][:SHAPE_WORDS] = row
        self.words[N_SHAPES] = k + 1

    def _put_pairs(self, apart: Sequence[tuple[str, str]]) -> None:
        self.words[N_PAIRS] = len(apart)
        for k, pair in enumerate(apart):
            self.words[PAIRS + 2 * k :][:2] = [self.bodies.index(name) for name in pair]

    def seen_from(self, zero: Floats) -> FenceSet:
        """The same fences for joint positions that are zero at `zero` (n,) of the robot file."""
        twin = self.for_one_thread()
        twin._zero = zero
        return twin

    def for_one_thread(self) -> FenceSet:
        """The same fences with numbers of their own to work on: one set must not be asked by two threads at once."""
        twin = copy(self)
        twin._work, twin._rows, twin._nearest = np.zeros(N_WORK), np.zeros(N_ROWS), np.zeros(N_ROWS)
        return twin

    def wider(self, by: float) -> FenceSet:
        """The same fences, from which motions keep `by` m more."""
        twin = self.for_one_thread()
        twin.margins = self.margins + by
        return twin

    # ----------------------------------------------------------------------------------------------------- distances

    def compiled(self) -> FenceSet:
        """Itself, once what measures distances is compiled, which may take a second."""
        self.for_one_thread().distances(np.zeros(self._zero.size))
        return self

    def distances(self, q: Floats) -> Floats:
        """Distance from each fence at `q` (n,), then from itself, m; inf where there is none. Shape (m + 1,)."""
        n_rows = clearances(q + self._zero, self.words, self._work, self._rows, self._nearest)
        return self._rows[:n_rows].copy()

    def slack(self, q: Floats) -> Floats:
        """`distances` less what motions keep."""
        slack: Floats = self.distances(q) - self.margins
        return slack

    def nearness(self, q: Floats) -> list[Nearness]:
        """The arm at `q` (n,) and each fence; the arm itself only where it is looked at."""
        rows = self.distances(q)
        return [
            Nearness(name, self._body_at(k), float(rows[k]), float(self.margins[k]))
            for k, name in enumerate(self.names)
            if np.isfinite(rows[k])
        ]

    def capsules_at(self, q: Floats) -> list[tuple[str, Floats, Floats, float]]:
        """Name, both ends in the base frame and radius of each capsule at `q` (n,), m."""
        self.distances(q)
        ends = self._work.reshape(-1, 2, 3)
        radii = self.words[CAPSULES + 7 :: CAPSULE_WORDS]
        return [(name, ends[i, 0].copy(), ends[i, 1].copy(), float(radii[i])) for i, name in enumerate(self.bodies)]

    def _body_at(self, row: int) -> str:
        number = int(self._nearest[row])
        return self.bodies[number] if number >= 0 else ""

    # --------------------------------------------------------------------------------------------------------- paths

    def floor(self, q: Floats) -> Floats:
        """Slack that a motion from `q` (n,) has to keep: none, or what there is where the arm stands too near already.

        Shape (m + 1,); where the arm stands too near a fence, of each of its parts by itself: (k m + 1,) for k parts.
        """
        slack = self.slack(q)
        if (slack[:-1] < 0.0).any():
            slack = self._slack_of_parts(q)
        floor: Floats = np.minimum(slack, 0.0) - SLACK_M
        return floor

    def check(self, q: Floats, floor: Floats, what: str, share: float) -> float:
        """Least slack above the `floor` at `q` (n,), m, which is `share` of the way.

        Raises:
            FenceCrossed: there is none.
        """
        slack = self._slack_like(q, floor)
        left = slack - floor
        row = int(left.argmin())
        if not left[row] >= 0.0:
            k, body = self._fence_and_body(row, floor)
            distance = float(slack[row] + self.margins[k])
            raise FenceCrossed(_sentence(what, self.names[k], body, distance, self.margins[k], share),
                               self.names[k], body, self.margins[k] - distance, share)  # fmt: skip
        return float(left[row])

    def _slack_like(self, q: Floats, floor: Floats) -> Floats:
        """The slack at `q` (n,) that a floor is compared with: of the arm as a whole, or of each of its parts."""
        return self.slack(q) if floor.size == self.margins.size else self._slack_of_parts(q)

    def _slack_of_parts(self, q: Floats) -> Floats:
        """Slack of each part of the arm to each fence, then of the arm to itself. Shape (k m + 1,)."""
        parts = []
        for words in self._words_of_parts:
            n_rows = clearances(q + self._zero, words, self._work, self._rows, self._nearest)
            parts.append(self._rows[: n_rows - 1] - self.margins[:-1])
        return np.concatenate([*parts, self.slack(q)[-1:]])

    @cached_property
    def _words_of_parts(self) -> list[Floats]:
        """The table for each part of the arm, in which the others are of its base: that is compared with no fence."""
        tables = []
        for i in range(len(self.bodies)):
            table = self.words.copy()
            links = table[CAPSULES : CAPSULES + CAPSULE_WORDS * len(self.bodies) : CAPSULE_WORDS]
            links[np.arange(len(self.bodies)) != i] = 0.0
            table[N_PAIRS] = 0.0
            tables.append(table)
        return tables

    def _fence_and_body(self, row: int, floor: Floats) -> tuple[int, str]:
        """Number of the fence and name of the part of the arm in a row of the slack that `floor` is compared with."""
        fences = self.margins.size - 1
        if floor.size == self.margins.size or row == floor.size - 1:
            k = row if floor.size == self.margins.size else fences
            return k, self._body_at(k)
        return row % fences, self.bodies[row // fences]

    def check_path(
        self, joints_at: Callable[[float, Floats], Floats], start: Floats, what: str, bends: Sequence[float] = ()
    ) -> None:
        """Look at a path at so many places that no body enters a margin unseen, to half of `RESOLUTION_M`.

        Args:
            joints_at: joint positions (n,) at a share of the way, 0 to 1, near others.
            start: where the way begins. Shape (n,).
            what: is asked, for people.
            bends: shares, rising, between which the way does not go out and come back unseen, and no joint turns by
                half a turn; none of a way that is straight for the joints.

        Raises:
            FenceCrossed: the first place, of those looked at, that is too near.
            MotionError: the joints jump between two places that are one, or what `joints_at` raises.
        """
        floor = self.floor(start)
        at, q, slack = 0.0, start, self.check(start, floor, what, 0.0)
        ahead: list[tuple[float, Floats, float]] = []
        near = start
        for share in (*bends, 1.0):
            near = joints_at(share, near)
            ahead.insert(0, (share, near, self._left(near, floor)))
        while ahead:
            share, there, left = ahead[-1]
            moved = float(np.abs(there - q) @ self._reach)
            if moved > RESOLUTION_M and slack + left < moved:  # nearer than half of what is not sure
                middle = 0.5 * (at + share)
                if not at < middle < share:
                    raise MotionError(f"{what}: the joints would jump after {100 * at:.0f} % of the way")
                between = joints_at(middle, q)
                ahead.append((middle, between, self._left(between, floor)))
                continue
            at, q, slack = share, there, self.check(there, floor, what, share)
            ahead.pop()

    def clear_share(self, start: Floats, goal: Floats) -> float:
        """Share of the joint motion from `start` to `goal` that keeps off the fences, 1 for all of it. Shapes (n,)."""
        way = goal - start
        try:
            self.check_path(lambda share, _: start + share * way, start, "")
        except FenceCrossed as error:
            back_off = 2.0 * RESOLUTION_M / float(np.abs(way) @ self._reach)
            return max(0.0, error.share - back_off)
        return 1.0

    def _left(self, q: Floats, floor: Floats) -> float:
        return float((self._slack_like(q, floor) - floor).min())


def _sentence(what: str, fence: str, body: str, distance: float, margin: float, share: float) -> str:
    where = f"after {100 * share:.0f} % of the way" if share > 0.0 else "where the motion begins"
    kept = f"motions keep {margin * MM_PER_M:g} mm away"
    return f"{what}: {body} would be {distance_words(fence, distance)} {where}, and {kept}; choose another way or goal"


def distance_words(fence: str, distance: float) -> str:
    """Words for how far something is off a fence, or inside it; `distance` in m."""
    off = f"{-distance * MM_PER_M:.1f} mm inside" if distance < 0.0 else f"{distance * MM_PER_M:.1f} mm off"
    return f"{off} {'another part of the arm' if fence == ITSELF else f'fence {fence!r}'}"


def _reaches(robot: Robot, capsules: Sequence[Capsule]) -> Floats:
    """The most that a point of the arm moves for each unit of each joint, m or 1: 1 for one that slides. Shape (n,)."""
    geometry, slides = robot.geometry, np.asarray(robot.prismatic)
    travel = np.where(slides, np.maximum(np.abs(robot.limits.q_min), np.abs(robot.limits.q_max)), 0.0)
    steps = np.hypot(geometry.a_m, np.abs(geometry.d_m) + travel)
    reach = np.zeros(robot.n)
    for j in range(robot.n):
        lengths = [0.0]
        for capsule in capsules:
            if capsule.link > j:
                farthest = max(np.linalg.norm(capsule.from_m), np.linalg.norm(capsule.to_m)) + capsule.radius_m
                lengths.append(float(steps[j + 1 : capsule.link].sum() + farthest))
        reach[j] = 1.0 if slides[j] else max(lengths)
    return reach


def fences_of(arm: DeployedArm, robot: Robot) -> FenceSet | None:
    """The fences that a deployment puts round an arm; None when it has none.

    Raises:
        ConfigError: the robot file tells no body of the arm.
    """
    chosen, fences = arm.fences, deployed_shapes(arm, robot)
    if chosen is None or not (fences or chosen.self_collision):
        return None
    return FenceSet(robot, fences, chosen.self_collision, chosen.self_margin_m, tool_capsule(arm, robot))
