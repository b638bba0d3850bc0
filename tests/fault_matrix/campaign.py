"""Which faults, under which conditions, within which bounds; and the table of what came of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

from qrobot.faultcodes import FaultCode
from tests.fault_matrix.trial import PUMA, Conditions, Result, Trial

SPEEDS: Final = (0.02, 0.1, 0.5, 1.0, 1.5)
SLOWEST: Final = SPEEDS[0]
STREAMS: Final = ("even", "jitter", "loss", "stalls")
JOINTS: Final = (0, 1, 2, 4)
BRAKED: Final = (0, 1, 2)
STRAY_DEG: Final = 5.0  # from the path, while the arm has torque
OVERSPEED: Final = 1.5  # of v_max, while the arm has torque


@dataclass(frozen=True)
class Fault:
    """Something that breaks and what is promised about it.

    Attributes:
        name: for the table.
        line: as it is injected, with {joint} for the joint that moves; None breaks nothing.
        codes: what the arm may be stopped for in the end; empty for any.
        reaction_ms: bound on the reaction where the fault shows at once, at rest too; infinite where it need not.
        moving_ms: the same of a joint on its way, at 0.02 rad/s and at all the other speeds.
        joints: of the arm, from 0, on which it is tried.
        stray_deg: bound on how far a joint may be from its path while it has torque.
        noticed: it has to be; what may turn out to harm nothing need not.
    """

    name: str
    line: str | None
    codes: tuple[FaultCode, ...] = ()
    reaction_ms: float = math.inf
    moving_ms: tuple[float, float] = (math.inf, math.inf)
    joints: tuple[int, ...] = JOINTS
    stray_deg: float = STRAY_DEG
    noticed: bool = True


F = FaultCode
SOON_ON_THE_WAY: Final = (250.0, 150.0)  # an encoder that counts no more: a slow joint has to lack some counts first
# Under an unknown load, a slow joint that counts backwards is first held like one that met an obstacle.
TURNED_ROUND: Final = (F.ENC_SIGN, F.RUNAWAY, F.ENC_STUCK, F.FOLLOWING, F.ENC_LOSS, F.COLLISION)
FAULTS: Final = (
    Fault("nothing", None, (F.NONE,), noticed=False),
    Fault("encoder's cable off", "encoder:{joint} off", (F.ENC_STUCK, F.FOLLOWING), math.inf, SOON_ON_THE_WAY, BRAKED),
    Fault(
        "encoder stuck",
        "encoder:{joint} stuck",
        (F.ENC_STUCK, F.ENC_LOSS, F.FOLLOWING),
        math.inf,
        SOON_ON_THE_WAY,
        BRAKED,
    ),
    Fault("encoder reversed", "encoder:{joint} reversed", TURNED_ROUND, moving_ms=(100.0, 100.0)),
    Fault("encoder garbage", "encoder:{joint} garbage", (F.ENC_JUMP, F.RUNAWAY), 10.0),
    Fault("encoder jump", "encoder:{joint} jump 3000", (F.ENC_JUMP,), 10.0),
    Fault("motor at full torque", "dac:{joint} full", reaction_ms=50.0),
    Fault("motor at full torque backwards", "dac:{joint} full -1", reaction_ms=50.0),
    Fault("motor dead", "dac:{joint} dead", noticed=False),
    Fault("motor torque stuck", "dac:{joint} stuck", noticed=False),
    Fault("brake closed", "brake:{joint} stuck", joints=BRAKED, noticed=False),
    Fault("power drops", "power drop", (F.POWER_LOST,), 5.0),
    Fault("emergency stop", "estop pressed", (F.ESTOP,), 5.0),
    Fault("board frozen", "board frozen", (F.BOARD_GONE,), 10.0),
    Fault("board reads ones", "board off", (F.BOARD_GONE,), 5.0),
)


@dataclass(frozen=True)
class Row:
    """A fault, its conditions and what came of it."""

    fault: Fault
    conditions: Conditions
    result: Result

    @property
    def _bound_ms(self) -> float:
        """Bound on the reaction under these conditions."""
        slow, others = self.fault.moving_ms if self.conditions.moving else (math.inf, math.inf)
        return min(self.fault.reaction_ms, slow if self.conditions.speed == SLOWEST else others)

    @property
    def wrong(self) -> str:
        """In which way it is out of its bounds; empty for none."""
        result, fault, degrees = self.result, self.fault, math.degrees(self.result.strayed_rad)
        unnoticed = fault.noticed and result.code is F.NONE
        late = not unnoticed and result.reaction_s * 1e3 > self._bound_ms
        misnamed = bool(fault.codes) and result.code is not F.NONE and result.name not in fault.codes
        reasons = (
            (result.false_alarm, "stopped before anything broke"),
            (fault.line is None and result.code is not F.NONE, "stopped although nothing broke"),
            (unnoticed, "not noticed"),
            (misnamed, f"first called {result.code.name}"),
            (late, f"reaction after {result.reaction_s * 1e3:.0f} ms"),
            (not degrees <= fault.stray_deg, f"{degrees:.1f} degrees off the path"),
            (not result.fastest <= OVERSPEED, f"{result.fastest:.1f} times the speed limit"),
        )
        said = ", ".join(text for wrong, text in reasons if wrong)
        return said and f"{said}, {result.ends.name}"


def conditions(every: int = 1) -> Iterator[Conditions]:
    """Combinations of the conditions: all of them, or one of so many."""
    everything = product(JOINTS, SPEEDS, (True, False), (False, True), STREAMS, (1, -1))
    for place, (joint, speed, moving, loaded, stream, direction) in enumerate(everything):
        if speed > 0.95 * PUMA.limits.v_max[joint] or place % every:
            continue
        yield Conditions(joint, speed, moving, loaded, stream, 1000.0, direction)


def run(fault: Fault, under: Iterable[Conditions]) -> list[Row]:
    """Try `fault` under each of the conditions that it is made for."""
    return [
        Row(fault, each, Trial(each).run(fault.line and fault.line.format(joint=each.joint + 1)))
        for each in under
        if each.joint in fault.joints
    ]


def table(rows: list[Row]) -> str:
    """The worst of each fault, as Markdown; times are those of faults in motion that were noticed."""
    lines = [
        "| what breaks | trials | out of bounds | noticed | called | first reaction | torque gone | off the path |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for fault in dict.fromkeys(row.fault for row in rows):
        lines.append(_line(fault, [row for row in rows if row.fault is fault]))
    return "\n".join(lines)


def _line(fault: Fault, rows: list[Row]) -> str:
    noticed = [row.result for row in rows if row.result.code is not F.NONE]
    called = sorted({result.name.name for result in noticed})
    moving = [row.result for row in rows if row.conditions.moving and row.result.code is not F.NONE]
    reaction = max((result.reaction_s for result in moving), default=math.inf)
    cut = max((result.cut_s for result in moving if math.isfinite(result.cut_s)), default=math.inf)
    stray = max(math.degrees(row.result.strayed_rad) for row in rows)
    wrong = sum(bool(row.wrong) for row in rows)
    return (
        f"| {fault.name} | {len(rows)} | {wrong} | {len(noticed)} | {', '.join(called) or '-'} "
        f"| {_ms(reaction)} | {_ms(cut)} | {stray:.1f}° |"
    )


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.0f} ms" if math.isfinite(seconds) else "-"
