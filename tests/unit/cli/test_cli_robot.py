"""`qrobot robot`: robots leave and come back through the command line, and what cannot be is refused in words."""

from __future__ import annotations

import csv
import errno
import json
import os
import re
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from qrobot.cli.console import FAILURE, SUCCESS, USAGE, run_app
from qrobot.cli.main import make_app
from qrobot.config import Robot, load_robot
from qrobot.config.robot import robot_path
from qrobot.model.arm import Arm

PUMA = load_robot("puma560")


def told(capsys: pytest.CaptureFixture[str], status: int, *words: str | Path) -> str:
    """What `qrobot robot ...` says when it ends with that status: on stdout, or in words when it fails."""
    assert run_app(make_app(), ["robot", *map(str, words)]) == status
    said = capsys.readouterr()
    return said.out if status == SUCCESS else " ".join(said.err.split())


def same_arm(one: Robot, other: Robot) -> None:
    for q in np.random.default_rng(7).uniform(one.limits.q_min, one.limits.q_max, (20, one.n)):
        np.testing.assert_allclose(Arm(one).forward(q), Arm(other).forward(q), atol=1e-12)
    np.testing.assert_allclose(one.links.mass, other.links.mass)


def test_a_robot_goes_out_as_a_urdf_and_comes_back_the_same_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, again = tmp_path / "arm.urdf", tmp_path / "again.toml"
    told(capsys, SUCCESS, "export", "puma560", "--output", urdf)
    said = told(capsys, SUCCESS, "import", urdf, "--like", "puma560", "--output", again)
    assert "6 joints" in said
    same_arm(PUMA, load_robot(again))
    facts = json.loads(told(capsys, SUCCESS, "import", urdf, "--like", "puma560", "--output", again, "--json"))
    assert (facts["robot"], facts["joints"]) == ("puma560", 6)
    assert facts["notes"]
    assert "wrist_bend" in told(capsys, SUCCESS, "show", again)


def test_a_robot_file_goes_out_and_comes_back_as_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "arm.toml").write_text(told(capsys, SUCCESS, "export", "stanford", "--format", "toml"))
    same_arm(load_robot("stanford"), load_robot(tmp_path / "arm.toml"))


def test_every_format_is_what_other_programs_read(capsys: pytest.CaptureFixture[str]) -> None:
    urdf = ElementTree.fromstring(told(capsys, SUCCESS, "export", "puma560", "--format", "urdf"))
    moving = [joint for joint in urdf.iter("joint") if joint.get("type") == "revolute"]
    assert [joint.get("name") for joint in moving] == list(PUMA.joint_names)
    model = mujoco.MjModel.from_xml_string(told(capsys, SUCCESS, "export", "puma560", "--format", "mjcf"))
    assert model.nq == PUMA.n
    lines = told(capsys, SUCCESS, "export", "puma560", "--format", "dh").splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [row["joint"] for row in rows] == list(PUMA.joint_names)
    # Denavit-Hartenberg rows of the PUMA 560, Craig: alpha_{i-1}, and a_2 of 17 in (Lee and Ziegler 1984)
    assert [float(row["alpha_deg"]) for row in rows] == [0.0, -90.0, 0.0, 90.0, -90.0, 90.0]
    assert float(rows[2]["a_m"]) == pytest.approx(17 * 0.0254)


