"""One body in the hands of two arms: a MuJoCo model of both, and the forces that they put on each other through it.

The body is welded to a hand, softly as every weld of MuJoCo, where it is when that hand takes it. Until then it stands
where it was put, on a weld to the world. What one arm does the other feels, whatever the joints of either can bear: the
force between the hands that does not carry the body is what tears it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.model.transform import inverse, quaternion, transform
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.mujoco_library import link_library
from qrobot.sim_board.mujoco_plant import robot_spec, step_model
from qrobot.sim_board.plant import Plant, plant_step

if TYPE_CHECKING:
    import mujoco

BODY: Final = "held"
STAND: Final = "stand"
SOFTNESS_S: Final = 0.004  # time constant of a weld [A]: a hand's jaws give way a little
_NUMBERS_OF_A_WELD: Final = 3  # anchor; then where the body is in the hand, its quaternion, and a scale of torque


class ArmInModel:
    """Owner of the plant of one arm of a model of several.

    Args:
        model, data: of all.
        first: index of its first joint among all.
        robot: the arm.
        steps: this arm is the one whose step moves the model on; it is to be the last one in turn.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, first: int, robot: Robot, steps: bool) -> None:
        self._model, self._data, self._steps = model, data, steps
        self._mine = slice(first, first + robot.n)

    @property
    def plant(self) -> Plant:
        """See `PlantOwner.plant`."""
        data, mine = self._data, self._mine
        handles = np.array([self._model._address, data._address])
        step = plant_step(step_model if self._steps else _leave_to_the_other)
        return Plant(step, handles, np.zeros(1), data.qpos[mine], data.qvel[mine], data.qfrc_applied[mine])

    def place(self, q: Floats) -> None:
        """See `PlantOwner.place`: the other arm stays where it is."""
        import mujoco

        self._data.qpos[self._mine], self._data.qvel[self._mine] = q, 0.0
        mujoco.mj_forward(self._model, self._data)


class HeldBody:
    """Two arms and a body that both can hold.

    Args:
        robots: the arms; their joints are the first in the model, in this order.
        bases: poses of the arms' base frames in the world. Shape (2, 4, 4).
        pose: of the body in the world, where it stands at first. Shape (4, 4).
        mass_kg: of the body, a cube of the density of water.
        dt: time step, s.

    Attributes:
        arms: owners of the arms' plants, for `Emulator(plant=...)`. Time passes with a step of the second one.

    Raises:
        ConfigError: MuJoCo refuses masses or inertias, or the body has none.
    """

    def __init__(
        self,
        robots: tuple[Robot, Robot],
        bases: Sequence[Floats],
        pose: Floats,
        mass_kg: float = 1.0,
        dt: float = 0.00025,
    ) -> None:
        import mujoco

        if not mass_kg > 0.0:
            raise ConfigError(f"the body has to have a mass, and {mass_kg} kg is none")
        spec = _spec_of(robots, bases, mass_kg, dt)
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise ConfigError(f"two arms with a body of {mass_kg} kg cannot be simulated: {error}") from error
        self._data = mujoco.MjData(self._model)
        link_library()
        first, second = robots
        self.arms = (
            ArmInModel(self._model, self._data, 0, first, steps=False),
            ArmInModel(self._model, self._data, first.n, second, steps=True),
        )
        self._hands = [self._model.body(f"{k}{robot.joint_names[-1]}").id for k, robot in enumerate(robots)]
        self._welds = [self._model.equality(f"{BODY}{k}").id for k in range(len(robots))]
        self._stand, self._body = self._model.equality(STAND).id, self._model.body(BODY).id
        self._put(pose)

    @property
    def pose(self) -> Floats:
        """Pose of the body in the world. Shape (4, 4)."""
        return self._pose_of(self._body)

    def hold(self, hand: int) -> None:
        """Hand 0 or 1 takes the body, as and where both are; it stands on its own no longer."""
        self._tie(self._welds[hand], inverse(self._pose_of(self._hands[hand])) @ self.pose)
        self._data.eq_active[self._stand] = 0

    def let_go(self, hand: int) -> None:
        """Hand 0 or 1 opens; when none is left, the body stays where it is."""
        self._data.eq_active[self._welds[hand]] = 0
        if not any(self._data.eq_active):
            self._tie(self._stand, self.pose)

    @property
    def forces(self) -> Floats:
        """Forces of the body on either hand in the last step, N, in the world. Shape (2, 3)."""
        return np.array([self._force(weld) for weld in self._welds])

    @property
    def tension(self) -> float:
        """Force by which the hands pull the body apart, N, along the line between them; negative when they press it.

        It is half the difference of what both do along that line, so that a body which is only carried has none when
        both carry alike.
        """
        left, right = (self._pose_of(hand)[:3, 3] for hand in self._hands)
        line = (right - left) / np.linalg.norm(right - left)
        of_left, of_right = self.forces
        return float(0.5 * (of_left - of_right) @ line)

    def _put(self, pose: Floats) -> None:
        import mujoco

        self._data.qpos[-7:] = [*pose[:3, 3], *quaternion(pose)]
        self._tie(self._stand, pose)
        mujoco.mj_forward(self._model, self._data)

    def _tie(self, weld: int, there: Floats) -> None:
        """Let a weld hold the body at `there` (4, 4), as seen from what holds it, from now on."""
        numbers = self._model.eq_data[weld]
        numbers[:_NUMBERS_OF_A_WELD] = 0.0
        numbers[_NUMBERS_OF_A_WELD : _NUMBERS_OF_A_WELD + 7] = [*there[:3, 3], *quaternion(there)]
        self._data.eq_active[weld] = 1

    def _pose_of(self, body: int) -> Floats:
        return transform(self._data.xmat[body].reshape(3, 3), self._data.xpos[body])

    def _force(self, weld: int) -> Floats:
        import mujoco

        data = self._data
        equality = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        rows = np.flatnonzero(equality & (data.efc_id[: data.nefc] == weld))[:3]
        return data.efc_force[rows].copy() if rows.size else np.zeros(3)


