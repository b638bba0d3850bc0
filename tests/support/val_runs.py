"""VAL II programs run off line: an ideal arm on virtual time, by RCCL or ARCL, what is typed kept in a list."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from qrobot import rci
from qrobot.config import load_robot
from qrobot.rccl.connect import open_channel
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import VirtualLink
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.val.arcl_arm import arcl_arm
from qrobot.val.arm import ValArm
from qrobot.val.interpreter import Interpreter
from qrobot.val.rccl_arm import RcclArm
from qrobot.val.source import read_source
from tests.support.fake_robot import FakeRobot

EXAMPLES = Path(__file__).parents[2] / "examples/val"

PLACES = """
.LOCATIONS
a 450 150 0 90 90 0
b 450 -150 0 90 90 0
.END
"""


class Typed(list[str]):
    """The lines that programs typed, and the answers that they get."""

    def __init__(self, *answers: str) -> None:
        super().__init__()
        self.answers = list(answers)

    def ask(self, _text: str) -> str:
        return self.answers.pop(0)


@contextmanager
def ideal_arm(library: str = "rccl", period_ms: float = 28.0) -> Iterator[ValArm]:
    """A PUMA 560 that is where it was told to be."""
    if library == "rccl":
        with open_channel(OfflineLink, "puma560", period_ms) as channel:
            yield RcclArm(channel)
    else:
        with (
            use_machine(MachineChoice("offline", None, load_robot("puma560"), analog_ranges={1: (0.0, 10.0)})),
            arcl_arm(load_robot("puma560"), period_ms) as arm,
        ):
            yield arm


@contextmanager
def faked_arm(fake: FakeRobot, library: str) -> Iterator[ValArm]:
    """An arm over the link to `fake`, a PUMA 560."""
    if library == "rccl":
        with open_channel(lambda hello: VirtualLink(hello, fake.transfer), "puma560") as channel:
            yield RcclArm(channel)
    else:
        with rci.use(lambda hello: VirtualLink(hello, fake.transfer)), arcl_arm(load_robot("puma560")) as arm:
            yield arm


@contextmanager
def interpreter(
    text: str = "", *answers: str, library: str = "rccl", period_ms: float = 28.0
) -> Iterator[tuple[Interpreter, Typed]]:
    """An interpreter with the programs of `text`, without their first blanks, on an ideal arm."""
    source, errors = read_source(text)
    assert errors == []
    typed = Typed(*answers)
    with ideal_arm(library, period_ms) as arm:
        run = Interpreter(arm, typed.append, typed.ask)
        run.machine.arm.override = 100.0
        run.machine.load(source)
        yield run, typed


def number(run: Interpreter, name: str) -> float:
    """The value of a variable of that name, which is a number."""
    value = run.machine.values[name, ()]
    assert isinstance(value, float)
    return value


def main_program(*lines: str, rest: str = "") -> str:
    """A file with a program `main` of these lines."""
    return "\n".join([".PROGRAM main", *lines, ".END", rest])


def interrupt_at(run: Interpreter, sample: int) -> None:
    """Ctrl-C in the sample of this number, from now, and never again."""
    count, sampled = iter(range(1_000_000)), run.machine.arm.sample

    def look() -> None:
        sampled()
        if next(count) == sample:
            raise KeyboardInterrupt

    run.machine.arm.sample = look  # type: ignore[method-assign]
