"""`qrobot doctor`: each lack is found, weighed and told with its remedy."""

from __future__ import annotations

import json
import os
import socket
from collections import namedtuple
from importlib.util import find_spec
from pathlib import Path

import pytest

from qrobot.cli import checks
from qrobot.cli.checks import Finding, Weight
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config import robot_path
from qrobot.realtime.setup import SetupStep
from qrobot.realtime.shared_memory import own

Usage = namedtuple("Usage", "total used free")


def test_json_lists_every_finding_and_each_that_is_not_ok_has_a_remedy(capsys: pytest.CaptureFixture[str]) -> None:
    status = run_app(make_app(), ["doctor", "--json"])
    report = json.loads(capsys.readouterr().out)
    assert status == (0 if report["usable"] else 1)
    assert {finding["group"] for finding in report["findings"]} == {
        "software", "shared memory", "network", "real time", "machine", "fences",
    }  # fmt: skip
    for finding in report["findings"]:
        assert finding["ok"] or finding["remedy"]


def test_the_table_shows_the_same_findings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    lack = Finding("machine", SetupStep("kernel", False, "no preemption", "install another"), Weight.TIMING)
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda _ports, _bases: [lack])
    assert run_app(make_app(), ["doctor"]) == 0
    text = capsys.readouterr().out
    for words in ("machine", "kernel", "no preemption", "→ install another", "1 findings marked !"):
        assert words in text


@pytest.mark.parametrize(("weight", "status"), [(Weight.NEEDED, 1), (Weight.TIMING, 0), (Weight.OPTIONAL, 0)])
def test_only_what_prevents_running_gives_status_1(
    weight: Weight, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lack = Finding("x", SetupStep("thing", False, "gone", "get one"), weight)
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda _ports, _bases: [lack])
    assert run_app(make_app(), ["doctor", "--json"]) == status


@pytest.mark.parametrize(
    ("robot", "status", "told"),
    [
        ("puma560", 0, ["floor (plane, keep out), its own body", "pose ready", "past fence low", "move the fence"]),
        ("stanford", 1, ["stanford has no [shape]", "tell the arm's body in the robot file"]),
    ],
)
def test_fences_that_cannot_be_and_poses_past_one_are_told(
    robot: str, status: int, told: list[str], tmp_path: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    file = tmp_path / "cell.toml"
    file.write_text(
        f'[[arm]]\nname = "one"\nrobot = "{robot}"\nbridge = {{ port = 5600 }}\n[arm.fences]\nscene = true\n'
        'self_collision = true\n[arm.board.scene]\nkind = "floor"\n'
        '[[arm.fences.shape]]\nname = "low"\nshape = "plane"\nrpy_deg = [0, 180, 0]\nposition_m = [0, 0, 0.8]\n'
    )
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda _ports, _bases: [])
    assert run_app(make_app(), ["doctor", str(file)]) == status
    text = capsys.readouterr().out
    assert [words for words in told if words not in text] == []


@pytest.mark.parametrize("damaged", ["one", "two"])
def test_nobody_is_told_to_leave_fences_out_because_of_a_robot_file_that_cannot_be_read(
    damaged: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = robot_path("puma560").read_text()
    (tmp_path / "mine.toml").write_text(text.replace("flange_m = 0.05625", 'flange_m = "0.05625"'))
    arms = [
        f'[[arm]]\nname = "{name}"\nrobot = "{"mine.toml" if name == damaged else "puma560"}"\n'
        f"bridge = {{ port = {port} }}\nstand = {{ position_m = [{port - 5600}, 0, 0] }}\n"
        for name, port in (("one", 5600), ("two", 5603))
    ]
    file = tmp_path / "cell.toml"
    file.write_text('fences = { arms = ["two"] }\n'.join(arms))
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda _ports, _bases: [])
    assert run_app(make_app(), ["doctor", str(file), "--json"]) == 1
    [lack] = [each for each in json.loads(capsys.readouterr().out)["findings"] if not each["ok"]]
    assert "flange_m" in lack["detail"]
    assert "robot file right" in lack["remedy"]
    assert "fences" not in lack["remedy"]


def test_the_ports_of_the_deployment_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, tuple[str, int]] = {}
    monkeypatch.setattr("qrobot.cli.doctor.all_findings", lambda ports, _bases: asked.update(ports) or [])
    run_app(make_app(), ["doctor", "two_arms", "--json"])
    assert len(asked) == 2
    assert all(host == "127.0.0.1" and port > 1024 for host, port in asked.values())


