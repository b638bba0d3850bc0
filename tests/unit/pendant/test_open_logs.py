"""Logs at the pendant: which ones pages may open, and what they are told of good and bad ones."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import LogError
from qrobot.fences.told_fences import ToldFences
from qrobot.log.fences_of_log import fence_attachments
from qrobot.log.header import header_for
from qrobot.log.record import write_log
from qrobot.pendant.answering_process import LOGS, AnsweringProcess
from qrobot.pendant.fence_facts import fence_facts
from qrobot.pendant.log_process import OpenLogs
from qrobot.pendant.log_shelf import LogShelf
from tests.support.log_samples import make_header, make_rows

ROWS = 3000


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "out/incidents").mkdir(parents=True)
    path = tmp_path / "out/run.mcap"
    write_log(path, make_rows(ROWS, 2), make_header(2))
    return path


def ask(logs: OpenLogs, path: Path, do: str, **more: Any) -> Any:
    told, data = logs.answer({"do": do, "path": str(path), **more})
    return told if "error" in told or not data else data


def test_pages_open_the_logs_of_the_deployment_and_no_other_file(path: Path, tmp_path: Path) -> None:
    incident = path.parent / "incidents/arm-GUARD_TRIP.mcap"
    for copy in (incident, path.with_name("run.0002.mcap"), tmp_path / "elsewhere.mcap"):
        copy.write_bytes(path.read_bytes())
    os.utime(incident, (1e9, 1e9))
    shelf = LogShelf([path.parent, path.parent])
    assert [(log["name"], log["kind"]) for log in shelf.listing()] == [(str(path), "run"), (str(incident), "incident")]
    assert shelf.path_of(str(path)) == path
    for name in (tmp_path / "elsewhere.mcap", path.parent / "../elsewhere.mcap", "/etc/passwd", ""):
        with pytest.raises(LogError, match="no log"):
            shelf.path_of(str(name))
    path.unlink()
    with pytest.raises(LogError, match="moved or removed"):
        shelf.path_of(str(path))


def test_the_replay_of_a_log_is_told_the_fences_that_were_in_force(tmp_path: Path) -> None:
    path, robot = tmp_path / "run.mcap", load_robot("puma560")
    told = ToldFences(fences=(Fence(name="floor", shape="plane", position_m=(0.0, 0.0, -0.6)),), self_collision=True)
    write_log(path, make_rows(ROWS, 6), header_for(robot, 1_000_000, "pd"), fence_attachments(told))
    arm = ask(OpenLogs(), path, "open")["arm"]
    assert {key: arm[key] for key in ("fences", "capsules", "pairs")} == {
        key: value for key, value in fence_facts(told, robot).items() if key != "self_margin"
    }
    assert ([fence["name"] for fence in arm["fences"]], bool(arm["pairs"])) == (["floor"], True)


def test_a_log_is_told_of_and_its_window_exported_with_every_number(path: Path) -> None:
    logs, rows = OpenLogs(), make_rows(ROWS, 2)
    facts = ask(logs, path, "open")
    assert (facts["joint_names"], facts["arm"]) == (("joint1", "joint2"), None)
    assert "cannot be drawn" in facts["why"]  # a robot that nobody knows
    while logs.read_on():
        pass
    assert ask(logs, path, "facts") == {
        "share": 1.0, "end": pytest.approx((ROWS - 1) * 250e-6), "damaged": 0, "whole": True, "events": [], "more": 0
    }  # fmt: skip
    data = ask(logs, path, "curves", begin=0.0, end=1.0, points=100)
    assert len(data) % (8 + 3 * 4 * 10) == 0
    head, *lines = ask(logs, path, "csv", begin=0.1, end=0.1 + 8e-4).decode().splitlines()
    assert head == "t_s,q_ref_joint1,q_ref_joint2,q_joint1,q_joint2,v_joint1,v_joint2,tau_joint1,tau_joint2,mode,fault"
    assert len(lines) == 4
    first = lines[0].split(",")
    assert first[-2:] == ["TRACKING", "0"]
    told = [float(number) for number in first[:-2]]
    np.testing.assert_array_equal(
        told, [0.1, *(rows[name][400][j] for name in ("q_ref", "q", "v", "tau") for j in (0, 1))]
    )
    assert logs.answer({"do": "glance", "paths": [str(path), "/none"]})[0] == {
        "seconds": [pytest.approx((ROWS - 1) * 250e-6, abs=0.01), None]
    }


def test_a_log_that_is_foreign_vanished_or_not_open_is_an_error_that_says_what_to_do(path: Path) -> None:
    logs = OpenLogs()
    assert "open it again" in ask(logs, path, "facts")["error"]
    ask(logs, path, "open")
    path.unlink()
    assert "has vanished" in ask(logs, path, "facts")["error"]
    path.write_bytes(b"something else")
    assert "not an MCAP file" in ask(logs, path, "open")["error"]


@pytest.mark.realtime
def test_a_file_cut_off_while_it_is_open_costs_an_answer_and_no_more(path: Path) -> None:
    reader = AnsweringProcess(*LOGS)
    good = path.with_name("good.mcap")
    good.write_bytes(path.read_bytes())
    try:
        reader.ask(do="open", path=str(path))
        reader.ask(do="facts", path=str(path))
        os.truncate(path, 100)  # what is mapped beyond the end kills who reads it
        with pytest.raises(LogError, match=r"(?i)open it again"):
            [reader.ask(do="curves", path=str(path), begin=0.0, end=1.0, points=100) for _ in range(50)]
        assert reader.ask(do="open", path=str(good))[0]["rate_hz"] == 4000.0
    finally:
        reader.close()
