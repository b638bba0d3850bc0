"""The engine of one C program: answers its calls until it ends, and lets go of its arm then.

Two channels, so that a call of the program that waits does not keep its functions from being called: the foreground
asks on the first; on the second we have functions called at the samples, within which the program may ask again.
While the program's thread for them is awake it is called without a message (`qrobot.c_transport.callback_slot`).
"""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import numpy as np

from qrobot.c_transport.callback_slot import DONE, SLOT_WORDS, UNSEEN, CallbackSlot
from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import BRIEF, SIZE, VERSION, CallMessage, Op, decode, encode_call
from qrobot.c_transport.program_link import CallDispatcher, MakeDispatcher, ProgramLink
from qrobot.c_transport.usable_time import UsableTime
from qrobot.errors import ConfigError, LinkLost, LinkTimeout, QRobotError
from qrobot.rci.listening import GivesWay, listening
from qrobot.realtime.process_end import end_of_process

GLOBALS: Final = 13  # places of RCCL that the greeting names before that of the callback slot
LANGUAGE: Final = 14  # where it says which library the program calls: an index into what `serve` is given
PROCESS: Final = 16  # where it gives the number of the program's process
CALLBACK_S: Final = 2.0  # a function of the program that takes more of its time will never come back
_LOOK_S: Final = 0.1  # between two looks whether it has had so much
_LOOKS: Final = 40  # some 50 us


class ProgramGone(LinkLost):
    """The program has ended, or is about to."""

    def __init__(self) -> None:
        super().__init__("the program has gone")


class Foreground:
    """The channel on which the program asks.

    Args:
        channel: SOCK_SEQPACKET.
    """

    def __init__(self, channel: socket.socket) -> None:
        self._channel = channel
        self._process: tuple[int, ...] = ()
        self._look, self._wait = select.poll(), select.poll()
        self._look.register(channel, select.POLLRDHUP)
        self._wait.register(channel, select.POLLIN)

    def greet(self) -> tuple[CallMessage, ProgramMemory]:
        """Wait for the greeting and the memory that comes with it. Raises ProgramGone, ConfigError."""
        data, files, _, _ = socket.recv_fds(self._channel, SIZE, 1)
        if len(data) != SIZE or len(files) != 1:
            raise ProgramGone
        hello = decode(data)
        if hello.op != Op.HELLO or hello.n != VERSION:
            raise ConfigError("this program was compiled by another version of qrobot: compile it anew")
        return hello, ProgramMemory(files[0])

    def watch(self, process: int) -> None:
        """Take the end of a process for that of the channel, which its children may keep open."""
        self._process = end_of_process(process)
        for end in self._process:
            self._look.register(end, select.POLLIN)
            self._wait.register(end, select.POLLIN)

    def has_ended(self) -> bool:
        """True when the process that is watched has: no function of it will come back."""
        ready = dict(self._look.poll(0))
        return any(end in ready for end in self._process)

    def send(self, message: CallMessage) -> None:
        """Raises ProgramGone when nobody is there."""
        _send(self._channel, message.encode())

    def receive(self) -> CallMessage:
        """Raises ProgramGone at the end."""
        if self._channel.fileno() not in dict(self._wait.poll()):
            raise ProgramGone
        return decode(_receive(self._channel))

    def listen(self) -> None:
        """Raise ProgramGone when the program has gone or is about to."""
        if self._look.poll(0):
            raise ProgramGone

    def ask(self, question: str) -> str:
        """Put a question to the person at the program's terminal. Raises EOFError when nobody answers."""
        self.send(CallMessage(Op.ASK, text=question))
        answer = self.receive()
        if not answer.n:
            raise EOFError
        return answer.text.rstrip("\n")

    def say(self, text: str) -> None:
        """Print lines at the program's terminal."""
        for line in text.splitlines():
            self.send(CallMessage(Op.SAY, text=line))

    def close(self) -> None:
        """The program goes on, or ends, without us."""
        self._channel.close()
        for end in self._process:
            os.close(end)