def test_no_rate_is_tried_beside_a_running_arm(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("qrobot.cli.doctor.runtime_path", lambda: tmp_path)
    (tmp_path / "gone-servo").touch()
    with (tmp_path / "left-servo").open("w") as owner:
        assert own(owner.fileno())
        run_app(make_app(), ["doctor", "two_arms", "--rate", "--json"])
    findings = json.loads(capsys.readouterr().out)["findings"]
    rates = [finding for finding in findings if finding["group"].startswith("servo of ")]
    assert len(rates) == 2
    assert all(finding["ok"] and "not tried beside left:" in finding["detail"] for finding in rates)


def test_the_rate_is_tried_when_it_is_asked_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    slow = SetupStep("rate", False, "1000 Hz: too slow", "lower it")
    monkeypatch.setattr("qrobot.cli.doctor.runtime_path", lambda: tmp_path)
    monkeypatch.setattr("qrobot.cli.doctor._tried", lambda _arm: [slow])
    assert run_app(make_app(), ["doctor", "--rate", "--json"]) == 0
    assert [f["detail"] for f in json.loads(capsys.readouterr().out)["findings"]].count(slow.detail) == 1
    run_app(make_app(), ["doctor", "--json"])
    assert slow.detail not in capsys.readouterr().out


def test_an_unknown_deployment_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app(), ["doctor", "emulater"]) == 1
    assert "emulator" in capsys.readouterr().err


def test_a_port_is_free_or_taken(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        taken = checks.look_at_port("left", "127.0.0.1", port, tmp_path)
        assert not taken.ok
        assert str(port) in taken.detail
    assert checks.look_at_port("left", "127.0.0.1", port, tmp_path).ok


def test_a_port_taken_by_a_running_arm_is_as_it_should_be(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, (tmp_path / "left-servo").open("w") as owner:
        assert own(owner.fileno())
        assert checks.look_at_port("left", "127.0.0.1", server.getsockname()[1], tmp_path).ok


@pytest.mark.parametrize(("free", "ok"), [(10 << 20, False), (checks.SEGMENT_BYTES, True)])
def test_shared_memory_needs_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, ok: bool) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _path: Usage(1 << 30, 0, free))
    step = checks.look_at_room(tmp_path)
    assert step.ok == ok
    assert ok or "size=256M" in step.remedy


def test_missing_shared_memory_prevents_running(tmp_path: Path) -> None:
    step = checks.look_at_room(tmp_path / "absent")
    assert (step.ok, "mount a tmpfs" in step.remedy) == (False, True)


def test_a_runtime_folder_that_others_may_write_in_prevents_running(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o777)
    monkeypatch.setenv("QROBOT_RUNTIME_DIR", str(tmp_path))
    findings = list(checks.shared_memory(tmp_path))
    assert findings[0].prevents_running
    assert "mode 0777" in findings[0].step.detail


def test_a_session_folder_that_is_not_taken_is_told_and_prevents_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def told() -> list[str]:
        findings = [finding for finding in checks.shared_memory(tmp_path) if finding.step.name == "$XDG_RUNTIME_DIR"]
        assert not any(finding.prevents_running for finding in findings)
        return [finding.step.detail for finding in findings]

    monkeypatch.setattr(checks, "passed_over", lambda: None)
    assert told() == []
    monkeypatch.setattr(checks, "passed_over", lambda: Path("/on/a/disk"))
    assert told() == ["/on/a/disk is not taken"]


def test_a_segment_is_in_use_or_left_behind(tmp_path: Path) -> None:
    (tmp_path / "a-servo").touch()
    (tmp_path / "other").touch()
    with (tmp_path / "b-servo").open("w") as owner:
        assert own(owner.fileno())
        found = {step.name: step.ok for step in checks.look_at_segments(tmp_path)}
    assert found == {"a-servo": False, "b-servo": True}


def test_of_many_segments_that_were_left_behind_a_few_are_named_below_those_in_use(tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / f"arm{number:02}-board").touch()
    with (tmp_path / "z-servo").open("w") as owner:
        assert own(owner.fileno())
        steps = list(checks.look_at_segments(tmp_path))
    assert [step.name for step in steps] == ["z-servo", "arm00-board", "arm01-board", "arm02-board", "9 more"]
    assert [step.ok for step in steps] == [True, *[False] * 4]


def test_a_missing_library_is_named_with_its_remedy() -> None:
    step = checks.look_at_library("surely-not-installed", "pip install it")
    assert (step.ok, step.remedy) == (False, "pip install it")


def test_the_compile_cache_is_where_numba_will_put_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "to" / "be" / "made"))
    assert checks.look_at_compile_cache().detail == str(tmp_path / "to" / "be" / "made")
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    assert "NUMBA_CACHE_DIR" in checks.look_at_compile_cache().remedy


def test_trying_real_time_leaves_this_thread_as_it_was() -> None:
    before = os.sched_getscheduler(0)
    assert {step.name for step in checks.realtime_rights()} == {"scheduler", "idle states", "memory"}
    assert os.sched_getscheduler(0) == before


def test_a_library_of_another_distribution_than_usual_is_found_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert checks.look_at_extra("pydantic", "pydantic-of-somebody", "").name == "pydantic"
    assert checks.look_at_extra("pydantic", "pydantic", "").ok
    (tmp_path / "a_folder").mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    assert not checks.look_at_extra("a_folder", "no-such-package", "").ok
    missing = checks.look_at_extra("no_such_module", "no-such-module", "pip install it")
    assert (missing.name, missing.ok, missing.remedy) == ("no-such-module", False, "pip install it")


def test_every_library_that_can_be_imported_is_found_whatever_its_distribution_is_called() -> None:
    found = {finding.step.name: finding.step.ok for finding in checks.software()}
    for module, extra in checks.EXTRAS.items():
        assert found[extra.distribution or module] == (find_spec(module) is not None)
