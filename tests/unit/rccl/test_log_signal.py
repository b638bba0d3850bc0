"""Numbers of a program's own: from its calls into the rows of the arm's log, with their names."""

from __future__ import annotations

from math import nan
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.log.export import table_columns
from qrobot.log.plot import figures_of
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.log.summary import sensed
from qrobot.rccl.offline import OfflineLink
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.log_samples import make_header
from tests.support.puma import ROBOT


def test_a_programs_numbers_are_in_the_log_by_name_until_it_lets_go(tmp_path: Path) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid", start="ready"))
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.log_signal("depth", 1.5)
        arm.waitas(iter([False] * 3 + [True]).__next__)
        arm.log_signal("parts", 3)
        arm.log_signal("depth", 2.0)
        arm.sample(20)  # a connection anew: the names go along
        arm.log_signal("depth", nan)
        arm.waitas(iter([False] * 3 + [True]).__next__)
        assert rig.mailbox.signal_names() == ("depth", "parts")
        with pytest.raises(MotionError, match="letters, digits and underscores"):
            arm.log_signal("two words", 1.0)
        with pytest.raises(MotionError, match="log_signal"):
            arm.log_signal("depth", "deep")  # type: ignore[arg-type]
    assert rig.mailbox.signal_names() == ()
    write_log(tmp_path / "run.mcap", rig.rows(), make_header(), laws=rig.laws_in_force())
    log = read_log(tmp_path / "run.mcap")
    assert log.program_signal_names == ("depth", "parts")
    columns = table_columns(log)
    depth = columns["program_signals_depth"]
    assert set(depth[~np.isnan(depth)].tolist()) == {1.5, 2.0}
    assert {"depth 1.5 to 2", "parts 3 to 3"} <= set(sensed(log))
    assert "signals" in figures_of(log)


def test_numbers_of_one_program_do_not_get_the_names_of_the_next(tmp_path: Path) -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, physics="rigid", start="ready"))
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)):
        for name in ("force", "height"):
            with rccl.control(ROBOT.name) as arm:
                arm.log_signal(name, 1.5)
                arm.waitas(iter([False] * 3 + [True]).__next__)
    write_log(tmp_path / "run.mcap", rig.rows(), make_header(), laws=rig.laws_in_force())
    log = read_log(tmp_path / "run.mcap")
    ticks = log.rows["tick"][~np.isnan(log.rows["program_signals"][:, 0])].tolist()
    told = [log.maybe_law_at(tick) for tick in (ticks[0], ticks[-1], ticks[-1] + 1)]
    assert [law.program_signals for law in told if law is not None] == ["force", "height", ""]
    assert log.program_signal_names == ()
    assert "program_signals_1" in table_columns(log)


def test_a_ninth_name_is_refused_and_a_load_is_believed_off_line() -> None:
    with rccl.use(OfflineLink), rccl.control(ROBOT.name) as arm:
        for k in range(8):
            arm.log_signal(f"s{k}", k)
        with pytest.raises(MotionError, match="9 signals: 8 at most"):
            arm.log_signal("s8", 8.0)
        arm.setload(2.0, (0.0, 0.0, 50.0))
        assert arm.how.payload_mass == 2.0
        arm.waitas(iter([False] * 6 + [True]).__next__)
        assert np.abs(arm.exerted.torque).max() < 0.01 * ROBOT.guard.tau_max.max()
        with pytest.raises(MotionError, match="a centre has 3 numbers"):
            arm.setload(2.0, (0.0, 0.0))
