"""Random streams within what the joints may do, none of their frames lost: nothing of the arm is told as broken.

Neither on an arm whose friction, torque and weight differ from its model. With a load of which nobody told it, such an
arm has not the torque for all of them: it is stopped for that, and for nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.campaign import PUMA, N
from tests.support.hard_streams import stream

LARGEST_SHARE = 0.8  # of the bound, of the torque nobody commanded, on an arm that is as its model says
STRANGERS = (0, 2, 4, 7, 10, 13)  # mismatched plants; with each of the others it ends in the same ways
TWO_THIRDS = 2.0 / 3.0  # of the joints take part


def push_share(rig: LockstepRig) -> Callable[[], float]:
    """Largest torque that nobody commanded now, of any joint, as a share of its bound."""
    push, threshold = rig.state.watch.push, rig.state.watch.threshold  # views, taken once: Python is slow to find them
    return lambda: float((np.abs(push) / threshold).max())


@dataclass(frozen=True)
class End:
    """How a stream ended.

    Attributes:
        mode: of the servo. code: for which it was stopped first. largest: see `push_share`.
    """

    mode: Mode
    code: FaultCode
    largest: float


def play(rig: LockstepRig, rows: Floats, period_ms: int, look_ms: int = 1) -> End:
    """Send `rows`, `period_ms` apart, to an arm that is powered for it, until they or the arm are stopped.

    The torque that nobody commanded is looked at every `look_ms`.
    """
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    share, largest, before = push_share(rig), 0.0, rig.rows().size
    for seq, q in enumerate(rows):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, period_ms * 1_000_000, [POSITION_SETPOINT] * N, q.tolist())
        for _ in range(period_ms // look_ms):
            rig.ticks(look_ms)
            largest = max(largest, share())
        if seq > 0 and rig.state.mode in (Mode.HOLDING, Mode.FAULT):
            break
    events = rig.rows()["fault"][before:]
    return End(Mode(rig.state.mode), FaultCode(int(events[np.argmax(events != FaultCode.NONE)])), largest)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("share", [0.5, 0.9])
@pytest.mark.parametrize("period_ms", [7, 28])
@pytest.mark.parametrize("velocity", ["difference", "observer"])
def test_no_legal_stream_looks_like_something_broken(velocity: str, period_ms: int, share: float, seed: int) -> None:
    rig = LockstepRig(PUMA, ServoSettings(velocity=velocity, pots=False), Emulator(PUMA, start="end", physics="rigid"))
    rows = stream(np.random.default_rng(seed), period_ms / 1000, share, 1.0 if seed % 2 else TWO_THIRDS)
    end = play(rig, rows, period_ms)
    assert (end.mode, end.code) == (Mode.TRACKING, FaultCode.NONE)
    assert end.largest < LARGEST_SHARE


def strangers(draw: int, payload_kg: float) -> list[End]:
    """How streams end on the mismatched plant `draw` with a load of which nobody told."""
    mismatch, ends = PlantMismatch.mismatched(N, seed=draw), []
    for velocity, period_ms, share, turn in product(["difference", "observer"], [7, 28], [0.5, 0.9], range(2)):
        plant = Emulator(PUMA, start="end", physics="rigid", mismatch=mismatch, payload_kg=payload_kg)
        rows = stream(np.random.default_rng(2 * draw + turn), period_ms / 1000, share, 1.0 if turn else TWO_THIRDS)
        rig = LockstepRig(PUMA, ServoSettings(velocity=velocity, pots=False), plant)
        ends.append(play(rig, rows, period_ms, look_ms=period_ms))  # how it ends is all that is asked
    return ends


@pytest.mark.sampled(2)
@pytest.mark.parametrize("draw", STRANGERS)
def test_none_does_on_an_arm_that_differs_from_its_model(draw: int) -> None:
    ends = strangers(draw, 0.0)
    assert {(end.mode, end.code) for end in ends} == {(Mode.TRACKING, FaultCode.NONE)}


def test_with_a_load_that_nobody_told_an_arm_is_stopped_for_want_of_torque_and_held() -> None:
    ends = [end for draw in STRANGERS for end in strangers(draw, 2.5)]
    stopped = [end for end in ends if end.code is not FaultCode.NONE]
    assert {end.code for end in stopped} <= {FaultCode.SATURATED, FaultCode.FOLLOWING, FaultCode.VEL_LIMIT}
    held = [end for end in stopped if end.mode is Mode.HOLDING]
    assert {end.code for end in held} == {FaultCode.SATURATED}
    assert len(stopped) - len(held) < 0.15 * len(ends)
    assert len(stopped) < 0.7 * len(ends)
