"""`qrobot bridge`: robot programs command a servo over TCP, as they commanded RCCL's robot simulator."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, robot_of_arm
from qrobot.cli.console import note
from qrobot.cli.option_types import Port
from qrobot.report import QueuedReport, ReportHandler

if TYPE_CHECKING:
    from qrobot.config.bridge import LinkChoice
    from qrobot.rccl_bridge.isolated_link import IsolatedLink

PRIORITY = 30  # below board and servo, above the programs' trajectory threads


def bridge(deployment: str = DEFAULT_DEPLOYMENT, *, arm: str | None = None, port: Port | None = None) -> None:
    """Serve the packet protocol for one arm, until Ctrl-C.

    One client commands, any number watch. The bridge may be started before the servo and outlives it; clients are told
    when the servo is away, and when another one has come.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    port
        TCP port, overriding the file.
    """
    from qrobot.model.payload_judge import PayloadJudge
    from qrobot.rccl_bridge.mailbox_port import warm_up
    from qrobot.rccl_bridge.server import run_bridge
    from qrobot.rccl_bridge.servo_port import ServoPort
    from qrobot.rccl_bridge.settings import BridgeSettings
    from qrobot.realtime.setup import hard_to_delay, set_fifo
    from qrobot.realtime.startup_order import await_turn
    from qrobot.servo.memory.commander_lock import Authority

    chosen = choose_arm(deployment, arm)
    robot, choice = robot_of_arm(chosen), chosen.bridge
    settings = BridgeSettings(
        choice.host,
        choice.port if port is None else port,
        round(choice.period_ms * 1000),
        link=_maybe_link(choice.link),
    )
    with QueuedReport(note, lambda: set_fifo(PRIORITY)) as told:  # frames wait for the lock that its thread may hold
        logging.basicConfig(level=logging.INFO, format="%(message)s", handlers=[ReportHandler(told)])
        warm_up()
        await_turn()
        with hard_to_delay(PRIORITY):  # frames keep their beat beside busy ordinary programs
            run_bridge(
                ServoPort(chosen.name, robot.name, robot.n, PayloadJudge(robot)),
                settings,
                lambda host, number: told(
                    f"bridge of {chosen.name} ({robot.name}) listens on {host}:{number}{_by_link(settings.link)}"
                ),
                Authority(chosen.name),
                chosen.name,
            )


def _maybe_link(choice: LinkChoice | None) -> IsolatedLink | None:
    """The link of a deployment with its token. Raises ConfigError for a token that is none."""
    from qrobot.rccl_bridge.isolated_link import IsolatedLink, read_link_token

    if choice is None:
        return None
    return IsolatedLink(choice.interface, choice.address, choice.peers, read_link_token(Path(choice.token_file)))


def _by_link(link: IsolatedLink | None) -> str:
    return "" if link is None else f", and on {link.address} ({link.interface}) for {', '.join(link.peers)}"
