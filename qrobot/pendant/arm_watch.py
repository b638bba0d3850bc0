"""The arm as its bridge tells it: an observer that connects anew for as long as it is wanted."""

from __future__ import annotations

import asyncio
import logging
import shlex
from collections.abc import Callable
from contextlib import suppress
from typing import Final

from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.errors import LinkError, LinkLost, LocalProtocolError, QRobotError
from qrobot.rci.client import Client
from qrobot.rci.link import check_welcome
from qrobot.realtime.bridge_token import arm_of_token, token_for
from qrobot.wire import ClientRole, Hello, State, Stop, Welcome

PERIOD_US: Final = 28_000
SILENCE_S: Final = 1.0  # ten of the longest sample periods
RETRY_S: Final = 0.5
CHUNK: Final = 1 << 16
_log = logging.getLogger(__name__)


class ArmWatch:
    """Follows one arm.

    Args:
        arm: of the deployment.
        robot: of the arm; of another one, or another arm, nothing is told, but it can be stopped.
        tell: takes each STATE, newest only.
        changed: called when `problem` is another.
        deployment: file of the arm, for advice; may be empty.

    Attributes:
        problem: why nothing is heard of the arm, "" while all is well.
    """

    def __init__(
        self,
        arm: DeployedArm,
        robot: Robot,
        tell: Callable[[State], None],
        changed: Callable[[], None],
        deployment: str = "",
    ) -> None:
        self.problem = "looking for the arm"
        self._start = f"qrobot up {shlex.quote(deployment)}" if deployment else "qrobot up"
        self._arm, self._robot, self._tell, self._changed = arm, robot, tell, changed
        self._stranger = ""  # what is wrong with the robot that answers
        self._found = ""  # name of the arm that answers, where its token tells it
        self._address = (arm.bridge.host, arm.bridge.port)
        self._line: tuple[Client, asyncio.StreamWriter] | None = None

    async def run(self) -> None:
        """Watch until cancelled."""
        while True:
            try:
                await self._watch()
            except (QRobotError, OSError) as error:
                self._say(self._why(error))
            except Exception as error:  # whatever it is: STOP by the bridge rests on this watch, which begins anew
                _log.exception("the watch of arm %s failed, and begins anew", self._arm.name)
                self._say(f"the watch of arm {self._arm.name} failed ({type(error).__name__}), and begins anew")
            await asyncio.sleep(RETRY_S)

    def ask_stop(self, power_off: bool = False) -> bool:
        """Have the bridge stop the arm, and take power away with `power_off`; False when it is not connected.

        Returns at once. To be called where `run` runs.
        """
        if self._line is None:
            return False
        client, writer = self._line
        try:
            client.tell(Stop(power_off))
            writer.write(client.say(None))
        except LocalProtocolError:  # the bridge has not let us in yet
            return False
        return not writer.is_closing()

    async def _watch(self) -> None:
        reader, writer = await asyncio.open_connection(*self._address)
        try:
            client = self._greet(writer)
            self._line = client, writer
            while True:
                await self._hear(client, reader)
        finally:
            self._line = None
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def _greet(self, writer: asyncio.StreamWriter) -> Client:
        token = token_for(*self._address)
        self._found = arm_of_token(token)
        hello = Hello(ClientRole.OBSERVER, "", "qrobot pendant", PERIOD_US, token)
        client = Client(hello, f"the bridge of {self._arm.name}")
        writer.write(client.greet())
        return client

    async def _hear(self, client: Client, reader: asyncio.StreamReader) -> None:
        try:
            async with asyncio.timeout(SILENCE_S):  # `wait_for` of Python 3.11 may swallow a cancellation
                client.take(await reader.read(CHUNK))
        except TimeoutError:
            raise client.silence() from None
        if (welcome := client.pop_welcome()) is not None:
            self._stranger = self._judge(welcome)
        if (state := client.pop_state()) is not None:
            self._say(self._stranger)
            if not self._stranger:
                self._tell(state)

    def _judge(self, welcome: Welcome) -> str:
        """Complaint about a bridge of another robot or arm than that of the deployment, "" when it is this one."""
        remedy = "start the pendant with the deployment file of that arm (--deployment)"
        try:
            check_welcome(welcome, self._robot, "this deployment")
        except LinkError as error:
            return f"at {self._where} {error}: {remedy}"
        if self._found not in ("", self._arm.name):
            return f"at {self._where} is the bridge of arm {self._found}, not of {self._arm.name}: {remedy}"
        return ""

    @property
    def _where(self) -> str:
        return ":".join(map(str, self._address))

    def _why(self, error: Exception) -> str:
        if isinstance(error, QRobotError) and not isinstance(error, LinkLost):
            return str(error)
        return f"no arm {self._arm.name} at {self._where}: start it with `{self._start}`"

    def _say(self, problem: str) -> None:
        if problem != self.problem:
            self.problem = problem
            self._changed()
