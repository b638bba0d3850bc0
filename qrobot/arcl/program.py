"""The calls of ARCL's application interface that begin and end a program, and those that name a robot."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from qrobot.arcl.attributes import Attribute, attribute_values
from qrobot.arcl.joint_units import units_of
from qrobot.arcl.kinematics import ManipulatorKinematics, kinematics
from qrobot.arcl.machine import MachineSettings, machine
from qrobot.arcl.machine.registry import EMULATED
from qrobot.arcl.motion import Motion
from qrobot.arcl.opened import newest, open_robots, remember
from qrobot.arcl.path_calls import WAY_BACK_DEG, WAY_BACK_MM
from qrobot.arcl.positions import TL, Pos, PosMark, joints_of
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.switches import switches
from qrobot.arcl.trans import Trans
from qrobot.arcl.vectors import require_name
from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.errors import JointLimit, MotionError, QRobotError, letting_go, raise_first
from qrobot.motion import Blend, Trsf, warm_up, warm_up_cartesian
from qrobot.rci.arguments import as_float, shown
from qrobot.rci.bad_end import at_bad_end, interpreter_ends_well, stop_all, stop_each
from qrobot.rci.machine_choice import choice_for, machine_choice
from qrobot.rci.tcp import address_text

DEFAULT_ROBOT = "puma560"
DEFAULT_MACHINE = "bridge"


def arcl_open(*attributes: Any) -> ArclRobot:
    """Open a robot: `arcl_open(ARCL_ARGCV, len(sys.argv), sys.argv, 0)`.

    Returns when the arm holds its position under power. A program that moves several calls it for each.

    Raises:
        MotionError: an attribute is unknown or impossible.
        ConfigError: no such robot, layer or switch.
        LinkError, ServoFault: the arm cannot be taken.
    """
    given = attribute_values("arcl_open", attributes)
    if Attribute.ARCL_ARGCV in given:
        switches.take(_argv(*given[Attribute.ARCL_ARGCV]))
    one = {attribute: values[0] for attribute, values in given.items() if len(values) == 1}
    bridge = _bridge(one.get(Attribute.ARCL_BRIDGE, ""))
    arm = _robot(one.get(Attribute.ARCL_ROBOT, DEFAULT_ROBOT), bridge)
    layer = switches.ami or one.get(Attribute.ARCL_AMI) or machine_choice().ami or DEFAULT_MACHINE
    if switches.unlimited and layer != "offline":
        raise MotionError("+nolim: joints without ranges are for the off-line machine alone")
    aki = kinematics(arm, switches.aki or one.get(Attribute.ARCL_AKI, ""), switches.unlimited)
    settings = MachineSettings(
        arm, aki.zero, _period(one.get(Attribute.ARCL_PERIOD)), _stream(one, arm), Path(sys.argv[0] or "python").name,
        Attribute.ARCL_CLEAR in given, _start(one.get(Attribute.ARCL_START), arm, aki, bridge), bridge,
    )  # fmt: skip
    if layer not in EMULATED:  # no sample may wait for the compiler
        warm_up(arm.n, Blend.ZERO_JERK)
        warm_up_cartesian(aki.limits, aki, arm.poses["park"] - aki.zero, Blend.ZERO_JERK)
    rp = ArclRobot(arm, aki, machine(layer, settings), bridge)
    remember(rp)
    return rp


def _argv(argc: int, argv: list[str]) -> list[str]:
    if not isinstance(argv, list) or argc != len(argv):
        raise MotionError("ARCL_ARGCV takes argc and argv, as in len(sys.argv), sys.argv")
    return argv


def _period(given: object) -> float | None:
    """A sample period, ms; which are possible the machine knows. Raises MotionError: no number."""
    if given is None:
        return None
    if isinstance(given, bool) or not isinstance(given, int | float) or not isfinite(as_float(given)):
        raise MotionError(f"ARCL_PERIOD: a number of ms is needed, not {shown(given)}")
    return float(given)


def _bridge(address: object) -> str:
    """Address of a bridge in full; empty for the program's. Raises MotionError, ConfigError: that is no address."""
    if not isinstance(address, str):
        raise MotionError(f"ARCL_BRIDGE: host:port is needed, not {address!r}")
    return address_text(address) if address else ""


