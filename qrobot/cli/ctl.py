"""`qrobot ctl`: command a running servo by hand."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from cyclopts import App, Parameter
from rich.table import Table

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, LAW_NAMES, choose_arm, robot_of_servo
from qrobot.cli.console import SUCCESS, note, out, plain_table, print_table, write_json
from qrobot.cli.fence_table import fence_table
from qrobot.cli.option_types import GainsOption, Indexes, LoadKg, NumberList, Percent, Seconds
from qrobot.config import Robot
from qrobot.config.scene import FORCE_AXES
from qrobot.errors import ConfigError
from qrobot.servo.laws.names import whole_law_name
from qrobot.servo.memory.settings_text import settings_text
from qrobot.servo.operator.client import ServoClient
from qrobot.servo.operator.messages import BoardStatus, ServoStatus
from qrobot.servo.operator.sockets import visitor_label

HELP: Final = """
Command a running servo by hand: power, stop, pause, speed, clear, law, gains; look at it, or watch it.

An arm has one commander: while a program commands it over the bridge, only `stop`, `power off`,
`pause`, `resume`, `override` and `collision` are obeyed from here.
Everybody may look.
"""

PATH_WAITS: Final = (
    "A program waits to go back to its path: put right what stopped the arm, look that nothing is in between, "
    "then `qrobot ctl resume`; a program in VAL goes on by PROCEED at its terminal alone."
)
_LAW: Final = f"{LAW_NAMES}."

app = App(name="ctl", help=HELP, help_format="plaintext", group_commands="Commands")


@Parameter(name="*")
@dataclass(frozen=True)
class Where:
    """The servo to talk to, and the form of the answer: options of every subcommand."""

    deployment: Annotated[str, Parameter(help="Deployment file, or the name of a packaged one.")] = DEFAULT_DEPLOYMENT
    arm: Annotated[str | None, Parameter(help="Which arm of the file; may be left out when there is only one.")] = None
    json: Annotated[
        bool, Parameter(help="Print the servo's answer as JSON, its whole status or what was asked for.")
    ] = False


def _do(where: Where | None, act: Callable[[ServoClient], ServoStatus]) -> int:
    where = where or Where()
    with ServoClient(choose_arm(where.deployment, where.arm).name) as servo:
        status = act(servo)
    if status.commander.startswith(visitor_label(os.getpid())):  # who has let go of the arm by now
        status = status.model_copy(update={"commander": ""})
    if where.json:
        write_json(status.model_dump())
    else:
        note(_line(status))
    return SUCCESS


def _line(status: ServoStatus) -> str:
    why = f": {status.text}" if status.text else ""
    by = f", commanded by {status.commander}" if status.commander else ""
    settings = f" ({settings_text(status.law_settings)})" if status.law_settings else ""
    return f"{status.arm}: {status.mode}{why}, law {status.law}{settings}{_changed(status)}{by}"


def _changed(status: ServoStatus) -> str:
    """Settings of speed and load that are not as usual."""
    told = [f"override {status.override:.0%}"] if status.override != 1 else []
    told += ["paused"] if status.paused else []
    told += [f"tool at most {status.tool_speed_limit:g} m/s"] if status.tool_speed_limit > 0 else []
    told += [f"payload {status.payload_mass:g} kg"] if status.payload_mass > 0 else []
    told += [f"after a collision {status.collision_reaction}"] if status.collision_reaction != "stop" else []
    return "".join(f", {each}" for each in told)


@app.command
def status(*, where: Where | None = None) -> int:
    """Tell how the servo is: mode, fault, law, gains, positions, lines, the way to the board. Needs no authority."""
    where = where or Where()
    chosen = choose_arm(where.deployment, where.arm)
    with ServoClient(chosen.name) as servo:
        now = servo.status()
    if where.json:
        write_json(now.model_dump())
        return SUCCESS
    robot = robot_of_servo(chosen, now.robot)
    out.print(_line(now), soft_wrap=True)
    if now.path_waits:
        out.print(PATH_WAITS, soft_wrap=True)
    print_table(_joints(robot, now))
    if any(value is not None for value in now.force):
        out.print(_force_line(now.force), soft_wrap=True)
    out.print(_lines_line(now), soft_wrap=True)
    out.print(_board_line(now.board), soft_wrap=True)
    return SUCCESS


def _lines_line(now: ServoStatus) -> str:
    inputs = " ".join(map(str, now.inputs)) or "none"
    outputs = "".join(f", {name} {'on' if on else 'off'}" for name, on in now.outputs.items())
    analog = "".join(f", {name} {volts:.3f} V" for name, volts in now.analog_outputs.items())
    return f"hand {now.hand}, inputs on: {inputs}{outputs}{analog}"


def _force_line(force: tuple[float | None, ...]) -> str:
    units = zip(FORCE_AXES, force, ("N",) * 3 + ("N m",) * 3, strict=True)
    return "force: " + ", ".join(f"{axis} {value:.4g} {unit}" for axis, value, unit in units if value is not None)


def _board_line(board: BoardStatus) -> str:
    age = "no image" if board.age_ms is None else f"image {board.age_ms:.1f} ms old"
    counters = f"lost {board.losses} times, {board.dropped} operations dropped, {board.illegal} without meaning"
    slipped = f", time stood still for {board.slipped_ms:.0f} ms" if board.slipped_ms else ""
    return f"board: {age}, {counters}, modules lost {board.module_losses} times{slipped}"


def _joints(robot: Robot, now: ServoStatus) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0))
    for heading in ("joint", "", "position", "speed", "torque", "Kp", "Kv", "inertia"):
        table.add_column(heading, justify="left" if heading in ("joint", "") else "right")
    columns = (now.q, now.v, now.tau, now.kp, now.kv, now.inertia)
    for name, slides, *numbers in zip(robot.joint_names, robot.prismatic.tolist(), *columns, strict=True):
        units = "m, m/s, N" if slides else "rad, rad/s, N m"
        table.add_row(name, units, *(f"{number:.4g}" for number in numbers))
    return table


@app.command
def fences(*, where: Where | None = None) -> int:
    """Tell which fences the servo guards, and which part of the arm is how far from which. Needs no authority.

    The one that is next to stop a motion comes first. Programs keep the margin; the servo stops the arm where it could
    not come to rest before the fence itself. Below zero the arm is inside. Fences are told in the deployment file, and
    a change of it counts from the next start of the servo. The surfaces of the arm are the capsules of its robot file.
    """
    where = where or Where()
    with ServoClient(choose_arm(where.deployment, where.arm).name) as servo:
        now, found = servo.status(), servo.fences()
    if where.json:
        write_json({"arm": now.arm, "calibrated": now.calibrated, "fences": [fence.model_dump() for fence in found]})
        return SUCCESS
    known = "" if now.calibrated else "; not calibrated: distances are of a position that may be wrong"
    out.print(f"{now.arm}: {len(found) or 'no'} fences in force{known}", soft_wrap=True)
    if found:
        print_table(fence_table(found))
    return SUCCESS


@app.command
def power(state: Literal["on", "off"], *, where: Where | None = None) -> int:
    """Switch arm power on, waiting until the arm is held, or off, after a controlled stop. Anybody may switch it off.

    Parameters
    ----------
    state
        on or off.
    """
    return _do(where, lambda servo: servo.power_on() if state == "on" else servo.power_off())


@app.command
def stop(*, where: Where | None = None) -> int:
    """Stop the arm on its path; it is held where it stops. Anybody may."""
    return _do(where, lambda servo: servo.stop())


@app.command
def override(percent: Percent, *, where: Where | None = None) -> int:
    """Let motions go at so many percent of their programmed speed, also those under way. Anybody may.

    A stop leaves it as it is; a servo starts with 100.

    Parameters
    ----------
    percent
        0 to 100; 100 is the speed as programmed.
    """
    return _do(where, lambda servo: servo.change_override(percent / 100))


@app.command
def payload(
    *, mass: LoadKg, center: NumberList = "0,0,0", inertia: NumberList = "0,0,0,0,0,0", where: Where | None = None
) -> int:
    """Tell the servo what the arm carries. It goes over to it within half a second, without a bump.

    It is in force until the servo ends. What the arm cannot hold at every pose is refused.

    Parameters
    ----------
    mass
        kg; 0 for nothing.
    center
        Its centre of mass in the frame of the flange, m: x,y,z.
    inertia
        About that centre along the axes of the flange, kg m^2: xx,yy,zz,xy,xz,yz.
    """
    at, moments = _listed("center", center, 3), _listed("inertia", inertia, 6)
    return _do(where, lambda servo: servo.change_payload(mass, at, moments))


def _listed(name: str, text: str, count: int) -> tuple[float, ...]:
    """Numbers with commas between them. Raises ConfigError."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ConfigError(f"--{name} {text}: {count} finite numbers with commas between them are wanted")
    return found


