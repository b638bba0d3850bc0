"""Fences in a deployment file and the body of an arm in its robot file: each mistake is told by its name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_deployment, load_robot
from qrobot.config.document import read_document
from qrobot.config.robot import robot_of, robot_path
from qrobot.errors import ConfigError
from qrobot.fences.fence_set import FenceSet, fences_of

HEAD = '[[arm]]\nname = "one"\nrobot = "puma560"\nbridge = { port = 5600 }\n'
BOX = '[[arm.fences.shape]]\nname = "bench"\nshape = "box"\nsize_m = [1.0, 1.0, 0.1]\nposition_m = [0.6, 0.0, -0.3]\n'


def deployment(tmp_path: Path, text: str) -> Any:
    """The arm of a deployment file with `text` below its head."""
    path = tmp_path / "cell.toml"
    path.write_text(HEAD + text)
    return load_deployment(path).arm[0]


def test_an_arm_without_fences_has_none(tmp_path: Path) -> None:
    assert fences_of(deployment(tmp_path, ""), load_robot("puma560")) is None
    assert fences_of(deployment(tmp_path, "[arm.fences]\n"), load_robot("puma560")) is None


def test_scene_tool_and_the_arm_itself_become_fences(tmp_path: Path) -> None:
    more = '[arm.fences]\nscene = true\nself_collision = true\n[arm.board.scene]\nkind = "table"\n'
    arm = deployment(tmp_path, more + "[arm.servo]\ntool_mm = [0, 0, 150]\n" + BOX)
    robot = load_robot("puma560")
    fences = fences_of(arm, robot)
    assert fences is not None
    assert fences.names == ("bench", "floor", "furniture", "itself")
    assert fences.bodies[-1] == "tool"
    park = {each.fence: each for each in fences.nearness(robot.poses["park"])}
    moving = fences.capsules_at(robot.poses["park"])[1:]  # behind the column
    lowest = min(min(start[2], end[2]) - radius for _, start, end, radius in moving)
    assert park["floor"].distance == pytest.approx(robot.geometry.base_height_m + lowest)
    assert park["itself"].distance > 0.0
    name, flange, tip, radius = fences.capsules_at(robot.poses["park"])[-1]
    assert (name, radius) == ("tool", 0.02)
    assert np.linalg.norm(tip - flange) == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (BOX.replace("box", "sphere"), "'box', 'cylinder' or 'plane'"),
        (BOX.replace("size_m = [1.0, 1.0, 0.1]\n", ""), "fence 'bench': a box needs size_m"),
        (BOX + "radius_m = 1.0\n", "fence 'bench': a box needs size_m"),
        (BOX.replace("0.1]", "-0.1]"), "greater than 0"),
        (BOX + BOX, "two fences have the same name bench"),
        (BOX.replace("bench", "itself"), "a fence may not be named itself"),
        (BOX + "margin_m = 3\n", "less than or equal to 0.5"),
        (BOX + "keeep = 'in'\n", "did you mean 'keep'"),
        (BOX.replace("0.6", "nan"), "finite number"),
    ],
)
def test_a_mistake_in_a_fence_is_told(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        deployment(tmp_path, text)


def test_an_arm_whose_file_tells_no_body_has_no_fences(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"stanford has no \[shape\]"):
        fences_of(deployment(tmp_path, BOX), load_robot("stanford"))


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda shape: shape["capsules"][1].update(link=7), "shoulder is fixed to link 7, and the last is 6"),
        (lambda shape: shape["capsules"][1].update(name="column"), "two capsules have the same name column"),
        (lambda shape: shape["apart"].append(["wrist", "hand"]), "apart names 'hand'"),
        (lambda shape: shape["capsules"][0].update(radius_m=0.0), "greater than 0"),
    ],
)
def test_a_mistake_in_the_body_is_told(change: Any, complaint: str) -> None:
    document = read_document(robot_path("puma560"))
    change(document["shape"])
    with pytest.raises(ConfigError, match=complaint):
        robot_of(document, "puma560.toml")


def test_the_poses_of_the_packaged_arm_are_clear_of_itself() -> None:
    robot = load_robot("puma560")
    fences = FenceSet(robot, [], self_collision=True)
    assert all(fences.distances(q)[0] > 0.02 for q in robot.poses.values())
