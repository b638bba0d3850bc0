"""Random motions to goals that move, ended at any instant, and what their setpoints ask of the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qrobot.errors import MotionError
from qrobot.motion import (
    HERE,
    Duration,
    Generator,
    MotionMode,
    MoveRequest,
    OrientationInterpolation,
    SpeedShare,
    Termination,
    ToolSpeed,
)
from tests.support.motion import ended
from tests.support.puma import LIMITS, PARK, Conveyor, at_park, puma_generator, shift

DEEDS = ("stop", "stop slowly", "interrupt", "next", "joints next", "here", "lost", "nothing")
PERIODS_MS = (1, 7, 28)


@dataclass(frozen=True)
class Run:
    """What came out: all setpoints (k, n), the sample period, and names and codes of what ended."""

    path: np.ndarray
    period_s: float
    codes: list[tuple[str, int]]

    @property
    def speed(self) -> float:
        """Largest speed, as a difference of setpoints, as a share of the limit."""
        return float((np.abs(np.diff(self.path, axis=0)) / self.period_s / LIMITS.v_max).max())

    @property
    def acceleration(self) -> float:
        """Largest acceleration, as a second difference, as a share of the limit."""
        return float((np.abs(np.diff(self.path, 2, axis=0)) / self.period_s**2 / LIMITS.a_max).max())


def conveyor(rng: np.random.Generator, period_s: float) -> Conveyor:
    """A frame that swings and turns, slowly or so fast that no arm can follow."""
    reach = rng.uniform(0.0, 1.0, 4) * [0.08, 0.08, 0.04, 0.5] * rng.choice([0.3, 1.0, 2.0])
    pace = rng.uniform(0.3, 3.0, 4) * rng.choice([0.5, 1.0, 2.0])
    phase = rng.uniform(0.0, 6.0, 4)
    return Conveyor(lambda t: tuple(reach * (np.sin(pace * t + phase) - np.sin(phase))), period_s)


def place(rng: np.random.Generator):
    x, y, z = rng.uniform(-0.25, 0.25, 3)
    return shift(x, y, min(z, 0.1), rng.uniform(-1.5, 1.5))


def request(rng: np.random.Generator, belt: Conveyor, fixed: bool) -> MoveRequest:
    """To somewhere on the conveyor, or beside it when `fixed`."""
    frames = (place(rng),) if fixed else (belt.trsf, place(rng))
    paces = (
        ToolSpeed(rng.uniform(0.05, 3.0), rng.uniform(0.3, 6.0)),
        SpeedShare(rng.choice([1.0, rng.uniform(0.1, 1.0)])),
        Duration(rng.uniform(0.2, 1.5)),
    )
    ta = None if rng.random() < 0.6 else rng.uniform(0.0, 0.4)
    mode = MotionMode.CARTESIAN if rng.random() < 0.6 else MotionMode.JOINT
    turn = OrientationInterpolation.ONE_AXIS if rng.random() < 0.7 else OrientationInterpolation.TWO_ANGLES
    return MoveRequest("move", at_park(*frames).goal(), paces[rng.integers(3)], ta, mode, turn=turn)


def push(gen: Generator, request: MoveRequest) -> None:
    """As a program that goes on when a motion is refused."""
    try:
        gen.push(request)
    except MotionError:
        return


def do(deed: str, gen: Generator, rng: np.random.Generator, belt: Conveyor) -> None:
    """End the motion in one of the ways there are."""
    if deed in ("stop", "stop slowly"):
        gen.stop(0.0 if deed == "stop" else rng.uniform(0.0, 0.8))
    elif deed == "lost":
        gen.abort(Termination.FORCE_LIMIT)
    elif deed == "here":
        push(gen, MoveRequest("here", HERE, SpeedShare(0.5)))
        gen.skip(3)
    elif deed != "nothing":
        if deed == "next":
            push(gen, request(rng, belt, bool(rng.random() < 0.5)))
        if deed == "joints next":
            push(gen, MoveRequest("joints", PARK + rng.uniform(-0.5, 0.5, 6), SpeedShare(rng.uniform(0.1, 1.0))))
        gen.skip(3)


def halted(seed: int, seconds: float = 3.0, fixed_share: float = 0.3, deeds: tuple[str, ...] = DEEDS) -> Run:
    """One random program, ended once or twice."""
    rng = np.random.default_rng(seed)
    period_s = 1e-3 * PERIODS_MS[seed % 3]
    gen, belt = puma_generator(period_s=period_s), conveyor(rng, period_s)
    for _ in range(rng.integers(1, 4)):
        push(gen, request(rng, belt, bool(rng.random() < fixed_share)))
    ticks = int(seconds / period_s)
    when = {int(rng.integers(2, ticks)): deeds[rng.integers(len(deeds))] for _ in range(rng.integers(1, 3))}
    path, codes = [PARK, PARK], []
    for tick in range(1, ticks + int(1.0 / period_s)):
        belt.tick = tick
        if tick in when:
            do(when[tick], gen, rng, belt)
        output = gen.update(tick)
        path.append(output.q)
        codes += ended([output])
    return Run(np.array(path), period_s, codes)