@app.command
def collision(
    *,
    threshold: GainsOption | None = None,
    reaction: Literal["stop", "comply"] = "stop",
    where: Where | None = None,
) -> int:
    """Tell collisions sooner than the robot file does, and choose what follows them. Anybody may.

    It is in force until the servo ends, or until a program that asks for its own leaves.

    Parameters
    ----------
    threshold
        Torque that nobody commanded, N m (N), one a joint, at most `unexplained_torque` of the robot file; left out,
        that counts.
    reaction
        stop: on the path, held where the arm got to. comply: and then soft for two seconds, before it is held.
    """
    return _do(where, lambda servo: servo.change_collision(threshold or (), reaction))


@app.command
def pause(*, where: Where | None = None) -> int:
    """Let motions stand still on their path until `qrobot ctl resume`. Anybody may.

    It is no stop: whoever must be sure that the arm stands uses `qrobot ctl stop`.
    """
    return _do(where, lambda servo: servo.pause())


@app.command
def resume(*, where: Where | None = None) -> int:
    """Let motions that were paused go on, and a program that keeps its path lead the arm back to it. Anybody may.

    Such a program clears a fault, asks for power and moves the arm, slowly: look that the way is free.
    """
    return _do(where, lambda servo: servo.resume())


@app.command
def clear(*, where: Where | None = None) -> int:
    """Clear a fault whose cause is gone. Nothing moves, and power stays off."""
    return _do(where, lambda servo: servo.clear())


