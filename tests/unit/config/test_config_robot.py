"""Robot files: everything is validated, every mistake is named at once, and every value has a source."""

from __future__ import annotations

import copy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from qrobot.config import Robot, load_robot, robot_path
from qrobot.config.document import read_document
from qrobot.config.robot import robot_of
from qrobot.errors import ConfigError
from qrobot.model.transmission import joint_to_counts, transmission_params

PUMA = tomllib.loads(robot_path("puma560").read_text())


@pytest.fixture
def document() -> dict[str, Any]:
    return copy.deepcopy(PUMA)


def mistakes(document: dict[str, Any]) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        robot_of(document, "x.toml")
    return [line.strip().rstrip(";") for line in str(caught.value).splitlines()[1:]]


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_packaged_robots_load_with_read_only_arrays_of_their_joint_count(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    assert robot.limits.q_min.shape == robot.poses["park"].shape == (robot.n,)
    assert robot.links.com.shape == (robot.n, 3)
    for array in (robot.limits.q_min, robot.poses["park"], robot.transmission.coupling, robot.links.inertia):
        assert array.dtype == np.float64
        assert not array.flags.writeable


def test_a_robot_cannot_be_changed() -> None:
    robot = load_robot("puma560")
    with pytest.raises(ValidationError, match="frozen"):
        robot.limits.q_min = np.zeros(6)  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        robot.limits.q_min[0] = 0.0


def test_angles_arrive_in_radians_and_the_sliding_joint_in_metres() -> None:
    robot = load_robot("stanford")
    assert list(robot.prismatic) == [False, False, True, False, False, False]
    np.testing.assert_allclose(robot.limits.q_max[[0, 2]], [np.radians(170), 1.270])
    np.testing.assert_allclose(robot.geometry.theta_rad, np.radians([0, 0, -90, 0, 0, 0]))


def test_the_range_of_a_sliding_joint_in_millimetres_is_refused() -> None:
    document = tomllib.loads(robot_path("stanford").read_text())
    document["limits"]["q_max_deg"][2] *= 1000.0
    [mistake] = mistakes(document)
    assert "limits.q_max_deg: must be m (m/s) on sliding joints: 1270 is more than any arm has (200)" in mistake


def test_end_is_park_plus_the_papers_move() -> None:
    poses = load_robot("puma560").poses
    np.testing.assert_allclose(np.degrees(poses["end"] - poses["park"]), [60, -30, -50, 40, -40, 80])
    np.testing.assert_allclose(np.degrees(poses["park"]), [0, -45, 180, 0, 45, 0])


def test_an_arm_of_two_joints_is_a_robot_too(document: dict[str, Any]) -> None:
    del document["shape"]  # of six joints
    robot = robot_of(first_joints(document, 2), "two.toml")
    assert robot.n == 2
    assert robot.poses["ready"].shape == (2,)


def first_joints(table: Any, n: int) -> Any:
    """The same document for the first n of six joints."""
    if isinstance(table, list):
        return table[:n] if len(table) == 6 else table
    if not isinstance(table, dict):
        return "generic" if table in ("puma", "stanford") else table
    return {key: {} if key == "coupling" and isinstance(v, dict) else first_joints(v, n) for key, v in table.items()}


def test_all_mistakes_are_reported_at_once_with_their_path(document: dict[str, Any]) -> None:
    document["limits"]["a_max"] = [1, 2]
    document["links"]["mass"][0] = float("nan")
    document["transmission"]["gear"][1] = -1
    document["control"]["velocity_filter_hz"] = "fast"
    del document["guard"]
    assert mistakes(document) == [
        "limits.a_max: must be 6 numbers, is 2",
        "transmission.gear: every entry must be above zero",
        "links.mass: must be finite",
        "control.velocity_filter_hz: Input should be a valid number",
        "guard: missing",
    ]


@pytest.mark.parametrize(
    ("section", "wrong", "right"),
    [("limits", "q_mim_deg", "q_min_deg"), ("control", "kpp", "kp"), ("board", "revison", "revision")],
)
def test_an_unknown_key_names_the_nearest_known_one(document: Any, section: str, wrong: str, right: str) -> None:
    document[section][wrong] = 1
    document[section]["source"][wrong] = "[A]"
    assert mistakes(document) == [f"{section}.{wrong}: unknown key; did you mean {right!r}?"]


def test_unknown_keys_are_named_inside_a_friction_preset_and_at_the_top(document: dict[str, Any]) -> None:
    document["friction"]["akb"] |= {"viscus": 1}
    document["friction"]["akb"]["source"]["viscus"] = "[A]"
    document["gard"] = {}
    assert set(mistakes(document)) == {
        "friction.akb.viscus: unknown key; did you mean 'viscous'?",
        "gard: unknown key; did you mean 'guard'?",
    }


def sections(table: dict[str, Any], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Paths of all tables with a source table beside their values."""
    found = [path] if "source" in table else []
    nested = [sections(v, (*path, k)) for k, v in table.items() if isinstance(v, dict) and k != "source"]
    return found + [p for paths in nested for p in paths]


def test_all_value_sections_of_the_files_are_covered_by_the_source_rule() -> None:
    assert sections(PUMA) == [
        ("geometry",), ("limits",), ("poses",), ("transmission",), ("links",),
        ("friction", "corke"), ("friction", "akb"), ("control",), ("guard",), ("board",), ("shape",),
    ]  # fmt: skip


@pytest.mark.parametrize("path", sections(PUMA), ids=".".join)
def test_a_value_without_a_source_is_refused_in_every_section(document: Any, path: tuple[str, ...]) -> None:
    section = document
    for part in path:
        section = section[part]
    key = next(iter(section["source"]))
    section["source"]["no_such_value"] = section["source"].pop(key)
    dotted = ".".join(path)
    assert mistakes(document) == [
        f"{dotted}.source: {key!r} has no source",
        f"{dotted}.source: 'no_such_value' is not a value of [{dotted}]",
    ]
    del section["source"]
    assert mistakes(document) == [f"{dotted}.source: missing"]


@pytest.mark.parametrize(
    ("section", "key", "value", "says"),
    [
        ("limits", "q_min_deg", [160, -223, -40, -110, -100, -266], "q_min_deg must be below q_max_deg"),
        ("limits", "v_max_deg_s", [0, 1, 1, 1, 1, 1], "above zero"),
        ("control", "inertia", [0, 1, 1, 1, 1, 1], "above zero"),
        ("control", "kp", [True] * 6, "6 numbers"),
        ("control", "kp", [1, 1, 1, 1, 1, "1"], "6 numbers"),
        ("control", "gravity_joints", [1, 0, 0, 0, 0, 0], "true or false"),
        ("control", "friction_preset", "sand", "must be one of corke, akb"),
        ("control", "velocity_filter_hz", float("inf"), "finite"),
        ("transmission", "count_sign", [1, 1, 2, 1, 1, 1], "1 or -1"),
        ("transmission", "counts_per_rev", [1000.5, 1, 1, 1, 1, 1], "whole numbers"),
        ("transmission", "dac_per_Nm", [0, 1, 1, 1, 1, 1], "zero"),
        ("transmission", "counts_per_rev", [4096, 800, 1000, 1000, 1000, 500], "fewer counts_per_rev"),
        ("transmission", "count_offset", [0] * 6, "counter of joint 4 would go from -36027 to 23354"),
        ("transmission", "gear", [1e300, 107.8, 53.7, 76.0, 71.9, 76.7], "the counter of joint 1 "),
        ("transmission", "pot_per_rev", [-150.1] * 5, "6 numbers"),
        ("transmission", "pot_per_rev", "150", "a finite number, or 6 numbers"),
        ("transmission", "pot_per_rev", True, "a finite number, or 6 numbers"),
        ("transmission", "pot_per_rev", float("nan"), "a finite number, or 6 numbers"),
        ("limits", "q_max_deg", [1e308] * 6, "the counter of joint 1 "),
        ("transmission", "coupling", {"k44": 0.1}, "k44"),
        ("transmission", "coupling", {"k78": 0.1}, "k78"),
        ("transmission", "coupling", {"k45": 1.0, "k54": 1.0}, "cannot be inverted"),
        ("transmission", "coupling", [1, 2], "table of coefficients"),
        ("transmission", "vendor_rad_per_count", [1e-4] * 5, "6 numbers"),
        ("links", "com", [[0, 0, 0]] * 5 + [[0, 0]], "6 rows of 3 numbers"),
        ("links", "com", [[0, 0, 0]] * 5, "6 rows of 3 numbers, is 5 x 3"),
        ("guard", "tau_max", [103, 1, 1, 1, 1, 1], "exceeds what the DAC can ask for"),
        ("guard", "a_stop", [100, 1, 1, 1, 1, 1], "exceeds limits.a_max"),
        ("guard", "a_stop", [10, 0.6, 30, 45, 45, 45], "takes more than 2 s to stop a joint at limits.v_max"),
        ("guard", "following_error", [3.4] * 6, "following_error exceeds 25% of the joint's range"),
        ("guard", "range_margin", [0.7] * 6, "range_margin exceeds 10% of the joint's range"),
        ("guard", "unknown_load", [0, 0, 1e9, 0, 0, 0], "unknown_load exceeds guard.tau_max"),
        ("guard", "start_tolerance", 0.0501, "start_tolerance exceeds guard.following_error"),
        ("guard", "unexplained_torque", [101, 105, 47, 5.2, 5.2, 5.2], "unexplained_torque exceeds guard.tau_max"),
        ("guard", "brake_slip", 0.5, "less than or equal to 0.1"),
        ("guard", "saturation_s", 500, "less than or equal to 10"),
        ("poses", "park", [0, 90, 180, 0, 45, 0], "poses.park lies outside limits"),
        ("geometry", "alpha_deg", [0, -90, 0, -90, 90, -90], "twists"),
        ("geometry", "a_m", [0, 0.1, 0.4318, -0.0203, 0, 0], "twists"),
        ("geometry", "a_m", [0, 0, 0, -0.0203, 0, 0], "twists"),
        ("board", "revision", "D", "'E' or 'F'"),
        ("geometry", "a_m", [0, 0, 431.8, -20.3, 0, 0], "geometry.a_m: must be m: 431.8 is more than any arm has (30)"),
        ("geometry", "d_m", [0, 243.5, -93.4, 433.1, 0, 0], "must be m: 433.1 is"),
        ("geometry", "base_height_m", 660.4, "must be m: 660.4 is"),
        ("geometry", "flange_m", -56.25, "must be m: 56.25 is"),
        ("geometry", "gravity_m_s2", [0, 0, -9810], "must be m/s2: 9810 is more than any arm has (30)"),
        ("limits", "payload_kg", 2.5e6, "must be kg: 2.5e+06 is"),
        ("links", "mass", [13e6, 17.4e6, 4.8e6, 820e3, 340e3, 90e3], "must be kg: 1.74e+07 is"),
        ("links", "com", [[0, 0, 0], [68.0, 6.0, -16.0], *[[0, 0, 0]] * 4], "must be m: 68 is"),
        ("links", "inertia", [[0, 0, 3500.0], [1300.0, 5240.0, 5390.0], *[[9, 9, 9]] * 4], "of a body 20 m wide"),
    ],
)
def test_what_cannot_be_is_refused(document: Any, section: str, key: str, value: Any, says: str) -> None:
    document[section][key] = value
    [mistake] = mistakes(document)
    assert says in mistake


def test_the_offset_that_a_counter_is_advised_makes_the_file_whole(document: dict[str, Any]) -> None:
    document["transmission"]["count_offset"] = [0] * 6
    [mistake] = mistakes(document)
    document["transmission"]["count_offset"][3] = int(mistake.rsplit(" ", 1)[1])
    robot_of(document, "x.toml")


@given(st.integers(0, 2**32 - 1))
def test_counters_of_positions_in_range_lie_between_the_ends_told(seed: int) -> None:
    robot = load_robot("puma560")
    params, counts = transmission_params(robot), np.zeros(6, np.int64)
    least, most = robot.transmission.counts_between(robot.limits.q_min, robot.limits.q_max)
    q = np.random.default_rng(seed).uniform(robot.limits.q_min, robot.limits.q_max)
    joint_to_counts(q, params, counts)
    assert (least - 1 <= counts).all()
    assert (counts <= most + 1).all()


def test_potentiometers_that_rise_in_different_ways_have_a_number_each(document: dict[str, Any]) -> None:
    assert load_robot("puma560").transmission.pots_per_rev.tolist() == [-150.1] * 6
    document["transmission"]["pot_per_rev"] = [150.1, *[-150.1] * 5]
    robot = robot_of(document, "x.toml")
    assert robot.transmission.pots_per_rev.tolist() == [150.1, *[-150.1] * 5]
    assert transmission_params(robot).pot_per_count[:2].tolist() == [150.1 / 1000, -150.1 / 800]


def test_a_pose_may_not_be_missing(document: dict[str, Any]) -> None:
    del document["poses"]["park"]
    del document["poses"]["source"]["park"]
    assert mistakes(document) == ["poses: missing pose park"]


def test_the_joint_table_is_judged_first_since_lengths_depend_on_it(document: dict[str, Any]) -> None:
    document["joints"]["kinds"][2] = "screw"
    assert mistakes(document) == ["kinds.2: Input should be 'revolute' or 'prismatic'"]
    document["joints"]["kinds"] = ["revolute"]
    assert mistakes(document) == ["file: 6 names but 1 kinds"]
    del document["joints"]
    with pytest.raises(ConfigError, match="joints: missing"):
        robot_of(document, "x.toml")


def test_vendor_scales_replace_the_ratios_only_when_asked_for(document: dict[str, Any]) -> None:
    assert load_robot("puma560").transmission.rad_per_count[1] == -2 * np.pi / (800 * 107.815)
    document["transmission"]["scales"] = "vendor"
    robot = robot_of(document, "x.toml")
    np.testing.assert_array_equal(robot.transmission.rad_per_count, PUMA["transmission"]["vendor_rad_per_count"])
    del document["transmission"]["vendor_rad_per_count"]
    del document["transmission"]["source"]["vendor_rad_per_count"]
    assert mistakes(document) == ['transmission: scales = "vendor" needs vendor_rad_per_count']


def test_an_unknown_robot_names_the_nearest_known_one() -> None:
    with pytest.raises(ConfigError, match="no configuration named 'puma561'; did you mean 'puma560'"):
        load_robot("puma561")


def test_a_robot_loads_from_a_path(tmp_path: Any) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(robot_path("puma560").read_bytes())
    assert isinstance(load_robot(path), Robot)
    with pytest.raises(ConfigError, match=r"no configuration file .*absent\.toml"):
        load_robot(tmp_path / "absent.toml")


def test_broken_toml_is_a_config_error_with_its_line(tmp_path: Any) -> None:
    path = tmp_path / "broken.toml"
    path.write_text("name = \n")
    with pytest.raises(ConfigError, match="line 1"):
        load_robot(path)


def test_a_file_read_again_does_not_know_what_was_done_to_its_first_reading() -> None:
    path = robot_path("puma560")
    first = read_document(path)
    first["joints"].clear()
    assert read_document(path) == tomllib.loads(path.read_text(encoding="utf-8"))


def test_a_file_that_was_changed_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "some.toml"
    for number in (1, 2):
        path.write_text(f"number = {number}")
        assert read_document(path) == {"number": number}
