"""The `qrobot` command: a table of subcommands, each imported only when it is called."""

from __future__ import annotations

import gc
import sys
from functools import partial
from importlib import import_module
from typing import Final, NamedTuple

from cyclopts import App, Group

from qrobot.cli.console import EveryTenth, run_app
from qrobot.cli.help_text import PLAIN_OPTIONS, FlowingHelp
from qrobot.realtime.compile_progress import tell_compiling
from qrobot.realtime.runtime_folder import hand_down_folder
from qrobot.realtime.supervised import end_with_supervisor

HELP: Final = """
Control a PUMA 560, or any robot described in a file: emulated on this machine or behind a TRC004 board.

Try first:

  qrobot demo          the experiment of the QRobot paper, on an emulated arm
  qrobot up            start an emulated arm; then, in another terminal,
  qrobot run PROGRAM   let a program move it
  qrobot doctor        what this machine lacks for real time
"""

EVERYDAY: Final = Group("Everyday", sort_key=1)
PROCESSES: Final = Group("Single processes (`up` starts them all)", sort_key=2)


class Subcommand(NamedTuple):
    """One line of the table; `target` is imported when the command is called."""

    name: str
    target: str
    group: Group
    help: str


COMMANDS: Final = (
    Subcommand(
        "demo", "qrobot.cli.demo:demo", EVERYDAY, "Move an emulated PUMA 560 through the experiment of the paper."
    ),
    Subcommand("up", "qrobot.cli.up:up", EVERYDAY, "Start everything a deployment file names, and watch it."),
    Subcommand("run", "qrobot.cli.run:run", EVERYDAY, "Run a program that moves an arm."),
    Subcommand("cc", "qrobot.cli.cc:cc", EVERYDAY, "Compile a C program that moves an arm, old ones included."),
    Subcommand("replay", "qrobot.cli.replay:replay", EVERYDAY, "Send the setpoints of a file to an arm."),
    Subcommand("arcl", "qrobot.cli.arcl:app", EVERYDAY, "Look at the streams that ARCL programs leave behind."),
    Subcommand("val", "qrobot.cli.val:app", EVERYDAY, "The monitor of VAL II; check and run its programs."),
    Subcommand("teach", "qrobot.cli.teach:teach", EVERYDAY, "Move an arm by commands, and record where it is."),
    Subcommand("jog", "qrobot.cli.jog:jog", EVERYDAY, "Move an arm as long as a key of the terminal is held."),
    Subcommand("guide", "qrobot.cli.guide:guide", EVERYDAY, "Lead an arm by hand, and record where it went."),
    Subcommand("pendant", "qrobot.cli.pendant:pendant", EVERYDAY, "Look at arms, and drive them, from a browser."),
    Subcommand(
        "ctl", "qrobot.cli.ctl:app", EVERYDAY, "Command a running servo: power, stop, clear, law, gains, watch."
    ),
    Subcommand("log", "qrobot.cli.log:app", EVERYDAY, "Look at logs: info, plot, animate, export; record one."),
    Subcommand(
        "calibrate", "qrobot.cli.calibrate:calibrate", EVERYDAY, "Find an arm's exact position; make its table."
    ),
    Subcommand("identify", "qrobot.cli.identify:app", EVERYDAY, "Find an arm's weight and friction; make its model."),
    Subcommand(
        "robot", "qrobot.cli.robot:app", EVERYDAY, "Look at robot files; exchange them as URDF, MJCF and tables."
    ),
    Subcommand("study", "qrobot.cli.study:app", EVERYDAY, "Try identification or gains on many arms drawn at random."),
    Subcommand(
        "compile", "qrobot.cli.compile:compile", EVERYDAY, "Compile beforehand what a first start would wait for."
    ),
    Subcommand("doctor", "qrobot.cli.doctor:doctor", EVERYDAY, "Tell what this machine lacks, and how to fix it."),
    Subcommand("board", "qrobot.cli.board:app", PROCESSES, "Emulate a TRC004 board with an arm behind it."),
    Subcommand("inject", "qrobot.cli.inject:inject", PROCESSES, "Break something in an emulated board that runs."),
    Subcommand("servo", "qrobot.cli.servo:app", PROCESSES, "Run the servo of one arm."),
    Subcommand("guardian", "qrobot.cli.guardian:guardian", PROCESSES, "Cut torque and power when a servo dies."),
    Subcommand("modbus", "qrobot.cli.modbus:modbus", PROCESSES, "Show a running robot to Modbus TCP clients."),
    Subcommand("bridge", "qrobot.cli.bridge:bridge", PROCESSES, "Let programs command a servo over TCP."),
)


def program_version() -> str:
    """Version of the installed distribution."""
    from importlib.metadata import PackageNotFoundError, version  # a tenth of a second

    try:
        return version("qrobot")
    except PackageNotFoundError:
        return "unknown (not installed)"


def make_app(chosen: str = "") -> App:
    """The command with all its subcommands, none of them imported.

    The `chosen` one brings its own, longer help; the others have a line in the list.
    """
    app = App(
        name="qrobot",
        help=HELP,
        help_format="plaintext",
        help_formatter=FlowingHelp(),
        default_parameter=PLAIN_OPTIONS,
        version=program_version,
        group_commands=EVERYDAY,
    )
    for place, command in enumerate(COMMANDS):
        line = {} if command.name == chosen else {"help": command.help}
        app.command(command.target, name=command.name, group=command.group, sort_key=place, **line)
    return app


def import_command(name: str) -> None:
    """Import the module of a command, if there is one of that name, without looking for garbage.

    Modules make none, and to look for it again and again while they fill the memory is a quarter of a process's start.
    What they leave behind is never looked at again either.
    """
    gc.disable()
    try:
        for command in COMMANDS:
            if command.name == name:
                import_module(command.target.partition(":")[0])
    finally:
        gc.freeze()
        gc.enable()


def main() -> None:
    """Entry point: run the command line and exit with its status."""
    end_with_supervisor()
    hand_down_folder()
    tell_compiling(EveryTenth())
    chosen = next(iter(sys.argv[1:]), "")
    sys.argv[0] = f"qrobot {chosen}".strip()  # how it greets a bridge
    sys.exit(run_app(make_app(chosen), sys.argv[1:], partial(import_command, chosen)))
