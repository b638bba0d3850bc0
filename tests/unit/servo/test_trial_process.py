"""A law in a file is tried in a process of its own: whatever it does there, it comes back as code or as a sentence."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError, LinkLost
from qrobot.realtime.jit import jit_disabled
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.checker import LOAD_SIGNAL, TRIAL_SIGNAL
from qrobot.servo.laws.law import ARGUMENTS, Law, law
from qrobot.servo.laws.machine_code_law import LoadedLaw
from qrobot.servo.laws.trial import prove_harmless
from qrobot.servo.laws.trial_inputs import at_extremes, at_pose, in_motion
from qrobot.servo.laws.trial_process import _cause_of_death, tried_law
from qrobot.servo.settings import ServoSettings
from tests.support.servo_bench import ServoBench, moving

ROBOT = load_robot("puma560")
PERIOD_NS = 1_000_000
Q, TAU = ARGUMENTS.index("q"), ARGUMENTS.index("tau")
HEAD = "from qrobot.servo.laws.law import KP, KV, Setting, law\n"
GOOD = (
    HEAD
    + """
@law(settings=(Setting("share", 1.0, 0.0, 2.0, "-", "of the gravity"),))
def mine(q_ref, v_ref, q, v, gravity, gains, settings, tau):
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + settings[0] * gravity[j]
"""
)
ZEROS = HEAD + "@law\ndef mine(q, tau):\n    for j in range(tau.size):\n        tau[j] = 0.0\n"
BAD = [
    ("    tau[7] = 1.0\n", "IndexError: index 7 is out of bounds for axis 0 with size 6"),
    ("    tau[100000] = 1.0\n", "IndexError: index 100000 is out of bounds"),
    ("    tau[0] = q[2000000000]\n", "IndexError: index 2000000000 is out of bounds"),
    ("    q[0] = 0.0\n", "changes q: it may only write tau and memory"),
    ("    tau[0] = q[int(0.1 * q[0])]\n", "with q = nan: ValueError: cannot convert float NaN to integer"),
]


@law
def idle(tau: np.ndarray) -> None:
    """No torque."""
    for j in range(tau.size):
        tau[j] = 0.0


def tried(folder: Path, text: str, **options: object) -> Law:
    path = folder / "law_file.py"
    path.write_text(text)
    return tried_law(f"{path}:mine", ROBOT, options.pop("settings", {}), PERIOD_NS, **options)  # type: ignore[arg-type]


def test_a_law_that_passes_comes_back_as_code_that_moves_the_arm_as_the_law_itself_does(tmp_path: Path) -> None:
    passed = tried(tmp_path, GOOD, settings={"share": 0.5})
    assert isinstance(passed, LoadedLaw) or jit_disabled()
    assert passed.chosen == {"share": 0.5}
    rows = []
    for one in (passed, _here().with_settings({"share": 0.5})):
        bench = ServoBench(law=one)
        moving(bench)
        rows.append(bench.rows())
    np.testing.assert_array_equal(rows[0]["tau"], rows[1]["tau"])


@pytest.mark.skipif(jit_disabled(), reason="without machine code a law is tried once")
def test_a_file_that_is_saved_while_its_law_is_tried_is_refused(tmp_path: Path) -> None:
    """What would be compiled is not what was tried index by index."""
    saves = (
        "import os\nif os.environ['NUMBA_DISABLE_JIT'] == '1':\n    open(__file__, 'a').write('    tau[7] = 1.0\\n')\n"
    )
    with pytest.raises(ConfigError, match="its file was changed while it was tried; ask for it again"):
        tried(tmp_path, ZEROS.replace("@law", f"{saves}@law"))


def _here() -> Law:
    scope: dict[str, Law] = {}
    exec(GOOD, scope)
    return scope["mine"]


@pytest.mark.parametrize(("line", "words"), BAD)
def test_a_law_that_could_do_harm_is_refused_and_told_where(line: str, words: str) -> None:
    scope: dict[str, Callable[..., None]] = {}
    exec(ZEROS.replace("@law\n", "") + line, scope)
    with pytest.raises(ConfigError) as refusal:
        prove_harmless(idle, "mine", ROBOT, lambda *arguments: scope["mine"](arguments[Q], arguments[TAU]))
    assert words in str(refusal.value)


def test_a_quotient_by_zero_is_a_number_in_compiled_code_unless_that_raises_it_itself() -> None:
    def raising(*arguments: np.ndarray) -> None:
        raise ZeroDivisionError("division by zero")

    prove_harmless(idle, "mine", ROBOT, raising)
    with pytest.raises(ConfigError, match="law mine: ZeroDivisionError: division by zero"):
        prove_harmless(idle, "mine", ROBOT, raising, compiled=True)


RATIO = """
from numba import njit
@njit("f8(f8, f8)"OPTIONS)
def ratio(a, b):
    return a / b
