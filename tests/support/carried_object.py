"""Two running arms carry one object up and down; what their logs say of it when one of them is lost.

Frames of both arms that have one number are of one instant in either arm's time, and telemetry names the frame that is
played. Where the time of one emulated arm stood still for longer than that of the other, that arm is so much behind by
the wall's clock, at which processes are killed.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.modecodes import Mode
from qrobot.model.transform import inverse
from qrobot.servo.memory.telemetry import Rows
from tests.support.c_programs import EXAMPLES
from tests.support.missed_frames import MISSED_BITS, in_time
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import UNHURRIED_MS, RunningArm, qrobot
from tests.support.stall_watch import RECENT_S, StreamLostError
from tests.support.two_hands import GRIP, WORLD, hand, hand_of, off

PERIOD_S: Final = UNHURRIED_MS * 1e-3
SPEED_M_S: Final = 0.1
MIDDLE_M: Final = -0.02  # height from which on it goes up at that speed for more than a second
BEFORE: Final = 300  # cycles before the loss that are looked at
SLOWER: Final = 0.97  # [A] of its speed: a hand slows down; at full speed it keeps to a hundredth
ASIDE_M: Final = 5e-4  # [A] of the straight line, on which joints interpolate and go on for two frames
SWINGS_M: Final = 0.1 * PERIOD_S * SPEED_M_S  # [A] a curve through setpoints that stop at once, by 0.04 of a step
SEEN_S: Final = 2.0 * RECENT_S  # [A] from a kill until a program has ended and what became of it was read
STEP_NS: Final = 4_000_000
CARRY: Final = """
high, low = (make_position(TRANS, EQ, gentr_rpy("PLACE", 480, 0, mm, 0, 180, 0), TL, TRANS) for mm in (150, -100))
setvel(obj, 100, 30)
while True:
    move(obj, low)
    wait_for(obj.completed)
    print("up it goes", flush=True)
    move(obj, high)
    wait_for(obj.completed)
"""


@contextmanager
def carrying(arms: list[RunningArm], directory: Path) -> Iterator[subprocess.Popen[str]]:
    """The program of `examples/22_two_hands.py` carries the object further; inside, it goes up at full speed.

    Raises StreamLostError: an arm has lost its stream on the way there.
    """
    text = (EXAMPLES / "22_two_hands.py").read_text().split("lifted =")[0]
    for name, arm in zip(WORLD, arms, strict=True):
        text = text.replace(f'"{name}"', f'"{arm.name}"')
    path = directory / "carry.py"
    path.write_text(text.replace("rccl_control(obj)", f"rccl_control(obj, period_ms={UNHURRIED_MS})") + CARRY)
    program = qrobot("run", "--deployment", arms[0].deployment, path)
    try:
        told = program.stdout is not None and any("up it goes" in line for line in program.stdout)
        wait_until(lambda: not told or program.poll() is not None or _is_half_way(arms[0]), "the object is half way up")
        if not told or program.poll() is not None:
            complaint = program.communicate(timeout=PATIENCE_S)[1]
            require_in_time("STREAM_LOST" not in complaint, complaint)
            raise AssertionError(complaint)
        yield program
    finally:
        program.kill()
        program.communicate(timeout=PATIENCE_S)


def _is_half_way(left: RunningArm) -> bool:
    return bool(hand("left", np.array(left.snapshot().q))[2, 3] > MIDDLE_M)


def require_in_time(well: bool, told: str) -> None:
    """Raise StreamLostError for what a stall of this machine may explain, and nothing else."""
    if not well:
        raise StreamLostError(told, SEEN_S)


def rows_since(arms: list[RunningArm], ticks: dict[str, int]) -> dict[str, Rows]:
    """Telemetry of both arms from a little before these ticks until both are at rest, by hand."""
    rows = {}
    for name, arm in zip(WORLD, arms, strict=True):
        arm.wait_for(Mode.HOLDING)
        rows[name] = rows_of(arm, ticks[name])
    return rows


def rows_of(arm: RunningArm, tick: int) -> Rows:
    """Telemetry of an arm from a little before this tick."""
    rows = arm.telemetry()
    return rows[rows["tick"] > tick - BEFORE]


def last_frame(rows: Rows) -> int:
    """Number of the newest frame that came and was followed."""
    return int(_heard(rows)["setpoint_seq"].max())


def _heard(rows: Rows) -> Rows:
    """Up to the newest frame that came and was followed."""
    came = np.flatnonzero((rows["mode"] == Mode.TRACKING) & (rows["flags"] >> MISSED_BITS == 0))
    assert came.size, f"{rows.size} rows, of which none follows a frame that came"
    return rows[: 1 + came[-1]]


def newest_frame(rows: Rows, t_ns: int) -> int:
    """Number of the newest frame that can have been made by then: each waits for half a period until it is played."""
    return int(rows["setpoint_seq"][rows["t_ns"] <= t_ns].max()) + 1


def slower_frame(name: str, rows: Rows) -> int:
    """Number of the frame that is played when the hand's reference first slows down.

    Raises StreamLostError: it does so before the loss already.
    """
    places = _places(name, rows)
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / (np.diff(rows["t_ns"]) * 1e-9)
    require_in_time(abs(speed[0] - SPEED_M_S) < (1.0 - SLOWER) * SPEED_M_S, f"at first it goes at {speed[0]} m/s")
    slower = np.flatnonzero(speed < SLOWER * SPEED_M_S)
    assert slower.size, "it never slows down"
    return int(rows["setpoint_seq"][1 + slower[0]])


def assert_it_rests_on_the_way_up(name: str, rows: Rows) -> None:
    """Its reference goes straight up, and stands before the object would have turned; what a late frame has bent is
    left out."""
    places = _places(name, rows)[in_time(rows, _heard(rows))]
    assert np.ptp(places[:, :2], axis=0).max() < ASIDE_M
    assert places[:, 2].max() - places[-1, 2] < SWINGS_M
    assert places[-1, 2] < 0.1
    assert not rows["v_ref"][-1].any()


def torn(rows: dict[str, Rows]) -> float:
    """The most by which the measured hands leave their places to each other, m, until both are at rest."""
    held = inverse(GRIP["left"].value) @ GRIP["right"].value
    begin_ns = max(int(own["t_ns"][0]) for own in rows.values())
    end_ns = max(int(own["t_ns"][-1]) for own in rows.values())  # who rests sooner stays where it is
    errors = []
    for t_ns in range(begin_ns, end_ns + STEP_NS, STEP_NS):
        left, right = (hand_of(name, rows[name], t_ns, "q") for name in WORLD)
        errors.append(off(held, inverse(left) @ right)[0])
    return max(errors)


def _places(name: str, rows: Rows) -> Floats:
    """Where the hand should have been, m. Shape (rows, 3)."""
    return np.array([hand(name, q)[:3, 3] for q in rows["q_ref"]])
