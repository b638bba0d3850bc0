"""Interface of a plant: arrays, and the address of the function that moves them on by one time step.

One type for all kinds of physics, so that everything which steps a plant is compiled once and cached, as with laws.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.pointer import KernelPointer, function_at

Physics = Literal["mujoco", "rigid"]

_VECTOR: Final = types.float64[::1]
_SIGNATURE: Final = types.void(types.int64[::1], _VECTOR, _VECTOR, _VECTOR, _VECTOR)
_step_at = function_at(_SIGNATURE)


class Plant(NamedTuple):
    """A plant compiled code can step; its owner keeps what the arrays and addresses refer to alive."""

    step: int  # address of a kernel of `handles`, `constants`, `q`, `v`, `torque`: see `plant_step`
    handles: NDArray[np.int64]  # addresses the step needs, if any
    constants: Floats  # numbers the step needs, if any
    q: Floats  # [n] joint positions
    v: Floats  # [n] joint velocities
    torque: Floats  # [n] torques applied to the joints until the next step


class PlantOwner(Protocol):
    """Interface of the owner of a plant."""

    @property
    def plant(self) -> Plant:
        """Plant for compiled code; valid while the owner lives."""

    def place(self, q: Floats) -> None:
        """Put the arm at `q` (n,) at rest."""


def plant_step(body: Callable[..., None]) -> int:
    """`Plant.step` of a kernel of (handles, constants, q, v, torque), which moves `q` and `v` on and has to live on."""
    return KernelPointer(body, _SIGNATURE).address


@lean_kernel
def step_plant(plant: Plant) -> None:
    """Advance the plant by its time step under `plant.torque`."""
    _step_at(plant.step)(plant.handles, plant.constants, plant.q, plant.v, plant.torque)
