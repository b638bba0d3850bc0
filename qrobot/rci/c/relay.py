"""The way from a program in C that uses RCI to an arm on virtual time: a bridge in this process, one period per answer.

The program connects to it for each robot that a task wants, as it would to the bridge of that robot, by the name that
the robot has here. Each of its commands goes to the link of that robot, which lets a sample period pass, and the STATE
comes back. A conversation that the program has ended is over, and its robot let go, before its next one with that
robot, and before the relay ends.
"""

from __future__ import annotations

import secrets
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from qrobot.errors import QRobotError
from qrobot.rci.environment import Environment, environment
from qrobot.rci.link import Link
from qrobot.rci.robot_data import KnownRobot
from qrobot.wire import Bye, Command, Connection, ErrorCode, Hello, Side, WireError

RELAY: Final = "QROBOT_RCI_RELAY"  # environment: where the relay of a program is
TIME: Final = "QROBOT_RCI_TIME"  # environment: "virtual", or real without it
ARMS: Final = "QROBOT_RCI_ARMS"  # environment: NAME=HOST:PORT of each arm, where there are several
TOKEN: Final = "QROBOT_TOKEN"  # environment: what a program shows to a bridge
_CHUNK: Final = 4096
_OVER_S: Final = 10.0  # [A] in which a conversation that the program has left comes to its end


@contextmanager
def relay() -> Iterator[dict[str, str]]:
    """Serve a program that is started with these environment variables; in real time it needs no relay."""
    surroundings = environment()
    arms = {ARMS: ",".join(map("=".join, sorted(surroundings.bridges.items())))}
    if not surroundings.virtual_time:
        yield arms
        return
    token = secrets.token_hex(16)
    begun: list[_Conversation] = []
    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=_accept, args=(server, surroundings, token.encode(), begun), daemon=True).start()
        try:
            yield arms | {RELAY: f"127.0.0.1:{server.getsockname()[1]}", TIME: "virtual", TOKEN: token}
        finally:
            server.shutdown(socket.SHUT_RDWR)
            for conversation in begun:
                conversation.over.wait(_OVER_S)


def _accept(server: socket.socket, surroundings: Environment, token: bytes, begun: list[_Conversation]) -> None:
    while True:
        try:
            client, _ = server.accept()
        except OSError:  # the program has ended
            return
        begun[:] = [each for each in begun if not each.over.is_set()]
        conversation = _Conversation(client, surroundings, token, tuple(begun))
        begun.append(conversation)
        threading.Thread(target=conversation.run, daemon=True).start()


class _Conversation:
    """One task of the program with its robot.

    Attributes:
        over: the robot has been let go.
        robot: and its task, once the program has told them.
    """

    def __init__(
        self, client: socket.socket, surroundings: Environment, token: bytes, before: tuple[_Conversation, ...]
    ) -> None:
        self._client, self._surroundings, self._token, self._before = client, surroundings, token, before
        self._connection = Connection(Side.SERVER)
        self._link: Link | None = None
        self.over = threading.Event()
        self.robot: KnownRobot | None = None

    def run(self) -> None:
        """Answer until either side has enough of it."""
        try:
            self._serve()
        finally:
            self.over.set()

    def _serve(self) -> None:
        with self._client:
            try:
                while not self._connection.ended and (data := self._client.recv(_CHUNK)):
                    self._client.sendall(self._answer(data))
            except OSError:
                pass  # the program was killed
            except QRobotError as error:
                self._refuse(ErrorCode.SERVO_GONE, str(error))
            finally:
                if self._link is not None:
                    self._link.close("the program has ended")

    def _answer(self, data: bytes) -> bytes:
        self._connection.receive_data(data)
        answers = b""
        while (event := self._connection.next_event()) is not None:
            match event:
                case Hello():
                    answers += self._greet(event)
                case Command() if self._link is not None:
                    answers += self._connection.send(self._link.exchange(event))
                case Bye():
                    break
        return answers

    def _greet(self, hello: Hello) -> bytes:
        if not secrets.compare_digest(hello.auth, self._token):
            return self._connection.send(WireError(ErrorCode.AUTHENTICATION, "this relay serves one program", True))
        self.robot = KnownRobot(hello.program, hello.robot)
        for conversation in self._before:
            if conversation.robot == self.robot:
                conversation.over.wait(_OVER_S)
        self._before = ()
        self._link = self._surroundings.links(self.robot, hello)
        welcome = self._connection.send(self._link.open())
        return welcome + self._connection.send(self._link.exchange(None))

    def _refuse(self, code: ErrorCode, text: str) -> None:
        if not self._connection.ended:
            with suppress(OSError, QRobotError):  # it has gone already
                self._client.sendall(self._connection.send(WireError(code, text, True)))