class Background:
    """The channel on which functions of the program are called.

    Args:
        channel: SOCK_SEQPACKET.
    """

    def __init__(self, channel: socket.socket) -> None:
        channel.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(_LOOK_S))  # settimeout would poll first
        self._channel = channel
        self._calling = threading.RLock()  # a function may move the arm, which asks for another function
        self.dispatcher: CallDispatcher | None = None
        self.time = UsableTime(os.getpid())
        self.slot = CallbackSlot(np.zeros(SLOT_WORDS, np.int64))

    def call(self, op: Op, place: int) -> None:
        """Have a function called; it may ask meanwhile.

        Raises:
            ProgramGone: the program has gone.
            LinkTimeout: the function does not come back.
        """
        with self._calling:
            progress = self.slot.call(op, place)
            if progress == DONE:
                return
            if progress == UNSEEN:
                _send(self._channel, encode_call(op, self.slot.number, place))
            while len(data := self._receive()) != BRIEF:
                _send(self._channel, self._answer(decode(data)).encode())

    def signal(self, place: int) -> None:
        """Have an event counted; nobody waits for it in a program that has gone."""
        with suppress(ProgramGone):
            self.call(Op.SIGNAL, place)

    def _receive(self) -> bytes:
        if data := self._receive_soon():
            return data
        self.time.begin()
        had_s = 0.0
        while had_s < CALLBACK_S:
            with suppress(BlockingIOError):
                return _receive(self._channel)
            had_s += self.time.usable_s(_LOOK_S)
        raise LinkTimeout(f"a function of the program, called at a sample, has not come back within {CALLBACK_S:g} s")

    def _receive_soon(self) -> bytes:
        """A message that comes while we stay awake for it, which is cheaper than to be woken up; else nothing."""
        for _ in range(_LOOKS):
            with suppress(BlockingIOError):
                return _receive(self._channel, socket.MSG_DONTWAIT)
        return b""

    def _answer(self, message: CallMessage) -> CallMessage:
        if self.dispatcher is None:
            raise ProgramGone
        return _answer(self.dispatcher, message, background=True)

    def end(self) -> None:
        """The program has ended: calls raise ProgramGone, those under way too, though children may have its channel."""
        with suppress(OSError):
            self._channel.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """No function will be called any more."""
        self._channel.close()


def serve(foreground: socket.socket, background: socket.socket, languages: Sequence[MakeDispatcher]) -> None:
    """Answer a program until it ends, and let go of its arms.

    Args:
        foreground, background: the two channels.
        languages: makers of dispatchers: of RCCL, of ARCL, of Multi-RCCL.

    Raises:
        ConfigError: it was compiled by another version, or calls a library that is not among the languages.
        QRobotError: an arm was lost, and the program could not be told.
    """
    front, back = Foreground(foreground), Background(background)
    try:
        _converse(front, back, languages)
    except ProgramGone:  # it had nothing to ask
        pass
    finally:
        front.close()
        back.close()


def serve_descriptors(languages: Sequence[MakeDispatcher]) -> int:
    """Serve the program at the other end of the descriptors on the command line; the exit status."""
    foreground, background = (socket.socket(fileno=int(word)) for word in sys.argv[1:3])
    try:
        serve(foreground, background, languages)
    except QRobotError as error:
        print(f"motion engine: {error}", file=sys.stderr)
        return 1
    return 0


def _converse(front: Foreground, back: Background, languages: Sequence[MakeDispatcher]) -> None:
    try:
        hello, memory = front.greet()
        front.watch(hello.refs[PROCESS])
        make = _maker(languages, hello.refs[LANGUAGE])
    except ConfigError as error:
        front.send(CallMessage(Op.ERROR, text=str(error)))
        raise
    sys.argv[0] = hello.text  # how links greet
    back.time = UsableTime(hello.refs[PROCESS])
    back.slot = CallbackSlot(memory.words(hello.refs[GLOBALS], SLOT_WORDS))
    link = ProgramLink(back.call, back.signal, front.ask, front.say, back.slot.others_wait)
    back.dispatcher = dispatcher = make(memory, hello.refs, link)
    front.send(CallMessage(Op.REPLY))
    try:
        with listening(front.listen):
            while True:
                front.send(_answer(dispatcher, front.receive()))
    except ProgramGone:
        if front.has_ended():
            back.end()
    finally:
        dispatcher.let_go()


def _maker(languages: Sequence[MakeDispatcher], language: int) -> MakeDispatcher:
    if not 0 <= language < len(languages):
        raise ConfigError("this program calls a library that is not served here: start it by itself or by `qrobot run`")
    return languages[language]


def _answer(dispatcher: CallDispatcher, message: CallMessage, background: bool = False) -> CallMessage:
    try:
        return dispatcher.answer(message, background)
    except GivesWay:
        return CallMessage(Op.AGAIN)
    except QRobotError as error:
        return CallMessage(Op.ERROR, text=str(error))


def _send(channel: socket.socket, data: bytes) -> None:
    try:
        channel.send(data)
    except OSError as error:
        raise ProgramGone from error


def _receive(channel: socket.socket, flags: int = 0) -> bytes:
    """A message; BlockingIOError when there is none in the time that was set."""
    try:
        data = channel.recv(SIZE, flags)
    except BlockingIOError:
        raise
    except OSError as error:
        raise ProgramGone from error
    if not data:
        raise ProgramGone
    return data


def _timeval(seconds: float) -> bytes:
    """`struct timeval`."""
    return struct.pack("ll", int(seconds), round(seconds % 1.0 * 1e6))
