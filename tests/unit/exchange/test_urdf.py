"""URDF both ways, against MuJoCo's own reader of URDF; and what is no serial arm refused by name."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random
from typing import Any, Final

import mujoco
import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.config.robot import DAC_HALF_RANGE
from qrobot.errors import ConfigError
from qrobot.exchange.denavit_hartenberg import denavit_hartenberg
from qrobot.exchange.robot_document import robot_document, robot_text, write_robot
from qrobot.exchange.serial_chain import serial_chain
from qrobot.exchange.urdf_document import read_urdf
from qrobot.exchange.urdf_export import urdf_text
from qrobot.exchange.urdf_import import import_urdf
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.model.kinematics import forward, kinematics_params
from qrobot.model.transform import inverse, rot_x, rot_z, transform

ROBOTS: Final = ("puma560", "stanford")
SEEDS: Final = range(12)


def mujoco_of(urdf: str) -> Any:
    """MuJoCo's own reading, with every link kept as a body."""
    spec = mujoco.MjSpec.from_string(urdf)
    spec.compiler.fusestatic = False
    spec.option.gravity = [0.0, 0.0, -9.81]
    model = spec.compile()
    return model, mujoco.MjData(model)


def poses(model: Any, data: Any, body: str, q: np.ndarray) -> np.ndarray:
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    number = model.body(body).id
    return transform(data.xmat[number].reshape(3, 3), data.xpos[number])


def flange(robot: Robot, q: np.ndarray) -> np.ndarray:
    T = np.empty((4, 4))
    forward(q, kinematics_params(robot), T)
    lift = transform(None, [0.0, 0.0, robot.geometry.base_height_m])
    return lift @ T @ transform(None, [0.0, 0.0, robot.geometry.flange_m])