@app.command
def calibrate(*, indexes: Indexes | None = None, where: Where | None = None) -> int:
    """Begin to calibrate a powered arm; `qrobot calibrate` also powers it and shows how it goes.

    Parameters
    ----------
    indexes
        Index pulses of each joint, 3 to 14; left to the servo if left out.
    """
    return _do(where, lambda servo: servo.calibrate(indexes or 0))


@app.command
def tare(*, where: Where | None = None) -> int:
    """Zero the force sensor of an arm at rest: what it shows now counts as no load, until the servo ends."""
    return _do(where, lambda servo: servo.zero_force())


@app.command
def law(
    name: Annotated[str, Parameter(help=_LAW)],
    *,
    set: Annotated[list[str] | None, Parameter(consume_multiple=True)] = None,
    where: Where | None = None,
) -> int:
    """Change the control law of an arm that holds, or is without power. The arm does not notice.

    Parameters
    ----------
    set
        Settings of the law, such as --set band=0.01 share=0.05; the others have their default. An impedance that
        is in force takes them at any time, also while it moves, and the others stay.
    """
    chosen = dict(map(_setting, set or ()))
    return _do(where, lambda servo: servo.change_law(whole_law_name(name), chosen))


def _setting(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (name.strip() and math.isfinite(number)):
        raise ConfigError(f"setting {text!r}: name=number is wanted, such as band=0.01, and the number is finite")
    return name.strip(), number


@app.command
def gains(
    *,
    kp: GainsOption | None = None,
    kv: GainsOption | None = None,
    inertia: GainsOption | None = None,
    force: bool = False,
    where: Where | None = None,
) -> int:
    """Show the gains in force, or change those of an arm that holds or is without power; what is left out stays.

    Changed ones last until the servo ends.

    Parameters
    ----------
    kp
        N m/rad, one number a joint: --kp 800 1200 ...
    kv
        N m s/rad, one number a joint.
    inertia
        kg m^2 of the acceleration feed-forward, one number a joint.
    force
        Take more than four times the robot file's numbers too, and less than a quarter of its Kv.
    """
    if kp is None and kv is None and inertia is None:
        return _show_gains(where or Where())
    return _do(where, lambda servo: servo.change_gains(kp, kv, inertia, force))


def _show_gains(where: Where) -> int:
    chosen = choose_arm(where.deployment, where.arm)
    with ServoClient(chosen.name) as servo:
        now = servo.status()
    if where.json:
        write_json({"law": now.law, "kp": now.kp, "kv": now.kv, "inertia": now.inertia})
    else:
        robot = robot_of_servo(chosen, now.robot)
        out.print(f"{now.arm}: gains in force, law {now.law}", soft_wrap=True)
        print_table(_gains(robot, now))
    return SUCCESS


def _gains(robot: Robot, now: ServoStatus) -> Table:
    table = plain_table("", "joint", "Kp", "Kv", "inertia", "units", words=["units"])
    for name, slides, *numbers in zip(
        robot.joint_names, robot.prismatic.tolist(), now.kp, now.kv, now.inertia, strict=True
    ):
        units = "N/m, N s/m, kg" if slides else "N m/rad, N m s/rad, kg m^2"
        table.add_row(name, *(f"{number:.8g}" for number in numbers), units)
    return table


@app.command
def watch(*, seconds: Seconds = float("inf"), where: Where | None = None) -> int:
    """Print a line whenever mode, fault, law or commander change, until Ctrl-C.

    It looks every 20 ms; what lasts for less time is in the log (`qrobot log events`).

    Parameters
    ----------
    seconds
        End after so long.
    """
    where = where or Where()
    with ServoClient(choose_arm(where.deployment, where.arm).name) as servo:
        for now in servo.watch(seconds):
            if where.json:
                out.print(now.model_dump_json(), soft_wrap=True, markup=False)
            else:
                out.print(_line(now), soft_wrap=True)
    return SUCCESS
