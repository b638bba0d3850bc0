"""Laws in files, as Numba functions or CasADi expressions: they run, and what is wrong is told with its line."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.realtime.jit import jit_disabled
from qrobot.servo.laws.law import MEMORY_WORDS, Law
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.laws.trial import prove, prove_finite, prove_harmless
from qrobot.servo.laws.trial_process import tried_law
from tests.support.servo_bench import ServoBench
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
NUMBA = """
from qrobot.servo.laws.law import KP, law

@law
def stiff(q_ref, q, gains, tau):
    for j in range(tau.size):
        tau[j] = 2.0 * gains[KP, j] * (q_ref[j] - q[j])
"""
CASADI = """
import casadi
from qrobot.servo.laws.casadi_law import casadi_law
from qrobot.servo.laws.law import KP, KV, Setting

@casadi_law(settings=(Setting("push", 0.5, 0.0, 5.0, "N m/V", "torque of a volt at channel 6"),))
def guided(q_ref, v_ref, q, v, gains, gravity, sensors, settings):
    feedback = gains[KP, :].T * (q_ref - q) + gains[KV, :].T * (v_ref - v)
    return feedback + gravity + settings[0] * sensors[6]
"""


def written(folder: Path, text: str, name: str = "mine.py") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_a_numba_law_in_a_file_is_its_formula(tmp_path: Path) -> None:
    law = find_law(f"{written(tmp_path, NUMBA)}:stiff", ROBOT)
    q_ref, gains = np.array([0.1, 0.2]), np.array([[100.0, 10.0], [0.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(call(law, q_ref=q_ref, q=np.zeros(2), gains=gains), [20.0, 4.0])


def test_the_only_law_of_a_file_needs_no_name(tmp_path: Path) -> None:
    assert isinstance(find_law(str(written(tmp_path, NUMBA)), ROBOT), Law)


def test_a_casadi_law_is_its_formula_with_sensors_gains_and_settings(tmp_path: Path) -> None:
    law = find_law(f"{written(tmp_path, CASADI)}:guided", ROBOT, {"push": 2.0})
    rng = np.random.default_rng(0)
    q_ref, v_ref, q, v, gravity = rng.normal(size=(5, 6))
    gains, sensors = rng.normal(size=(3, 6)), rng.normal(size=8)
    tau = call(law, q_ref=q_ref, v_ref=v_ref, q=q, v=v, gravity=gravity, gains=gains, sensors=sensors)
    np.testing.assert_allclose(tau, gains[0] * (q_ref - q) + gains[1] * (v_ref - v) + gravity + 2.0 * sensors[6])


def test_a_casadi_law_may_keep_a_memory(tmp_path: Path) -> None:
    text = """
from qrobot.servo.laws.casadi_law import casadi_law

@casadi_law
def winding(q_ref, q, memory, dt):
    after = memory + 0
    after[0:6] = memory[0:6] + dt * (q_ref - q)
    return 10 * after[0:6], after
