"""S-06 in C beside its twin in Python: in contact, where the rounding of a `float` grows, both turn the crank."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.c_transport.program import run_served
from qrobot.config.scene import Scene
from qrobot.multi_rccl.c.__main__ import other_release
from qrobot.multi_rccl.c.dispatcher import ManipDispatcher
from qrobot.rccl.c.program import run_executable
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.c_programs import (
    CHECKED,
    EXAMPLES,
    compiled,
    edited_for_manipulators,
    needs_compiler,
    needs_valgrind,
    under_valgrind,
)
from tests.support.puma import ROBOT
from tests.support.tables import crank_angle

pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache")]

SAMPLE_US = 28_000
TOUCHED_S = 3.3  # the rod has come into the hole
ROUNDING = 2e-6  # rad: fields of C programs are single precision, a part in 1e7 of some hundred millimetres or degrees
APART = 0.01  # rad, a twentieth of what any of the joints moves: what became of it after twenty seconds of contact


def one_turn(folder: Path) -> Path:
    """The source of a program that turns the crank once: it meets every direction of the contact in that."""
    text = (EXAMPLES / "c" / "s06_crank.c").read_text()
    assert "#define TURNS 4" in text
    source = folder / "once.c"
    source.write_text(text.replace("#define TURNS 4", "#define TURNS 1"))
    return source


def rig_after(program: Callable[[], object]) -> LockstepRig:
    """A rig with a crank on which a program has run."""
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, scene=Scene(kind="crank")))
    with rccl.use(partial(link_factory, rig, SAMPLE_US)):
        program()
    return rig


@pytest.mark.thorough
def test_in_c_the_crank_is_turned_on_the_way_of_its_twin_to_rounding_and_in_contact_nearly_so_s06(
    tmp_path: Path, capfd
) -> None:
    program = compiled(EXAMPLES / "c" / "s06_crank.c", tmp_path, *CHECKED)
    status: list[int] = []
    in_c = rig_after(lambda: status.append(run_executable(program)))
    assert status == [0]
    assert capfd.readouterr().out == "turned 4 times in 16.5 s\n"
    in_python = rig_after(lambda: runpy.run_path(str(EXAMPLES / "08_crank.py"), run_name="__main__"))
    assert capfd.readouterr().out == "turned 4 times in 16.5 s\n"
    rows, twin = in_c.rows(), in_python.rows()
    assert not rows["fault"].any()
    assert rows["t_ns"].tolist() == twin["t_ns"].tolist()
    off = np.abs(rows["q_ref"] - twin["q_ref"]).max(axis=1)
    free = rows["t_ns"] < rows["t_ns"][0] + TOUCHED_S * 1e9
    assert off[free].max() < ROUNDING
    assert off.max() < APART
    angles = np.degrees([crank_angle(rig.emulator) for rig in (in_c, in_python)])
    assert np.abs(angles - 4 * 360.0).max() < 2.0


@pytest.mark.thorough
def test_the_crank_is_turned_by_a_manipulator_too_after_small_edits_s06(tmp_path: Path, capfd) -> None:
    source = tmp_path / "edited.c"
    source.write_text(edited_for_manipulators(one_turn(tmp_path)))
    program = compiled(source, tmp_path)
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, scene=Scene(kind="crank")))
    with rci.use(partial(link_factory, rig, SAMPLE_US)):
        assert run_served(program, (), [other_release, other_release, ManipDispatcher]) == 0
    assert capfd.readouterr().out.startswith("turned 1 times")
    assert not rig.rows()["fault"].any()
    assert abs(np.degrees(crank_angle(rig.emulator)) - 360.0) < 2.0


@pytest.mark.thorough
@needs_valgrind
def test_valgrind_finds_nothing_while_the_crank_is_turned_s06(tmp_path: Path, capfd) -> None:
    program = under_valgrind(compiled(one_turn(tmp_path), tmp_path, "-O2", "-gdwarf-4"))
    status: list[int] = []
    rig_after(lambda: status.append(run_executable(program)))
    assert status == [0]
    assert re.fullmatch(r"turned 1 times in 4\.\d s\n", capfd.readouterr().out)
