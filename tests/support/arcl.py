"""ARCL programs off line: a robot that begins at the paper's PARK, and what goes out to it."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from qrobot.arcl import (
    ARCL_AMI,
    ARCL_START,
    EQ,
    T6,
    TL,
    arcl_close,
    arcl_errproc,
    arcl_open,
    makeposition,
    sym_delete,
    sym_names,
)
from qrobot.arcl.c.dispatcher import ArclDispatcher
from qrobot.arcl.opened import open_robots
from qrobot.arcl.program import end_all
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.switches import Switches, switches
from qrobot.arcl.trans import new_trans_value
from qrobot.c_transport.program import run_served
from qrobot.config import load_robot
from qrobot.config.signals import NamedSignal
from qrobot.model.transform import rpy, transform
from qrobot.rccl.c.program import rccl_dispatcher
from qrobot.rci.machine_choice import MachineChoice, TeachPendant, use_machine

EXAMPLES = Path(__file__).parents[2] / "examples/arcl"
SIGNALS = (
    NamedSignal(name="lamps", outputs=(3, 4)),
    NamedSignal(name="pressure", analog=6, per_volt=2.0, unit="bar"),
    NamedSignal(name="power", analog_output=2, per_volt=20.0, unit="percent"),
)
ANALOG_RANGES = {2: (0.0, 5.0)}
PARK = (0.0, 90.0, -90.0, 0.0, 90.0, 0.0)  # degrees


def forget_programs() -> None:
    """Leave nothing of an earlier program behind."""
    arcl_errproc(None)
    for name in sym_names():
        sym_delete(name)
    switches.__dict__.update(Switches().__dict__)
    for rp in open_robots():
        rp.abandon()
    end_all(well=False)


def offline(*attributes: Any, start: tuple[float, ...] = PARK) -> ArclRobot:
    return arcl_open(ARCL_AMI, "offline", ARCL_START, start, *attributes)


def at(x: float, y: float, z: float, pitch: float = 90.0, *terms: Any):
    """T6 at a place, mm, with a pitch in degrees; `terms` behind it."""
    goal = new_trans_value("goal", transform(rpy(0.0, np.radians(pitch), 0.0), [x / 1e3, y / 1e3, z / 1e3]))
    return makeposition(T6, EQ, goal, *terms, TL, terms[-1] if terms else goal)


@contextmanager
def recorded(rp: ArclRobot) -> Iterator[list[np.ndarray]]:
    """The setpoints of each sample, degrees."""
    rows: list[np.ndarray] = []
    sample = rp.ami._cycle

    def cycle(seen):
        rows.append(np.degrees(sample(seen)))
        return np.radians(rows[-1])

    rp.ami._cycle = cycle
    yield rows
    rp.ami._cycle = sample


def run_example(
    name: str, folder: Path, *arguments: str, ami: str = "offline", pendant: TeachPendant | None = None
) -> None:
    """An example as it is, with its streams in a folder."""
    argv = sys.argv
    sys.argv = [str(EXAMPLES / name), *arguments]
    try:
        with use_machine(MachineChoice(ami, folder, pendant=pendant)):
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    finally:
        sys.argv = argv
        for rp in open_robots():
            arcl_close(rp)


def keys_of_a_terminal(*typed: tuple[float, str]) -> Callable[[], str]:
    """Keys at their times, ms, of a pendant that reads them once per sample of 28 ms."""
    samples, left = count(), sorted(typed)

    def read() -> str:
        now_ms = next(samples) * 28.0
        came = [key for t_ms, key in left if t_ms <= now_ms]
        del left[: len(came)]
        return "".join(came)

    return read


HELD = [(500.0, "."), *((800.0 + 33.0 * k, ".") for k in range(40))]
"""A key that is held for a second and a half: of the jog's two, the one that moves onwards."""


def run_c(
    program: Path, folder: Path, *arguments: str, ami: str = "offline", pendant: TeachPendant | None = None
) -> int:
    """A program in C off line, with its streams in a folder; its exit status."""
    try:
        with use_machine(MachineChoice(ami, folder, load_robot("puma560"), SIGNALS, pendant, ANALOG_RANGES)):
            return run_served(program, arguments, [rccl_dispatcher(), ArclDispatcher])
    finally:
        forget_programs()
