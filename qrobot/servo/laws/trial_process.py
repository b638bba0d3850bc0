"""A law in somebody's file is tried in a process of its own, and comes back as machine code, or not at all.

The servo neither runs the file nor compiles what is in it: whatever the law does in its trial - loop for ever, reach
past an array, take all memory -, servo, stop and power-off do not notice. First the law runs as plain Python, in which
every index is checked; then it is compiled, and what is compiled runs, is timed, and is what the servo loads.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from qrobot.config import Robot
from qrobot.errors import CodegenError, ConfigError, LinkLost
from qrobot.realtime.deadline import Deadline
from qrobot.realtime.jit import jit_disabled
from qrobot.realtime.machine_code import MachineCode
from qrobot.servo.laws.checker import LOAD_S, LOAD_SIGNAL, TRIAL_S, TRIAL_SIGNAL, Question
from qrobot.servo.laws.file import law_digest
from qrobot.servo.laws.law import Law, Setting
from qrobot.servo.laws.machine_code_law import LoadedLaw
from qrobot.servo.laws.names import is_file_law
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.laws.trial import prove, prove_finite

PATIENCE_S: Final = 240.0  # [A] of the wall clock: a law that sleeps computes nothing
POLL_S: Final = 0.05
_CHECKER: Final = ("-P", "-c", "from qrobot.servo.laws.checker import main; main()")  # -P: see `own_process`


def tried_law(
    name: str,
    robot: Robot,
    settings: Mapping[str, float],
    period_ns: int,
    given_up: threading.Event | None = None,
    timed: bool = True,
) -> Law:
    """A law that has passed its trial: a shipped one as it is, one in a file by way of a process of its own.

    Args:
        name: of a shipped law, or `path/to/file.py:name`. settings: of the law, those chosen.
        period_ns: of the servo's cycle, of which the law may take half.
        given_up: once set, nobody wants the law any more.
        timed: whether a shipped law is timed; one in a file always is.

    Raises:
        ConfigError: it cannot be found, made or compiled, or did not pass.
        LinkLost: it was given up.
    """
    if is_file_law(name):
        question = Question(name, robot, dict(settings), period_ns, law_digest(name))
        return law_in_file(question, given_up or threading.Event())
    law = find_law(name, robot, settings)
    if timed:
        prove(law, name, robot, period_ns)
    else:
        prove_finite(law, name, robot)
    return law


def law_in_file(question: Question, given_up: threading.Event) -> Law:
    """The law, tried as plain Python and then compiled. Raises ConfigError and LinkLost as `tried_law` does."""
    _ask(question, given_up, NUMBA_DISABLE_JIT="1")
    if jit_disabled():  # there is no machine code
        return find_law(question.name, question.robot, question.settings)
    header, code = _ask(question, given_up, NUMBA_DISABLE_JIT="0")
    settings = tuple(Setting(**setting) for setting in header["settings"])
    values, signals = np.array(header["values"]), tuple(header["signals"])
    try:
        return LoadedLaw(MachineCode(header["entry"], code), settings, values, header["doc"], signals)
    except CodegenError as error:
        raise ConfigError(f"law {question.name}: {error}") from error


def _ask(question: Question, given_up: threading.Event, **environment: str) -> tuple[dict[str, Any], bytes]:
    """Ask a new process; the header of its answer and what follows. Raises ConfigError with its complaint."""
    command = [sys.executable, *_CHECKER]
    surroundings = {**os.environ, **environment}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=surroundings
    ) as checker:
        try:
            answer = _answer(checker, pickle.dumps(question), given_up)
        finally:
            checker.kill()
    line, _, code = answer.partition(b"\n")
    if not line:
        raise ConfigError(_cause_of_death(question.name, checker.returncode))
    header: dict[str, Any] = json.loads(line)
    if "error" in header:
        raise ConfigError(header["error"])
    return header, code


def _answer(checker: subprocess.Popen[bytes], question: bytes, given_up: threading.Event) -> bytes:
    """The process's answer. Raises LinkLost when it was given up, ConfigError when it takes for ever."""
    patience, said = Deadline(PATIENCE_S), question
    while True:
        try:
            answer, _ = checker.communicate(said or None, timeout=POLL_S)
            return answer
        except subprocess.TimeoutExpired:
            said = b""  # what was not sent yet goes on by itself
        if given_up.is_set():
            raise LinkLost("whoever asked for the law has gone: it has not been taken")
        if patience.passed:
            raise ConfigError(
                f"the law was not tried to the end within {PATIENCE_S:g} s and has not been taken: is it too long to "
                "compile, or has this machine too much to do?"
            )


def _cause_of_death(name: str, status: int) -> str:
    """Reason for which a process ended without an answer, in words for people."""
    if -status == TRIAL_SIGNAL:
        return f"law {name} does not come back within {TRIAL_S:g} s of computing: does it loop for ever?"
    if -status == LOAD_SIGNAL:
        return f"law {name} takes more than {LOAD_S:g} s of computing to load and compile: does its file loop for ever?"
    if status < 0:
        how = signal.strsignal(-status) or f"signal {-status}"
        return f"law {name} ended the process it was tried in ({how}): does it reach past the end of an array?"
    return f"law {name} ended the process it was tried in, with status {status}"
