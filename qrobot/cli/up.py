"""`qrobot up`: everything a deployment file names, started in order and watched until Ctrl-C."""

from __future__ import annotations

import time
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, neighbours_of_arm, robot_of_arm
from qrobot.cli.console import SUCCESS, note
from qrobot.cli.option_types import OutputFolder, checked_folder
from qrobot.realtime.lasting_folder import lasting_advice
from qrobot.realtime.runtime_folder import runtime_path
from qrobot.report import QueuedReport, Report

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from qrobot.config.deployment import DeployedArm
    from qrobot.rig.log_trouble import LogTrouble
    from qrobot.rig.process_starter import ProcessStarter
    from qrobot.rig.processes import ProcessRig

POLL_S = 0.2


def up(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    calibrate: bool = False,
    reduced_speed: bool = False,
    out_dir: OutputFolder = Path("out/processes"),
) -> int:
    """Start board, servo, guardian, bridge and log of every arm of a deployment file; end them with Ctrl-C.

    Programs then reach the arms through their bridges (`qrobot run PROGRAM`). When board, servo or guardian dies the
    others are ended in good order: the servo stops the arm first. A bridge or a log that dies is started again, up to
    three times a minute. When `qrobot up` itself is killed, all its processes end, in the same order.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one (emulator, pressing, two_arms).
    calibrate
        Calibrate each arm whose board has lost its counters, before programs may move it. THE ARM MOVES. The key
        `calibrate_at_start` of an arm's board asks for the same.
    reduced_speed
        Stop each arm when its tool would move faster than 250 mm/s, or the file's reduced_speed_mm_s if that is less.
    out_dir
        Where the processes' messages go, one file each.
    """
    from qrobot.config.deployment import load_deployment
    from qrobot.rig.interrupts import interrupted_by_signals
    from qrobot.rig.process_starter import ProcessStarter

    arms = load_deployment(deployment).arm
    with interrupted_by_signals(), closing(ProcessStarter()) as starter:
        starter.begin()  # it imports what the processes need, while this process imports what it needs itself
        for arm in arms:  # what is wrong with the last arm is told before the first one starts
            _check(arm, deployment, reduced_speed)
        _run(deployment, arms, starter, out_dir, calibrate, reduced_speed)
    return SUCCESS


def _check(arm: DeployedArm, deployment: str, reduced_speed: bool) -> None:
    """Raise a QRobotError where an arm could not be started."""
    from qrobot.cli.servo_settings import refuse_emulated_table, servo_settings  # kernels: half a second
    from qrobot.rig.deployed import require_free_port

    robot_of_arm(arm)
    refuse_emulated_table(arm, servo_settings(arm, reduced_speed=reduced_speed).calibration)
    neighbours_of_arm(arm, deployment)
    require_free_port(arm)
    if arm.log.directory:
        checked_folder(Path(arm.log.directory))


def _run(
    deployment: str,
    arms: Sequence[DeployedArm],
    starter: ProcessStarter,
    out_dir: Path,
    calibrate: bool,
    reduced_speed: bool,
) -> None:
    """Start all arms, watch them until Ctrl-C, end them."""
    from qrobot.rig.deployed import ArmProcesses
    from qrobot.rig.log_trouble import LogTrouble
    from qrobot.rig.processes import ProcessRig

    # A queue of lines: none may keep the processes from being ended. What their logs have lost is told behind that.
    with QueuedReport(note) as told, ExitStack() as ended, ProcessRig(out_dir, starter, told) as rig:
        trouble = LogTrouble(told)
        ended.callback(lambda: trouble.look_back(rig.children.values()))
        look = _looks(rig, told, trouble)
        if advice := lasting_advice(runtime_path()):
            told(advice)
        for arm in arms:
            told(f"starting {arm.name} (a first start compiles for half a minute or more)")
            ArmProcesses(rig, deployment, arm, ("--reduced-speed",) if reduced_speed else ()).start_all()
            if calibrate or arm.board.calibrate_at_start:
                _calibrate(arm, told, look)
            told(f"{arm.name} is up: programs reach it at {arm.bridge.host}:{arm.bridge.port}")
        told("Ctrl-C ends everything")
        with suppress(KeyboardInterrupt):
            _watch(look)
        told("stopping")


def _calibrate(arm: DeployedArm, told: Report, look: Callable[[], None]) -> None:
    """Leave the arm with counters that are right. Raises what `calibrate_arm` and `look` raise."""
    from qrobot.cli.calibrate import calibrate_arm

    told(f"calibrating {arm.name}, unless its board has kept its counters: keep clear, it moves")
    kept = calibrate_arm(arm, report=told, look=look).was_calibrated
    told(f"{arm.name} is calibrated{': its board has kept the counters' if kept else ''}")


def _looks(rig: ProcessRig, told: Report, trouble: LogTrouble) -> Callable[[], None]:
    """A look after all processes; it raises LinkLost when one has ended that the arm cannot do without."""
    from qrobot.rig.restarts import Restarts

    restarts = Restarts(rig, told)

    def look() -> None:
        restarts.look()
        trouble.look([child for child in rig.children.values() if not child.plan.vital])

    return look


def _watch(look: Callable[[], None]) -> None:
    """Return never; raise what `look` raises."""
    while True:
        time.sleep(POLL_S)
        look()
