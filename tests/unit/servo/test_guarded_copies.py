"""A law runs on copies: what it does beside its result reaches nothing, and ends in a stop under the built-in law."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.realtime.jit import jit_disabled
from qrobot.servo.laws.guarded_copies import EDGE_WORDS, GAP_WORDS, GUARDED, broken_words, make_law_copies
from qrobot.servo.laws.law import KP, KV, Law, law
from qrobot.servo.laws.law_swap import OUT_OF_BOUNDS, SWAPPED, ask_for_law, maybe_swap_result
from tests.support.servo_bench import ServoBench, moving

needs_compiler = pytest.mark.skipif(jit_disabled(), reason="plain Python checks every index by itself")


@law
def decent(q_ref: Any, v_ref: Any, q: Any, v: Any, gravity: Any, gains: Any, tau: Any) -> None:
    """PD with gravity."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j]


@law
def beside(q_ref: Any, v_ref: Any, q: Any, v: Any, gravity: Any, gains: Any, tau: Any) -> None:
    """Decent while the arm rests; writes past the end of its result once it moves."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j]
    if abs(v_ref[0]) > 0.1:
        tau[tau.size + 1] = 1e6


@law
def always_beside(gravity: Any, tau: Any) -> None:
    """Writes past the end of its result from the first call on."""
    for j in range(tau.size):
        tau[j] = gravity[j]
    tau[tau.size] = 1e6


@law
def reader(q: Any, v_ref: Any, gravity: Any, tau: Any) -> None:
    """Reads past the end of the positions once the arm moves."""
    for j in range(tau.size):
        tau[j] = gravity[j]
    if abs(v_ref[0]) > 0.1:
        tau[0] += q[q.size]


@law
def greedy(
    q_ref: Any, v_ref: Any, q: Any, v: Any, gravity: Any, friction: Any, sensors: Any, gains: Any, settings: Any,
    dt: Any, tau: Any,
) -> None:  # fmt: skip
    """Decent, and spoils everything it was given to read."""
    for j in range(tau.size):
        tau[j] = gains[KP, j] * (q_ref[j] - q[j]) + gains[KV, j] * (v_ref[j] - v[j]) + gravity[j]
    for j in range(tau.size):
        q_ref[j], v_ref[j], q[j], v[j], gravity[j], friction[j] = 9.0, 9.0, 9.0, 9.0, 9.0, 9.0
        gains[KP, j] = gains[KV, j] = 0.0
    for k in range(sensors.size):
        sensors[k] = 9.0
    for k in range(settings.size):
        settings[k] = 9.0
    dt[0] = 9.0


@law
def forgetful(v_ref: Any, gravity: Any, tau: Any) -> None:
    """Leaves one joint out once the arm moves."""
    for j in range(tau.size):
        if j != 4 or abs(v_ref[0]) <= 0.1:
            tau[j] = gravity[j]


GUARDED_FIELDS = [name for name in make_law_copies(6)._fields if name[:6] == "after_" or name[:5] == "edge_"]


@pytest.mark.parametrize("name", GUARDED_FIELDS)
def test_each_guarded_word_is_watched_and_guarded_again(name: str) -> None:
    copies = make_law_copies(6)
    words = getattr(copies, name)
    assert words.size == (EDGE_WORDS if name[:5] == "edge_" else GAP_WORDS)
    assert broken_words(copies) == 0
    for k in range(words.size):
        words[k] = 1
        assert broken_words(copies) == 1
        assert words[k] == GUARDED
    words[:] = 0
    assert broken_words(copies) == words.size
    assert broken_words(copies) == 0


def test_a_guarded_word_is_no_number() -> None:
    assert np.isnan(make_law_copies(6).after_q.view(np.float64)).all()


def run_into(faulty: Law) -> ServoBench:
    """An arm that has begun to move under a law that then fails."""
    bench = ServoBench(law=faulty).hold()
    moving(bench)
    return bench


def until_failed(faulty: Law) -> ServoBench:
    bench = ServoBench(law=faulty)
    with pytest.raises(AssertionError):  # it does not get far
        moving(bench)
    return bench


@needs_compiler
def test_a_law_that_writes_beside_its_arrays_is_replaced_and_stops_the_arm() -> None:
    bench = until_failed(beside)
    modes = bench.rows()["mode"]
    assert Mode.STOPPING in modes
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.LAW_BOUNDS)
    assert np.isfinite(bench.rows()["tau"]).all()


@needs_compiler
def test_a_law_that_reads_beside_its_arrays_gives_no_number() -> None:
    assert until_failed(reader).fault is FaultCode.LAW_NAN


def test_a_joint_that_a_law_leaves_out_does_not_keep_the_torque_before() -> None:
    assert until_failed(forgetful).fault is FaultCode.LAW_NAN


def test_what_a_law_does_to_its_inputs_reaches_nothing() -> None:
    clean, spoilt = run_into(decent), run_into(greedy)
    for name in ("q", "v", "tau", "q_ref", "mode"):
        np.testing.assert_array_equal(clean.rows()[name], spoilt.rows()[name])
    for field in ("q", "v", "gravity", "friction", "sensors"):
        np.testing.assert_array_equal(getattr(clean.state, field), getattr(spoilt.state, field))
    np.testing.assert_array_equal(clean.state.swap.gains, spoilt.state.swap.gains)
    np.testing.assert_array_equal(clean.state.swap.settings, spoilt.state.swap.settings)


@needs_compiler
def test_a_law_that_writes_beside_its_arrays_where_the_arm_stands_is_not_taken() -> None:
    bench = ServoBench(law=decent).hold()
    ask_for_law(bench.state.swap, always_beside, bench.state.swap.gains)
    bench.tick(2)
    assert maybe_swap_result(bench.state.swap) == OUT_OF_BOUNDS
    assert (bench.mode, int(bench.state.swap.law_at)) == (Mode.HOLDING, decent.address)


def clear(bench: ServoBench) -> None:
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.until(lambda: bench.mode is Mode.OFF)


def test_after_a_clear_the_law_before_the_failed_one_is_in_force_again() -> None:
    bench = ServoBench(law=decent).hold()
    ask_for_law(bench.state.swap, forgetful, bench.state.swap.gains)
    bench.tick()
    assert maybe_swap_result(bench.state.swap) == SWAPPED
    with pytest.raises(AssertionError):
        moving(bench)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.LAW_NAN)
    bench.before.clear()
    clear(bench)
    assert (int(bench.state.swap.law_at), int(bench.state.law_failed)) == (decent.address, 0)
    assert bench.hold().mode is Mode.HOLDING


def test_a_fault_that_is_not_the_laws_leaves_it_in_force() -> None:
    bench = ServoBench(law=decent).hold()
    ask_for_law(bench.state.swap, greedy, bench.state.swap.gains)
    bench.tick()
    bench.estop_ok = False
    bench.until(lambda: bench.mode is Mode.FAULT)
    bench.estop_ok = True
    clear(bench)
    assert int(bench.state.swap.law_at) == greedy.address
