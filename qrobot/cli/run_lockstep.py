"""A program on an emulated arm inside this process, on virtual time, with the servo's log."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

from qrobot.cli.arms import check_law, controlled_robot, robot_of_arm, servo_settings
from qrobot.cli.console import note
from qrobot.cli.program_settings import settings_of
from qrobot.config import Robot, deployment_path, robot_path
from qrobot.config.deployment import DeployedArm
from qrobot.config.scene import SceneKind
from qrobot.fences.told_fences import told_fences
from qrobot.log.fences_of_log import fence_attachments
from qrobot.log.follow import log_paths
from qrobot.log.header import LOCKSTEP, attach_files, header_for
from qrobot.log.record import write_log
from qrobot.rci import LinkFactory
from qrobot.realtime.interrupt import heed_interrupts
from qrobot.rig.compile_ahead import compiled_beside
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.sim_board.deployed import emulator_of_arm
from qrobot.units import US_PER_MS


@dataclass(frozen=True)
class LockstepRun:
    """An arm of a deployment file, with what the command line and the program say otherwise; None says nothing."""

    arm: DeployedArm
    program: Path
    plant: Literal["nominal", "mismatched"] | None = None
    scene: SceneKind | None = None
    law: str | None = None
    model: str | None = None
    rate_hz: float | None = None

    def perform(self, run: Callable[[LinkFactory], int], deployment: str, log: Path | None) -> int:
        """Let `run` do it; its status. The log is written however it ends.

        Raises:
            ConfigError: law, model, rate or the program's own settings cannot be. LogError: no log can be written.
        """
        with compiled_beside(self.arm.robot) as compile_loop:
            rig = self._rig(keep=log is not None)
            compile_loop(rig)
        factory = partial(link_factory, rig, round(self.arm.bridge.period_ms * US_PER_MS))
        with heed_interrupts(), self._logged(rig, deployment, log):
            return run(factory)

    @cached_property
    def _robot(self) -> Robot:
        return robot_of_arm(self.arm)

    def _rig(self, keep: bool) -> LockstepRig:
        law = None if self.law is None else check_law(self.law, self._robot)
        scene = self.scene or settings_of(self.program).scene
        believed, _ = controlled_robot(self.arm, self.model)
        emulator = emulator_of_arm(self.arm, self._robot, plant=self.plant, scene=scene)
        return LockstepRig(believed, servo_settings(self.arm, self.rate_hz, law), emulator, keep_telemetry=keep)

    @contextmanager
    def _logged(self, rig: LockstepRig, deployment: str, log: Path | None) -> Iterator[None]:
        try:
            yield
        finally:
            if log is not None:
                path = self._write(rig, deployment, log)
                note(f"log {path}: look at it with `qrobot log info {path}`")

    def _write(self, rig: LockstepRig, deployment: str, log: Path) -> Path:
        settings, plant = rig.settings, self.plant or self.arm.board.plant
        choices = settings.velocity, settings.interpolation
        header = header_for(self._robot, rig.period_ns, settings.law, LOCKSTEP, plant, *choices)
        attachments = attach_files([robot_path(self.arm.robot), deployment_path(deployment)])
        attachments += fence_attachments(told_fences(self.arm, self._robot))
        return write_log(
            next(log_paths(log, self.arm.name)), rig.rows(), header, attachments, laws=[rig.law_in_force()]
        )[0]
