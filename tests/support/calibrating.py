"""An uncalibrated emulated arm and its servo in lock-step."""

from __future__ import annotations

from typing import Any

import numpy as np

from qrobot.config import Robot, load_robot
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.state import Stage
from qrobot.servo.calibration.table import CalibrationTable, load_table
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.operator.calibration_client import CalibrationReport, run_calibration
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from tests.support.bench_blocks import word_of

PUMA = load_robot("puma560")
TABLE = load_table("puma560", PUMA)


def random_pose(seed: int, robot: Robot = PUMA) -> np.ndarray:
    """Somewhere in the joints' range."""
    return np.random.default_rng(seed).uniform(robot.limits.q_min, robot.limits.q_max)


class CalibratingRig(LockstepRig):
    """A rig with a calibration table, its arm at `start`, its board just switched on."""

    def __init__(
        self,
        start: Any = "park",
        *,
        robot: Robot = PUMA,
        table: CalibrationTable | None = TABLE,
        rate_hz: float = 1000.0,
        calibrated: bool = False,
        emulator: Emulator | None = None,
        seed: int = 0,
        **options: Any,
    ) -> None:
        board = emulator or Emulator(
            robot, physics="rigid", start=start, calibrated=calibrated, seed=seed, options=BoardOptions(**options)
        )
        settings = ServoSettings(rate_hz=rate_hz, calibration=table)
        super().__init__(robot, settings, board, keep_telemetry=False)
        # Words, looked at after each tick: a whole report of the progress takes Python longer than a tick takes.
        progress = self.mailbox.memory.calibration
        self._stage_word, self._joint_word = word_of(progress, "stage"), word_of(progress, "joint")

    @property
    def seen(self) -> ServoSnapshot:
        """The servo's state."""
        return self.mailbox.snapshot()

    @property
    def mode(self) -> Mode:
        """The servo's mode."""
        return Mode(self.seen.mode)

    @property
    def event(self) -> tuple[FaultCode, int]:
        """The newest event and its joint."""
        return FaultCode(self.seen.event), self.seen.event_joint

    @property
    def stage(self) -> Stage:
        """Where the calibration stands."""
        return Stage(int(self._stage_word[0]))

    def powered(self) -> CalibratingRig:
        """With arm power, holding or waiting for calibration."""
        self.mailbox.request_power(True)
        self.run_for(0.5)
        return self

    def calibrating(self, indexes: int = 0, until: Stage = Stage.SWEEPING, joint: int = 0) -> CalibratingRig:
        """With a calibration that has come to a stage of a joint."""
        self.powered().mailbox.request_calibration(indexes)
        for _ in range(30_000):
            if (stage := self.stage) is until and self._joint_word[0] >= joint:
                return self
            self.ticks(1 if stage >= Stage.SETTLING else round(0.005 * self.settings.rate_hz))
        raise AssertionError(f"{until.name} was not reached: {self.mode.name}, {self.event}")

    def finish(self, seconds: float = 90.0) -> CalibratingRig:
        """Until the calibration has ended, well or not."""
        for _ in range(round(seconds / 0.1)):
            self.run_for(0.1)
            if self.mode is not Mode.CALIBRATING:
                return self
        raise AssertionError("the calibration does not end")

    def calibrate(self, indexes: int = 0) -> CalibrationReport:
        """As the command line does it."""
        return run_calibration(self.mailbox, self.run_for, indexes)

    def outcome(self) -> FaultCode | None:
        """Why a calibration was refused, or None for counters that are exact; fails the test for wrong ones."""
        try:
            self.calibrate()
        except ServoFault as refusal:
            why = FaultCode(refusal.code)
        else:
            why = None
        assert self.emulator.calibrated == (why is None)
        assert why is not None or self.exact(), "calibrated, and wrong"
        return why

    def exact(self) -> bool:
        """The counters hold the true positions to the last count."""
        shaft = np.floor(self.emulator.bundle.shaft[: self.robot.n] + 0.5).astype(np.int64)
        true = shaft + self.robot.transmission.count_offset
        return bool(np.array_equal(true & 0xFFFF, self.emulator.counters))
