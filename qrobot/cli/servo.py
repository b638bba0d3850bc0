"""`qrobot servo`: the servo daemon of one arm, with its guardian beside it."""

from __future__ import annotations

import os
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import App, Parameter

from qrobot.cli.arms import (
    DEFAULT_DEPLOYMENT,
    LAW_NAMES,
    card_of_arm,
    choose_arm,
    controlled_robot,
    insist_on_its_board,
    neighbours_of_arm,
    tool_of_arm,
)
from qrobot.cli.console import SUCCESS, note
from qrobot.cli.option_types import RateHz
from qrobot.cli.servo_settings import refuse_emulated_table, servo_settings
from qrobot.config.deployment import DeployedArm, Interpolation, Velocity, guardian_objection
from qrobot.errors import ConfigError
from qrobot.realtime.lasting_folder import lasting_advice
from qrobot.realtime.own_process import own_command
from qrobot.realtime.runtime_folder import runtime_path
from qrobot.report import QueuedReport, Report

if TYPE_CHECKING:
    from qrobot.config import Robot
    from qrobot.log.flight import FlightRecorder
    from qrobot.log.header import LogHeader
    from qrobot.servo.memory.servo_memory import ServoInfo

_LAW: Final = f"Control law, overriding the file's: {LAW_NAMES}; in the file it is from that file's."

app = App(name="servo", help_format="plaintext", group_commands="Commands")


@app.default
def servo(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    rate: RateHz | None = None,
    law: Annotated[str | None, Parameter(help=_LAW)] = None,
    model: str | None = None,
    velocity: Velocity | None = None,
    interpolation: Interpolation | None = None,
    reduced_speed: bool = False,
    guardian: Annotated[bool, Parameter(negative="--own-guardian")] = True,
) -> None:
    """Run the servo of one arm, until Ctrl-C: then a controlled stop, torque off, power off.

    It starts with the arm unpowered and does not move it; programs command it through `qrobot bridge`. It survives its
    clients, and refuses power while no guardian watches it. When a fault stops the arm, the seconds around it are saved
    in the folder `incidents` beside the arm's logs.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    rate
        Cycles per second, overriding the file: 1000, 2000, 4000, ...
    model
        Identified model of the arm (`qrobot identify fit`), overriding the file.
    velocity
        How velocities are estimated, overriding the file: the paper's difference, or an observer with less noise.
    interpolation
        Path between setpoints, overriding the file; linear is a sample period faster, and rough.
    reduced_speed
        Stop the arm when its tool would move faster than 250 mm/s, or the file's reduced_speed_mm_s if that is less.
    guardian
        Start a guardian too. With --own-guardian somebody else starts it (`qrobot guardian`, `qrobot up`).
    """
    from qrobot.servo.process.daemon import serve

    chosen = choose_arm(deployment, arm)
    robot, identified = controlled_robot(chosen, model)
    settings = servo_settings(chosen, rate, law, velocity, interpolation, reduced_speed)
    refuse_emulated_table(chosen, settings.calibration)
    insist_on_its_board(chosen)
    if objection := guardian_objection(settings.rate_hz, settings.guardian_timeout_ms):
        raise ConfigError(objection)
    settings = replace(settings, neighbours=neighbours_of_arm(chosen, deployment))

    def started() -> None:
        if guardian:
            command = own_command("qrobot", "guardian", deployment, "--arm", chosen.name)
            subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
        choices = f"law {settings.law}, velocity by {settings.velocity}, {settings.interpolation} interpolation"
        choices += f", model {identified}" if identified else ""
        choices += f", tool up to {settings.reduced_speed_m_s * 1e3:g} mm/s" if settings.reduced_speed_m_s else ""
        if advice := lasting_advice(runtime_path()):
            told(advice)
        told(f"servo of {chosen.name} ({robot.name}) runs at {settings.rate_hz:g} Hz: {choices}")

    card = card_of_arm(chosen)
    with QueuedReport(note) as told:
        look = {"look": _flight_recorder(chosen, robot, told).look} if chosen.log.directory else {}
        serve(chosen.name, robot, settings, chosen.servo.require_realtime, told, started, card=card, **look)


def _flight_recorder(arm: DeployedArm, robot: Robot, report: Report) -> FlightRecorder:
    """Make the flight recorder; its files lie beside the arm's logs, in `incidents`."""
    from qrobot.cli.log import recorded_header
    from qrobot.fences.told_fences import told_fences
    from qrobot.log.fences_of_log import fence_attachments
    from qrobot.log.flight import KEEP, FlightRecorder

    def header_of(servo: ServoInfo) -> LogHeader:
        return recorded_header(arm, robot, servo, os.getpid())

    fences = told_fences(arm, robot)
    folder = Path(arm.log.directory) / "incidents"
    looks = robot, fence_attachments(fences), tool_of_arm(arm), fences
    return FlightRecorder(folder, arm.name, header_of, report, KEEP, *looks)


@app.command(help_flags=[])
def ctl(*words: Annotated[str, Parameter(allow_leading_hyphen=True)]) -> int:
    """Command a running servo: the same as `qrobot ctl`.

    Parameters
    ----------
    words
        What `qrobot ctl` takes; --help lists it.
    """
    from qrobot.cli.ctl import app as ctl_app

    status: object = ctl_app(words, exit_on_error=False, print_error=False, result_action="return_value")
    return status if isinstance(status, int) else SUCCESS
