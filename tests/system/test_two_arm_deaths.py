"""What carries an object with two arms dies at some instant, on virtual time; the campaign `two_arms` has more."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from qrobot.rccl.arm_session import ArmSession
from qrobot.rccl.task_group import TaskGroup
from qrobot.rci.client import Client
from tests.support import two_arm_deaths
from tests.support.thorough import wide
from tests.support.two_arm_deaths import Death, carry_until, deaths, judge

DEATHS = list(deaths(3))
OF_EACH_KIND = list({death.kind: death for death in DEATHS}.values())


@pytest.mark.parametrize(
    "death",
    [*OF_EACH_KIND, *wide(*(death for death in DEATHS if death not in OF_EACH_KIND))],
    ids=lambda death: f"{death.kind}-{death.victim}-{death.after_s:.2f}",
)
def test_whatever_dies_the_other_arm_stops_on_its_path_and_what_both_hold_is_not_torn(death: Death) -> None:
    assert judge(death).wrong == ""


def test_a_trial_repeats_itself_to_the_bit() -> None:
    death = Death("bridge", "right", 0.4)
    first, again = carry_until(death), carry_until(death)
    for name, rows in first.rows.items():
        assert np.array_equal(rows["q"], again.rows[name]["q"])


@pytest.mark.thorough
def test_a_program_that_waits_for_a_dead_servo_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Client, "_warn", lambda *_: None)
    assert "right goes on" in judge(Death("servo", "left", 0.4)).wrong


def test_an_arm_that_is_left_to_its_servo_would_be_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TaskGroup, "lose", TaskGroup.leave)
    monkeypatch.setattr(two_arm_deaths, "ending", nullcontext)
    try:
        assert "right has fault" in judge(Death("bridge", "left", 0.4)).wrong
    finally:
        ArmSession.end_all(well=False)
