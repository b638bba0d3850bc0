"""The end of any task at any run stops its own arm on its path, and changes nothing for any other."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rci
from qrobot.errors import QRobotError
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from tests.support.puma import PARK, ROBOT
from tests.support.thorough import examples

SAMPLES = 60
NAMES = ("left", "right", "watch")
BEAT = 14  # ticks of 1 ms between two runs of the task without an arm
Rows = dict[str, np.ndarray]


class EndedError(Exception):
    """What a task ends by."""


def program(dies: str, run: int, way: str) -> tuple[Rows, list[int], list[str]]:
    """Telemetry of both arms, ticks at which `watch` ran, and what the program was told.

    Args:
        dies: name of the task that ends.
        run: of it, at which it does.
        way: "raises", "leaves the range" or "is released".
    """
    rigs = {name: LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)) for name in ("left", "right")}
    beats: list[int] = []
    told: list[str] = []

    def swing(td: rci.TaskDescriptor) -> None:
        end_at(td)
        q = np.array(PARK)
        q[0] += 0.2 * (1.0 - np.cos(2.0 * np.pi * min(td.runs / SAMPLES, 1.0)))
        if td.name == dies and td.runs >= run and way == "leaves the range":
            q[0] = 10.0
        td.chg.go_to(tuple(q.tolist()))

    def watch(td: rci.TaskDescriptor) -> None:
        end_at(td)
        beats.append(rci.rci_ticks())

    def end_at(td: rci.TaskDescriptor) -> None:
        if td.name == dies and td.runs == run and way == "raises":
            raise EndedError(f"{td.name} has ended")

    with rci.use({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()}):
        rci.rci_clock(1000)
        for name in rigs:
            rci.rci_robot(name, "puma560")
        tasks = {name: rci.rci_create(name) for name in NAMES}
        for name, td in tasks.items():
            rci.rci_control(td, watch if name == "watch" else swing)
            rci.rci_onclock(td, BEAT if name == "watch" else 28)
        rci.rci_start(sum(td.bit for td in tasks.values()))
        end = rci.rci_ticks() + 28 * (SAMPLES + 20)
        while rci.rci_ticks() < end:
            try:
                victim = tasks.get(dies)
                if way == "is released" and victim is not None and victim.active and victim.runs >= run:
                    rci.rci_release(victim.bit)
                now = rci.rci_ticks()
                rci.rci_wait(lambda now=now: rci.rci_ticks() > now)
            except (QRobotError, EndedError) as error:
                told.append(str(error))
        rci.rci_close()
    for rig in rigs.values():
        rig.run_for(0.5)
    return {name: rig.rows() for name, rig in rigs.items()}, beats, told


@cache
def undisturbed() -> tuple[Rows, list[int], list[str]]:
    """The program in which nothing ends before its time."""
    return program("", 0, "")


@given(st.sampled_from(NAMES), st.integers(0, SAMPLES), st.sampled_from(["raises", "leaves the range", "is released"]))
@settings(max_examples=examples(12))
def test_a_task_that_ends_stops_its_arm_and_nothing_else(dies: str, run: int, way: str) -> None:
    if dies == "watch" and way == "leaves the range":
        way = "raises"
    rows, beats, told = program(dies, run, way)
    whole, all_beats, nothing = undisturbed()
    assert nothing == []
    assert len(told) == (way != "is released"), told
    for name in ("left", "right"):
        if name == dies:
            mine = rows[name]
            assert not mine["fault"].any()
            assert mine[-1]["mode"] == Mode.HOLDING
            assert np.abs(mine["v_ref"][-100:]).max() < 1e-9
            assert np.abs(mine["v_ref"]).max() <= 1.1 * ROBOT.limits.v_max.max()
            assert (mine["q_ref"] >= ROBOT.limits.q_min).all()
            assert (mine["q_ref"] <= ROBOT.limits.q_max).all()
        else:
            shorter = min(len(rows[name]), len(whole[name]))
            assert shorter > 28 * SAMPLES
            assert np.array_equal(rows[name]["q_ref"][:shorter], whole[name]["q_ref"][:shorter])
    if dies != "watch":
        assert beats == all_beats
