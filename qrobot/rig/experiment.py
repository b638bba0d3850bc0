"""The experiment of the QRobot paper: park, end position at constant speed, park at triple speed, and how it tracked.

One program, four ways to run it: against processes on the wall clock at 1, 2 and 4 kHz, and in lock-step with a plant
that is what the controller believes and with one that is not.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import runpy
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from qrobot import rccl
from qrobot.config import Robot, load_robot
from qrobot.errors import LinkTimeout, QRobotError, Stalled
from qrobot.faultcodes import FaultCode
from qrobot.log.header import LOCKSTEP, REALTIME, header_for
from qrobot.log.read import Log, read_log
from qrobot.log.record import write_log
from qrobot.log.summary import TrackingSummary, tracking_summary
from qrobot.log.writer import remove_log
from qrobot.modecodes import Mode
from qrobot.rig.compile_ahead import compiled_beside
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.kernels.interpolation_polynomials import DEFAULT_FORM
from qrobot.servo.kernels.velocity import DEFAULT_ESTIMATOR
from qrobot.servo.laws.names import DEFAULT_LAW, law_label
from qrobot.servo.memory.telemetry import Rows, sampled
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US

Clock = Literal["realtime", "lockstep"]
PlantName = Literal["nominal", "mismatched"]

PROGRAM: Final = "01_park_and_return.py"
RATES_HZ: Final = (1000, 2000, 4000)
PROGRAM_PATIENCE_S: Final = 120.0
# What the servo says when it, or a process it depends on, came too late.
STALLS: Final = frozenset(
    code.name
    for code in (
        FaultCode.BOARD_GONE,
        FaultCode.OVERRUN,
        FaultCode.STREAM_LOST,
        FaultCode.GUARD_TRIP,
        FaultCode.GUARD_LOST,
    )
)
# A fault of any other name may be the machine's work too: what comes so soon after so long without a cycle or an image.
STALL_NS: Final = 5_000_000
AFTERMATH_NS: Final = 50_000_000


@dataclass(frozen=True)
class ExperimentRun:
    """One run of the experiment."""

    rate_hz: int
    clock: Clock = "lockstep"
    plant: PlantName = "nominal"
    law: str = DEFAULT_LAW
    velocity: str = DEFAULT_ESTIMATOR
    interpolation: str = DEFAULT_FORM

    @property
    def name(self) -> str:
        """Name of its files; what is not the default of estimator and interpolation is told.

        It has no colon, which other file systems do not take and `scp` takes for the end of a host's name.
        """
        unusual = [self.velocity] * (self.velocity != DEFAULT_ESTIMATOR)
        unusual += [self.interpolation] * (self.interpolation != DEFAULT_FORM)
        return "-".join([self.clock, str(self.rate_hz), self.plant, self.law_label.replace(":", "-"), *unusual])

    @property
    def law_label(self) -> str:
        """The law's name, of one in a file without the folder."""
        return law_label(self.law)

    @property
    def settings(self) -> ServoSettings:
        """The servo's, in lock-step."""
        return ServoSettings(
            rate_hz=self.rate_hz, law=self.law, velocity=self.velocity, interpolation=self.interpolation
        )


@dataclass(frozen=True)
class Result:
    """Outcome of a run.

    Attributes:
        realtime_factor: robot time over wall-clock time from the program's first packet to its last; writing the log is
            not part of it.
        fault: name of the first fault code while the arm was powered, "" for none.
        made_again: why the run was made a second time, which this is the result of; "" when the first one counted.
        digest: of every telemetry row of a lock-step run; equal digests are bit-identical runs.
    """

    run: ExperimentRun
    log: Log
    summary: TrackingSummary
    realtime_factor: float
    fault: str
    digest: str = ""
    made_again: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        run, numbers = self.run, self.summary.to_dict()
        return {
            "rate_hz": run.rate_hz,
            "clock": run.clock,
            "plant": run.plant,
            "law": run.law,
            "velocity": run.velocity,
            "interpolation": run.interpolation,
            "max_abs_error_rad": numbers["max_abs_error"],
            "rms_error_rad": numbers["rms_error"],
            "cycles": numbers["cycles"],
            "late_cycles": numbers["late_cycles"],
            "skipped_cycles": numbers["skipped_cycles"],
            "lost_rows": numbers["lost_rows"],
            "wakeup_us": numbers["wakeup_us"],
            "realtime_factor": self.realtime_factor,
            "fault": self.fault or None,
            "made_again": self.made_again or None,
            "log": str(self.log.path),
        }


def program_path(name: str = PROGRAM) -> Path:
    """An example program, of an installed package or of a checkout."""
    package = Path(str(files("qrobot")))
    installed = package / "_examples"
    return (installed if installed.is_dir() else package.parent / "examples") / name


