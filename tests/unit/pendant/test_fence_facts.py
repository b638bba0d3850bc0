"""Fences and body of an arm as a page is told them, against the servo's own table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_deployment, load_robot
from qrobot.config.fences import Stand
from qrobot.errors import ConfigError
from qrobot.fences.fence_set import fences_of
from qrobot.fences.table import CAPSULE_WORDS, CAPSULES, SHAPE_WORDS, SHAPES
from qrobot.fences.told_fences import told_fences
from qrobot.pendant.fence_facts import fence_facts, stand_facts

CELL = """
[[arm]]
name = "one"
robot = "{robot}"
bridge = {{ port = 5600 }}
servo = {{ tool_mm = [10, 0, 120] }}
board = {{ scene = {{ kind = "table" }} }}
[arm.fences]
scene = true
self_collision = true
shape = [{{ name = "drum", shape = "cylinder", keep = "in", radius_m = 0.9, length_m = 2.4, rpy_deg = [10, 20, 30] }}]
"""


def test_a_page_is_told_the_bodies_that_the_servo_guards(tmp_path: Path) -> None:
    file = tmp_path / "cell.toml"
    file.write_text(CELL.format(robot="puma560"))
    arm, robot = load_deployment(file).arm[0], load_robot("puma560")
    guarded, told = fences_of(arm, robot), fence_facts(told_fences(arm, robot), robot)
    assert guarded is not None
    assert [fence["name"] for fence in told["fences"]] == list(guarded.names[:-1]) == ["drum", "floor", "furniture"]
    for k, fence in enumerate(told["fences"]):
        row = guarded.words[SHAPES + SHAPE_WORDS * k :][:SHAPE_WORDS]
        T = np.reshape(fence["T"], (4, 4))
        assert np.array_equal(row[7:16].reshape(3, 3), T[:3, :3])
        assert np.array_equal(row[16:19], T[:3, 3])
        half = (fence["size"][0], 0.0, fence["size"][2] / 2) if k == 0 else np.array(fence["size"]) / 2
        assert row[4:7] == pytest.approx(half)
    assert [capsule["name"] for capsule in told["capsules"]] == list(guarded.bodies)
    for i, capsule in enumerate(told["capsules"]):
        row = guarded.words[CAPSULES + CAPSULE_WORDS * i :][:CAPSULE_WORDS]
        assert row.tolist()[:8] == [capsule["link"], *capsule["from_m"], *capsule["to_m"], capsule["radius_m"]]
    assert len(told["pairs"]) == len(robot.shape.apart)


def test_an_arm_without_fences_has_none_to_draw_and_one_without_a_body_is_refused(tmp_path: Path) -> None:
    file, stanford = tmp_path / "cell.toml", load_robot("stanford")
    file.write_text(CELL.format(robot="stanford"))
    with pytest.raises(ConfigError, match=r"stanford has no \[shape\]"):
        fence_facts(told_fences(load_deployment(file).arm[0], stanford), stanford)
    file.write_text(CELL.format(robot="stanford").partition("[arm.fences]")[0])
    assert fence_facts(told_fences(load_deployment(file).arm[0], stanford), stanford)["capsules"] == []


def test_a_page_is_told_where_an_arm_stands_as_its_deployment_says() -> None:
    assert stand_facts(None) == {"stand": None}
    T = np.reshape(stand_facts(Stand(position_m=(1.0, 0.5, 0.2), rpy_deg=(90.0, 0.0, 0.0)))["stand"], (4, 4))
    assert pytest.approx(np.array([[0, -1, 0, 1], [1, 0, 0, 0.5], [0, 0, 1, 0.2], [0, 0, 0, 1]]), abs=1e-12) == T
