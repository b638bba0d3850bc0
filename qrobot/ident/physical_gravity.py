"""Links that bodies could have, with the gravity that was identified.

Base parameters are combinations; a law wants masses and centres. Of all links with those combinations the nearest to
the robot file's are taken, with positive masses and centres that stay near where the file has them: a small quadratic
programme, for IPOPT (Wächter and Biegler 2006). A load in the hand belongs to the last link, whose mass may grow most.
"""

from __future__ import annotations

from typing import Any, Final

import casadi
import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import IdentificationError
from qrobot.ident.base import BaseParameters

MASS_SHARE: Final = 0.3  # of a link's mass: what is likely to be wrong
LOAD_KG: Final = 2.5  # what a hand may hold, Unimation's figure for a PUMA 560
CENTRE_M: Final = 0.03  # what is likely to be wrong with a centre
LIGHTEST: Final = 0.2  # of the file's mass
HEAVIEST: Final = 3.0  # times the file's mass, and the load
FARTHEST_M: Final = 0.3  # of a centre from the file's, along an axis
_PER_LINK: Final = 4
_OPTIONS: Final[dict[str, Any]] = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}


def nearest_links(robot: Robot, base: BaseParameters, beta: Floats) -> tuple[Floats, Floats]:
    """Masses (n,) in kg and centres (n, 3) in m with the base parameters `beta` of gravity.

    Raises:
        IdentificationError: no such links exist.
    """
    solver = casadi.nlpsol("links", "ipopt", _programme(robot, base, beta), _OPTIONS)
    links, n = robot.links, robot.n
    lowest, highest = np.full((n, _PER_LINK), -np.inf), np.full((n, _PER_LINK), np.inf)
    lowest[:, 0], highest[:, 0] = LIGHTEST * links.mass, HEAVIEST * links.mass
    highest[-1, 0] += LOAD_KG
    start = np.column_stack([links.mass, links.mass[:, None] * links.com])
    below = np.concatenate([np.zeros(beta.size), np.full(2 * links.com.size, -np.inf)])
    answer = solver(x0=start.ravel(), lbx=lowest.ravel(), ubx=highest.ravel(), lbg=below, ubg=0.0)
    if not solver.stats()["success"]:
        raise IdentificationError(
            "no links with positive masses have the gravity found. The recording is sound by itself, so it is another "
            "arm's than the robot file, the hand holds more than a hand may, or torques (dac_per_Nm) are far off"
        )
    found = np.asarray(answer["x"]).reshape(n, _PER_LINK)
    return found[:, 0], found[:, 1:] / np.maximum(found[:, :1], 1e-9)


def with_gravity(robot: Robot, base: BaseParameters, beta: Floats) -> Robot:
    """The robot with those masses and centres, and the inertia of its file. Raises what `nearest_links` raises."""
    mass, com = nearest_links(robot, base, beta)
    return robot.model_copy(update={"links": robot.links.model_copy(update={"mass": mass, "com": com})})


def _programme(robot: Robot, base: BaseParameters, beta: Floats) -> dict[str, casadi.SX]:
    """Stay near the file's masses and centres; first the base parameters (= 0), then the centres' bounds (<= 0)."""
    theta = casadi.SX.sym("theta", _PER_LINK, robot.n)
    mass, moment = theta[0, :], theta[1:, :]
    likely = MASS_SHARE * np.maximum(robot.links.mass, 0.1)
    likely[-1] += LOAD_KG
    shift = casadi.vec(moment - robot.links.com.T @ casadi.diag(mass))  # mass times the shift of the centre
    reach = casadi.vec(FARTHEST_M * casadi.repmat(mass, 3, 1))
    off = casadi.vertcat((mass.T - robot.links.mass) / likely, shift / CENTRE_M)
    bounds = casadi.vertcat(base.K @ casadi.vec(theta) - beta, shift - reach, -shift - reach)
    return {"x": casadi.vec(theta), "f": casadi.sumsqr(off), "g": bounds}
