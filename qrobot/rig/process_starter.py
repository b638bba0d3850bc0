"""Starts processes of the `qrobot` command: forked by a process that has imported their libraries, else afresh."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import IO, Final

from qrobot.errors import LinkLost
from qrobot.realtime.forked_process import ForkedProcess
from qrobot.realtime.forking import ForkServer
from qrobot.realtime.own_process import own_command

PROGRAM: Final = "qrobot"

# What processes of an arm import. Of the kernels, small ones: the first of them loads what the compiler needs for any.
PREPARATIONS: Final = (
    "qrobot.cli.main", "qrobot.cli.board", "qrobot.cli.servo", "qrobot.cli.guardian", "qrobot.cli.bridge",
    "qrobot.cli.log", "qrobot.sim_board.deployed", "qrobot.sim_board.server", "qrobot.hwif.transports", "mujoco",
    "qrobot.servo.process.daemon", "qrobot.servo.process.guardian", "qrobot.log.flight", "qrobot.fences.told_fences",
    "qrobot.model.payload_judge", "qrobot.rccl_bridge.server", "qrobot.rccl_bridge.servo_port",
    "qrobot.log.fences_of_log", "qrobot.log.follow", "qrobot.log.room", "qrobot.log.writer",
    "qrobot.rccl_bridge.mailbox_port:warm_up",
)  # fmt: skip

Started = ForkedProcess | subprocess.Popen[bytes]


class ProcessStarter:
    """Starts processes in sessions of their own, without input. It has a fork server from `begin` to `close`."""

    def __init__(self) -> None:
        self._forks: ForkServer | None = None

    def begin(self) -> ForkServer:
        """The fork server, started if there is none; nobody waits for what it imports."""
        if self._forks is None:
            self._forks = ForkServer(f"{PROGRAM}.cli.main:main", PREPARATIONS)
        return self._forks

    def prepare(self) -> None:
        """Wait until processes can be started at once. A KeyboardInterrupt may come in between."""
        forks = self.begin()
        try:
            with suppress(LinkLost):
                forks.wait_ready()
        except BaseException:  # its answer may have been lost
            self.close()
            raise

    def start(self, words: Sequence[str], output: IO[bytes], inherited: Mapping[str, Sequence[int]]) -> Started:
        """A process of the command with these words behind it.

        It is started afresh where there is no fork server, or that one cannot.

        Args:
            words: of the command line.
            output: file for results and messages.
            inherited: variables, and the open descriptors that each names in the process, with commas between them.
        """
        if self._forks is not None:
            with suppress(LinkLost):
                return self._forks.fork((PROGRAM, *words), output.fileno(), inherited)
        return subprocess.Popen(
            own_command(PROGRAM, *words),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            pass_fds=[descriptor for named in inherited.values() for descriptor in named],
            env={**os.environ, **{name: ",".join(map(str, named)) for name, named in inherited.items()}},
        )

    def close(self) -> None:
        """End the fork server; processes go on."""
        if self._forks is not None:
            self._forks.close()
            self._forks = None
