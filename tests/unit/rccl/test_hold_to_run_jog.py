"""Hold-to-run jog on virtual time: an arm in lock-step, and keys that are held from one instant to another."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.rccl.held_key import REPEAT_MS
from qrobot.rccl.held_motion import BRAKE_MS
from qrobot.rccl.hold_to_run import HeldJog
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.checks.hold_to_run import PATIENCE_NS
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.units import MM_PER_M, NS_PER_MS
from tests.support.puma import ROBOT

PERIOD_MS, FIRST_MS, NEXT_MS = 28.0, 300.0, 33.0
START_MS = 400.0  # when the first key is pressed
Typed = list[tuple[float, str]]


def held(key: str, begin_ms: float, end_ms: float) -> Typed:
    """What a terminal makes of a key that is held."""
    repeats = np.arange(begin_ms + FIRST_MS, end_ms, NEXT_MS)
    return [(begin_ms, key), *((t, key) for t in repeats.tolist())]


class Desk:
    """An arm in lock-step at its start pose, and somebody at its keys."""

    def __init__(self, *typed: Typed) -> None:
        self.rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
        self.said: list[str] = []
        self._typed = sorted(entry for entries in typed for entry in entries)
        self._now_ms: Callable[[], float] = lambda: 0.0

    def read_keys(self) -> str:
        came = [key for t, key in self._typed if t <= self._now_ms()]
        del self._typed[: len(came)]
        return "".join(came)

    def jog(
        self, spoil: Callable[[rccl.Channel], None] = lambda _arm: None, frame: rccl.Transform | None = None
    ) -> Desk:
        with rccl.use(partial(link_factory, self.rig, round(PERIOD_MS * 1e3))), rccl.control() as arm:
            self._now_ms = lambda: arm.time
            jog = HeldJog(arm, self.read_keys, self.said.append, frame=frame)
            spoil(arm)
            jog.run()
        return self

    @property
    def rows(self) -> Rows:
        return self.rig.rows()


def moving(rows: Rows) -> Rows:
    """Rows in which the reference moves."""
    return rows[np.abs(rows["v_ref"]).max(axis=1) > 1e-9]


def test_a_joint_moves_at_its_speed_while_the_key_is_held_and_no_other_does() -> None:
    desk = Desk([(100.0, "3")], held(".", START_MS, 2400.0), [(3500.0, "q")]).jog()
    rows, there = desk.rows, moving(desk.rows)
    assert set(rows["fault"].tolist()) == {FaultCode.NONE}
    assert np.abs(np.delete(there["v_ref"], 2, axis=1)).max() < 1e-3
    assert np.median(there["v_ref"][:, 2]) == pytest.approx(0.1, rel=1e-2)
    assert there["v_ref"][:, 2].max() < 0.115  # the interpolation overshoots where the acceleration ends
    assert there["v_ref"][:, 2].min() > -0.015
    lasted_ms = (there["t_ns"][-1] - there["t_ns"][0]) / NS_PER_MS
    last_ms = 2400.0 - START_MS - FIRST_MS
    assert last_ms - 2 * PERIOD_MS < lasted_ms < last_ms + REPEAT_MS + BRAKE_MS
    assert Mode(int(rows["mode"][-1])) is Mode.HOLDING
    assert desk.said[-1].startswith("at ")


@pytest.mark.parametrize(("key", "way"), [(".", 1.0), (",", -1.0)])
@pytest.mark.parametrize("frame", ["b", "t", "n"])
def test_the_tool_goes_straight_along_its_axis(key: str, way: float, frame: str) -> None:
    desk = Desk([(100.0, "x"), (400.0, frame)], held(key, 700.0, 2500.0), [(4000.0, "q")])
    named = rccl.gentr_rpy("TABLE", 0.0, 0.0, 0.0, 30.0, 20.0, 10.0)
    desk.jog(frame=named)
    arm, rows = Arm(ROBOT), moving(desk.rows)
    poses = np.array([arm.forward(q) for q in rows["q_ref"][::10]])
    axis = {"b": np.eye(3)[0], "t": poses[0][:3, 0], "n": named.value[:3, 0]}[frame]
    travelled = (poses[:, :3, 3] - poses[0][:3, 3]) * MM_PER_M
    along = way * travelled @ axis
    assert set(desk.rows["fault"].tolist()) == {FaultCode.NONE}
    assert 40.0 < along[-1] < 120.0  # 1.5 s at 50 mm/s, and to rest
    assert np.abs(travelled - np.outer(travelled @ axis, axis)).max() < 0.1
    assert np.abs(poses[:, :3, :3] - poses[0][:3, :3]).max() < 1e-3
    assert np.diff(along).min() > -0.02  # mm: a quintic between the setpoints of a stop overshoots by some micrometres


def test_one_stroke_moves_nothing() -> None:
    desk = Desk([(START_MS, ".")], [(2000.0, "q")]).jog()
    assert np.abs(desk.rows["v_ref"]).max() < 1e-9


def test_the_end_of_a_range_is_no_fault() -> None:
    desk = Desk([(100.0, "5"), (400.0, "f"), (700.0, "f")], held(".", 1000.0, 15_000.0), [(16_000.0, "q")]).jog()
    assert desk.rows["q"][-1][4] == pytest.approx(ROBOT.limits.q_max[4] - 0.01, abs=2e-3)
    assert set(desk.rows["fault"].tolist()) == {FaultCode.NONE}


def test_where_no_straight_path_leads_on_the_arm_stops_and_says_so() -> None:
    desk = Desk([(100.0, "x"), (400.0, "f"), (700.0, "f")], held(".", 1000.0, 14_000.0), [(15_000.0, "q")]).jog()
    assert any(line.startswith("error: ") for line in desk.said)
    assert Mode(int(desk.rows["mode"][-1])) is Mode.HOLDING
    assert set(desk.rows["fault"].tolist()) == {FaultCode.NONE}


@pytest.mark.parametrize("key", [".", ","])
def test_a_jog_that_hangs_with_its_key_held_is_stopped_by_the_servo(key: str) -> None:
    """Its main thread no longer brakes, and its samples say that the key is let go."""

    def hang(arm: rccl.Channel) -> None:
        arm.stop = lambda _ms=0.0: arm.waitas(lambda: False)  # type: ignore[method-assign]

    desk = Desk([(100.0, "1")], held(key, START_MS, 2000.0))
    with pytest.raises(ServoFault, match="HOLD_TO_RUN"):
        desk.jog(hang)
    rows = desk.rows
    stop = rows[rows["mode"] == Mode.STOPPING]
    let_go_ms = 2000.0 + REPEAT_MS + BRAKE_MS + PATIENCE_NS / NS_PER_MS
    began_ms = (stop["t_ns"][0] - rows["t_ns"][0]) / NS_PER_MS
    assert began_ms < let_go_ms + 10 * PERIOD_MS