"""
    law, memory = find_law(str(written(tmp_path, text)), ROBOT), np.zeros(MEMORY_WORDS)
    for _ in range(3):
        tau = call(law, q_ref=np.ones(6), q=np.zeros(6), memory=memory, dt=0.01)
    np.testing.assert_allclose(memory[:6], 0.03)
    np.testing.assert_allclose(tau, 0.3)


@pytest.mark.parametrize("text", [NUMBA, CASADI])
def test_a_users_law_holds_the_arm_in_the_cycle(tmp_path: Path, text: str) -> None:
    bench = ServoBench(law=find_law(str(written(tmp_path, text)), ROBOT)).hold()
    bench.run(0.05)
    assert bench.mode.name == "HOLDING"


def test_a_file_that_has_changed_is_read_again_however_soon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path = written(tmp_path, NUMBA)
    arguments = {"q_ref": np.ones(2), "q": np.zeros(2), "gains": np.ones((3, 2))}
    np.testing.assert_allclose(call(find_law(str(path), ROBOT), **arguments), 2.0)
    written_ns = path.stat().st_mtime_ns
    path.write_text(NUMBA.replace("2.0 *", "3.0 *"))
    os.utime(path, ns=(written_ns, written_ns))
    np.testing.assert_allclose(call(find_law(str(path), ROBOT), **arguments), 3.0)


HEAD = "from qrobot.servo.laws.law import law\nfrom qrobot.servo.laws.casadi_law import casadi_law\n"
HELPER = "from numba import njit\n@njit\ndef near(q):\n    assert q[0] < 1.0\n"
BAD = [
    ("def law(:\n", "mine.py, line 1: SyntaxError"),
    ("\nimport no_such_module\n", "mine.py, line 2: ModuleNotFoundError: No module named 'no_such_module'"),
    ("import sys\nsys.exit()\n", "mine.py, line 2: SystemExit"),
    ("x = 1\n", "has no law 'stiff'; there is none: put @law or @casadi_law above a function"),
    (NUMBA.replace("stiff", "soft"), "has no law 'stiff'; there are: soft"),
    (HEAD + "@law\ndef stiff(wind, tau):\n    pass\n", "line 3: ConfigError: law stiff takes 'wind'"),
    (
        HEAD + "@law\ndef stiff(q, tau):\n    tau[:] = q\n    print(q[0])\n",
        "stiff prints in line 6, and so waits for Python",
    ),
    (HEAD + HELPER + "@law\ndef stiff(q, tau):\n    near(q)\n", "near raises in line 6, and so waits for Python"),
    (HEAD + "@casadi_law\ndef stiff(q):\n    return q[0]\n", "law stiff: tau has 1 elements, 6 are wanted"),
    (HEAD + "@casadi_law\ndef stiff(q):\n    return q, q\n", "next_memory has 6 elements, 64 are wanted"),
    (HEAD + "@casadi_law\ndef stiff(q):\n    return q, q, q\n", "it returns 3 expressions"),
    (HEAD + "@casadi_law\ndef stiff(q):\n    return q + 'x'\n", "the expression cannot be built: "),
    (HEAD + "@casadi_law\ndef stiff(q):\n    return 'x'\n", "tau is str, not an expression"),
    (HEAD + "@casadi_law\ndef stiff(q, tau):\n    return q\n", "law stiff takes 'tau', which is none of robot, arm"),
]


@pytest.mark.parametrize(("text", "words"), BAD)
def test_a_file_that_is_wrong_is_refused_with_the_place_and_the_reason(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        find_law(f"{written(tmp_path, text)}:stiff", ROBOT)
    assert words in str(refusal.value)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no law file .*nothing\.py: No such file"):
        find_law(f"{tmp_path}/nothing.py:stiff", ROBOT)


def test_a_law_without_a_finite_torque_is_refused_before_anything_moves(tmp_path: Path) -> None:
    text = HEAD + "@law\ndef root(q, tau):\n    for j in range(tau.size):\n        tau[j] = (q[1] - 1.0) ** 0.5\n"
    name = str(written(tmp_path, text))
    if jit_disabled():  # a complex number instead of NaN: plain Python differs here
        return
    with pytest.raises(ConfigError, match="gives joint 1 no finite torque at the pose"):
        prove_finite(find_law(name, ROBOT), name, ROBOT)


def test_a_law_that_fills_not_every_joint_is_refused(tmp_path: Path) -> None:
    name = str(written(tmp_path, HEAD + "@law\ndef half(tau):\n    for j in range(3):\n        tau[j] = 0.0\n"))
    with pytest.raises(ConfigError, match="gives joint 4 no finite torque"):
        prove_finite(find_law(name, ROBOT), name, ROBOT)


def test_a_law_without_a_finite_torque_where_the_arm_stands_at_its_reference_is_refused(tmp_path: Path) -> None:
    text = "@law\ndef sign(q_ref, q, tau):\n    for j in range(tau.size):\n        e = q_ref[j] - q[j]\n"
    name = str(written(tmp_path, HEAD + text + "        tau[j] = e / abs(e)\n"))
    with (
        np.errstate(all="ignore"),
        pytest.raises(ConfigError, match=r"gives joint 1 no finite torque at the pose '.*' without any error"),
    ):
        prove_finite(find_law(name, ROBOT), name, ROBOT)


def test_a_law_that_takes_most_of_a_cycle_is_refused_with_both_numbers(tmp_path: Path) -> None:
    text = HEAD + (
        "@law\ndef busy(q, tau):\n    x = q[0]\n    for k in range(400000):\n        x = x * 0.999 + 1e-3 * k\n"
        "    for j in range(tau.size):\n        tau[j] = 1e-12 * x\n"
    )
    law = find_law(str(written(tmp_path, text)), ROBOT)
    prove(find_law("pd", ROBOT), "pd", ROBOT, 100_000_000)
    with pytest.raises(ConfigError, match=r"law busy takes .* us, and a cycle of 20 us leaves it 10.0: make it faster"):
        prove(law, "busy", ROBOT, 20_000)


MISTAKES = {
    "out of bounds": "@law\ndef mine(q, tau):\n    for j in range(tau.size):\n        tau[j + 1] = q[j]\n",
    "no number": '@law\ndef mine(q, tau):\n    for j in range(tau.size):\n        tau[j] = "full"\n',
    "no name": "@casadi_law\ndef mine(q_ref, q):\n\n    return q_ref - q + nothing\n",
    "no colon": "@law\ndef mine(q, tau):\n    x = 1\n    for j in range(6)\n",
}


def test_a_law_that_mixes_two_lengths_is_refused_before_it_is_compiled(tmp_path: Path) -> None:
    text = HEAD + "@law\ndef mine(q, tau):\n    tau[:] = q[1:]\n"
    name = str(written(tmp_path, text))
    found: Any = find_law(name, ROBOT)
    with pytest.raises(ConfigError, match=r"line 5: ValueError: could not broadcast"):
        prove_harmless(found, name, ROBOT, found.body.py_func)


def found_compiled_and_tried(name: str) -> None:
    found: Any = find_law(name, ROBOT)
    assert found.address
    prove_harmless(found, name, ROBOT, found.body.py_func)


@pytest.mark.skipif(jit_disabled(), reason="plain Python compiles anything")
@pytest.mark.parametrize("text", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_a_law_is_told_with_its_file_and_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "laws.py"
    file.write_text(
        f"from qrobot.servo.laws.casadi_law import casadi_law\nfrom qrobot.servo.laws.law import law\n\n\n{text}"
    )
    with pytest.raises(ConfigError, match=rf"{file}(:mine)?, line 8: "):
        found_compiled_and_tried(f"{file}:mine")


def test_a_mistake_that_only_running_the_law_shows_is_told_with_its_line_too(tmp_path: Path) -> None:
    file = tmp_path / "laws.py"
    file.write_text("from qrobot.servo.laws.law import law\n\n\n@law\ndef mine(tau):\n    tau[0] = nothing\n")
    with pytest.raises(ConfigError, match=rf"{file}, line 6: NameError: name 'nothing'"):
        tried_law(str(file), ROBOT, {}, 1_000_000)
