"""The ARCL Machine Interface: the way to an arm, usable alone and chosen by name (Corke & Kirkham, section 3.2)."""

from qrobot.arcl.machine.bridge import BridgeMachine
from qrobot.arcl.machine.interface import MachineSample, MachineSettings, PathKeeper, RobotMachine, SetpointCycle
from qrobot.arcl.machine.offline import OfflineMachine
from qrobot.arcl.machine.registry import machine, machine_names, register_machine

__all__ = [
    "BridgeMachine",
    "MachineSample",
    "MachineSettings",
    "OfflineMachine",
    "PathKeeper",
    "RobotMachine",
    "SetpointCycle",
    "machine",
    "machine_names",
    "register_machine",
]
