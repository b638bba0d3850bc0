"""The servo as plain Python: the cycle tick for tick, and every branch of the guard."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from tests.support.servo_scenario import eventful_runs
from tests.support.thorough import wide

ROOT = Path(__file__).parents[2]


def python(*arguments: str, **environment: str) -> None:
    """Run a module with the JIT off. Fails the test with its output when it fails."""
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"} | environment,
        cwd=ROOT, check=False, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


def test_compiled_and_plain_cycles_write_the_same_telemetry(tmp_path: Path) -> None:
    python("tests.support.servo_scenario", str(tmp_path / "plain.npy"))
    plain, compiled = np.load(tmp_path / "plain.npy"), eventful_runs()
    assert {Mode.TRACKING, Mode.STOPPING, Mode.FAULT} <= set(compiled["mode"])
    assert {FaultCode.SP_INVALID, FaultCode.ESTOP} <= set(compiled["fault"])
    for name in compiled.dtype.names:  # bit for bit: no fast-math, no reordering
        np.testing.assert_array_equal(plain[name], compiled[name], name)


@pytest.mark.parametrize("chosen", ["stopped", *wide("held")])
def test_an_arm_of_one_sliding_joint_is_held_and_stopped(chosen: str) -> None:
    python("pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, "tests/support/one_joint_checks.py")


SOME_DEATHS = (
    "(leaves_holding and power_off-memory) or powers_up or (stalls_anywhere and memory) or waits_for_the_card"
    " or guardian_that_dies"
)


@pytest.mark.parametrize("chosen", [SOME_DEATHS, *wide("")], ids=["some", "all"])
def test_a_servo_that_dies_after_any_of_its_stores_leaves_the_arm_safe(chosen: str) -> None:
    python("pytest", "-q", "-p", "no:cacheprovider", "-k", chosen, "tests/support/kill_point_checks.py")


def test_the_tests_of_the_guard_take_every_branch_of_it(tmp_path: Path) -> None:
    gates = ("limit_checks", "motor_fault_diagnosis", "timing_checks")
    python(
        "pytest", "-q", "-p", "no:cacheprovider", *(f"tests/unit/servo/test_{gate}.py" for gate in gates),
        *(f"--cov=qrobot.servo.checks.{gate}" for gate in gates),
        "--cov-branch", "--cov-fail-under=100", "--cov-report=term-missing",
        COVERAGE_FILE=str(tmp_path / "coverage"),
    )  # fmt: skip