def _robot(name: object, bridge: str) -> Robot:
    if not isinstance(name, str | Robot):
        raise MotionError(f"ARCL_ROBOT: a name or a path is needed, not {name!r}")
    arm = load_robot(name) if isinstance(name, str) else name
    return choice_for(arm.name, bridge).robot or arm


def _stream(one: dict[Attribute, Any], arm: Robot) -> Path | None:
    """The file of the stream; in a folder one for each robot that is opened."""
    named = switches.stream or one.get(Attribute.ARCL_STREAM)
    if named:
        return Path(named)
    folder = machine_choice().stream
    if folder is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    number = len(open_robots())
    return folder / f"{arm.name}{f'-{number + 1}' if number else ''}.arcl"


def _start(degs: Sequence[float] | None, arm: Robot, aki: ManipulatorKinematics, bridge: str) -> Floats | None:
    """Setpoints at which an arm stands that is not there: as the program says, or whoever has started it; or None."""
    if degs is None:
        chosen = choice_for(arm.name, bridge).start
        return None if chosen is None else chosen - aki.zero
    q, limits = joints_of("ARCL_START", degs, units_of(arm)), aki.limits
    outside = np.flatnonzero(~((q >= limits.q_min) & (q <= limits.q_max)))
    if outside.size and not switches.unlimited:
        joint = int(outside[0])
        raise JointLimit(f"ARCL_START: joint {joint + 1} ({limits.names[joint]}) is out of its range; +nolim allows it")
    return q


def arcl_close(rp: ArclRobot, power_off: bool = False) -> None:
    """Wait until all motions of a robot are done, and let go of it; a second call does nothing.

    Raises:
        MotionError: one of them could not be done; the arm is let go all the same.
    """
    _opened("arcl_close", rp)
    rp.close(power_off)


def end_all(well: bool) -> None:
    """The program has ended: do what motions wait if it ended well, else stop all; and let go of all robots.

    Raises the first error of a program that ended well, and Ctrl-C, once all robots are let go.
    """
    failed: list[BaseException] = []
    for rp in open_robots():
        try:
            _end(rp, well and all(isinstance(error, QRobotError) for error in failed))
        except BaseException as error:
            failed.append(error)
    raise_first(failed, ours_too=well)


def _end(rp: ArclRobot, well: bool) -> None:
    """`end_all` for one robot: where it cannot do its motions the others do theirs, after Ctrl-C all stop."""
    with letting_go(rp.abandon):
        try:
            if well:
                rp.finish()
            else:
                stop_all()
        except QRobotError:
            raise
        except BaseException:
            stop_all()
            raise


@at_bad_end
def _stop_all() -> None:
    stop_each([rp.begin_stop for rp in open_robots()])


def _at_exit() -> None:
    try:
        end_all(well=interpreter_ends_well())
    except QRobotError as error:
        print(error, file=sys.stderr)


atexit.register(_at_exit)


def _opened(call: str, rp: object) -> ArclRobot:
    if not isinstance(rp, ArclRobot):
        raise MotionError(f"{call}: a robot is needed, from arcl_open, not {rp!r}")
    return rp


def ami_treal(rp: ArclRobot | None = None) -> float:
    """The real-time clock, ms since a robot's first sample; of that opened last when none is named."""
    return (newest() if rp is None else _opened("ami_treal", rp)).treal


def move(rp: ArclRobot, pos: Pos, *attributes: Any) -> Motion:
    """Queue a motion: `move(rp, pos, MOV_TRAJ, TRAJ_CART, 0)`; see `ArclRobot.move`."""
    return _opened("move", rp).move(pos, *attributes)


def stop(rp: ArclRobot, *attributes: Any) -> None:
    """Drop all motions and come to rest; see `ArclRobot.stop`."""
    _opened("stop", rp).stop(*attributes)


def arcl_skip(rp: ArclRobot) -> None:
    """End the motion under way and go on to the next one; see `ArclRobot.skip`."""
    _opened("arcl_skip", rp).skip()


def arcl_override(rp: ArclRobot, percent: float) -> None:
    """Let motions go at a share of their speed; see `ArclRobot.override`."""
    _opened("arcl_override", rp).override(percent)


