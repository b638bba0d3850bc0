"""A joint at constant speed in lock-step whose encoder cable is pulled out, at rest or on the way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Generator, MoveRequest, SpeedShare, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.table import load_table
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.campaign import FRAME_NS, FRAME_S, PUMA, N
from tests.support.transport_rig import RareRig

TABLE = load_table("puma560", PUMA)
STEP_S = FRAME_S / 14
RAMP_S = 0.15
COAST_FRAMES = 12  # so long after power was cut an arm may still move
RUN_S = 1.0  # healthy, before the cable comes off on the way


@dataclass(frozen=True)
class Case:
    """What is tried.

    Attributes:
        joint: from 1. speed: rad/s, of the reference; its sign is the way. moving: the cable comes off on the way.
        table: the servo has a calibration table, hence looks at potentiometers.
        draw: of the mismatched plant, which then carries 2.5 kg of which nobody knows; None for the nominal one.
    """

    joint: int
    speed: float
    moving: bool
    table: bool
    draw: int | None = None

    def __str__(self) -> str:
        return (
            f"joint {self.joint} at {self.speed:g} rad/s, {'moving' if self.moving else 'at rest'},"
            f" {'table' if self.table else 'no table'}, plant {self.draw}"
        )


@dataclass(frozen=True)
class Result:
    """What came of it.

    Attributes:
        code: power was cut for, NONE if it was not. seconds: from the cable, or from the first motion of the reference.
        degrees: how far the joint truly went from there until it stood again.
    """

    code: FaultCode
    seconds: float
    degrees: float


def reference(speed: float, t: float) -> float:
    """Way at constant speed, from rest, begun as a half cosine of velocity."""
    if t < RAMP_S:
        return speed * 0.5 * (t - RAMP_S / math.pi * math.sin(math.pi * t / RAMP_S))
    return speed * (t - 0.5 * RAMP_S)


class SlowArm:
    """An arm that holds, ready for a motion of one joint; its board is asked once in so many `cycles` of the servo.

    Power is asked for `after_s` seconds, times these.
    """

    def __init__(
        self,
        case: Case,
        rate_hz: float = 1000.0,
        *faults: str,
        cycles: int = 1,
        after_s: float = 0.3,
        **settings: Any,
    ) -> None:
        mismatch = PlantMismatch.nominal(N) if case.draw is None else PlantMismatch.mismatched(N, seed=case.draw)
        load = 0.0 if case.draw is None else 2.5
        plant = Emulator(PUMA, start="park", physics="rigid", payload_kg=load, mismatch=mismatch)
        servo = ServoSettings(rate_hz=rate_hz, calibration=TABLE if case.table else None, **settings)
        self.case = case
        self.rig = (
            LockstepRig(PUMA, servo, plant, keep_telemetry=False)
            if cycles == 1
            else RareRig(PUMA, servo, plant, cycles, keep_telemetry=False)
        )
        for fault in faults:
            plant.faults.add(fault)
        self.rig.run_for(after_s * cycles)
        self.rig.mailbox.request_power(True)
        self.rig.run_for(0.5 * cycles)
        assert self.mode is Mode.HOLDING
        self.start = np.array(self.rig.mailbox.snapshot().q_setpoint)
        self.seq = self.begun = 0

    @property
    def mode(self) -> Mode:
        return Mode(self.rig.mailbox.snapshot().mode)

    @property
    def angle(self) -> float:
        """Where the joint truly is, rad."""
        return float(self.rig.emulator.q[self.case.joint - 1])

    def frame(self) -> list[float]:
        """Send the next setpoint, and let a sample period pass; where the joint truly was in it, rad."""
        q, path = self.start.copy(), []
        q[self.case.joint - 1] += reference(self.case.speed, (self.seq - self.begun) * FRAME_S)
        self._send(q)
        for _ in range(round(FRAME_S / STEP_S)):
            self.rig.run_for(STEP_S)
            path.append(self.angle)
        return path

    def go(self, angle: float, share: float = 0.3) -> None:
        """Move the joint to `angle` at that share of its greatest speed; its motion begins anew from there."""
        generator, goal = Generator(motion_limits(PUMA), FRAME_S, self.start), self.start.copy()
        goal[self.case.joint - 1] = angle
        generator.push(MoveRequest("there", goal, SpeedShare(share)))
        tick, moving = 0, True
        while moving:
            tick += 1
            output = generator.update(tick)
            self._send(output.q)
            self.rig.run_for(FRAME_S)
            moving = output.moving
        self.start, self.begun = goal, self.seq

    def _send(self, q: Floats) -> None:
        self.rig.mailbox.push_setpoint(1, self.seq, self.rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        self.seq += 1

    def pull_cable(self) -> None:
        """From now on the encoder gives nothing."""
        self.rig.emulator.faults.add(f"encoder:{self.case.joint} off")

    def suffer(self, seconds: float = 3.0) -> Result:
        """Go on until some time after the power was cut, or for so long."""
        began, path, after = self.rig.now_ns, [self.angle], 0
        for _ in range(round(seconds / FRAME_S)):
            path += self.frame()
            after += self.mode is Mode.FAULT
            if after > COAST_FRAMES:
                break
        incident = read_incident(self.rig.state.watch.incident)
        way = float(np.degrees(np.abs(np.array(path) - path[0]).max()))
        if incident is None or self.mode is not Mode.FAULT:
            return Result(FaultCode.NONE, math.inf, way)
        return Result(FaultCode(incident.code), (incident.t_ns - began) * 1e-9, way)


def run_case(case: Case, rate_hz: float = 1000.0, cycles: int = 1, **settings: Any) -> Result:
    """Pull the cable out and see."""
    arm = SlowArm(case, rate_hz, cycles=cycles, **settings)
    if case.moving:
        for _ in range(round(min(RUN_S, 0.5 / abs(case.speed)) / FRAME_S)):
            arm.frame()
    arm.pull_cable()
    return arm.suffer()
