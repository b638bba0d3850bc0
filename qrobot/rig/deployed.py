"""All processes of one arm of a deployment, in the order they need each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from qrobot.config.deployment import Arm
from qrobot.rig.processes import ProcessRig, board_ready, bridge_ready, guardian_ready, servo_ready


@dataclass(frozen=True)
class ArmProcesses:
    """Starts the processes of `arm` in a rig.

    Attributes:
        deployment: file the processes read, as given on the command line.
        board_options, servo_options: command-line options that override the file.
    """

    deployment: str
    arm: Arm
    board_options: tuple[str, ...] = ()
    servo_options: tuple[str, ...] = ()

    def start_board(self, rig: ProcessRig) -> None:
        """Start the emulated board. Raises LinkError with its own words when it does not come up."""
        self._start(rig, "board", self.board_options, lambda: board_ready(self.arm.name))

    def start_servo(self, rig: ProcessRig) -> None:
        """Start the servo and its guardian."""
        options = (*self.servo_options, "--own-guardian")
        self._start(rig, "servo", options, lambda: servo_ready(self.arm.name))
        self._start(rig, "guardian", (), lambda: guardian_ready(self.arm.name))

    def start_bridge(self, rig: ProcessRig) -> None:
        """Start the bridge."""
        host, port = self.arm.bridge.host, self.arm.bridge.port
        self._start(rig, "bridge", (), lambda: bridge_ready(host, port))

    def start_log(self, rig: ProcessRig) -> None:
        """Start the recorder, when the deployment keeps logs."""
        if self.arm.log.directory:
            rig.start(
                self._name("log"), ["log", "record", self.arm.name, "--out", self.arm.log.directory], lambda: True
            )

    def start_all(self, rig: ProcessRig) -> None:
        """Board, servo, guardian, bridge, log."""
        self.start_board(rig)
        self.start_servo(rig)
        self.start_bridge(rig)
        self.start_log(rig)

    def _name(self, what: str) -> str:
        return f"{self.arm.name}-{what}"

    def _start(self, rig: ProcessRig, command: str, options: tuple[str, ...], ready: Callable[[], bool]) -> None:
        rig.start(self._name(command), [command, self.deployment, "--arm", self.arm.name, *options], ready)