def drawn(robot: Robot, seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(robot.limits.q_min, robot.limits.q_max, (count, robot.n))


def gravity(robot: Robot, q: np.ndarray) -> np.ndarray:
    tau, still = np.empty(robot.n), np.zeros(robot.n)
    inverse_dynamics(q, still, still, dynamics_params(robot), dynamics_work(robot.n), tau)
    return tau


def gravity_of(model: Any, data: Any, q: np.ndarray) -> np.ndarray:
    data.qpos[:], data.qvel[:] = q, 0.0
    mujoco.mj_forward(model, data)
    return data.qfrc_bias.copy()


@pytest.mark.parametrize("name", ROBOTS)
def test_another_reader_of_the_urdf_finds_the_flange_and_the_weight_where_this_project_does(name: str) -> None:
    robot = load_robot(name)
    model, data = mujoco_of(urdf_text(robot))
    for q in drawn(robot, 1, 20):
        assert np.allclose(poses(model, data, "tool0", q), flange(robot, q), atol=1e-12)
        assert np.allclose(gravity_of(model, data, q), gravity(robot, q), atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_an_exported_arm_comes_back_with_the_same_geometry_ranges_and_links(name: str, tmp_path: Path) -> None:
    robot, path = load_robot(name), tmp_path / "arm.urdf"
    path.write_text(urdf_text(robot))
    back = import_urdf(path, like=name).robot
    for section in ("geometry", "limits", "links"):
        old, new = (getattr(each, section).model_dump(exclude={"source"}) for each in (robot, back))
        for key, value in old.items():
            assert new[key] == value if isinstance(value, str) else np.allclose(new[key], value, atol=1e-13), key
    assert back.joint_names == robot.joint_names


ANGLES: Final = re.compile(r'(?<=rpy=")[^"]*')


def notes_of_angles(text: str, name: str, path: Path) -> tuple[str, list[str]]:
    """The family of an arm, and what its import says of its angles."""
    path.write_text(text)
    made = import_urdf(path, like=name)
    return made.robot.geometry.family, [told for told in made.notes if "right angles" in told]


@pytest.mark.parametrize("name", ROBOTS)
def test_right_angles_that_somebody_has_rounded_are_named_where_they_cost_the_closed_form(
    name: str, tmp_path: Path
) -> None:
    robot, path = load_robot(name), tmp_path / "arm.urdf"
    text, family = urdf_text(robot), robot.geometry.family
    assert notes_of_angles(text, name, path) == (family, [])
    turned = [joint for joint, alpha in zip(robot.joints.names, robot.geometry.alpha_rad, strict=True) if alpha]
    for digits in range(2, 15):
        shorter = ANGLES.sub(lambda found, d=digits: " ".join(f"{float(x):.{d}f}" for x in found[0].split()), text)
        found, notes = notes_of_angles(shorter, name, path)
        if found == family:
            assert notes == []
            continue
        (told,) = notes
        assert told.startswith(f"{', '.join(turned)}: right angles to within ")
        assert told.endswith(f"the arm then has the closed-form inverse of family {family!r}")
    assert notes_of_angles(ANGLES.sub("0.3 0.2 0.1", text), name, path) == ("generic", [])


def test_rounded_angles_of_an_arm_that_has_no_closed_form_anyway_are_its_own_matter(tmp_path: Path) -> None:
    text, path = urdf_text(load_robot("puma560")), tmp_path / "arm.urdf"
    elbow = re.compile(r'(<joint name="elbow".*?rpy=")[^"]*', re.DOTALL)
    for turn in ("1.5707963267948966", "1.5708"):  # about its own axis, where the closed form wants none
        assert notes_of_angles(elbow.sub(rf"\g<1>0 0 {turn}", text), "puma560", path) == (
            "generic",
            [],
        )


def arbitrary_urdf(seed: int) -> str:
    """An arm of three to seven joints with axes and frames anywhere, things bolted on, and a fixed foot."""
    draw = np.random.default_rng(seed)
    n = int(draw.integers(3, 8))

    def words(size: int, scale: float) -> str:
        return " ".join(repr(float(x)) for x in draw.uniform(-scale, scale, size))

    def inertial() -> str:
        return (
            f'<inertial><origin xyz="{words(3, 0.2)}" rpy="{words(3, 3.0)}"/><mass value="{draw.uniform(0.5, 4):.6f}"/>'
            '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial>'
        )

    def joint(name: str, kind: str, parent: str, child: str) -> str:
        axis = ("0 0 1", "0 1 0", "-1 0 0", words(3, 1.0))[int(draw.integers(4))]
        turn = ("0 0 0", "1.5707963267948966 0 0", words(3, 3.0))[int(draw.integers(3))]
        limit = '<limit lower="-2" upper="2" velocity="3" effort="10"/>' if kind != "fixed" else ""
        place = ("0 0 0", words(3, 0.4))[int(draw.integers(2))]
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{place}" rpy="{turn}"/><axis xyz="{axis}"/>{limit}</joint>'
        )

    links, joints, last = ['<link name="foot"/>'], [joint("pedestal", "fixed", "foot", "base")], "base"
    links.append('<link name="base"/>')
    for i in range(n):
        kind = "prismatic" if draw.random() < 0.25 else "revolute"
        links.append(f'<link name="l{i}">{inertial()}</link>')
        joints.append(joint(f"j{i}", kind, last, f"l{i}"))
        last = f"l{i}"
        if draw.random() < 0.4:  # a cover, which is no end of the arm
            links.append(f'<link name="c{i}">{inertial()}</link>')
            joints.append(joint(f"cover{i}", "fixed", last, f"c{i}"))
    links.append('<link name="tip"/>')
    joints.append(joint("mount", "fixed", last, "tip"))
    return f'<robot name="arm {seed}">{"".join(links)}{"".join(joints)}</robot>'


@pytest.mark.parametrize("seed", SEEDS)
def test_rows_of_an_arm_with_axes_anywhere_move_its_tip_as_another_reader_does(seed: int, tmp_path: Path) -> None:
    urdf, path = arbitrary_urdf(seed), tmp_path / "arm.urdf"
    path.write_text(urdf)
    chain = serial_chain(read_urdf(path), "tip")
    rows = denavit_hartenberg([link.T_previous_joint for link in chain.links], chain.T_last_tip)
    model, data = mujoco_of(urdf)
    for q in np.random.default_rng(seed).uniform(-2, 2, (5, len(chain.links))):
        T = chain.T_root_base @ rows.T_base_0
        for i, link in enumerate(chain.links):
            slides = link.joint.kind == "prismatic"
            theta, d = rows.theta[i] + (0.0 if slides else q[i]), rows.d[i] + (q[i] if slides else 0.0)
            T = T @ transform(rot_x(rows.alpha[i])) @ transform(None, [rows.a[i], 0.0, 0.0])
            T = T @ transform(rot_z(theta), None) @ transform(None, [0.0, 0.0, d])
        T = T @ inverse(rows.T_joint_frame[-1]) @ chain.T_last_tip
        assert np.allclose(T, poses(model, data, "tip", q), atol=1e-9)


def drives(n: int) -> str:
    """What a URDF does not tell, for n joints."""
    document = robot_document(load_robot("puma560"))
    document["transmission"] |= {"coupling": {}, "q_offset_deg": [0] * 6, "count_offset": [0] * 6}
    wanted = {"transmission": (), "control": (), "guard": (), "board": (), "limits": ("a_max",)}
    lines = []
    for section, keys in wanted.items():
        table = {
            key: value for key, value in document[section].items() if key != "source" and (not keys or key in keys)
        }
        table.pop("vendor_rad_per_count", None)
        for key, value in table.items():
            table[key] = ([*value, value[-1]])[:n] if isinstance(value, list) else value
        lines.append(robot_text({"name": "x", section: table | {"source": dict.fromkeys(table, "test")}}))
    text = "\n".join(line for block in lines for line in block.splitlines() if not line.startswith(("#", "name")))
    return text.replace('friction_preset = "corke"', 'friction_preset = "own"') + (
        f"\n[friction.own]\nviscous = {[1.0] * n}\ncoulomb_pos = {[1.0] * n}\ncoulomb_neg = {[1.0] * n}\n"
        'stiction_factor = 1.0\n[friction.own.source]\nviscous = "t"\ncoulomb_pos = "t"\ncoulomb_neg = "t"\n'
        'stiction_factor = "t"\n'
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_an_imported_arm_weighs_on_its_joints_what_another_reader_says(seed: int, tmp_path: Path) -> None:
    urdf, path, beside = arbitrary_urdf(seed), tmp_path / "arm.urdf", tmp_path / "drives.toml"
    path.write_text(urdf)
    n = len(serial_chain(read_urdf(path), "tip").links)
    beside.write_text(drives(n).replace("pot_channel = [0, 1, 2, 3, 4, 5, 5]", "pot_channel = [0, 1, 2, 3, 4, 5, 6]"))
    robot = import_urdf(path, "tip", beside=beside).robot
    model, data = mujoco_of(urdf)
    for q in np.random.default_rng(seed).uniform(-2, 2, (5, n)):
        assert np.allclose(gravity(robot, q), gravity_of(model, data, q), atol=1e-7)


def far_turning(tmp_path: Path) -> Path:
    """An arm whose joints turn two turns each."""
    path = tmp_path / "arm.urdf"
    text = re.sub(r'lower="[^"]*"', 'lower="-6.2832"', urdf_text(load_robot("puma560")))
    path.write_text(re.sub(r'upper="[^"]*"', 'upper="6.2832"', text))
    return path


def test_borrowed_encoders_are_made_coarse_enough_for_the_range_and_that_is_told(tmp_path: Path) -> None:
    path, like = far_turning(tmp_path), load_robot("puma560")
    made = import_urdf(path, like="puma560")
    write_robot(tmp_path / "arm.toml", made.document)
    robot = load_robot(tmp_path / "arm.toml")
    least, most = robot.transmission.counts_between(robot.limits.q_min, robot.limits.q_max)
    assert (least > -32768).all()
    assert (most < 32767).all()
    assert (robot.transmission.counts_per_rev < like.transmission.counts_per_rev).all()
    assert any("counts_per_rev of joint 1, 2, 3, 4, 5, 6 is made up" in note for note in made.notes)


def test_a_borrowed_offset_gives_way_to_the_range(tmp_path: Path) -> None:
    path, sections = tmp_path / "arm.urdf", tmp_path / "ranges.toml"
    path.write_text(urdf_text(load_robot("puma560")))
    wanted = "q_min_deg = [-160, -223, -40, -200, -100, -266]\nq_max_deg = [160, 43, 240, 60, 100, 266]\n"
    sections.write_text(f'[limits]\n{wanted}[limits.source]\nq_min_deg = "t"\nq_max_deg = "t"\n')
    made = import_urdf(path, like="puma560", beside=sections)
    like = load_robot("puma560").transmission
    assert (made.robot.transmission.counts_per_rev == like.counts_per_rev).all()
    assert (made.robot.transmission.count_offset != like.count_offset).tolist() == [False] * 3 + [True] + [False] * 2
    assert any("count_offset of joint 4 is made up" in note for note in made.notes)


def test_encoders_that_somebody_told_are_not_changed_but_refused(tmp_path: Path) -> None:
    sections = tmp_path / "drives.toml"
    sections.write_text(
        "[transmission]\ncounts_per_rev = [1000, 1000, 1000, 1000, 1000, 1000]\n"
        '[transmission.source]\ncounts_per_rev = "data sheet"\n'
    )
    with pytest.raises(ConfigError, match=r"counter of joint 1 would go from -.*: fewer counts_per_rev"):
        import_urdf(far_turning(tmp_path), like="puma560", beside=sections)


def test_torque_limits_of_a_file_beside_win_over_efforts(tmp_path: Path) -> None:
    """Many URDFs tell an effort of 1000, and the user knows better."""
    path, beside = tmp_path / "arm.urdf", tmp_path / "drives.toml"
    path.write_text(re.sub('effort="[^"]*"', 'effort="1000"', urdf_text(load_robot("puma560"))))
    beside.write_text('[guard]\ntau_max = [30, 40, 20, 5, 5, 5]\n[guard.source]\ntau_max = "measured"\n')
    made = import_urdf(path, like="puma560", beside=beside)
    np.testing.assert_array_equal(made.robot.guard.tau_max, [30.0, 40.0, 20.0, 5.0, 5.0, 5.0])
    assert made.document["guard"]["source"]["tau_max"] == "measured"


@pytest.mark.parametrize("name", ROBOTS)
def test_an_effort_beyond_the_converters_becomes_what_they_can_ask_for(name: str, tmp_path: Path) -> None:
    path, made = tmp_path / "arm.urdf", tmp_path / "made.toml"
    path.write_text(re.sub('effort="[^"]*"', 'effort="1000"', urdf_text(load_robot(name))))
    write_robot(made, import_urdf(path, like=name).document)
    most = DAC_HALF_RANGE / np.abs(load_robot(name).transmission.dac_per_Nm)
    np.testing.assert_array_equal(load_robot(made).guard.tau_max, most)


def test_efforts_are_the_limits_of_torque_where_no_file_tells_them(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(re.sub('effort="[^"]*"', 'effort="3"', urdf_text(load_robot("puma560"))))
    made = import_urdf(path, like="puma560")
    np.testing.assert_array_equal(made.robot.guard.tau_max, np.full(6, 3.0))
    assert made.document["guard"]["source"]["tau_max"].startswith("URDF: effort")
    np.testing.assert_allclose(made.robot.guard.unexplained_torque_or_default, np.full(6, 2.1))  # not the PUMA's 88 N m
    np.testing.assert_allclose(made.robot.guard.unknown_load_or_default, np.full(6, 0.45))  # nor its 27 N m


def test_what_a_urdf_does_not_tell_is_asked_for_by_name(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_text(load_robot("puma560")))
    with pytest.raises(ConfigError) as refused:
        import_urdf(path)
    for missing in (
        "--like",
        "--with",
        "transmission: missing",
        "guard: missing",
        "control.kp: missing",
        "limits.a_max",
    ):
        assert missing in str(refused.value)
    with pytest.raises(ConfigError, match="stanford is not like it"):
        import_urdf(path, like="stanford")


PLAIN: Final = (
    '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
    '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    '<joint name="k" type="fixed"><parent link="b"/><child link="c"/></joint></robot>'
)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<robot", "<sdf", "not XML"),
        ('type="revolute"', 'type="floating"', "floating"),
        ('type="revolute"', "", "of no type"),
        ('child link="b"', 'child link="nobody"', "'nobody'"),
        ('child link="c"', 'child link="b"', "hangs on two joints"),
        ('child link="c"', 'child link="a"', "round in a circle"),
        ('xyz="0 0 1"', 'xyz="0 0 0"', "no direction"),
        ('xyz="0 0 1"', 'xyz="0 nan 1"', "three numbers"),
        ('xyz="0 0 1"', 'xyz="1 2"', "three numbers"),
        ('lower="-1"', 'lower="low"', "lower must be a number"),
        ('<link name="c"/>', '<link name="b"/>', "two links are called 'b'"),
        ('<link name="a"/>', '<link name=""/>', "has no name"),
        ('<link name="c"/>', '<link name="c"><inertial><mass value="-1"/></inertial></link>', "below zero|missing"),
        ('name="j" type="revolute"', 'name="j" type="fixed"', "no joint moves"),
        ("</joint>", '<mimic joint="k"/></joint>', "'j' follows joint 'k'.*--tip"),
        (
            '<robot name="r">',
            '<robot name="r"><xacro:property xmlns:xacro="http://www.ros.org/wiki/xacro" name="p"/>',
            "xacro FILE",
        ),
        ('<parent link="b"/>', '<parent link="a"/>', "several ends.*--tip"),
        (
            '<robot name="r">',
            '<!DOCTYPE r [<!ENTITY a "ha">]><robot name="&a;">',
            "declares a document type, <!DOCTYPE r",
        ),
        ('<robot name="r">', '<!DOCTYPE r SYSTEM "/etc/passwd"><robot name="r">', "declares a document type"),
        ('lower="-1"', 'lower="-1e308"', r"a number, up to 1e\+20, is '-1e308'"),
        ('lower="-1"', 'lower="1_0"', "a number, up to"),
        ('xyz="0 0 1"', 'xyz="0 0 1e200"', "three numbers, up to"),
        ('name="j"', 'name="a&#9;b"', "cannot be printed"),
        ('name="j"', f'name="{"j" * 101}"', "too long"),
    ],
)
def test_what_is_no_serial_arm_is_refused_with_its_place(tmp_path: Path, old: str, new: str, told: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(PLAIN.replace(old, new, 1))
    with pytest.raises(ConfigError, match=told):
        serial_chain(read_urdf(path))


def fan(count: int, kind: str, parent: str) -> str:
    """A URDF of so many joints of a kind; `parent` has the number of the one before as {}, or none."""
    links = "".join(f'<link name="l{k}"/>' for k in range(count + 1))
    joint = f'<joint name="j{{0}}" type="{kind}"><parent link="{parent}"/><child link="l{{1}}"/></joint>'
    return f'<robot name="r">{links}{"".join(joint.format(k, k + 1) for k in range(count))}</robot>'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('<robot name="r">' + "".join(f'<link name="l{k}"/>' for k in range(20_000)) + "</robot>", "and 19980 more"),
        (fan(5000, "revolute", "l0"), "several ends; name one with --tip: l1, .* and 4980 more"),
        (fan(2000, "revolute", "l{0}"), "2000 joints move .*; 1 to 32 can"),
        (fan(2000, "fixed", "l{0}").replace('"fixed"', '"revolute"', 1), "puma560 is not like it"),
        ("<a>" * 50_000 + "</a>" * 50_000, "a URDF begins with <robot>"),
        (" " * 16_000_001, "larger than 16 MB"),
    ],
    ids=["links", "ends", "joints", "bolted on", "depth", "bytes"],
)
def test_a_urdf_of_absurd_size_is_refused_soon(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(ConfigError, match=told):
        import_urdf(tmp_path / "arm.urdf", like="puma560")


@pytest.mark.parametrize(
    ("beside", "told"),
    [
        ("joints = 3", r"must be a section .*\[joints\]"),
        ("limits = 5", r"must be a section .*\[limits\]"),
        ("poses = []", r"must be a section .*\[poses\]"),
        ("[guard]\nsource = 3", "guard.source must name"),
        ("[friction]\nurdf = 3", "friction.urdf: "),
        ("[limits]\nq_min_deg = ['a', 'b', 'c', 'd', 'e', 'f']", "limits.q_min_deg"),
        ("[limits]\nq_min_deg = [[1], [2], [3], [4], [5], [6]]", "limits.q_min_deg"),
        ("[limits]\nq_max_deg = [nan, nan, nan, nan, nan, nan]", "limits.q_max_deg: must be finite"),
        ("[transmission]\ndac_per_Nm = ['a', 1, 1, 1, 1, 1]", "transmission.dac_per_Nm"),
        ("[poses]\npark = ['x', 0, 0, 0, 0, 0]", "poses.park"),
        ("[poses]\npark = 'x'", "poses.park"),
        ("=", "Invalid statement"),
    ],
)
@pytest.mark.parametrize("like", ["puma560", None])
def test_a_file_beside_with_values_of_other_kinds_is_refused(
    tmp_path: Path, beside: str, told: str, like: str | None
) -> None:
    arm, sections = tmp_path / "arm.urdf", tmp_path / "more.toml"
    arm.write_text(urdf_text(load_robot("puma560")))
    sections.write_text(beside)
    with pytest.raises(ConfigError, match=told):
        import_urdf(arm, like=like, beside=sections)


ODD: Final = (
    "",
    "1e999",
    "nan",
    "-1e-320",
    "1e19",
    "0x1",
    "-0",
    "1 2 3",
    "\u0661",
    "a&#10;b",
    "mimic",
    "l0",
    "revolute",
)


def test_urdfs_with_other_values_and_elements_are_refused_or_make_a_file_that_is_read(tmp_path: Path) -> None:
    path, made, draw = tmp_path / "arm.urdf", tmp_path / "arm.toml", Random(4)
    whole = urdf_text(load_robot("puma560"))
    values, elements = list(re.finditer('="([^"]*)"', whole)), list(re.finditer("<[^>]*/>", whole))
    read = 0
    for _ in range(150):
        text = whole
        for place in sorted(draw.sample(values, draw.randint(1, 2)), key=lambda match: -match.start()):
            text = f"{text[: place.start(1)]}{draw.choice(ODD)}{text[place.end(1) :]}"
        if draw.random() < 0.3:
            left_out = draw.choice(elements)[0]
            text = text.replace(left_out, draw.choice(["", left_out * 2, f"{left_out}<mimic joint='waist'/>"]), 1)
        path.write_text(text)
        try:
            write_robot(made, import_urdf(path, like="puma560").document)
        except ConfigError:
            continue
        read += 1
        assert load_robot(made).n == 6
    assert 10 < read < 140


def test_damaged_urdfs_get_an_error_of_ours_or_are_read(tmp_path: Path) -> None:
    path, draw = tmp_path / "arm.urdf", np.random.default_rng(9)
    whole = bytearray(urdf_text(load_robot("puma560")), "utf-8")
    refused = 0
    for _ in range(300):
        damaged = bytearray(whole)
        for place in draw.integers(0, len(whole), int(draw.integers(1, 6))):
            damaged[place] = int(draw.integers(0, 256))
        path.write_bytes(bytes(damaged[: int(draw.integers(1, len(whole) + 1))] if draw.random() < 0.2 else damaged))
        try:
            import_urdf(path, like="puma560")
        except ConfigError:
            refused += 1
    assert 100 < refused < 300
