"""What `qrobot ctl status` says of hand, inputs and outputs."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.ctl import _lines_line
from qrobot.cli.main import make_app
from qrobot.servo.operator.messages import BoardStatus, FenceStatus, ServoStatus


@pytest.mark.parametrize(
    ("inputs", "outputs", "line"),
    [
        ((2, 5), {"glue": False, "clamp": True}, "hand closed, inputs on: 2 5, glue off, clamp on"),
        ((), {}, "hand closed, inputs on: none"),
    ],
)
def test_the_status_names_what_is_on(inputs: tuple[int, ...], outputs: dict[str, bool], line: str) -> None:
    now: Any = SimpleNamespace(hand="closed", inputs=inputs, outputs=outputs, analog_outputs={})
    assert _lines_line(now) == line


class Servo:
    """A servo that tells its gains, and is asked for nothing else."""

    def __init__(self, arm: str) -> None:
        self.arm = arm

    def __enter__(self) -> Servo:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def fences(self) -> tuple[FenceStatus, ...]:
        row = {"body": "wrist", "margin_m": 0.02, "bodies": "all"}
        return (
            FenceStatus(name="cell", shape="cylinder", keep="in", distance_m=0.3, **row),
            FenceStatus(name="bench", shape="box", keep="out", distance_m=-0.0123, **row),
            FenceStatus(name="itself", shape="capsules", keep="out", distance_m=0.01, **row),
        )

    def status(self) -> SimpleNamespace:
        gains = {"kp": [3510.25, *range(5)], "kv": [234.0, *range(5)], "inertia": [3.9, *range(5)]}
        return SimpleNamespace(arm=self.arm, robot="puma560", law="qrobot", calibrated=True, **gains)


def test_the_last_two_lines_of_a_status_tell_what_is_on_and_how_the_board_is_reached(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    status: Any = ServoStatus.model_construct(
        arm="puma560", robot="puma560", law="qrobot", law_settings={}, mode="HOLDING", text="", commander="",
        hand="closed", inputs=(), outputs={}, force=(1.0, *[None] * 5),
        board=BoardStatus(losses=0, dropped=0, illegal=0, module_losses=0),
        **dict.fromkeys(("q", "v", "tau", "kp", "kv", "inertia"), (0.0,) * 6),
    )  # fmt: skip
    monkeypatch.setattr("qrobot.cli.ctl.ServoClient", Servo)
    monkeypatch.setattr(Servo, "status", lambda _: status)
    assert run_app(make_app(), ["ctl", "status"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[-3:]] == ["force:", "hand", "board:"]


def test_gains_alone_shows_those_in_force(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("qrobot.cli.ctl.ServoClient", Servo)
    assert run_app(make_app(), ["ctl", "gains"]) == 0
    told = capsys.readouterr().out
    assert "waist 3510.25 234 3.9 N m/rad, N m s/rad, kg m^2" in " ".join(told.split())
    assert run_app(make_app(), ["ctl", "gains", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kp"][0] == 3510.25


@pytest.mark.parametrize("command", ["status", "gains"])
def test_numbers_of_another_robot_are_not_told_as_those_of_this_file(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.cli.ctl.ServoClient", Servo)
    monkeypatch.setattr(Servo, "status", lambda _: SimpleNamespace(robot="stanford"))
    assert run_app(make_app(), ["ctl", command]) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert "the servo of puma560 drives stanford, and this deployment file has puma560 there" in " ".join(
        told.err.split()
    )


def test_fences_are_told_with_the_one_that_is_nearest_first(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.cli.ctl.ServoClient", Servo)
    assert run_app(make_app(), ["ctl", "fences"]) == 0
    head, _, *rows = (" ".join(line.split()) for line in capsys.readouterr().out.splitlines())
    assert head == "puma560: 3 fences in force"
    assert rows == [
        "bench all of the arm keeps out of a box wrist -12 20 ENTERED: motions may leave, and go no deeper",
        "itself parts of the arm keep apart wrist 10 20 within the margin: motions may leave, and come no nearer",
        "cell all of the arm stays in a cylinder wrist 300 20",
    ]
    assert run_app(make_app(), ["ctl", "fences", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [fence["distance_m"] for fence in told["fences"]] == [0.3, -0.0123, 0.01]
    monkeypatch.setattr(Servo, "fences", lambda _: ())
    assert run_app(make_app(), ["ctl", "fences"]) == 0
    assert capsys.readouterr().out == "puma560: no fences in force\n"


@pytest.mark.parametrize("value", ["nan", "inf", "-1"])
def test_gains_that_cannot_be_never_reach_a_servo(
    value: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("qrobot.cli.ctl.ServoClient", Servo)
    assert run_app(make_app(), ["ctl", "gains", f"--kp={value}", *["--kp=1"] * 5]) == 2
    assert "only 0 to 1e+12" in capsys.readouterr().err