def test_what_a_urdf_does_not_tell_is_asked_for_by_name_and_a_link_without_weight_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, made = tmp_path / "arm.urdf", tmp_path / "arm.toml"
    told(capsys, SUCCESS, "export", "puma560", "-o", urdf)
    said = told(capsys, FAILURE, "import", urdf, "-o", made)
    for missing in ("transmission: missing", "guard: missing", "control.kp: missing", "limits.a_max", "--like"):
        assert missing in said
    assert not made.exists()
    robot = ElementTree.parse(urdf)
    link = next(link for link in robot.iter("link") if link.get("name") == "shoulder_link")
    link.remove(next(link.iter("inertial")))
    robot.write(urdf)
    facts = json.loads(told(capsys, SUCCESS, "import", urdf, "--like", "puma560", "-o", made, "--json"))
    assert any("shoulder weighs nothing" in line and "links.mass" in line for line in facts["notes"])


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["export", "nobody"], FAILURE, "nobody"),
        (["export", "puma560", "--format", "step"], USAGE, "step"),
        (["export", "{folder}/flat.toml", "--format", "mjcf"], FAILURE, "cannot be simulated: "),
        (["export", "puma560", "-o", "{folder}/none/arm.urdf"], FAILURE, "none"),
        (["export", "puma560", "-o", "/dev/full/arm.urdf"], USAGE, "/dev/full"),
        (["export", "puma560", "-o", "{folder}/arm.toml"], FAILURE, "a URDF ends in .urdf or .xml"),
        (["export", "puma560", "--format", "toml", "-o", "{folder}/cell.toml"], FAILURE, "it is a deployment file"),
        (["export", "puma560", "--format", "dh", "-o", "{folder}/lesson.csv"], FAILURE, "it is no table of such rows"),
        (["export", "puma560", "--format", "mjcf", "-o", "{folder}/nodes.xml"], FAILURE, "it is something else"),
        (["export", "puma560", "-o", "{folder}/nodes.xml"], FAILURE, "it is something else, not a URDF"),
        (["import", "{folder}/none.urdf", "-o", "{folder}/arm.toml"], FAILURE, "none.urdf"),
        (["import", "{folder}/fork.urdf", "--like", "puma560", "-o", "{folder}/arm.toml"], FAILURE, "--tip"),
        (["import", "{folder}/fork.urdf", "-o", "{folder}/arm.json"], USAGE, "ends in .toml"),
        (["import", "{folder}/fork.urdf", "--tip", "d", "-o", "{folder}/arm.toml"], FAILURE, "'d'"),
        (["import", "{folder}/fork.urdf"], USAGE, "--output"),
        (["show", "{folder}/fork.urdf"], FAILURE, "fork.urdf"),
    ],
)
def test_what_cannot_be_is_told_in_words(
    words: list[str], status: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fork.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="-1" upper="1"/></joint>'
        '<joint name="k" type="revolute"><parent link="a"/><child link="c"/><limit lower="-1" upper="1"/></joint>'
        "</robot>"
    )
    (tmp_path / "cell.toml").write_text("[[arm]]\n")
    (tmp_path / "nodes.xml").write_text("<launch/>\n")
    (tmp_path / "lesson.csv").write_text("# qrobot setpoints 1\n")
    file = robot_path("puma560").read_text()
    (tmp_path / "flat.toml").write_text(re.sub(r"(\ninertia = \[\s*)\[.*?\]", r"\1[0.02, 0.11, 0.9]", file, count=1))
    complaint = told(capsys, status, *(word.format(folder=tmp_path) for word in words))
    assert said in complaint
    assert not (tmp_path / "arm.toml").exists()


@pytest.mark.parametrize(("to", "suffix"), [("urdf", "urdf"), ("mjcf", "xml"), ("dh", "csv"), ("toml", "toml")])
def test_an_export_is_written_over_an_export_of_its_kind(
    to: str, suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        told(capsys, SUCCESS, "export", "puma560", "--format", to, "-o", tmp_path / f"arm.{suffix}")


def test_an_export_that_the_disk_refuses_is_told_by_the_name_of_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_path: Path, _text: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))  # without a name, as that of `write` is

    nowhere = tmp_path / "none" / "arm.urdf"
    assert told(capsys, FAILURE, "export", "puma560", "-o", nowhere).endswith(
        f"cannot write {nowhere}: {os.strerror(errno.ENOENT)}"
    )
    monkeypatch.setattr("qrobot.cli.robot.replace_file", refuse)
    full = tmp_path / "arm.urdf"
    assert told(capsys, FAILURE, "export", "puma560", "-o", full).endswith(
        f"cannot write {full}: {os.strerror(errno.ENOSPC)}"
    )


@pytest.mark.parametrize("command", [(), ("export",), ("import",), ("show",), ("list",)])
def test_every_command_tells_what_it_takes(command: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    said = told(capsys, SUCCESS, *command, "--help")
    for word in {"export": ("urdf", "mjcf", "--output"), "import": ("--like", "--with", "--tip")}.get(
        "".join(command), ()
    ):
        assert word in said
