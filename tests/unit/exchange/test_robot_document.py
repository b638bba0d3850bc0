"""Robot files that are written: nothing of a robot is lost, and no other robot's body is borrowed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from qrobot.config import Robot, load_robot
from qrobot.config.document import packaged_names
from qrobot.exchange.robot_document import robot_document, robot_text, write_robot
from qrobot.exchange.urdf_export import urdf_text
from qrobot.exchange.urdf_import import import_urdf

PUMA = load_robot("puma560")


def assert_same(one: Any, other: Any, place: str) -> None:
    """Values of two robot files agree to the last digit that is written."""
    one, other = (value.model_dump() if isinstance(value, BaseModel) else value for value in (one, other))
    if isinstance(other, dict):
        assert one.keys() == other.keys(), place
        for key, value in other.items():
            assert_same(one[key], value, f"{place}.{key}")
    elif isinstance(other, tuple):
        assert len(one) == len(other), place
        for number, pair in enumerate(zip(one, other, strict=True)):
            assert_same(*pair, f"{place}[{number}]")
    elif isinstance(other, np.ndarray | float):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11, err_msg=place)
    else:
        assert one == other, place


@pytest.mark.parametrize("name", packaged_names("robots"))
def test_a_robot_written_as_text_is_the_same_robot(name: str, tmp_path: Path) -> None:
    robot, path = load_robot(name), tmp_path / "again.toml"
    write_robot(path, robot_document(robot))
    again = load_robot(path)
    for section in Robot.model_fields:
        assert_same(getattr(again, section), getattr(robot, section), section)


@pytest.mark.parametrize("about", ["two\nlines", "carriage\rreturn", "tab\t, bell\x07", "line\u2028separator", "\n"])
def test_whatever_a_robot_file_says_about_its_robot_is_read_again(about: str, tmp_path: Path) -> None:
    document = robot_document(PUMA) | {"about": about}
    write_robot(tmp_path / "robot.toml", document)
    assert load_robot(tmp_path / "robot.toml").about == about


def test_poses_and_friction_of_any_name_are_written_as_toml(tmp_path: Path) -> None:
    document, path = robot_document(PUMA), tmp_path / "again.toml"
    document["poses"]["over table"] = document["poses"]["ready"]
    document["poses"]["source"]["over table"] = "test"
    document["friction"]['in "oil"'] = document["friction"]["corke"]
    write_robot(path, document)
    again = load_robot(path)
    assert_same(again.poses["over table"], PUMA.poses["ready"], "pose")
    assert_same(again.friction['in "oil"'], PUMA.friction["corke"], "friction")


@pytest.mark.parametrize("section", [name for name in Robot.model_fields if name not in ("name", "about")])
def test_a_section_of_the_users_file_is_that_of_the_imported_robot(section: str, tmp_path: Path) -> None:
    key = Robot.model_fields[section].alias or section
    urdf, own, made = tmp_path / "arm.urdf", tmp_path / "own.toml", tmp_path / "made.toml"
    urdf.write_text(urdf_text(PUMA))
    own.write_text(robot_text({"name": "puma560", key: robot_document(PUMA)[key]}))
    write_robot(made, import_urdf(urdf, like="puma560", beside=own).document)
    found, told = getattr(load_robot(made), section), getattr(PUMA, section)
    if section == "friction":  # that of the URDF stands beside it
        found = {name: found[name] for name in told}
    assert_same(found, told, section)


def test_an_imported_arm_has_no_body_of_another_one(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf_text(PUMA))
    assert import_urdf(tmp_path / "arm.urdf", like="puma560").robot.shape is None
