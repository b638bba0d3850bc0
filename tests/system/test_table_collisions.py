"""The tool comes down on a table, on virtual time: at every speed and by every joint it is told as what it is.

The servo has its calibration table, as the packaged deployment does. A collision has to be COLLISION, and leave the arm
held: the stop gives way, so that after the blow itself there is no force left.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from qrobot.config.scene import Scene
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.sim_board.mujoco_plant import PlantMemory
from tests.support.campaign import FRAME_NS, FRAME_S, PUMA, Floats, N
from tests.support.dead_encoder import TABLE, reference
from tests.support.pressing import tip_down
from tests.support.puma import arm

TOP = -0.3  # m, of the table
FROM_NEAR = 60.0  # mm/s, up to which 10 mm are room enough to speed up in
ELBOW = 250.0  # mm/s, to which joint 3 may accelerate in this test
SPEEDS = (10.0, 30.0, 60.0, 120.0, 250.0, 400.0)  # mm/s
PLACES = {"down": (0.5, 0.0, 0.0), "down aside": (0.4, 0.3, 0.0), "slanting": (0.5, 0.0, 0.5)}  # x, y, outwards
Path = Callable[[float], Floats]


class CollidingArm:
    """An arm whose tool hangs above the table at (x, y), holding."""

    def __init__(self, x: float, y: float, height: float, draw: int | None = None) -> None:
        scene = Scene(kind="table", position_m=(x, y, TOP))
        self.start = tip_down(x, y, TOP + height, scene)
        mismatch = PlantMismatch.nominal(N) if draw is None else PlantMismatch.mismatched(N, seed=draw)
        plant = Emulator(PUMA, start=self.start, scene=scene, mismatch=mismatch)
        self.scene, self.rig = scene, LockstepRig(PUMA, ServoSettings(rate_hz=1000.0, calibration=TABLE), plant)
        self.rig.run_for(0.3)
        self.rig.mailbox.request_power(True)
        self.rig.run_for(0.5)
        assert self.mode is Mode.HOLDING
        self.here = np.array(self.rig.mailbox.snapshot().q_setpoint)

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    def follow(self, path: Path, longest_s: float) -> list[FaultCode]:
        """Go the path, rad from the start at each time, until the servo stops; the codes it told, in order."""
        for seq in range(round(longest_s / FRAME_S)):
            q = self.here + path(seq * FRAME_S)
            self.rig.mailbox.push_setpoint(1, seq, self.rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
            self.rig.run_for(FRAME_S)
            if seq > 0 and self.mode is not Mode.TRACKING:
                break
        self.rig.run_for(0.4)
        faults = [FaultCode.NONE, *map(FaultCode, self.rig.rows()["fault"])]
        return [code for before, code in pairwise(faults) if code not in (before, FaultCode.NONE)]


def collide(speed: float, place: tuple[float, float, float], draw: int | None = None) -> tuple[list[FaultCode], Mode]:
    """Codes and last mode of an arm whose tool comes down straight, or slanting."""
    x, y, outwards = place
    height = 0.04 if speed > FROM_NEAR else 0.01
    one = CollidingArm(x, y, height, draw)

    def path(t: float) -> Floats:
        way = reference(speed * 1e-3, t)
        return tip_down(x + outwards * way, y, TOP + height - way, one.scene) - one.start

    codes = one.follow(path, (height + 0.1) / (speed * 1e-3))
    return codes, one.mode


def swing(speed: float, joint: int) -> tuple[list[FaultCode], Mode]:
    """The same by one joint alone, its tip at `speed` down where it begins."""
    one = CollidingArm(0.6, 0.1, 0.02)
    axis, length = np.eye(N)[joint - 1], PUMA.geometry.flange_m + one.scene.tool.length_m

    def height(q: Floats) -> float:
        T = arm().forward(q)
        return float(T[2, 3] + T[2, 2] * length)

    lever = (height(one.start + 1e-4 * axis) - height(one.start)) / 1e-4
    codes = one.follow(lambda t: axis * reference(-speed * 1e-3 / lever, t), 0.15 / (speed * 1e-3))
    return codes, one.mode


def is_told_as_a_collision(codes: list[FaultCode], mode: Mode) -> bool:
    return codes == [FaultCode.COLLISION] and mode is Mode.HOLDING


@pytest.mark.sampled(6)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_tool_that_comes_down_on_a_table_is_told_as_a_collision(speed: float, place: str) -> None:
    codes, mode = collide(speed, PLACES[place])
    assert is_told_as_a_collision(codes, mode), (codes, mode)


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("speed", "joint"), [(speed, joint) for joint in (2, 3) for speed in SPEEDS if joint == 2 or speed <= ELBOW]
)
def test_it_is_by_one_joint_alone_as_well(speed: float, joint: int) -> None:
    codes, mode = swing(speed, joint)
    assert is_told_as_a_collision(codes, mode), (codes, mode)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("draw", [0, 1])
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_wrong_model_does_not_change_the_name(speed: float, draw: int) -> None:
    codes, mode = collide(speed, PLACES["slanting"], draw)
    assert is_told_as_a_collision(codes, mode), (codes, mode)


def force_on(one: CollidingArm) -> float:
    """Force on the tool now, N."""
    plant = one.rig.emulator.plant
    assert isinstance(plant, PlantMemory)
    return float(np.linalg.norm(plant.contact_force()))


# N s within 0.2 s of the first touch, and ms above 200 N: it was 9.6 and 19, 27.9 and 34, 28.3 and 32 with a stop that
# went on along its path.
@pytest.mark.parametrize(("speed", "impulse", "pressing_ms"), [(120.0, 4.5, 10), (250.0, 10.0, 9), (400.0, 14.0, 8)])
def test_after_the_blow_itself_the_arm_does_not_press_on(speed: float, impulse: float, pressing_ms: int) -> None:
    x, y, _ = PLACES["down"]
    one = CollidingArm(x, y, 0.04)
    forces = []
    for seq in range(round(0.14 / (speed * 1e-3) / FRAME_S) + 20):
        if seq < 3 or one.mode is Mode.TRACKING:
            way = reference(speed * 1e-3, seq * FRAME_S)
            q = one.here + tip_down(x, y, TOP + 0.04 - way, one.scene) - one.start
            one.rig.mailbox.push_setpoint(1, seq, one.rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        for _ in range(round(FRAME_S / 0.001)):
            one.rig.run_for(0.001)
            forces.append(force_on(one))
    blow = np.array(forces[int(np.argmax(np.array(forces) > 1.0)) :])
    assert 0.1 * impulse < 0.001 * blow[:200].sum() <= impulse
    assert np.sum(blow > 200.0) <= pressing_ms
    assert blow[-20:].max() <= 20.0
    assert one.mode is Mode.HOLDING
