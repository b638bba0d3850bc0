"""Whether what a fit leaves has structure in position, speed or load, and how large.

Residuals of neighbouring passes are alike, so how much of them chance explains is not told by their number. It is
tried: the residuals of each swing, forwards and back, get a random sign in common (wild cluster bootstrap, Cameron,
Gelbach and Miller 2008), and what the columns of a term explain then is compared with what they explain as it is.

How large a term is follows from the same residuals: the deviation of its coefficients and the scatter beside it are
found together by expectation and maximisation (Dempster, Laird and Rubin 1977).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.ident.fit import Fit
from qrobot.ident.observe import Observations
from qrobot.ident.swings import swings_of
from qrobot.ident.terms import KINDS, FrictionTermKind, Term, Terms
from qrobot.ident.unknowns import Unknowns
from qrobot.ident.whitened import WhitenedFit, unexplained

CHANCE: Final = 0.01  # of a false alarm in a whole recording, all motors and kinds together [A]
SMALLEST: Final = 0.002  # of Coulomb friction, rms: less changes no interval that anybody looks at [A]
BENDS: Final = 0.02  # of Coulomb friction at a tenth of greatest speed: stiction of 1.5 has left as much
BEND_DOUBT: Final = 0.15  # of Coulomb friction: least deviation of what fades with speed, once friction bends [A]
FEWEST: Final = 12  # passes of a motor
_DRAWS: Final = 4000
_ROUNDS: Final = 60  # of expectation and maximisation
_NOTHING: Final = 1e-6  # of the longest column
_SMALLEST_DEVIATION: Final = 1e-6


def terms_seen(unknowns: Unknowns, fit: Fit, seen: Observations) -> Terms | None:
    """The terms of friction that the residuals of a fit without any show, with their deviations; none if none."""
    motors, swing = np.unique(seen.motor).tolist(), swings_of(unknowns.robot, seen)
    found = [(motor, kind) for motor in motors for kind in _kinds_seen(unknowns, fit, seen, swing, motor)]
    if any(kind == "load" for _, kind in found):  # all gears are of one make: what is too small to show is there too
        found += [(motor, "load") for motor in motors if (motor, "load") not in found]
    return terms_of(unknowns, fit, seen, found) if found else None


def _kinds_seen(unknowns: Unknowns, fit: Fit, seen: Observations, swing: Ints, motor: int) -> list[FrictionTermKind]:
    """Kinds of friction that one motor shows: first the one that explains most with each of its columns.

    Args:
        unknowns: what was sought.
        fit: of them.
        seen: observations.
        swing: number of the swing of each. Shape (m,).
        motor: which, from 0.
    """
    chosen: list[FrictionTermKind] = ["speed"] if _bends(unknowns, fit, motor) else []
    left = _left(unknowns, fit, seen)
    for kind in chosen:
        left = left.with_columns(_whitened(unknowns, fit, seen, left, motor, kind))
    while rest := [kind for kind in KINDS if kind not in chosen]:
        gains = {kind: _gain(unknowns, fit, seen, swing, left, motor, kind) for kind in rest}
        best = max(rest, key=lambda kind: gains[kind])
        if gains[best] <= 0.0:
            break
        chosen.append(best)
        left = left.with_columns(_whitened(unknowns, fit, seen, left, motor, best))
    return [kind for kind in KINDS if kind in chosen]


def _bends(unknowns: Unknowns, fit: Fit, motor: int) -> bool:
    """Whether what a motor rubs more at a tenth of its speed is more than a drive that sticks has left, or is less."""
    found, half_width = unknowns.parts(fit.values), unknowns.parts(fit.half_width)
    remainder, coulomb = found.remainder[motor], np.abs(found.friction[motor, 1:])
    too_much = remainder > np.maximum(BENDS * coulomb, half_width.remainder[motor])
    too_little = remainder < -np.maximum(SMALLEST * coulomb, 2.0 * half_width.remainder[motor])
    return bool((too_much | too_little).any())


def terms_of(unknowns: Unknowns, fit: Fit, seen: Observations, sought: Sequence[tuple[int, FrictionTermKind]]) -> Terms:
    """The terms sought, whether they show or not, with the deviations that the residuals of a fit without any give
    them."""
    terms, left = _terms(unknowns, fit, sought), _left(unknowns, fit, seen)
    found = _deviations(seen, left, _of_terms(unknowns, seen, left, terms), terms.owner)
    least = [BEND_DOUBT if term.kind == "speed" else 0.0 for term in terms.sought]
    deviations = np.maximum(found, least).tolist()
    sized = tuple(term._replace(deviation=d) for term, d in zip(terms.sought, deviations, strict=True))
    return replace(terms, sought=sized)


def _terms(unknowns: Unknowns, fit: Fit, sought: Sequence[tuple[int, FrictionTermKind]]) -> Terms:
    parts = unknowns.parts(fit.values)
    return Terms(tuple(Term(motor, kind, 1.0) for motor, kind in sought), parts.weights, np.abs(parts.friction[:, 1:]))


def _left(unknowns: Unknowns, fit: Fit, seen: Observations) -> WhitenedFit:
    """Observations first, then what is known beforehand, as rows of the same system."""
    inverse = np.sqrt(fit.weight[: len(seen)]) / np.hypot(fit.scatter[seen.motor], seen.doubt)
    doubt = unknowns.doubt()
    known = np.isfinite(doubt)
    rows = np.vstack([unknowns.jacobian(fit.values, seen) * inverse[:, None], np.diag(1.0 / doubt)[known]])
    fitted, _ = np.linalg.qr(rows)
    beforehand = (unknowns.start() - fit.values)[known] / doubt[known]
    residual = np.concatenate([(seen.torque - unknowns.predict(fit.values, seen)) * inverse, beforehand])
    return WhitenedFit(unexplained(fitted, residual), fitted, inverse)


def _of_terms(unknowns: Unknowns, seen: Observations, left: WhitenedFit, terms: Terms) -> Floats:
    """Part of the columns of terms that is not explained yet. Shape (m + known, c)."""
    own = terms.columns(unknowns.robot, seen, unknowns.weights(seen)) * left.inverse[:, None]
    return unexplained(left.fitted, np.vstack([own, np.zeros((len(left.residual) - len(seen), own.shape[1]))]))


def _whitened(
    unknowns: Unknowns, fit: Fit, seen: Observations, left: WhitenedFit, motor: int, kind: FrictionTermKind
) -> Floats:
    """Orthonormal columns of one term beside what is explained already. Shape (m + known, c)."""
    terms = _terms(unknowns, fit, [(motor, kind)])
    directions, sizes, _ = np.linalg.svd(_of_terms(unknowns, seen, left, terms), full_matrices=False)
    return np.asarray(directions[:, sizes > _NOTHING * max(float(sizes[0]), 1e-9)])


def _gain(
    unknowns: Unknowns,
    fit: Fit,
    seen: Observations,
    swing: Ints,
    left: WhitenedFit,
    motor: int,
    kind: FrictionTermKind,
) -> float:
    """Squares that a term explains with each of its columns; 0 where chance does as much, or it is not worth a word."""
    mine = seen.motor == motor
    if mine.sum() < FEWEST:
        return 0.0
    directions = _whitened(unknowns, fit, seen, left, motor, kind)
    if not directions.size:
        return 0.0
    along = directions.T @ left.residual
    rms = float(np.sqrt(np.mean(((directions @ along)[: len(seen)] / left.inverse)[mine] ** 2)))
    coulomb = float(np.mean(np.abs(unknowns.parts(fit.values).friction[motor, 1:])))
    tries = unknowns.robot.n * len(KINDS)
    if rms <= SMALLEST * coulomb or _chance(directions[: len(seen)], left.residual, swing) >= CHANCE / tries:
        return 0.0
    return float(np.square(along).sum()) / int(directions.shape[1])


def _chance(directions: Floats, residual: Floats, swing: Ints) -> float:
    """Share of random signs of swings (m,) with which directions (m, c) explain as much as they do."""
    each = directions * residual[: len(swing), None]
    by_swing = np.stack([np.bincount(swing, column) for column in each.T], axis=1)
    by_swing = by_swing[np.abs(by_swing).any(axis=1)]
    by_chance = ((_signs(len(by_swing)) @ by_swing) ** 2).sum(axis=1)
    as_it_is = float((by_swing.sum(axis=0) ** 2).sum())
    return float((1.0 + int(np.count_nonzero(by_chance >= as_it_is))) / (1.0 + _DRAWS))


@lru_cache(maxsize=2)  # of a motor, whose terms are tried one after the other: of 100 swings they take 3 MB
def _signs(swings: int) -> Floats:
    """Random signs of swings, the same each time. Shape (_DRAWS, swings)."""
    return np.random.default_rng(0).choice((-1.0, 1.0), size=(_DRAWS, swings))


def _deviations(seen: Observations, left: WhitenedFit, columns: Floats, owner: Ints) -> Floats:
    """Deviation of the coefficients of each term, with the scatter of each motor beside them; known rows keep their
    own."""
    r, many, m = left.residual, np.bincount(owner), len(seen)
    longest = max(float(np.sqrt(np.mean(columns[:m] ** 2))), 1e-12)
    deviation = np.full(len(many), float(np.sqrt(np.mean(r[:m] ** 2))) / longest)
    scatter, group = np.ones(int(seen.motor.max()) + 2), np.concatenate([seen.motor, np.full(len(r) - m, -1)])
    for _ in range(_ROUNDS):
        precise = 1.0 / scatter[group] ** 2
        covariance = np.linalg.inv((columns * precise[:, None]).T @ columns + np.diag(1.0 / deviation[owner] ** 2))
        value = covariance @ (columns.T @ (precise * r))
        squares = np.bincount(owner, value**2 + np.diag(covariance)) / many
        deviation = np.sqrt(np.maximum(squares, _SMALLEST_DEVIATION**2))
        rest = ((r - columns @ value) ** 2 + (columns @ covariance * columns).sum(axis=1))[:m]
        per_motor = np.bincount(seen.motor, rest) / np.maximum(np.bincount(seen.motor), 1)
        scatter[:-1] = np.sqrt(np.maximum(per_motor, 1e-6))
    return deviation