"""
USES_RATIO = ZEROS.replace("mine(q,", "mine(v, memory,") + "    memory[0] = ratio(tau[0], v[0])\n"


@pytest.mark.thorough
@pytest.mark.skipif(jit_disabled(), reason="the helper is plain Python then")
def test_a_helper_that_was_compiled_before_its_law_and_raises_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ZeroDivisionError: division by zero"):
        tried(tmp_path, RATIO.replace("OPTIONS", "") + USES_RATIO)
    assert tried(tmp_path, RATIO.replace("OPTIONS", ', error_model="numpy"') + USES_RATIO).address


def test_a_law_that_writes_past_its_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="index 7 is out of bounds"):
        tried(tmp_path, ZEROS + BAD[0][0])


def test_a_law_without_an_end_is_refused_and_so_it_is_in_lockstep(tmp_path: Path) -> None:
    path = tmp_path / "law_file.py"
    path.write_text(ZEROS + "    while q[0] == q[0]:\n        tau[0] += 1.0\n")
    with pytest.raises(ConfigError, match=r"does not come back within 3 s of computing: does it loop for ever\?"):
        LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0, law=f"{path}:mine"))


@pytest.mark.thorough
@pytest.mark.skipif(jit_disabled(), reason="plain Python is not timed")
def test_a_law_that_is_too_slow_for_the_rate_is_refused_in_lockstep(tmp_path: Path) -> None:
    path = tmp_path / "law_file.py"
    path.write_text(
        HEAD + "@law\ndef mine(q, tau):\n    x = q[0]\n    for k in range(200000):\n        x = x * 0.999 + 1e-3 * k\n"
        "    for j in range(tau.size):\n        tau[j] = 1e-12 * x\n"
    )
    with pytest.raises(ConfigError, match=r"takes .* us, and a cycle of 250 us leaves it 125\.0: make it faster"):
        LockstepRig(ROBOT, ServoSettings(rate_hz=4000.0, law=f"{path}:mine"))


def test_a_file_that_takes_all_memory_is_refused(tmp_path: Path) -> None:
    """Five gibibytes that nobody touches, which the system would give to anybody."""
    with pytest.raises(ConfigError, match="MemoryError: Unable to allocate"):
        tried(tmp_path, "import numpy\nnumpy.zeros(5 << 30, numpy.uint8)\n" + ZEROS)


def test_a_file_that_ends_its_process_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ended the process it was tried in"):
        tried(tmp_path, "import ctypes\nctypes.string_at(0)\n" + ZEROS)


def test_a_law_that_nobody_wants_any_more_is_given_up(tmp_path: Path) -> None:
    given_up = threading.Event()
    given_up.set()
    with pytest.raises(LinkLost, match="has gone: it has not been taken"):
        tried(tmp_path, "import time\ntime.sleep(1000.0)\n" + ZEROS, given_up=given_up)


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (-TRIAL_SIGNAL, "loop for ever"),
        (-LOAD_SIGNAL, "to load and compile: does its file loop for ever"),
        (-signal.SIGSEGV, "does it reach past the end of an array"),
        (3, "with status 3"),
    ],
)
def test_however_the_process_ends_there_is_a_sentence_for_it(status: int, words: str) -> None:
    assert words in _cause_of_death("mine", status)


def test_a_trial_goes_through_the_range_and_through_every_input_that_a_fault_could_spoil() -> None:
    states = list(in_motion(idle, ROBOT))
    q = np.array([state[ARGUMENTS.index("q")] for state in states])
    assert (q >= ROBOT.limits.q_min).all()
    assert (q <= ROBOT.limits.q_max).all()
    assert (np.ptp(q, axis=0) > 0.7 * (ROBOT.limits.q_max - ROBOT.limits.q_min)).all()
    spoilt = {where.split(" =")[0] for where, _ in at_extremes(idle, ROBOT)}
    assert spoilt == set(ARGUMENTS) - {"payload", "gains", "settings", "memory", "dt", "tau"}
    usual = at_pose(idle, ROBOT, ROBOT.poses["ready"])
    for where, arguments in at_extremes(idle, ROBOT):
        pairs = zip(ARGUMENTS, arguments, usual, strict=True)
        assert [name for name, a, b in pairs if not np.array_equal(a, b, equal_nan=True)] == [where.split(" =")[0]]