def arcl_keep_path(
    rp: ArclRobot, keep: bool = True, way_back_mm: float = WAY_BACK_MM, way_back_deg: float = WAY_BACK_DEG
) -> None:
    """Let motions outlive a stop of the servo; see `ArclRobot.keep_path`."""
    _opened("arcl_keep_path", rp).keep_path(keep, way_back_mm, way_back_deg)


def arcl_retract(rp: ArclRobot, mm: float) -> None:
    """Let the arm go back by the way it came after a collision; see `ArclRobot.retract`."""
    _opened("arcl_retract", rp).retract(mm)


def arcl_kept(rp: ArclRobot) -> str:
    """Reason for which the arm stands off its path; see `ArclRobot.kept`."""
    return _opened("arcl_kept", rp).kept


def arcl_pause(rp: ArclRobot) -> None:
    """Let motions come to a standstill on their path, or on the way back to it; see `ArclRobot.pause`."""
    _opened("arcl_pause", rp).pause()


def arcl_resume(rp: ArclRobot) -> None:
    """Let motions go on, and an arm that has left its path be led back to it; see `ArclRobot.resume`."""
    _opened("arcl_resume", rp).resume()


def arcl_wait(rp: ArclRobot, predicate: Callable[[], object] | None = None) -> None:
    """Wait until all motions are done, or a predicate is true; see `ArclRobot.wait`."""
    _opened("arcl_wait", rp).wait(predicate)


def gripper(rp: ArclRobot, command: int, value: float | None = None) -> None:
    """Command the gripper: `gripper(rp, GRIP_CLOSE_BY, 40.0)`; see `ArclRobot.gripper`."""
    _opened("gripper", rp).gripper(command, value)


def arcl_setload(
    rp: ArclRobot, kg: float, centre: Sequence[float] | None = None, inertia: Sequence[float] | None = None
) -> None:
    """Tell the arm what its hand holds; see `ArclRobot.setload`."""
    _opened("arcl_setload", rp).setload(kg, centre, inertia)


def arcl_collision(rp: ArclRobot, reaction: str = "stop", thresholds: Sequence[float] | None = None) -> None:
    """Choose what follows a collision, and when one is told; see `ArclRobot.collision`."""
    _opened("arcl_collision", rp).collision(reaction, thresholds)


def teach(rp: ArclRobot, function: Callable[..., object]) -> int:
    """Let a person move the arm by its teach pendant; `function(T6, rp)` at each ENTER. See `ArclRobot.teach`."""
    return _opened("teach", rp).teach(function)


def fkine(rp: ArclRobot, degs: Sequence[float], name: str = "T6") -> Trans:
    """T6 at joint positions, degrees (mm); see `ArclRobot.fkine`."""
    return _opened("fkine", rp).fkine(degs, name)


def where(rp: ArclRobot, name: str = "HERE") -> Trans:
    """T6 at the measured joint positions; see `ArclRobot.where`."""
    return _opened("where", rp).where(name)


def joint_pos(rp: ArclRobot, name: str, degs: Sequence[float], *tool: Trsf | PosMark | int) -> Pos:
    """A position given by its joints, degrees (mm); `TL, tool` behind them names the tool whose speed counts.

    Raises:
        MotionError: not n finite numbers, or something else behind them.
    """
    return _opened("joint_pos", rp).joint_pos(name, degs, _tool(tool))


def robot_pos(rp: ArclRobot, name: str, *tool: Trsf | PosMark | int) -> Pos:
    """A pose of the robot file, such as "park"; `TL, tool` as for `joint_pos`. Raises ConfigError: there is none."""
    require_name("robot_pos", name)
    return _opened("robot_pos", rp).pose(name, _tool(tool))


def _tool(given: tuple[Trsf | PosMark | int, ...]) -> Trsf | None:
    """The tool that stands behind joint positions, with or without the 0 that closes a list."""
    if not given or given == (0,):
        return None
    if given[-1] == 0:
        given = given[:-1]
    if len(given) != 2 or given[0] is not TL or not isinstance(given[1], Trsf):
        raise MotionError("write TL and the transform of the tool behind the joint positions, or nothing")
    return given[1]
