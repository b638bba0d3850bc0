"""A whole tick of the servo, and the telemetry row at its end, on a board that only shows new images."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from benchmarks.box import FRAME_NS
from benchmarks.rows import Goal, Row, row
from benchmarks.timing import Effort, interleaved
from qrobot.config import load_robot
from qrobot.fences.fence_set import FenceSet
from qrobot.hwif.board_memory import Lane
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS
from qrobot.hwif.lanes import discard_operations, take_operation
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, make_frame, push_frame
from qrobot.servo.memory.telemetry import append_telemetry
from qrobot.servo.process.loop import one_cycle
from qrobot.servo.settings import ServoSettings

SERVO_LANE: Final = int(Lane.SERVO)
TICKS: Final = 200_000
RATE_HZ: Final = 4000


@lean_kernel
def ticks(params: Any, state: Any, mail: Any, ring: Any, board: Any, frame: Any, now_ns: int, n: int) -> int:
    """`n` servo ticks: each finds a new image, frames come in time, and what is written goes nowhere."""
    late_ns = now_ns - now_ns  # no constant, for which another cycle would be compiled than the one that runs
    for _ in range(n):
        board.shown.image[IMAGE_T_NS] = now_ns
        board.shown.image[IMAGE_COUNT] += 1
        if now_ns >= frame.t_ns + FRAME_NS:
            frame.seq += 1
            frame.t_ns = now_ns
            push_frame(mail, frame)
        one_cycle(params, state, mail, ring, board, now_ns, late_ns)
        discard_operations(board, SERVO_LANE)
        take_operation(board, SERVO_LANE, state.ops[0])  # there is none: the lane sees that it is empty
        now_ns += params.period_ns
    return now_ns


@lean_kernel
def telemetry_rows(ring: Any, state: Any, n: int) -> None:
    """`n` rows of telemetry."""
    for k in range(n):
        state.row.tick = k
        append_telemetry(ring, state.row)


def holding_rig(fences: FenceSet | None = None) -> LockstepRig:
    """A rig with the arm under power at its ready pose."""
    robot = load_robot("puma560")
    rig = LockstepRig(robot, ServoSettings(rate_hz=RATE_HZ, fences=fences), keep_telemetry=False)
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    return rig


def frame_here(rig: LockstepRig) -> Any:
    """A frame of a new stream that asks every joint to stay where its reference is."""
    n = rig.robot.n
    frame = make_frame(n)
    frame.stream, frame.seq, frame.period_ns = 1, -1, FRAME_NS
    frame.modes[:], frame.values[:] = POSITION_SETPOINT, rig.mailbox.snapshot().q_setpoint
    return frame


def tracking(rig: LockstepRig) -> Callable[[int], None]:
    """A function that runs so many ticks of an arm that follows setpoints. Raises RuntimeError when it does not."""
    frame = frame_here(rig)

    def run(n: int) -> None:
        rig.now_ns = ticks(rig.params, rig.state, rig.mail, rig.mailbox.ring, rig.board, frame, rig.now_ns, n)
        mode = Mode(rig.mailbox.snapshot().mode)
        if mode is not Mode.TRACKING:
            raise RuntimeError(f"the servo on the bench is {mode.name}, not tracking: its tick is not the whole one")

    run(2 * FRAME_NS // rig.period_ns)
    return run


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    rig, many = holding_rig(), effort.times(TICKS)
    run = tracking(rig)
    telemetry_rows(rig.mailbox.ring, rig.state, 1)
    contenders = {"tick": lambda: run(many), "row": lambda: telemetry_rows(rig.mailbox.ring, rig.state, many)}
    times = {name: duration / many * 1e9 for name, duration in interleaved(contenders, effort.rounds).items()}
    yield row("servo tick while tracking, image to register writes and telemetry", times["tick"], "ns", Goal(500.0))
    yield row("telemetry row into the ring", times["row"], "ns", Goal(50.0))
