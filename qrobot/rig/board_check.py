"""A walk through a board that nobody has driven yet, in the order in which mistakes do least harm.

First what only reads, then what writes without arm power, then power for an instant, at last short pushes on
single joints. A step that fails ends the walk, and whatever happens, torque and power are switched off at its end; a
finding says when that is not seen to have worked. Everything goes over a `Bus`: the same walk is made on the emulated
board, on one behind a gateway, and on a card in this machine.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from qrobot.errors import QRobotError
from qrobot.hwif.registers import (
    ADC_VALUE,
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_INDEX,
    DISCRETE_J6_OVERFLOW,
    ENC_COUNT,
    ENC_LOAD,
    N_ADCS,
    N_DACS,
    N_ENCODERS,
    SCRATCH_BITS,
    STATUS,
    STATUS_ADC_BUSY,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_INDEX,
    STATUS_POWER,
)
from qrobot.rig.board_power import power_for_an_instant, push_each_joint, see_ways
from qrobot.rig.board_walk import LeftOutError, StepError, Walk, joints_named, reversed_counts
from qrobot.rig.interrupts import interrupts_deferred
from qrobot.servo.kernels.converter import code_volts

LOAD_STEP: Final = 1000  # counts added to a counter to see that it takes a load
STILL: Final = 5  # counts a standing joint may show
CONVERSION_S: Final = 0.05


@dataclass(frozen=True)
class StepResult:
    """Finding of a step; `ok` is None for one that was left out."""

    step: str
    ok: bool | None
    detail: str
    remedy: str = ""


class CheckStep(NamedTuple):
    """One step: what it does, and what it must be allowed to."""

    name: str
    look: Callable[[Walk], str]
    writes: bool = False
    powers: bool = False
    hands: bool = False  # somebody has to turn, measure or look at something
    torque: bool = False  # converters have to mean torque
    board: bool = False  # separate drives have nothing of that
    question: str = ""


@dataclass(frozen=True)
class Permissions:
    """Permissions of a walk.

    Attributes:
        read_only: write nothing.
        power: make the steps with arm power too.
        hands: somebody is there who turns joints and measures voltages.
    """

    read_only: bool = False
    power: bool = False
    hands: bool = True


def check_board(walk: Walk, allowed: Permissions) -> Generator[StepResult]:
    """Make the steps, one after the other; from the main thread. What goes wrong is a finding.

    Raises:
        StepError: the walk was broken off, and torque and power may still be on.
    """
    try:
        walk.begin()
    except QRobotError as error:
        yield StepResult(
            "find the board", False, str(error), "start it with `qrobot board`, or look at the address and the cable"
        )
        return
    try:
        yield from _make_all(walk, allowed)
    except BaseException:  # Ctrl-C, or nobody wants the other findings
        _leave_safe(walk, allowed)
        raise
    try:
        _leave_safe(walk, allowed)
    except StepError as error:
        yield StepResult("torque and power off", False, str(error), error.remedy)


def _make_all(walk: Walk, allowed: Permissions) -> Iterator[StepResult]:
    for step in STEPS:
        finding = _make(step, walk, allowed)
        yield finding
        if finding.ok is False:
            return


def _leave_safe(walk: Walk, allowed: Permissions) -> None:
    """Torque and power off, untorn by a second Ctrl-C, and let go of the board. Raises StepError."""
    try:
        if walk.seen and not allowed.read_only:
            with interrupts_deferred():
                walk.make_safe()
    except QRobotError as error:
        raise StepError(
            f"they may still be on, PRESS THE EMERGENCY STOP: {error}", "press the emergency stop"
        ) from error
    finally:
        walk.bus.close()


def _make(step: CheckStep, walk: Walk, allowed: Permissions) -> StepResult:
    if why_not := _absent(step, walk) or _forbidden(step, allowed):
        return StepResult(step.name, None, f"left out: {why_not}")
    try:
        if step.question and not walk.ask(step.question):
            return StepResult(step.name, None, "left out: not wanted")
        return StepResult(step.name, True, step.look(walk))
    except LeftOutError as error:
        return StepResult(step.name, None, f"left out: {error}")
    except StepError as error:
        return StepResult(step.name, False, str(error), error.remedy)
    except QRobotError as error:
        return StepResult(step.name, False, str(error), "look at the link to the board")


def _absent(step: CheckStep, walk: Walk) -> str:
    if step.board and walk.drives is not None:
        return "separate drives have none"
    return "drives in position mode take no torque" if step.torque and walk.drives == "position" else ""


def _forbidden(step: CheckStep, allowed: Permissions) -> str:
    if step.writes and allowed.read_only:
        return "it writes"
    if step.powers and not allowed.power:
        return "it needs arm power (--power)"
    return "it needs somebody's hands" if step.hands and not allowed.hands else ""


def see_images(walk: Walk) -> str:
    """The board answers, and not with the 0xFFFF of an empty slot."""
    walk.look()
    first = walk.count
    walk.wait(0.05)
    words = {walk.word(offset) for offset in (STATUS, *range(ENC_COUNT, ENC_COUNT + 12, 2))}
    if words == {0xFFFF}:
        raise StepError("every register reads 0xFFFF", "nothing answers at this address: check base address and cable")
    if walk.count == first:
        raise StepError("the image stands still", "does the board have power?")
    channels = min(walk.facts.joints, N_ENCODERS)
    if walk.robot.n > channels:
        raise StepError(
            f"{walk.robot.name} has {walk.robot.n} joints, the board {channels} encoder channels",
            "put right the robot, board or drives of the deployment file",
        )
    images = walk.count - first
    if not walk.keeps_time():
        raise StepError(
            "its clock goes faster or slower than that of this machine", "its time stamps are to be nanoseconds"
        )
    return f"revision {walk.facts.revision}, {walk.facts.joints} joints, {images} images in 50 ms"


def see_status(walk: Walk) -> str:
    """Emergency stop healthy, arm power off."""
    if walk.status & STATUS_POWER:
        raise StepError("arm power is on", "switch it off before anything else")
    if not walk.status & STATUS_ESTOP_OK:
        raise StepError("the emergency stop is pressed, or its chain is open", "close it; the walk needs it closed")
    calibrated = "calibrated" if walk.status & STATUS_CALIBRATED else "not calibrated"
    return f"STATUS {walk.status:#06x}: emergency stop healthy, power off, {calibrated}"


def toggle_scratch(walk: Walk) -> str:
    """Writes arrive: bits 6 and 7 of DISCRETE come back in STATUS. Zero torque is the first to be written."""
    before = walk.kept
    walk.make_safe()
    try:
        for bits in (DISCRETE_CALIBRATED, DISCRETE_J6_OVERFLOW, 0):
            walk.write((DISCRETE, bits | DISCRETE_HAND_RELAXED))
            if (back := walk.status & SCRATCH_BITS) != bits:
                raise StepError(
                    f"wrote {bits:#04x} to DISCRETE, STATUS shows {back:#04x}", "do writes reach the board?"
                )
    finally:  # a board must not be left calibrated that was not
        walk.write((DISCRETE, before))
    return "bits 6 and 7 can be written and read back"


def zero_outputs(walk: Walk) -> str:
    """Zero torque, power disabled, and the scratch bits stay."""
    kept = walk.status & SCRATCH_BITS
    walk.make_safe()
    if walk.status & SCRATCH_BITS != kept:
        raise StepError("the scratch bits did not stay", "bits 6 and 7 of DISCRETE and STATUS do not belong together")
    return "all converters at 0 V, power disabled"


def load_counters(walk: Walk) -> str:
    """Each counter takes a load, and gets its count back; until that is seen, the board is not calibrated."""
    before, kept = walk.counts(), walk.kept
    walk.write((DISCRETE, kept & ~DISCRETE_CALIBRATED))
    try:
        _add_to_counters(walk, [LOAD_STEP] * len(before))
        loaded = walk.moved(before)
    finally:
        walk.look()  # whether a load that got no answer was taken
        _add_to_counters(walk, [-LOAD_STEP * round(by / LOAD_STEP) for by in walk.moved(before)])
    steps = zip(loaded, walk.moved(before), strict=True)
    wrong = [joint + 1 for joint, (by, back) in enumerate(steps) if abs(by - LOAD_STEP) > STILL or abs(back) > STILL]
    if wrong:
        raise StepError(
            f"{joints_named(wrong)} did not take a load", "is the arm at rest? else its counter is at fault"
        )
    walk.write((DISCRETE, kept))
    return f"{len(before)} counters take a load; their counts are back"


def _add_to_counters(walk: Walk, steps: list[int]) -> None:
    """Load counters with what the newest image shows and so many counts more; those with 0 stay alone."""
    counts = enumerate(zip(walk.counts(), steps, strict=True))
    walk.write(*((ENC_LOAD + 2 * joint, count + step & 0xFFFF) for joint, (count, step) in counts if step))


def arm_indexes(walk: Walk) -> str:
    """Index flags that were preset and armed show 1 while nothing turns; what masked flags show is for the record."""
    walk.write((DISCRETE, walk.kept))
    masked = walk.status
    walk.write((DISCRETE, walk.kept | DISCRETE_INDEX))
    armed = walk.status & STATUS_INDEX
    walk.write((DISCRETE, walk.kept))
    wrong = [joint + 1 for joint in range(walk.robot.n) if not armed >> (8 + joint) & 1]
    if wrong:
        raise StepError(
            f"the index flag of {joints_named(wrong)} is not armed by its mask",
            "does the joint stand just on its index pulse? turn it a little; else the board's decoder differs",
        )
    index, bit_14 = _level(masked, STATUS_INDEX), _level(masked, STATUS_ADC_BUSY)
    return f"armed flags show 1; idle levels: index {index}, bit 14 {bit_14}"


def _level(status: int, mask: int) -> str:
    return {0: "0", mask: "1"}.get(status & mask, "mixed")


def convert_all(walk: Walk) -> str:
    """Every channel of the converter gives a result in time."""
    volts = []
    for channel in range(N_ADCS):
        base = walk.kept
        walk.write((DISCRETE, base))
        walk.start_conversion(channel, base)
        if not walk.wait(CONVERSION_S, lambda: not walk.status & STATUS_ADC_BUSY):
            walk.write((DISCRETE, base))
            raise StepError(
                f"channel {channel} is not done in {CONVERSION_S * 1e3:.0f} ms", f"is it revision {_other(walk)}?"
            )
        volts.append(code_volts(walk.word(ADC_VALUE), ord(walk.facts.revision)))
        walk.write((DISCRETE, base))
    return "volts " + " ".join(f"{value:.2f}" for value in volts)


def _other(walk: Walk) -> str:
    return "E" if walk.facts.revision == "F" else "F"


def measure_outputs(walk: Walk) -> str:
    """Converters at known voltages, without arm power, for a voltmeter."""
    word = DAC_ZERO - round(DAC_ZERO / 10)
    walk.write(*((DAC + 2 * channel, word) for channel in range(N_DACS)))
    try:
        if not walk.ask("Every analogue output now stands at +1.00 V. Does the voltmeter say so on each?"):
            raise StepError("an output is not at +1 V", "trim its zero at 0x800 first, then look at its wiring")
    finally:
        walk.write(*((DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)))
    return "+1 V on every output, by the operator's word; back at 0 V"


def turn_by_hand(walk: Walk) -> str:
    """Joints without brakes, turned by hand towards positive angles, count the right way."""
    free = [j for j in range(walk.robot.n) if not walk.robot.transmission.brake[j]]
    if not free:
        raise LeftOutError("every joint has a brake")
    told = []
    for joint in free:
        before = walk.counts()
        way = _SLIDE if walk.robot.prismatic[joint] else _TURN
        if not walk.ask(way.format(joint + 1)):
            raise StepError(f"joint {joint + 1} was not moved", "make the walk again")
        walk.look()
        by = walk.moved(before)[joint] * float(np.sign(walk.robot.transmission.rad_per_count[joint]))
        if by <= STILL:
            raise StepError(f"joint {joint + 1} counted {by:+.0f}", reversed_counts(walk))
        walk.ways_seen.add(joint)
        told.append(f"joint {joint + 1} {by:+.0f}")
    return "counts the positive way: " + ", ".join(told)


_TURN: Final = "Turn joint {} by hand towards positive angles, by some ten degrees. Done?"
_SLIDE: Final = "Slide joint {} by hand towards positive positions, by some centimetres. Done?"
_HOLD_ARM: Final = (
    "The brakes will open and the arm may sink by some degrees: is it supported or hanging, with nobody in its reach "
    "and a hand on the emergency stop?"
)
_LOOK_AT_JOINTS: Final = " Does somebody look at the joints from outside it, each with a line drawn across?"

STEPS: Final = (
    CheckStep("the board answers", see_images),
    CheckStep("status", see_status),
    CheckStep("scratch bits", toggle_scratch, writes=True),
    CheckStep("outputs to zero", zero_outputs, writes=True),
    CheckStep("counters take a load", load_counters, writes=True),
    CheckStep("index flags", arm_indexes, writes=True, board=True),
    CheckStep("converter", convert_all, writes=True, board=True),
    CheckStep(
        "analogue outputs",
        measure_outputs,
        writes=True,
        hands=True,
        board=True,
        question="Is arm power locked out, and a voltmeter at hand?",
    ),
    CheckStep(
        "encoders by hand", turn_by_hand, hands=True, question="Can the joints without brakes be turned by hand?"
    ),
    CheckStep("power for an instant", power_for_an_instant, writes=True, powers=True, question=_HOLD_ARM),
    CheckStep(
        "which way the joints go",
        see_ways,
        writes=True,
        powers=True,
        hands=True,
        torque=True,
        question=_HOLD_ARM + _LOOK_AT_JOINTS,
    ),
    CheckStep("a push on each joint", push_each_joint, writes=True, powers=True, torque=True, question=_HOLD_ARM),
)
"""In this order."""
