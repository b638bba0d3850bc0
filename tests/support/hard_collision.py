"""An arm in lock-step that turns hard, and whose tool meets a wall in the middle of an acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.scene import Scene
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.model.transform import quaternion, transform
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.sim_board.mujoco_plant import PlantMemory
from qrobot.sim_board.mujoco_scene import FURNITURE
from tests.support.campaign import FRAME_NS, FRAME_S, PUMA, N
from tests.support.dead_encoder import TABLE
from tests.support.hard_streams import swings_of
from tests.support.puma import arm

JOINTS = ((0,), (1,), (2,), (3, 4), (4,), (0, 1, 2), tuple(range(N)))
DRAWS = (None, 0, 2, 4)
FAR = Scene(kind="table", position_m=(0.0, 0.0, -5.0))  # the wall, until it is put before the tool
GAP_M = 0.001
DELAY_FRAMES = 2.5  # by which the reference is behind the newest setpoint: its look-ahead, and half a frame in hand
HARD = 0.5  # of a_max
FAST_M_S = 0.15  # of the tool's end
DEPTH_M, WRIST_M = 0.1, 0.04  # by which the path goes on beyond the wall; by the wrist alone
WRIST = 3  # first joint of it
AHEAD = 12  # frames in which it does
HONEST = frozenset({FaultCode.COLLISION, FaultCode.SATURATED, FaultCode.RUNAWAY})
MOST_BEHIND = 0.9  # of the following error: no bound of another watch has to find it
MOST_PRESSING_N = 60.0  # in the end
MOST_TILT = np.radians(40.0)  # of the wall, to the way of the tool
FLOOR_M = 0.05 - PUMA.geometry.base_height_m  # no lower before the wall
DEEPEST = 4  # frames that may be played by the time that the wall is there
STEP_S = 1e-6
CYCLE_S = 0.001
AFTER_MS = 800  # by which everything stands


@dataclass(frozen=True)
class Case:
    """What is tried.

    Attributes:
        joints: that turn, indices. seed: of their turns, and of where and how the wall stands.
        draw: of the mismatched plant, None for the nominal one.
    """

    joints: tuple[int, ...]
    seed: int
    draw: int | None = None


@dataclass(frozen=True)
class Result:
    """What came of it.

    Attributes:
        code: that stopped the arm, NONE if nothing did. last: told in the end. mode: in which it ended.
        after_ms: from the first touch to that.
        share: of a_max that the reference had of a joint when the wall was put there. speed: of the tool then, m/s.
        behind: largest following error until the stop, as a share of the one that is allowed.
        force: largest on the tool, N. pressing: the same in the end.
    """

    code: FaultCode
    last: FaultCode
    mode: Mode
    after_ms: int
    share: float
    speed: float
    behind: float
    force: float
    pressing: float

    @property
    def honest(self) -> bool:
        """The arm was stopped for what had happened, before a joint was as far behind as it may be, and let go."""
        stands = self.mode in (Mode.HOLDING, Mode.FAULT) and self.pressing <= MOST_PRESSING_N
        return stands and self.code in HONEST and self.behind <= MOST_BEHIND


class HardTurn:
    """A trial; `run` tells what came of it, None for turns without a place for a wall."""

    def __init__(self, case: Case) -> None:
        self._random = np.random.default_rng((case.seed, *case.joints))
        self.rows = swings_of(self._random, FRAME_S, 0.9, case.joints)
        mismatch = PlantMismatch.nominal(N) if case.draw is None else PlantMismatch.mismatched(N, seed=case.draw)
        self._case, self._mismatch = case, mismatch

    def _start(self) -> None:
        emulator = Emulator(PUMA, start="end", scene=FAR, mismatch=self._mismatch)
        velocity = "observer" if self._case.seed % 2 else "difference"
        settings = ServoSettings(rate_hz=1000.0, velocity=velocity, calibration=TABLE)
        self.rig = LockstepRig(PUMA, settings, emulator)
        assert isinstance(emulator.plant, PlantMemory)
        self._plant = emulator.plant
        self.rig.run_for(0.3)
        self.rig.mailbox.request_power(True)
        self.rig.run_for(0.5)
        assert self.rig.state.mode == Mode.HOLDING
        self.rows = self.rows + np.array(self.rig.state.q_ref) - self.rows[0]

    def place(self) -> tuple[int, Floats] | None:
        """A frame at which the path accelerates hard with a fast tool, and the way into a wall into which it goes on.

        None where there is none.
        """
        step = np.diff(self.rows, axis=0) / FRAME_S
        share = np.abs(np.diff(step, axis=0) / FRAME_S / PUMA.limits.a_max).max(axis=1)
        ends = np.array([tool_ends(q) for q in self.rows])
        depth = WRIST_M if min(self._case.joints) >= WRIST else DEPTH_M
        for k in self._random.permutation(np.arange(1, len(self.rows) - AHEAD)):
            ways = ends[k + 1] - ends[k]
            fastest = ways[int(np.argmax(np.linalg.norm(ways, axis=1)))]
            fast = float(np.linalg.norm(fastest))
            if ends[: k + DEEPEST, :, 2].min() < FLOOR_M:
                continue
            if share[k - 1] < HARD or fast < FAST_M_S * FRAME_S:
                continue
            inwards = tilted(fastest / fast, self._random)
            gone = (ends[k : k + AHEAD] @ inwards).max(axis=1)
            if gone.max() - gone[0] > depth:
                return int(k), inwards
        return None

    def run(self) -> Result | None:
        """Put a wall there, and see."""
        place = self.place()
        if place is None:
            return None
        self._start()
        k, inwards = place
        return self._go(round((k + DELAY_FRAMES + self._random.uniform()) * FRAME_S / CYCLE_S), inwards)

    def _go(self, wall_ms: int, inwards: Floats) -> Result | None:
        """None where the arm was stopped before: the tool is a load of which nobody told."""
        rig = self.rig
        for ms in range(wall_ms):
            self._cycle(ms)
        if rig.state.mode != Mode.TRACKING:
            return None
        share = float((np.abs(rig.state.a_ref) / PUMA.limits.a_max).max())
        speed, forces, behind, stopped, code = self._put_wall(inwards), [], 0.0, -1, FaultCode.NONE
        for ms in range(wall_ms, wall_ms + AFTER_MS):
            self._cycle(ms)
            forces.append(float(np.linalg.norm(self._plant.contact_force())))
            if stopped < 0:
                late = np.abs(np.array(rig.state.q_ref) - np.array(rig.state.q)) / PUMA.guard.following_error
                behind = max(behind, float(late.max()))
            if stopped < 0 and rig.state.mode != Mode.TRACKING:
                stopped, code = len(forces), FaultCode(rig.state.event)
        first = int(np.argmax(np.array(forces) > 0.0)) + 1
        last, mode = FaultCode(rig.state.event), Mode(rig.state.mode)
        return Result(code, last, mode, stopped - first, share, speed, behind, max(forces), forces[-1])

    def _cycle(self, ms: int) -> None:
        """Send the setpoint that is due, and let a cycle pass."""
        seq, within = divmod(ms, round(FRAME_S / CYCLE_S))
        if within == 0 and seq < len(self.rows):
            modes = [POSITION_SETPOINT] * N
            self.rig.mailbox.push_setpoint(1, seq, self.rig.now_ns, FRAME_NS, modes, self.rows[seq].tolist())
        self.rig.ticks(1)

    def _put_wall(self, inwards: Floats) -> float:
        """Put the wall before the tool; the speed of the tool towards it, m/s."""
        data, model = self._plant.data, self._plant.model
        q, v = np.array(data.qpos[:N]), np.array(data.qvel[:N])
        ends = tool_ends(q)
        first = ends[int(np.argmax(ends @ inwards))]
        z = -inwards
        x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
        x /= np.linalg.norm(x)
        turn = transform(np.column_stack([x, np.cross(z, x), z]))
        data.mocap_quat[model.body(FURNITURE).mocapid] = quaternion(turn)
        self._plant.move_scene(first + (FAR.tool.radius_m + GAP_M) * inwards)
        return float(((tool_ends(q + STEP_S * v) - ends) @ inwards).max() / STEP_S)


def tilted(way: Floats, random: np.random.Generator) -> Floats:
    """`way` (3,) turned about a random axis across it, by up to `MOST_TILT`."""
    across = np.cross(way, random.normal(size=3))
    across /= np.linalg.norm(across)
    angle = random.uniform(0.0, MOST_TILT)
    return np.asarray(np.cos(angle) * way + np.sin(angle) * np.cross(across, way))


def tool_ends(q: Floats) -> Floats:
    """Middles of the round ends of the tool in the base frame, m. Shape (2, 3)."""
    T, tool = arm().forward(q), FAR.tool
    heights = PUMA.geometry.flange_m + np.array([tool.radius_m, tool.length_m - tool.radius_m])
    return np.asarray(T[:3, 3] + heights[:, None] * T[:3, 2])


def cases(times: int) -> list[Case]:
    """So many trials, evenly over joints that turn and plants."""
    return [Case(JOINTS[k % len(JOINTS)], k, DRAWS[k // len(JOINTS) % len(DRAWS)]) for k in range(times)]
