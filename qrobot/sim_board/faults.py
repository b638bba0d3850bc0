"""Faults of an emulated board, and the text in which one is written down.

Modelled on PX4's failure injection: a component, a kind of fault, and when. One line says it all:

    encoder:2 stuck @1.5s +0.5s         joint 2's encoder counts nothing for half a second, 1.5 s from now
    dac:1 gain 0.8                      from now on amplifier 1 gives 80 % of the torque asked for
    estop pressed @2s +100ms

Joints are numbered from 1, as people do. Kinds a component does not have are refused by name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

from qrobot.config.document import Table, check_document, read_document
from qrobot.config.kinds import FileKind, refuse_other_kind
from qrobot.errors import ConfigError
from qrobot.hwif.registers import N_ENCODERS


class FaultKind(NamedTuple):
    """One row of the table of faults.

    Attributes:
        number: what stands for it in board memory; tens are the component.
        component, name: how it is called.
        what: what happens to it.
        per_joint: it befalls one joint, which has to be named.
        default: value when none is given; None for a kind that takes no value.
        low, high: range of the value.
        unit: of the value.
        once: it happens at an instant and has no duration.
    """

    number: int
    component: str
    name: str
    what: str
    per_joint: bool = True
    default: float | None = None
    low: float = 0.0
    high: float = 0.0
    unit: str = ""
    once: bool = False

    @property
    def address(self) -> str:
        """Beginning of a line that names the component."""
        return f"{self.component}:JOINT" if self.per_joint else self.component


ENC_STUCK, ENC_JUMP, ENC_GARBAGE, ENC_REVERSED, ENC_SCALE, ENC_LOST, ENC_WRONG, ENC_OFF = range(10, 18)
INDEX_MISSING, INDEX_DOUBLE = 20, 21
POT_NOISY, POT_DEAD, POT_WRONG = 30, 31, 32
ADC_STOPPED: Final = 40
DAC_STUCK, DAC_FULL, DAC_GAIN_OFF, DAC_DEAD = 50, 51, 52, 53
POWER_DROP, POWER_FAILED = 60, 61
BRAKE_STUCK, BRAKE_SLIPS, BRAKE_SLOW = 70, 71, 72
ESTOP_HELD: Final = 80
BOARD_OFF, BOARD_FROZEN, BOARD_SLOW, BOARD_INTERMITTENT, BOARD_DEAF = range(90, 95)
ARM_PUSHED: Final = 100

KINDS: Final = (
    FaultKind(ENC_STUCK, "encoder", "stuck", "counts nothing; what was not counted stays lost"),
    FaultKind(
        ENC_JUMP, "encoder", "jump", "jumps and goes on from there", True, 2000, -32000, 32000, "counts", once=True
    ),
    FaultKind(ENC_GARBAGE, "encoder", "garbage", "reads a random word"),
    FaultKind(ENC_REVERSED, "encoder", "reversed", "counts the wrong way"),
    FaultKind(ENC_SCALE, "encoder", "scale", "counts so many times what it should", True, 1.01, -10, 10, "times"),
    FaultKind(ENC_LOST, "encoder", "lost", "loses one of so many rising counts", True, 1000, 1, 1e6, "counts"),
    FaultKind(ENC_WRONG, "encoder", "wrong", "reads so much more while it lasts", True, 500, -32000, 32000, "counts"),
    FaultKind(ENC_OFF, "encoder", "off", "gives neither counts nor index pulses, as with its cable pulled out"),
    FaultKind(INDEX_MISSING, "index", "missing", "gives no index pulse"),
    FaultKind(INDEX_DOUBLE, "index", "double", "gives a second index pulse half a revolution off"),
    FaultKind(POT_NOISY, "pot", "noise", "is so many times as noisy", True, 10, 0, 10000, "times"),
    FaultKind(POT_DEAD, "pot", "dead", "reads zero volts"),
    FaultKind(POT_WRONG, "pot", "wrong", "reads so much more", True, 0.5, -10, 10, "V"),
    FaultKind(ADC_STOPPED, "adc", "stuck", "shows its last code for every channel", False),
    FaultKind(DAC_STUCK, "dac", "stuck", "holds the word it had"),
    FaultKind(DAC_FULL, "dac", "full", "holds word 4095, or 0 for a negative value", True, 1, -1, 1, "sign"),
    FaultKind(DAC_GAIN_OFF, "dac", "gain", "gives so much of the torque", True, 0.8, -1, 1, "times"),
    FaultKind(DAC_DEAD, "dac", "dead", "gives no torque"),
    FaultKind(POWER_DROP, "power", "drop", "falls off and may be switched on again", False, once=True),
    FaultKind(POWER_FAILED, "power", "off", "is off and does not come on", False),
    FaultKind(BRAKE_STUCK, "brake", "stuck", "does not release"),
    FaultKind(BRAKE_SLIPS, "brake", "slips", "holds with so much of its torque", True, 0.05, 0, 1, "times"),
    FaultKind(BRAKE_SLOW, "brake", "slow", "acts so much later, on every joint", False, 300, 0, 60000, "ms"),
    FaultKind(ESTOP_HELD, "estop", "pressed", "is pressed", False),
    FaultKind(BOARD_OFF, "board", "off", "reads this word at every input", False, 0xFFFF, 0, 0xFFFF, "word"),
    FaultKind(BOARD_FROZEN, "board", "frozen", "publishes no new image", False),
    FaultKind(BOARD_SLOW, "board", "slow", "shows its inputs so much later", False, 5, 0, 60, "ms"),
    FaultKind(
        BOARD_INTERMITTENT, "board", "intermittent", "reads 0xFFFF in this share of images", False, 0.5, 0, 1, "share"
    ),
    FaultKind(BOARD_DEAF, "board", "deaf", "loses what is written to it", False),
    FaultKind(ARM_PUSHED, "arm", "pushed", "is pushed at the joint, by so much", True, 30, -1000, 1000, "N.m or N"),
)
COMPONENTS: Final = tuple(dict.fromkeys(kind.component for kind in KINDS))
_BY_NAME: Final = {(kind.component, kind.name): kind for kind in KINDS}

_SECONDS: Final = {"ms": 1e-3, "s": 1.0}
_TIME: Final = re.compile(r"([@+])(\d+\.?\d*|\.\d+)(ms|s)")
MOST_S: Final = 1e9  # of a start or a duration: thirty years, which the board's nanoseconds can count
_EXAMPLE: Final = '"encoder:2 stuck @1.5s +0.5s"'


@dataclass(frozen=True)
class Fault:
    """One thing that breaks.

    Attributes:
        component: what breaks, one of `COMPONENTS`.
        kind: how, see `KINDS`.
        joint: whose, from 1; for the components that joints have.
        start_s: when, seconds after it was injected.
        duration_s: for how long; None is for good.
        value: how much, in the kind's unit; None is the kind's default.

    Raises:
        ConfigError: the component has no such kind, or joint, time or value make no sense for it.
    """

    component: str
    kind: str
    joint: int | None = None
    start_s: float = 0.0
    duration_s: float | None = None
    value: float | None = None

    def __post_init__(self) -> None:
        if (self.component, self.kind) not in _BY_NAME:
            _refuse_name(self.component, self.kind)
        row = self.row
        name = f"{self.component} {self.kind}"
        if row.per_joint and (self.joint is None or not 1 <= self.joint <= N_ENCODERS):
            raise ConfigError(f"{name}: which joint? Write {self.component}:1 to {self.component}:{N_ENCODERS}")
        if not row.per_joint and self.joint is not None:
            raise ConfigError(f"{name} befalls no single joint: write {self.component} without a number")
        if not 0.0 <= self.start_s <= MOST_S:
            raise ConfigError(f"{name}: it cannot begin at {self.start_s} s; give 0 to {MOST_S:g} s from now on")
        if row.once and self.duration_s is not None:
            raise ConfigError(f"{name} happens at an instant: leave the duration out")
        if self.duration_s is not None and not 0.0 < self.duration_s <= MOST_S:
            raise ConfigError(f"{name}: it cannot last {self.duration_s} s; leave the duration out for good")
        self._check_value(row)

    def _check_value(self, row: FaultKind) -> None:
        if self.value is None:
            return
        if row.default is None:
            raise ConfigError(f"{self.component} {self.kind} takes no value, not {self.value:g}")
        if not row.low <= self.value <= row.high:
            raise ConfigError(
                f"{self.component} {self.kind}: {self.value:g} {row.unit} is out of range {row.low:g} to {row.high:g}"
            )

    @property
    def row(self) -> FaultKind:
        """Its row of the table."""
        return _BY_NAME[self.component, self.kind]

    @property
    def amount(self) -> float:
        """Its value, the default filled in; 0 for a kind without."""
        return self.value if self.value is not None else (self.row.default or 0.0)

    @classmethod
    def parse(cls, line: str) -> Fault:
        """Read `component[:joint] kind [value] [@start] [+duration]`; times in s or ms. Raises ConfigError."""
        words = line.split()
        if len(words) < 2:
            raise ConfigError(f"fault {line!r}: say what breaks and how, as in {_EXAMPLE}")
        component, joint = _component(words[0], line)
        start_s, duration_s, value = 0.0, None, None
        for word in words[2:]:
            time = _TIME.fullmatch(word)
            if time is None:
                value = _number(word, line)
            elif time[1] == "@":
                start_s = float(time[2]) * _SECONDS[time[3]]
            else:
                duration_s = float(time[2]) * _SECONDS[time[3]]
        return cls(component, words[1], joint, start_s, duration_s, value)

    def __str__(self) -> str:
        joint = "" if self.joint is None else f":{self.joint}"
        value = "" if self.value is None else f" {self.value:.9g}"
        start = f" @{self.start_s:.9g}s" if self.start_s else ""
        duration = "" if self.duration_s is None else f" +{self.duration_s:.9g}s"
        return f"{self.component}{joint} {self.kind}{value}{start}{duration}"


@dataclass(frozen=True)
class FaultPlan:
    """Faults to inject together, and the seed of what is random in them."""

    faults: tuple[Fault, ...] = ()
    seed: int = 0

    @classmethod
    def parse(cls, lines: Iterable[str], seed: int = 0) -> FaultPlan:
        """A plan of one fault per line. Raises ConfigError."""
        return cls(tuple(Fault.parse(line) for line in lines), seed)

    @classmethod
    def load(cls, path: Path) -> FaultPlan:
        """A plan from a TOML file with the keys `faults`, a list of lines, and `seed`. Raises ConfigError."""
        refuse_other_kind(path, FileKind.FAULTS)
        plan = check_document(PlanFile, read_document(path), str(path))
        return cls.parse(plan.faults, plan.seed)


class PlanFile(Table):
    """A file of faults."""

    faults: list[str]
    seed: int = 0


def kind_of(number: int) -> FaultKind:
    """The row with that number. Raises ConfigError when there is none: somebody has damaged the board memory."""
    for kind in KINDS:
        if kind.number == number:
            return kind
    raise ConfigError(f"the board memory holds a fault of kind {number}, which does not exist: restart the board")


def _component(word: str, line: str) -> tuple[str, int | None]:
    name, colon, joint = word.partition(":")
    if colon and not joint.isdecimal():
        raise ConfigError(f"fault {line!r}: after the colon stands the number of a joint, as in {_EXAMPLE}")
    return name, int(joint) if colon else None


def _number(word: str, line: str) -> float:
    try:
        return float(int(word, 0)) if word.lower().startswith("0x") else float(word)
    except (ValueError, OverflowError):
        raise ConfigError(
            f"fault {line!r}: {word!r} is no value, no start (@1.5s) and no duration (+0.5s or +20ms)"
        ) from None


def _refuse_name(component: str, kind: str) -> NoReturn:
    known = [row.name for row in KINDS if row.component == component]
    if known:
        raise ConfigError(f"{component} has no fault {kind!r}{_meant(kind, known)}, only {', '.join(known)}")
    raise ConfigError(f"nothing called {component!r} can break{_meant(component, COMPONENTS)}: {', '.join(COMPONENTS)}")


def _meant(word: str, known: Iterable[str]) -> str:
    near = get_close_matches(word, list(known), n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""
