"""Program of the process in which a law from somebody's file is tried, see `servo.laws.trial_process`.

Nothing in it matters to anybody else: it may loop for ever, write past an array, or take all the memory it is
allowed. It is asked once, on standard input, and answers once, on what was its standard output:

    {"entry": ..., "values": [...], "settings": [...], "signals": [...], "doc": ...}   and the code, when the law passed
    {"error": ...}                                                   when it did not

With NUMBA_DISABLE_JIT=1 the law runs as plain Python, in which every index is checked; there is no code then.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import math
import os
import pickle
import resource
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from qrobot.config import Robot
from qrobot.errors import ConfigError, QRobotError

if TYPE_CHECKING:
    from qrobot.arrays import Floats
    from qrobot.servo.laws.law import Law
    from qrobot.servo.laws.trial import Call

LOAD_S: Final = 90.0  # [A] of computing time, to run the file and to compile the law
TRIAL_S: Final = 3.0  # [A] of computing time, for one call; even as plain Python it comes back before
ENOUGH_S: Final = 10.0  # [A] of computing time, after which plain Python has shown enough
MEMORY_BYTES: Final = 4 << 30  # [A] of addresses: importing everything takes 1.5 GB of them

_PR_SET_PDEATHSIG: Final = 1  # linux/prctl.h: when the thread that started this process ends
LOAD_SIGNAL: Final = signal.SIGVTALRM
TRIAL_SIGNAL: Final = signal.SIGPROF


@dataclass(frozen=True)
class Question:
    """A law to be tried.

    Attributes:
        name: of a law in a file, as `path/to/file.py:name`.
        robot: what it is to drive. settings: of the law, those chosen. period_ns: of the servo's cycle.
        digest: of its file, when it was asked for.
    """

    name: str
    robot: Robot
    settings: dict[str, float]
    period_ns: int
    digest: str


def main() -> None:
    """Answer the question on standard input."""
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what the law prints is no answer
    _limit()
    question: Question = pickle.load(sys.stdin.buffer)
    try:
        header, code = _tried(question)
    except QRobotError as error:
        header, code = {"error": str(error)}, b""
    except MemoryError:
        header, code = {"error": f"the law needs more than the {MEMORY_BYTES >> 30} GiB it is allowed"}, b""
    except Exception as error:
        header, code = {"error": _told(question.name, error)}, b""
    answer.write(json.dumps(header).encode() + b"\n" + code)
    answer.flush()
    os._exit(0)  # whatever the file has left running


def _told(name: str, error: Exception) -> str:
    from qrobot.servo.laws.file import law_and_line

    return f"law {law_and_line(name, error)}: {type(error).__name__}: {error}"


def _limit() -> None:
    """Give up what a law could take from others: memory, processors, a core dump, a life beyond who asked."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.nice(5)


@contextlib.contextmanager
def _at_most(timer: int, seconds: float) -> Iterator[None]:
    """End this process with the timer's signal when the block computes for longer; no Python has to run for it."""
    signal.setitimer(timer, seconds)
    yield
    signal.setitimer(timer, 0.0)


def _each_at_most(call: Call, enough_s: float) -> Call:
    """`call` under the limit of one trial, and not any more once all calls have computed for `enough_s`."""
    until = time.process_time() + enough_s

    def limited(*arguments: Floats) -> None:
        if time.process_time() < until:
            with _at_most(signal.ITIMER_PROF, TRIAL_S):
                call(*arguments)

    return limited


def _tried(question: Question) -> tuple[dict[str, Any], bytes]:
    from qrobot.realtime.jit import jit_disabled

    return _tried_as_python(question) if jit_disabled() else _tried_as_code(question)


def _asked_for(question: Question) -> Law:
    """The law, of the text that was asked for: both trials are of that. Raises ConfigError."""
    from qrobot.servo.laws.file import law_digest
    from qrobot.servo.laws.shipped import find_law

    law = find_law(question.name, question.robot, question.settings)
    if law_digest(question.name) != question.digest:
        raise ConfigError(f"law {question.name}: its file was changed while it was tried; ask for it again")
    return law


def _tried_as_python(question: Question) -> tuple[dict[str, Any], bytes]:
    from qrobot.servo.laws.trial import prove_harmless

    with _at_most(signal.ITIMER_VIRTUAL, LOAD_S):
        law = _asked_for(question)
    prove_harmless(law, question.name, question.robot, _each_at_most(law.body, ENOUGH_S))
    return {}, b""


def _tried_as_code(question: Question) -> tuple[dict[str, Any], bytes]:
    from qrobot.realtime.machine_code import compile_for_export
    from qrobot.realtime.pointer import COMPILE_ERRORS
    from qrobot.servo.laws.law import LAW_SIGNATURE, without_advice
    from qrobot.servo.laws.machine_code_law import LoadedLaw
    from qrobot.servo.laws.trial import prove, prove_harmless

    with _at_most(signal.ITIMER_VIRTUAL, LOAD_S):
        law = _asked_for(question)
        try:
            compiled, code = compile_for_export(law.body.py_func, LAW_SIGNATURE)  # type: ignore[attr-defined]
        except COMPILE_ERRORS as error:
            raise ConfigError(f"the law does not compile: {without_advice(error)}") from error
        loaded = LoadedLaw(
            code, law.settings, law.values, law.__doc__, law.signals
        )  # the very code that the servo will run
    prove_harmless(law, question.name, question.robot, _each_at_most(compiled, math.inf), compiled=True)
    with _at_most(signal.ITIMER_PROF, TRIAL_S):
        prove(loaded, question.name, question.robot, question.period_ns)
    settings = [asdict(setting) for setting in law.settings]
    header = {"entry": code.entry, "values": law.values.tolist(), "settings": settings, "doc": law.__doc__}
    return header | {"signals": law.signals}, code.code
