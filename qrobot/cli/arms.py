"""One arm of a deployment file, out of command-line options: which it is, its robot and what surrounds it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from qrobot.arrays import Words
from qrobot.cli.console import note
from qrobot.config import Robot, load_robot
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.config.identified import IdentifiedModel, load_model, with_model
from qrobot.errors import ConfigError, LinkError
from qrobot.servo.laws.names import SHIPPED_LAWS
from qrobot.units import MM_PER_M

if TYPE_CHECKING:
    from qrobot.fences.fence_set import FenceSet
    from qrobot.servo.neighbour import Neighbour

DEFAULT_DEPLOYMENT = "emulator"
LAW_NAMES = f"{', '.join(SHIPPED_LAWS)}, or your own as path/to/file.py:name, from this folder"  # as help tells them


def choose_arm(deployment: str, name: str | None) -> DeployedArm:
    """The arm called `name`, or the only one. Raises ConfigError when that is not clear."""
    arms = {arm.name: arm for arm in load_deployment(deployment).arm}
    if name is None and len(arms) == 1:
        return next(iter(arms.values()))
    if name in arms:
        return arms[name]
    known = ", ".join(arms)
    if name is None:
        raise ConfigError(f"{deployment} has several arms: choose one with --arm ({known})")
    raise ConfigError(f"{deployment} has no arm {name!r}; there are: {known}")


def choose_arms(deployment: str, name: str | None) -> tuple[DeployedArm, ...]:
    """The arm called `name`, or all of the file. Raises ConfigError when there is none of that name."""
    return load_deployment(deployment).arm if name is None else (choose_arm(deployment, name),)


def robot_of_arm(arm: DeployedArm) -> Robot:
    """The robot file an arm names."""
    return load_robot(arm.robot)


def place_of_arm(arm: DeployedArm) -> str:
    """The address of an arm's bridge, as programs may name it."""
    from qrobot.rci.tcp import place_text

    return place_text((arm.bridge.host, arm.bridge.port))


def controlled_robot(arm: DeployedArm, model: str | None = None, emulated: bool = False) -> tuple[Robot, str]:
    """The robot as the servo of an arm knows it, and the model it was identified by ("" for the robot file's own).

    A `model` that was asked for has to fit. One of the deployment file that does not is told, and the robot file's
    numbers are used instead: an arm that has always run shall not stand still for it. In lock-step the board is
    `emulated`, whatever the file says.

    Raises:
        ConfigError: `model` is missing, damaged, another robot's, or that of an emulated arm for a real one.
    """
    robot = robot_of_arm(arm)
    if model is not None:
        return with_model(robot, _model_of_arm(arm, model, robot, emulated)), model
    if arm.servo.model is None:
        return robot, ""
    try:
        return with_model(robot, _model_of_arm(arm, arm.servo.model, robot, emulated)), arm.servo.model
    except ConfigError as error:
        note(f"warning: the identified model of {arm.name} is not used, the robot file's numbers are: {error}")
        return robot, ""


def _model_of_arm(arm: DeployedArm, name: str, robot: Robot, emulated: bool) -> IdentifiedModel:
    """The identified model of that name for an arm. Raises ConfigError."""
    model = load_model(name, robot)
    if model.plant and not (emulated or arm.board.emulated):
        raise ConfigError(
            f"{name} was identified on an emulated arm (plant {model.plant!r}), and {arm.name} is a real one: "
            "record it by `qrobot identify record --go`, and fit that log"
        )
    return model


def robot_of_servo(arm: DeployedArm, driven: str) -> Robot:
    """The robot of an arm whose servo drives the one named `driven`. Raises ConfigError when these are two."""
    robot = robot_of_arm(arm)
    if robot.name != driven:
        raise ConfigError(
            f"the servo of {arm.name} drives {driven}, and this deployment file has {robot.name} there: name the file "
            "that the servo was started with"
        )
    return robot


def insist_on_its_board(arm: DeployedArm) -> None:
    """Raise ConfigError where an arm runs under this name whose board is no emulated one, as the file says it is.

    Every command has the packaged emulated arm by default; copies of its file keep the name.
    """
    from qrobot.hwif.board_memory import attach_board_memory
    from qrobot.servo.emulated_board import insist_on_emulated

    if not arm.board.emulated:
        return
    with suppress(LinkError), attach_board_memory(arm.name) as board:  # no board here: whoever needs one says so
        insist_on_emulated(board.memory, arm.name)


def plant_of_arm(arm: DeployedArm) -> str:
    """The plant as logs and models tell of it; "" where it is no emulated one."""
    return arm.board.plant if arm.board.emulated else ""


def revision_of_arm(arm: DeployedArm) -> str:
    """The deployment's word on the board's revision, or else the robot file's."""
    return arm.board.revision or robot_of_arm(arm).board.revision


def card_of_arm(arm: DeployedArm, read_only: bool = False) -> Words:
    """The card that servo and guardian reach by themselves; none, unless the board is on this machine's ISA bus.

    It is read only when either the file or the caller says so.
    """
    from qrobot.hwif.isa.card import NO_CARD, REAL_CARD, make_card  # kernels: half a second

    transport = arm.board.port
    if transport is None:
        return make_card(NO_CARD)
    return make_card(REAL_CARD, transport.base, revision_of_arm(arm), transport.read_only or read_only)


def fences_of_arm(arm: DeployedArm) -> FenceSet | None:
    """The fences of an arm, None for none. Raises ConfigError when its robot file tells no body."""
    if arm.fences is None:
        return None
    from qrobot.fences.fence_set import fences_of  # kernels

    return fences_of(arm, robot_of_arm(arm))


def neighbours_of_arm(arm: DeployedArm, deployment: str) -> tuple[Neighbour, ...]:
    """Other arms of a deployment that an arm keeps off. Raises ConfigError when a robot file tells no body."""
    if arm.fences is None or not arm.fences.arms:
        return ()
    from qrobot.servo.neighbour import neighbour_between  # kernels

    others = [choose_arm(deployment, name) for name in arm.fences.arms]
    return tuple(neighbour_between(arm, other, robot_of_arm(arm), robot_of_arm(other)) for other in others)


@contextmanager
def inside_fences(arm: DeployedArm) -> Iterator[None]:
    """Motions of programs in this block keep off the fences of an arm. Raises what `fences_of_arm` does."""
    if arm.fences is None:
        yield
        return
    from qrobot.fences.in_force import use_fences

    with use_fences(fences_of_arm(arm), place_of_arm(arm)):
        yield


def tool_of_arm(arm: DeployedArm) -> tuple[float, float, float]:
    """The tip of the tool from the flange, m."""
    x, y, z = arm.servo.tool_mm
    return x / MM_PER_M, y / MM_PER_M, z / MM_PER_M
