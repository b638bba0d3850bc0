"""An arm imported from a URDF, without a closed form, moved by a program of ARCL off line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl import ARCL_ROBOT, EQ, MOV_TIME, MOV_TRAJ, T6, TL, TRAJ_CART, arcl_close, arcl_wait, makeposition, move
from qrobot.arcl.trans import new_trans_value
from qrobot.config import Robot, load_robot
from qrobot.exchange.urdf_export import urdf_text
from qrobot.exchange.urdf_import import import_urdf
from qrobot.model.transform import transform
from tests.support.arcl import offline, recorded

pytestmark = pytest.mark.usefixtures("arcl_alone")


def imported(folder: Path) -> Robot:
    """A PUMA whose wrist axes do not meet, as its URDF tells it."""
    puma = load_robot("puma560")
    d_m = puma.geometry.d_m + np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0])
    geometry = puma.geometry.model_copy(update={"family": "generic", "d_m": d_m})
    path = folder / "arm.urdf"
    path.write_text(urdf_text(puma.model_copy(update={"geometry": geometry})))
    return import_urdf(path, like="puma560").robot


def test_an_imported_arm_is_moved_along_a_straight_line(tmp_path: Path) -> None:
    robot = imported(tmp_path)
    assert robot.geometry.family == "generic"
    start = np.degrees(robot.poses["ready"]) + np.array([0.0, -20.0, 10.0, 0.0, 40.0, 0.0])
    rp = offline(ARCL_ROBOT, robot, start=tuple(start))
    begin = rp.aki.forward(np.radians(start))
    goal = new_trans_value("goal", begin @ transform(None, [0.05, 0.1, -0.08]))
    with recorded(rp) as rows:
        move(rp, makeposition(T6, EQ, goal, TL, goal), MOV_TRAJ, TRAJ_CART, MOV_TIME, 2000, 0)
        arcl_wait(rp)
    poses = np.array([rp.aki.forward(np.radians(row)) for row in rows])
    arcl_close(rp)
    way = poses[-1, :3, 3] - begin[:3, 3]
    off = poses[:, :3, 3] - begin[:3, 3]
    off = off - np.outer(off @ way / (way @ way), way)
    assert np.linalg.norm(way) == pytest.approx(np.linalg.norm([0.05, 0.1, -0.08]), abs=1e-9)
    assert np.linalg.norm(off, axis=1).max() < 1e-9
    assert np.allclose(poses[:, :3, :3], begin[:3, :3], rtol=0.0, atol=1e-9)
