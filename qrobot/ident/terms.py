"""Terms of friction beyond viscous and Coulomb's: what varies with position, with speed otherwise, and with load.

No law has them. They are sought where a fit leaves structure behind (`structure`), for two reasons: left out they
bend what is fitted, and make its intervals too narrow. Each is a sum of columns times sign(v), and times the Coulomb
friction of the direction but for the load's:

    position    cos(k r), sin(k r) of the motor's angle r in joint units, k = 1 to HARMONICS: gears out of true
    speed       1 / (1 + (v / v_k)^2) at some v_k far above Stribeck's, and v^2, of each direction its own: friction
                that bends at high speed
    load        |gravity torque|: teeth and bearings that rub more the more they bear

The coefficients of a term are believed to be 0 with a deviation that `structure` finds for it: so what a recording does
not tell of them widens the intervals of what is beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.ident.observe import HARMONICS, SUBSAMPLES, Observations

FrictionTermKind = Literal["position", "speed", "load"]
KINDS: Final[tuple[FrictionTermKind, ...]] = get_args(FrictionTermKind)
FADES_AT: Final = (0.05, 0.1, 0.2, 0.4)  # v_k over a joint's greatest speed [A]
_NAMES: Final[dict[FrictionTermKind, tuple[str, ...]]] = {
    "position": tuple(f"ripple_{wave}{k}" for wave in ("cos", "sin") for k in range(1, HARMONICS + 1)),
    "speed": tuple(
        f"{shape}_{side}"
        for side in ("pos", "neg")
        for shape in (*(f"fading_at_{100 * share:.0f}" for share in FADES_AT), "quadratic")
    ),
    "load": ("load_share",),
}


class Term(NamedTuple):
    """One kind of term of one motor, whose coefficients are 0 ± `deviation` beforehand."""

    motor: int
    kind: FrictionTermKind
    deviation: float


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms that a fit has.

    Attributes:
        sought: motor by motor.
        beta: base parameters by which gravity loads the motors, arm's and load's. Shape (n_weights,).
        coulomb: friction of positive and of negative motion by which the others are scaled. Shape (n, 2).
    """

    sought: tuple[Term, ...]
    beta: Floats
    coulomb: Floats

    @property
    def deviation(self) -> Floats:
        """Deviation of each coefficient. Shape (c,)."""
        return np.concatenate([np.full(len(_NAMES[term.kind]), term.deviation) for term in self.sought])

    @property
    def owner(self) -> NDArray[np.int64]:
        """Number of the term that each coefficient belongs to. Shape (c,)."""
        return np.repeat(np.arange(len(self.sought)), [len(_NAMES[term.kind]) for term in self.sought])

    def columns(self, robot: Robot, observations: Observations, weights: Floats) -> Floats:
        """Columns of the coefficients; `weights` (m, n_weights) multiplies `beta`. Shape (m, c)."""
        borne = self._borne(observations, weights)
        return np.column_stack([self._columns(robot, term, observations, borne) for term in self.sought])

    def _borne(self, observations: Observations, weights: Floats) -> Floats:
        """Mean size of gravity's torque along each pass, in which it may change its sign. Shape (m,)."""
        b = observations.gravity.shape[1]
        hand = weights[:, b:] @ self.beta[b:] / SUBSAMPLES
        return np.asarray(np.abs(observations.gravity_parts @ self.beta[:b] + hand[:, None]).sum(axis=1))

    def names(self, robot: Robot) -> Iterator[tuple[str, str, str]]:
        """Name, meaning and unit of each coefficient."""
        for motor, kind, _ in self.sought:
            joint, of = robot.joint_names[motor], "gravity's torque" if kind == "load" else "Coulomb friction"
            for name in _NAMES[kind]:
                yield f"{joint}.{name}", f"share of {of} by which friction of motor {joint} varies with {kind}", ""

    def _columns(self, robot: Robot, term: Term, observations: Observations, borne: Floats) -> Floats:
        """Columns of one term; zero in the rows of other motors. Shape (m, ...)."""
        mine = (observations.motor == term.motor) * np.sign(observations.rate)
        if term.kind == "load":
            return np.asarray((mine * borne)[:, None])
        mine *= np.where(observations.rate > 0.0, *self.coulomb[term.motor])
        if term.kind == "position":
            return np.asarray(mine[:, None] * observations.harmonics)
        share = np.abs(observations.rate) / robot.limits.v_max[term.motor]
        shapes = np.stack([*(1.0 / (1.0 + (share / fades) ** 2) for fades in FADES_AT), share**2], axis=1)
        return np.hstack([np.maximum(mine, 0.0)[:, None] * shapes, np.minimum(mine, 0.0)[:, None] * shapes])
