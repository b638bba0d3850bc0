"""A process of low priority that answers questions of the pendant: what is heavy must not keep it from a stop.

Each line on its input is a request as JSON; each answer is the lengths of a JSON object and of the bytes behind it, and
both. It ends with its input. The other end is `answering_process`.
"""

from __future__ import annotations

import json
import os
import select
import signal
import struct
import sys
from io import RawIOBase
from typing import Any, BinaryIO, Final, Protocol

NICE: Final = 10
ANSWER_HEAD: Final = struct.Struct("<II")
ProcessAnswer = tuple[dict[str, Any], bytes]


class Answerer(Protocol):
    """Source of the answers."""

    def answer(self, request: dict[str, Any]) -> ProcessAnswer:
        """Answer to a request; {"error": why} when there is none."""

    def read_on(self) -> bool:
        """Do a piece of what is to be done between requests; False when there is none."""


def serve_answers(answerer: Answerer) -> None:
    """Answer what this process is asked until its input ends. From its main thread."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the pendant, whose end ends this
    os.nice(NICE)
    with open(sys.stdin.fileno(), "rb", buffering=0, closefd=False) as requests:  # select sees what no buffer holds
        _serve(requests, sys.stdout.buffer, answerer)


def _serve(requests: RawIOBase, answers: BinaryIO, answerer: Answerer) -> None:
    while True:
        while answerer.read_on() and not select.select([requests], [], [], 0)[0]:  # at least a piece between two
            pass
        line = requests.readline()
        if not line:
            return
        told, data = answerer.answer(json.loads(line))
        head = json.dumps(told).encode()
        answers.write(ANSWER_HEAD.pack(len(head), len(data)) + head + data)
        answers.flush()
