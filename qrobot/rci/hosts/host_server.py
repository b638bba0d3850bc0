"""The processor that a host offers: it answers programs, and runs the tasks of one at a time."""

from __future__ import annotations

import hmac
import os
import platform
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from qrobot.errors import LinkBusy, LinkError, LinkLost, RemoteProtocolError
from qrobot.rci.hosts.hosted_program import FORWARDED, HostedProgram
from qrobot.rci.hosts.packets import (
    LONGEST_TEXT,
    PROTOCOL,
    BootPacket,
    EndPacket,
    ExchangePacket,
    HelloPacket,
    HostReply,
    HostRequest,
    Offer,
    OrderPacket,
    decode_request,
    encode,
    failure_of,
)
from qrobot.rci.hosts.session import answer_questions, listening, open_session
from qrobot.rci.hosts.settings import HostSettings
from qrobot.realtime.bridge_token import offered_token
from qrobot.realtime.setup import lock_memory, tighten_timers
from qrobot.report import Report

SILENCE_S: Final = 1.0  # [A] after which a program is given up
_LOOK_S: Final = 0.005


class HostServer:
    """Answers what programs ask, from threads of the session; `run` looks after the tasks meanwhile.

    `report` must neither wait nor raise.
    """

    def __init__(self, settings: HostSettings, report: Report) -> None:
        self._settings, self._report = settings, report
        self._program: HostedProgram | None = None
        self._token = b""
        self._heard = 0.0
        self._taking = threading.Lock()
        self._over = threading.Event()

    def run(self) -> None:
        """Serve one program, until it ends or is silent. Raises LinkLost: the endpoint cannot be had."""
        lock_memory()
        tighten_timers()
        for number in FORWARDED:
            signal.signal(number, lambda caught, _: self._note_signal(caught))
        with self._offered_token():
            self._serve()

    @contextmanager
    def _offered_token(self) -> Iterator[None]:
        """A token by which programs without certificates are known, as those of a bridge."""
        if self._settings.tls is not None:
            yield
            return
        with offered_token(self._settings.address[1]) as token:
            self._token = token
            yield

    def _serve(self) -> None:
        where = f"host {self._settings.name} cannot listen at {self._settings.endpoint}"
        session = open_session(listening(self._settings), where)
        try:
            answer_questions(session, self._settings.name, "orders", self._answer)
            answer_questions(session, self._settings.name, "exchanges", self._answer)
            self._say(f"waits for a program at {self._settings.endpoint}")
            self._look_after()
        finally:
            session.close()  # type: ignore[no-untyped-call]

    def _say(self, what: str) -> None:
        self._report(f"processor {self._settings.name}: {what}")

    def _look_after(self) -> None:
        while not self._over.wait(_LOOK_S):
            if self._program is None:
                continue
            self._program.look_after()
            if time.monotonic() - self._heard > SILENCE_S:
                self._say(f"program {self._program.name} is silent; its robots are stopped")
                break
        if self._program is not None:
            self._program.farewell()

    def _note_signal(self, number: int) -> None:
        if self._program is not None:
            self._program.note_signal(number)

    # -------------------------------------------------------------------------------------------------------- answers

    def _answer(self, data: bytes) -> bytes:
        try:
            reply = self._replied(decode_request(data))
        except Exception as error:  # it belongs to whoever asked
            reply = HostReply(error=failure_of(error))
        return encode(reply)

    def _replied(self, request: HostRequest) -> HostReply:
        if isinstance(request, HelloPacket):
            return HostReply(offer=self._offer())
        if isinstance(request, BootPacket):
            return self._boot(request)
        program = self._program
        if program is None or request.session != program.session or self._over.is_set():
            raise LinkLost("it runs no such program, or runs it no more")
        self._heard = time.monotonic()
        return _ANSWERS[type(request)](self, program, request)

    def _offer(self) -> Offer:
        what = f"{platform.system()} {platform.release()}, {os.cpu_count()} processors, Python {sys.version.split()[0]}"
        program = "" if self._program is None else self._program.name
        return Offer(
            protocol=PROTOCOL,
            host=self._settings.name,
            description=what[:LONGEST_TEXT],
            now_ns=time.monotonic_ns(),
            program=program,
        )

    def _boot(self, boot: BootPacket) -> HostReply:
        if boot.protocol != PROTOCOL:
            raise RemoteProtocolError(f"this host speaks protocol {PROTOCOL} of processors, not {boot.protocol}")
        if not hmac.compare_digest(boot.token.encode(), self._token):
            raise LinkError(
                f"host {self._settings.name}: this program cannot read the token in the host's runtime folder: "
                "start both under one account, or use certificates"
            )
        with self._taking:
            if self._program is not None:
                raise LinkBusy(f"host {self._settings.name} runs program {self._program.name}, and one at a time")
            self._heard = time.monotonic()
            self._program = HostedProgram(boot, self._settings.name, self._settings.modules)
            self._heard = time.monotonic()
        self._say(f"runs tasks of program {boot.program}")
        return HostReply()

    def _order(self, program: HostedProgram, packet: OrderPacket) -> HostReply:
        program.obey(packet)
        return HostReply()

    def _exchange(self, program: HostedProgram, packet: ExchangePacket) -> HostReply:
        return HostReply(report=program.exchange(packet))

    def _end(self, program: HostedProgram, _packet: EndPacket) -> HostReply:
        self._say(f"program {program.name} has ended")
        self._over.set()
        return HostReply()


_ANSWERS: Final[dict[type, Callable[..., HostReply]]] = {
    OrderPacket: HostServer._order,
    ExchangePacket: HostServer._exchange,
    EndPacket: HostServer._end,
}
