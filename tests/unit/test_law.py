"""The shipped laws are their formulas, and a law is a pointer the compiled cycle need not know."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import NumbaError

from qrobot.errors import ConfigError
from qrobot.realtime.jit import jit_disabled
from qrobot.servo.cycle import cycle
from qrobot.servo.law import DEFAULT_LAW, KP, KV, LAWS, M0, MEMORY_WORDS, N_GAINS, find_law, law
from qrobot.servo.modes import Mode
from tests.support.servo_bench import ServoBench, moving

N = 3
numbers = st.lists(st.floats(-1e3, 1e3), min_size=N, max_size=N).map(np.array)
terms = st.fixed_dictionaries(
    dict.fromkeys(("q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction", "kp", "kv", "m0"), numbers)
)


def torque(name: str, t: dict[str, Any]) -> np.ndarray:
    gains, tau = np.zeros((N_GAINS, N)), np.full(N, np.nan)
    gains[KP], gains[KV], gains[M0] = t["kp"], t["kv"], t["m0"]
    find_law(name)(
        t["q_ref"], t["v_ref"], t["a_ref"], t["q"], t["v"], t["gravity"], t["friction"],
        np.zeros(8), gains, np.zeros(MEMORY_WORDS), tau,
    )  # fmt: skip
    return tau


def feedback(t: dict[str, Any]) -> np.ndarray:
    return t["kp"] * (t["q_ref"] - t["q"]) + t["kv"] * (t["v_ref"] - t["v"])


@given(terms)
def test_pd_is_its_formula(t: dict[str, Any]) -> None:
    np.testing.assert_allclose(torque("pd", t), feedback(t), rtol=1e-12, atol=1e-6)


@given(terms)
def test_the_qrobot_law_adds_friction_and_gravity(t: dict[str, Any]) -> None:
    np.testing.assert_allclose(torque("qrobot", t), feedback(t) + t["friction"] + t["gravity"], rtol=1e-12, atol=1e-6)


@given(terms)
def test_the_law_with_feed_forward_adds_inertia_times_acceleration(t: dict[str, Any]) -> None:
    expected = feedback(t) + t["friction"] + t["gravity"] + t["m0"] * t["a_ref"]
    np.testing.assert_allclose(torque("qrobot+a", t), expected, rtol=1e-12, atol=1e-6)


def test_an_unknown_law_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(ConfigError, match=r"no control law 'lqr'; there are: pd, qrobot, qrobot\+a"):
        find_law("lqr")


def test_the_default_law_is_the_papers() -> None:
    assert find_law(DEFAULT_LAW) is LAWS["qrobot"]


@law
def spring(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """A user's law: a weak spring to where the arm was first seen, and the arm's weight."""
    for j in range(tau.size):
        if memory[j] == 0.0:
            memory[j] = q[j]
        tau[j] = 10.0 * (memory[j] - q[j]) + gravity[j]


def test_a_users_law_runs_in_the_cycle_and_has_a_memory_that_power_up_wipes() -> None:
    bench = ServoBench(law=spring, pose="end").hold()
    bench.run(0.1)
    held = bench.q.copy()
    np.testing.assert_allclose(bench.state.memory[:6], bench.snapshot.q, atol=1e-12)
    bench.follows = False
    bench.q = held + 1e-3
    bench.run(0.05)
    np.testing.assert_allclose(bench.snapshot.tau[[0, 3, 4, 5]], -0.01, atol=2e-3)
    bench.mailbox.request_power(False)
    bench.run(0.1)
    bench.hold()
    np.testing.assert_allclose(bench.state.memory[:6], bench.snapshot.q, atol=1e-12)


def test_all_laws_share_one_compiled_cycle() -> None:
    first, *others = LAWS
    ServoBench(law=first).hold()
    if not jit_disabled():
        compiled = list(cycle.signatures)  # type: ignore[attr-defined]
        for name in others:
            ServoBench(law=name).hold()
        assert cycle.signatures == compiled  # type: ignore[attr-defined]


def test_a_law_that_does_not_fit_the_signature_is_refused_when_it_is_made() -> None:
    def too_few(q: Any, tau: Any) -> None:
        tau[0] = q[0]

    def not_a_number(
        q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
        sensors: Any, gains: Any, memory: Any, tau: Any,
    ) -> None:  # fmt: skip
        tau[0] = "full"

    if not jit_disabled():
        for function in (too_few, not_a_number):
            with pytest.raises((NumbaError, TypeError)):
                law(function)


def test_a_law_typed_at_a_prompt_works_too() -> None:
    names = "q_ref, v_ref, a_ref, q, v, gravity, friction, sensors, gains, memory, tau"
    scope: dict[str, Any] = {}
    exec(f"def weightless({names}):\n    for j in range(tau.size):\n        tau[j] = 0.0\n", scope)
    bench = ServoBench(law=law(scope["weightless"])).hold()
    bench.run(0.05)
    np.testing.assert_array_equal(bench.snapshot.tau, 0.0)


def test_velocity_and_acceleration_reach_the_law_in_the_same_tick_as_the_position() -> None:
    bench = ServoBench(law="qrobot+a")
    moving(bench, speed=0.8)
    rows = bench.rows()
    rows = rows[rows["mode"] == Mode.TRACKING][100:]  # after the interpolator's tiny swing at the start
    inertia = bench.robot.control.inertia[0]
    gains = bench.params.gains
    feedback_tau = gains[KP, 0] * (rows["q_ref"] - rows["q"])[:, 0] + gains[KV, 0] * (rows["v_ref"] - rows["v"])[:, 0]
    rest = rows["tau"][:, 0] - feedback_tau - inertia * rows["a_ref"][:, 0]
    assert np.all(rest >= -1e-9)  # friction of a positive velocity, no gravity on the waist
    assert rest[-1] == pytest.approx(24.73 + 5.802 * 0.8, rel=0.02)  # Corke 1994, Coulomb and viscous
