"""Look of `qrobot doctor` at the fences of a deployment: whether they can be in force, and which poses they forbid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from qrobot.cli.arms import choose_arm, fences_of_arm, neighbours_of_arm, robot_of_arm
from qrobot.cli.checks import Finding, Weight
from qrobot.config import Robot
from qrobot.errors import ConfigError
from qrobot.realtime.setup import SetupStep
from qrobot.units import MM_PER_M

if TYPE_CHECKING:
    from qrobot.config.deployment import DeployedArm
    from qrobot.fences.fence_set import FenceSet

GROUP: Final = "fences"
UNREAD_REMEDY: Final = "put the robot file right, or `robot` of the arm in the deployment file"
BODY_REMEDY: Final = (
    "tell the arm's body in the robot file, as docs/how-to/keep-inside-fences.md says, or leave fences out"
)


def look_at_fences(arm: DeployedArm, deployment: str) -> Iterator[Finding]:
    """One finding for the fences of an arm, and one for each pose of its robot file that they forbid."""
    remedy = UNREAD_REMEDY
    try:
        _load_robots(arm, deployment)
        remedy = BODY_REMEDY
        fences = fences_of_arm(arm)
        neighbours_of_arm(arm, deployment)
    except ConfigError as error:
        yield Finding(GROUP, SetupStep(arm.name, False, str(error), remedy), Weight.NEEDED)
        return
    others = [] if arm.fences is None else [f"the arm {name}" for name in arm.fences.arms]
    listed = ", ".join([*(_listed(fences) if fences is not None else ()), *others]) or "none"
    yield Finding(GROUP, SetupStep(arm.name, True, listed), Weight.OPTIONAL)
    if fences is not None:
        steps = _forbidden_poses(robot_of_arm(arm), fences)
        yield from (Finding(GROUP, step, Weight.OPTIONAL) for step in steps)


def _load_robots(arm: DeployedArm, deployment: str) -> None:
    """Read the robot files that the fences of an arm are about. Raises ConfigError: one is not there, or damaged."""
    if arm.fences is not None:
        for each in (arm, *(choose_arm(deployment, name) for name in arm.fences.arms)):
            robot_of_arm(each)


def _listed(fences: FenceSet) -> list[str]:
    shapes = [f"{fence.name} ({fence.shape}, keep {fence.keep})" for fence in fences.fences]
    return [*shapes, *(["its own body"] if fences.self_collision else [])]


def _forbidden_poses(robot: Robot, fences: FenceSet) -> Iterator[SetupStep]:
    """Poses of the robot file at which a part of the arm is past a fence: the servo stops whoever moves there."""
    for pose, q in robot.poses.items():
        worst = min(fences.nearness(q), key=lambda near: near.distance)
        if worst.distance < 0.0:
            detail = f"{worst.body} is {-worst.distance * MM_PER_M:.0f} mm past fence {worst.fence}"
            remedy = "move the fence, or never ask for that pose"
            yield SetupStep(f"pose {pose}", False, detail, remedy)
