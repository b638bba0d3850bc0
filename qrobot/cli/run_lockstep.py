"""A program on emulated arms inside this process, on virtual time, with the logs of their servos."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from qrobot.cli.arm_links import ArmLinks, links_of
from qrobot.cli.arms import controlled_robot, robot_of_arm, tool_of_arm
from qrobot.cli.console import note
from qrobot.cli.logs import files_of_run
from qrobot.cli.program_settings import settings_of
from qrobot.cli.run_film import film_log, filmed
from qrobot.cli.servo_settings import check_law, servo_settings
from qrobot.config.deployment import DeployedArm
from qrobot.config.scene import SceneKind
from qrobot.config.start_place import start_place
from qrobot.errors import ConfigError, LinkBusy
from qrobot.fences.told_fences import told_fences
from qrobot.log.fences_of_log import fence_attachments
from qrobot.log.follow import log_paths
from qrobot.log.header import LOCKSTEP, attach_files, header_for
from qrobot.log.record import write_log
from qrobot.rci import Link
from qrobot.realtime.interrupt import heed_interrupts
from qrobot.rig.compile_ahead import compiled_beside
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.sim_board.deployed import emulator_of_arm
from qrobot.units import US_PER_MS
from qrobot.wire import ClientRole, Hello


@dataclass(frozen=True)
class LockstepRun:
    """Arms of a deployment file, with what the command line and the program say otherwise; None says nothing."""

    arms: tuple[DeployedArm, ...]
    program: Path
    plant: Literal["nominal", "mismatched"] | None = None
    scene: SceneKind | None = None
    law: str | None = None
    model: str | None = None
    rate_hz: float | None = None
    start: str | None = None

    def perform(
        self, run: Callable[[ArmLinks], int], deployment: str, log: Path | None, record: Path | None = None
    ) -> int:
        """Let `run` do it; its status. The log of each arm, and the film `record`, are written however it ends.

        Raises:
            ConfigError: law, model, rate or the program's own settings cannot be, or several logs are to be one file.
            LogError: no log, or no film, can be written.
        """
        written: list[Path] = []
        with TemporaryDirectory(prefix="qrobot-run-") as folder:
            passing = None if record is None else Path(folder) / "run.mcap"  # a log for the film alone
            with nullcontext() if record is None else filmed(lambda: _film(written, record)):
                try:
                    return self._perform(run, deployment, log or passing, written)
                finally:
                    for path in written if log is not None else ():
                        note(f"log {path}: look at it with `qrobot log info {path}`")

    def _perform(self, run: Callable[[ArmLinks], int], deployment: str, log: Path | None, written: list[Path]) -> int:
        if log is not None and log.suffix == ".mcap" and len(self.arms) > 1:
            raise ConfigError(f"--log {log}: each of {len(self.arms)} arms has a log of its own; give a folder")
        with compiled_beside(self.arms[0].robot) as compile_loop:
            emulated = [LockstepArm(self, arm, keep=log is not None) for arm in self.arms]
            for each in emulated:
                compile_loop(each.rig)
        links = {each.arm.name: each.link for each in emulated}
        with heed_interrupts(), ExitStack() as logs:
            for each in emulated:
                logs.enter_context(each.logged(deployment, log, written))
            return run(links_of(self.arms, lambda arm: links[arm.name]))


def _film(written: Sequence[Path], record: Path) -> None:
    """Make the film of the first log that was written, if any."""
    for log in written[:1]:
        film_log(log, record)


class LockstepArm:
    """One arm of a run, with emulated board and servo of its own.

    Args:
        run: what it belongs to.
        arm: of the deployment file.
        keep: its telemetry, for a log.

    Attributes:
        arm: as given. rig: board and servo.

    Raises:
        ConfigError: law, model, rate or the program's own settings cannot be.
    """

    def __init__(self, run: LockstepRun, arm: DeployedArm, keep: bool) -> None:
        self.arm, self._plant, self._several = arm, run.plant, len(run.arms) > 1
        self._law, self._model = run.law, run.model
        self._robot = robot_of_arm(arm)
        law = None if run.law is None else check_law(run.law, self._robot)
        scene = run.scene or settings_of(run.program).scene
        believed, _ = controlled_robot(arm, run.model, emulated=True)
        start = None if run.start is None else start_place(run.start, arm)
        emulator = emulator_of_arm(arm, self._robot, plant=run.plant, scene=scene, start=start)
        self.rig = LockstepRig(believed, servo_settings(arm, run.rate_hz, law), emulator, keep_telemetry=keep)

    def link(self, hello: Hello) -> Link:
        """A program's way to it. Raises LinkBusy: the program of a single emulated arm takes a second one."""
        if self.rig.lease.taken and hello.role is ClientRole.COMMANDER and not self._several:
            raise LinkBusy(
                f"the program commands {self.arm.name!r}, the one emulated arm, already; for several arms choose a "
                "deployment file that has them and leave out --arm, as in `qrobot run --lockstep --deployment two_arms`"
            )
        return link_factory(self.rig, round(self.arm.bridge.period_ms * US_PER_MS), hello)

    @contextmanager
    def logged(self, deployment: str, log: Path | None, written: list[Path]) -> Iterator[None]:
        """Block behind which the log is written, if there is to be one; its file is added to `written`."""
        try:
            yield
        finally:
            if log is not None:
                written.append(self._write(deployment, log))

    def _write(self, deployment: str, log: Path) -> Path:
        arm, rig = self.arm, self.rig
        settings, plant = rig.settings, self._plant or arm.board.plant
        choices = settings.velocity, settings.interpolation
        laws, tool = rig.laws_in_force(), tool_of_arm(arm)
        header = header_for(self._robot, rig.period_ns, laws[0].law, LOCKSTEP, plant, *choices, arm.name)
        attachments = attach_files(files_of_run(arm, deployment, self._law, self._model))
        fences = told_fences(arm, self._robot)
        attachments += fence_attachments(fences)
        path, rows = next(log_paths(log, arm.name)), rig.rows()
        return write_log(path, rows, header, attachments, laws=laws, robot=self._robot, tool_m=tool, fences=fences)[0]