def run_lockstep(run: ExperimentRun, directory: Path, robot: Robot | None = None) -> Result:
    """The experiment on virtual time; its log is written below `directory` afterwards."""
    robot = robot or load_robot("puma560")
    wrong = PlantMismatch.mismatched(robot.n) if run.plant == "mismatched" else PlantMismatch.nominal(robot.n)
    with compiled_beside(robot.name) as compile_loop:
        rig = LockstepRig(robot, run.settings, Emulator(robot, mismatch=wrong))
        compile_loop(rig)
        rig.ticks(1)  # loads the compiled loop, which is not the motion's time
        run_program(rig, program_path())
    rows = rig.rows()
    header = header_for(robot, rig.period_ns, run.law_label, LOCKSTEP, run.plant, run.velocity, run.interpolation)
    directory.mkdir(parents=True, exist_ok=True)
    path = write_log(directory / f"{run.name}.mcap", rows, header, laws=rig.laws_in_force(), robot=robot)[0]
    return _result(run, read_log(path), rig.realtime_factor, hashlib.sha256(rows.tobytes()).hexdigest())


def run_program(rig: LockstepRig, program: Path, period_us: int = DEFAULT_PERIOD_US) -> str:
    """Run a program against `rig` on virtual time; returns what it printed."""
    printed = io.StringIO()
    with rccl.use(partial(link_factory, rig, period_us)), contextlib.redirect_stdout(printed):
        runpy.run_path(str(program), run_name="__main__")
    return printed.getvalue()


def run_realtime(run: ExperimentRun, processes: ArmProcesses, directory: Path) -> Result:
    """The experiment on the wall clock; board and bridge of the arm have to run.

    Raises:
        LinkError: a process did not start, or the program did not end.
        Stalled: this machine left one of the processes without time.
        QRobotError: the program failed for another reason; the message is the program's own.
    """
    path = directory / f"{run.name}.mcap"
    remove_log(path)  # of an earlier run: the recorder writes over none
    with _servo_running(run, processes, path):
        began = time.monotonic()
        program = processes.start_program(program_path())
        try:
            status = program.process.wait(PROGRAM_PATIENCE_S)
        except subprocess.TimeoutExpired:
            processes.rig.end(program.name)
            raise LinkTimeout(f"the program did not end within {PROGRAM_PATIENCE_S:.0f} s") from None
        wall_s = time.monotonic() - began
    processes.rig.end(program.name)
    log = read_log(path)
    result = _result(run, log, 1.0)
    if status != 0:
        reason = Stalled if result.fault in STALLS or stalled_before_fault(log) else QRobotError
        raise reason(f"the program failed after {wall_s:.1f} s: {program.complaint()}")
    return result


@contextlib.contextmanager
def _servo_running(run: ExperimentRun, processes: ArmProcesses, log: Path) -> Iterator[None]:
    """Servo, guardian and recorder for one run."""
    choices = ("--law", run.law, "--velocity", run.velocity, "--interpolation", run.interpolation)
    servo = processes.servo("--rate", str(run.rate_hz), *choices)
    processes.rig.start(servo, processes.guardian(), processes.log("--output", str(log), "--plant", run.plant))
    try:
        yield
    finally:
        processes.end("servo", "log", "guardian")


def _result(run: ExperimentRun, log: Log, factor: float, digest: str = "") -> Result:
    faults = _rows_with_fault(log)
    fault = FaultCode(int(faults["fault"][0])).name if faults.size else ""
    return Result(run, log, tracking_summary(log), factor, fault, digest)


def _rows_with_fault(log: Log) -> Rows:
    """Rows in which a fault stands, or has just begun to stop the arm; a warning, told in the same field, does not."""
    mode, code = log.rows["mode"], log.rows["fault"]
    new = np.diff(code, prepend=0) != 0  # else it is a stop that somebody asked for, after a warning
    return np.asarray(log.rows[((mode == Mode.FAULT) | ((mode == Mode.STOPPING) & new)) & (code != 0)])


def stalled_before_fault(log: Log) -> bool:
    """Whether the first fault of the powered arm came within `AFTERMATH_NS` of a stall.

    A stall is a time of `STALL_NS` or more without a cycle that saw a new image: servo or board had no processor. On a
    punctual machine there is none, and whatever the arm does is its own fault.
    """
    faults = _rows_with_fault(log)
    if not faults.size:
        return False
    fault_ns, seen = faults["t_ns"][0], sampled(log.rows)
    seen_ns = log.rows["t_ns"][seen & (log.rows["t_ns"] <= fault_ns)]
    stalls = np.diff(seen_ns) >= STALL_NS
    return bool(np.any(stalls & (seen_ns[1:] > fault_ns - AFTERMATH_NS)))


def plan(
    lockstep: bool = False,
    rate_hz: int | None = None,
    plant: PlantName | None = None,
    law: str | None = None,
    velocity: str | None = None,
    interpolation: str | None = None,
) -> list[ExperimentRun]:
    """The runs of a demo: everything, or what the options choose."""
    usual = ExperimentRun(
        RATES_HZ[0],
        law=law or DEFAULT_LAW,
        velocity=velocity or DEFAULT_ESTIMATOR,
        interpolation=interpolation or DEFAULT_FORM,
    )
    rates = (rate_hz,) if rate_hz else RATES_HZ
    plants: tuple[PlantName, ...] = (
        (plant,) if plant else ("nominal",) if lockstep and rate_hz else ("nominal", "mismatched")
    )
    runs = []
    if not lockstep and plant != "mismatched":
        runs += [replace(usual, rate_hz=rate, clock=REALTIME) for rate in rates]
    runs += [replace(usual, rate_hz=rate, plant=p) for p in plants for rate in rates]
    if not (rate_hz or plant or law):
        runs.append(replace(usual, law="pd"))
    return runs