def _spec_of(robots: tuple[Robot, Robot], bases: Sequence[Floats], mass_kg: float, dt: float) -> Any:
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    children = [robot_spec(robot, dt) for robot in robots]
    for name in ("timestep", "gravity", "integrator", "jacobian"):
        setattr(spec.option, name, getattr(children[0].option, name))
    off = mujoco.mjtDisableBit
    spec.option.disableflags = children[0].option.disableflags & ~int(off.mjDSBL_EQUALITY | off.mjDSBL_CONSTRAINT)
    for k, (robot, base, child) in enumerate(zip(robots, bases, children, strict=True)):
        child.option.disableflags = spec.option.disableflags
        floor = base @ transform(translation=[0.0, 0.0, -robot.geometry.base_height_m])
        frame = spec.worldbody.add_frame(pos=floor[:3, 3], quat=quaternion(floor))
        spec.attach(child, prefix=str(k), frame=frame)
    _add_body(spec, mass_kg)
    for k, robot in enumerate(robots):
        _add_weld(spec, f"{BODY}{k}", f"{k}{robot.joint_names[-1]}")
    _add_weld(spec, STAND, "world", active=True)
    return spec


def _add_body(spec: Any, mass_kg: float) -> None:
    body = spec.worldbody.add_body(name=BODY, explicitinertial=True)
    body.add_freejoint()
    edge_m = (mass_kg / 1000.0) ** (1.0 / 3.0)
    body.mass, body.ipos, body.inertia = mass_kg, [0.0, 0.0, 0.0], [mass_kg * edge_m**2 / 6.0] * 3


def _add_weld(spec: Any, name: str, holder: str, active: bool = False) -> None:
    import mujoco

    weld = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
    weld.name1, weld.name2, weld.active = holder, BODY, active
    weld.solref = [SOFTNESS_S, 1.0]


@lean_kernel
def _leave_to_the_other(_handles: Any, _constants: Any, _q: Any, _v: Any, _torque: Any) -> None:
    """The torques stand in the model, whose step is the other arm's."""
