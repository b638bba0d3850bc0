"""Ways to the arms of a deployment file: one, or several that a program names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NoReturn, TypeAlias

from qrobot.cli.arms import insist_on_its_board, place_of_arm, robot_of_arm
from qrobot.config.deployment import DeployedArm
from qrobot.errors import ConfigError
from qrobot.rci import LinkFactory, TcpLink
from qrobot.wire import Hello

ArmLinks: TypeAlias = LinkFactory | dict[str, LinkFactory]
"""Ways for whatever a program names; or, of several arms, by their names and by the addresses of their bridges."""


def link_of(arm: DeployedArm, offline: bool = False) -> LinkFactory:
    """The way to the bridge of an arm of a deployment file; `offline` to an ideal arm in this process.

    Raises ConfigError: the arm that runs here is another one than the file tells of.
    """
    if offline:
        from qrobot.rccl.offline import OfflineLink

        return partial(OfflineLink, robot=robot_of_arm(arm))
    insist_on_its_board(arm)
    return partial(TcpLink, address=(arm.bridge.host, arm.bridge.port), arm=arm.name)


def links_of(arms: Sequence[DeployedArm], link: Callable[[DeployedArm], LinkFactory]) -> ArmLinks:
    """The ways that `link` makes to arms of a deployment file."""
    if len(arms) == 1:
        return link(arms[0])
    made = [(arm, link(arm)) for arm in arms]
    by_name = {arm.name: way for arm, way in made}
    return by_name | {place_of_arm(arm): way for arm, way in made}


def the_only(links: ArmLinks) -> LinkFactory:
    """Way of a program that names no arm; refused where there are several. See `ArmLinks`."""
    return _refuse if isinstance(links, dict) else links


def _refuse(hello: Hello) -> NoReturn:
    raise ConfigError(
        f"there are several arms, and the program does not say which one its {hello.robot!r} is: choose one with --arm "
        "or name them in the program (`rccl_open` of qrobot.multi_rccl, `rci_robot` of qrobot.rci)"
    )
