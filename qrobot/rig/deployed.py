"""All processes of one arm of a deployment, in the order they need each other."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from qrobot.config.deployment import DeployedArm
from qrobot.errors import LinkBusy
from qrobot.rig.processes import Child, ProcessPlan, ProcessRig, board_ready, bridge_ready, guardian_ready, servo_ready

# The higher the rank, the sooner a process ends: the servo stops the arm while board, guardian and log still live.
PROGRAM_RANK, BRIDGE_RANK, SERVO_RANK, LOG_RANK, GUARDIAN_RANK, BOARD_RANK = 5, 4, 3, 2, 1, 0
RESTARTS = 3  # [A] a minute, of processes without which the servo holds the arm


def require_free_port(arm: DeployedArm) -> None:
    """Raise LinkBusy when somebody answers where the bridge of `arm` is to listen."""
    host, port = arm.bridge.host, arm.bridge.port
    if not bridge_ready(host, port):
        return
    if servo_ready(arm.name):
        raise LinkBusy(
            f"{host}:{port} is in use: {arm.name} runs already, as `qrobot ctl status` tells; end that first"
        )
    raise LinkBusy(f"{host}:{port} is in use: does another bridge run? Choose another port for {arm.name}")


@dataclass(frozen=True)
class ArmProcesses:
    """Starts and ends the processes of one arm in a rig.

    Attributes:
        deployment: file the processes read, as given on the command line.
        arm: which arm of it.
        servo_options: of `qrobot servo`, for whoever chooses for a run and leaves the file as it is.
    """

    rig: ProcessRig
    deployment: str
    arm: DeployedArm
    servo_options: tuple[str, ...] = ()

    def start_all(self) -> None:
        """Board, servo, guardian, bridge, log. Raises LinkError in the words of the process that failed.

        A card on this machine's own bus needs no board process: the servo reaches it by itself.
        """
        require_free_port(self.arm)
        plans = [] if self.arm.board.kind == "port" else [self.board()]
        plans += [self.servo(), self.guardian(), self.bridge()]
        if self.arm.log.directory:
            plans.append(self.log("--output", self.arm.log.directory))
        self.rig.start(*plans)

    def start(self, *commands: str) -> None:
        """Start the processes of these commands, in this order: board, servo, guardian, bridge.

        Raises LinkBusy when the bridge's port is taken, and what `ProcessRig.start` raises.
        """
        if "bridge" in commands:
            require_free_port(self.arm)
        plans = {"board": self.board, "servo": self.servo, "guardian": self.guardian, "bridge": self.bridge}
        self.rig.start(*(plans[command]() for command in commands))

    def board(self, *options: str) -> ProcessPlan:
        """The emulated board."""
        return self._plan(("board", self.deployment), options, partial(board_ready, self.arm.name), BOARD_RANK)

    def servo(self, *options: str) -> ProcessPlan:
        """The servo; it refuses power until a guardian watches it."""
        options = (*self.servo_options, *options, "--own-guardian")
        return self._plan(("servo", self.deployment), options, partial(servo_ready, self.arm.name), SERVO_RANK)

    def guardian(self, *options: str) -> ProcessPlan:
        """The guardian of a running servo; it follows restarts of servo and board, whenever they come."""
        options = (*options, "--linger", "inf")
        since_ns = time.monotonic_ns()
        ready = partial(guardian_ready, self.arm.name, since_ns)
        return self._plan(("guardian", self.deployment), options, ready, GUARDIAN_RANK)

    def bridge(self, *options: str) -> ProcessPlan:
        """The bridge."""
        host, port = self.arm.bridge.host, self.arm.bridge.port
        return self._plan(
            ("bridge", self.deployment), options, lambda _: bridge_ready(host, port), BRIDGE_RANK, RESTARTS
        )

    def log(self, *options: str) -> ProcessPlan:
        """The recorder of the servo's telemetry."""
        return self._plan(("log", "record", self.deployment), options, None, LOG_RANK, RESTARTS, vital=False)

    def start_program(self, program: Path) -> Child:
        """Start a program of this arm."""
        arguments = ["run", "--deployment", self.deployment, "--arm", self.arm.name, str(program)]
        self.rig.start(ProcessPlan(self.name_of("program"), arguments, None, PROGRAM_RANK))
        return self.rig.children[self.name_of("program")]

    def end(self, *commands: str) -> None:
        """End the processes of these commands, in this order."""
        for command in commands:
            self.rig.end(self.name_of(command))

    def name_of(self, command: str) -> str:
        """Name of a process in the rig."""
        return f"{self.arm.name}-{command}"

    def _plan(
        self,
        command: tuple[str, ...],
        options: tuple[str, ...],
        ready: Callable[[int], bool] | None,
        rank: int,
        restarts: int = 0,
        vital: bool = True,
    ) -> ProcessPlan:
        arguments = [*command, "--arm", self.arm.name, *options]
        return ProcessPlan(self.name_of(command[0]), arguments, ready, rank, restarts, vital)
