"""Machine layers by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from qrobot.arcl.machine.bridge import BridgeMachine
from qrobot.arcl.machine.ceded import CededMachine
from qrobot.arcl.machine.interface import MachineSettings, RobotMachine
from qrobot.arcl.machine.offline import OfflineMachine
from qrobot.arcl.machine.position_loops import LoopMachine
from qrobot.arcl.machine.stepper import StepperMachine
from qrobot.errors import ConfigError

MachineMaker: TypeAlias = Callable[[MachineSettings], RobotMachine]

_MAKERS: Final[dict[str, MachineMaker]] = {
    "bridge": BridgeMachine,
    "ceded": CededMachine,
    "loops": LoopMachine,
    "offline": OfflineMachine,
    "stepper": StepperMachine,
}
EMULATED: Final = frozenset({"ceded", "loops", "offline", "stepper"})
"""Layers whose arm is inside the program, on virtual time: no sample comes too late for them."""


def register_machine(name: str, maker: MachineMaker) -> None:
    """Make a machine layer known under a name."""
    _MAKERS[name] = maker


def machine_names() -> list[str]:
    """Names that `machine` takes."""
    return sorted(_MAKERS)


def machine(name: str, settings: MachineSettings) -> RobotMachine:
    """A machine of the layer of that name. Raises ConfigError: there is none, and what the layer raises."""
    if name not in _MAKERS:
        raise ConfigError(f"no machine layer {name!r}; there are {', '.join(machine_names())}")
    return _MAKERS[name](settings)
