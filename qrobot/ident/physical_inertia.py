"""Links that bodies could have, with the inertia that was identified.

A body of positive mass everywhere has a positive definite pseudo-inertia (Wensing, Kim and Slotine 2018). Written about
the centre of mass that is a positive mass and positive second moments, of which the principal inertias are sums: so
Ixx + Iyy > Izz. Principal axes are taken along the axes of the link frames, as robot files have them. Of all such links
those are taken that have the base parameters found, each by its uncertainty, and else are near the robot file's: a
small programme for IPOPT (Wächter and Biegler 2006).
"""

from __future__ import annotations

from typing import Any, Final

import casadi
import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.robot import Links
from qrobot.config.values import frozen
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters
from qrobot.ident.physical_gravity import CENTRE_M, FARTHEST_M, HEAVIEST, LIGHTEST, LOAD_KG, MASS_SHARE

SECOND_SHARE: Final = 0.5  # of a second moment: what is likely to be wrong
GYRATION_M: Final = 0.03  # and this, squared, times the mass
LEAST_KG: Final = 1e-3
LEAST_SECOND: Final = 1e-7  # kg m2
_PER_LINK: Final = 7  # mass, first moment, second moments about the centre
_CERTAIN: Final = 1e-3  # of a parameter's value: intervals are not believed to be narrower
_OPTIONS: Final[dict[str, Any]] = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-8}}


def nearest_bodies(robot: Robot, base: BaseParameters, beta: Floats, covariance: Floats) -> Links:
    """Links with the base parameters `beta` (b,) of inertia and gravity, within their `covariance` (b, b).

    Raises:
        IdentificationError: no such links are found.
    """
    solver = casadi.nlpsol("bodies", "ipopt", _programme(robot, base, beta, covariance), _OPTIONS)
    lowest, highest = _bounds(robot)
    free = np.full(2 * robot.links.com.size, -np.inf)
    answer = solver(x0=_file(robot).ravel(), lbx=lowest.ravel(), ubx=highest.ravel(), lbg=free, ubg=0.0)
    if not solver.stats()["success"]:
        raise IdentificationError("no links of positive mass have the inertia found: is the right robot file used?")
    found = np.asarray(answer["x"]).reshape(robot.n, _PER_LINK)
    mass, second = found[:, :1], found[:, 4:]
    inertia = second.sum(axis=1, keepdims=True) - second
    update = {"mass": frozen(mass[:, 0]), "com": frozen(found[:, 1:4] / mass), "inertia": frozen(inertia)}
    return robot.links.model_copy(update=update)


def _file(robot: Robot) -> Floats:
    """Inertial parameters of each link in the robot file. Shape (n, 7)."""
    links = robot.links
    second = 0.5 * links.inertia.sum(axis=1, keepdims=True) - links.inertia
    mass = np.maximum(links.mass, LEAST_KG)[:, None]
    return np.column_stack([mass, mass * links.com, np.maximum(second, LEAST_SECOND)])


def _bounds(robot: Robot) -> tuple[Floats, Floats]:
    """Least and greatest of masses and moments. Shapes (n, 7)."""
    mass = np.maximum(robot.links.mass, LEAST_KG)
    lowest, highest = np.full((robot.n, _PER_LINK), -np.inf), np.full((robot.n, _PER_LINK), np.inf)
    lowest[:, 0], highest[:, 0] = np.maximum(LIGHTEST * mass, LEAST_KG), HEAVIEST * mass
    highest[-1, 0] += LOAD_KG
    lowest[:, 4:] = LEAST_SECOND
    return lowest, highest


def _programme(robot: Robot, base: BaseParameters, beta: Floats, covariance: Floats) -> dict[str, casadi.SX]:
    """Base parameters in their deviations, and those from the file in likely ones; bounds of the centres (<= 0)."""
    x, file = casadi.SX.sym("x", _PER_LINK, robot.n), _file(robot).T
    likely = np.maximum(MASS_SHARE * file[:1], MASS_SHARE * 0.1)
    likely[0, -1] += LOAD_KG
    shift = x[1:4, :] - robot.links.com.T @ casadi.diag(x[0, :])  # mass times the shift of the centre
    reach = FARTHEST_M * casadi.repmat(x[0, :], 3, 1)
    near = SECOND_SHARE * file[4:] + GYRATION_M**2 * likely
    off = [(x[0, :] - file[:1]) / likely, shift / CENTRE_M, (x[4:, :] - file[4:]) / near]
    theta = casadi.vertcat(*(_parameters(x[:, i]) for i in range(robot.n)))
    missed = _whitening(beta, covariance) @ (base.K @ theta - beta)
    cost = casadi.sumsqr(casadi.vertcat(missed, *map(casadi.vec, off)))
    bounds = casadi.vertcat(casadi.vec(shift - reach), casadi.vec(-shift - reach))
    return {"x": casadi.vec(x), "f": cost, "g": bounds}


def _parameters(link: casadi.SX) -> casadi.SX:
    """The ten parameters of a link, inertia about the origin of its frame, from mass, moments and second moments."""
    mass, moment, second = link[0], link[1:4], link[4:]
    whole = casadi.diag(second) + moment @ moment.T / mass
    inertia = casadi.trace(whole) * casadi.SX.eye(3) - whole
    six = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    return casadi.vertcat(mass, moment, *six)


def _whitening(beta: Floats, covariance: Floats) -> Floats:
    """W with W^T W the inverse covariance, none of it believed beyond reason. Shape (b, b)."""
    floor = np.diag((_CERTAIN * np.maximum(np.abs(beta), 1e-3)) ** 2)
    return np.asarray(np.linalg.cholesky(np.linalg.inv(covariance + floor)).T)
