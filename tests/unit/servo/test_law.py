"""The shipped laws are their formulas, and a law is a pointer the compiled cycle need not know."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.modecodes import Mode
from qrobot.realtime.jit import jit_disabled
from qrobot.servo.laws.law import KP, KV, MEMORY_WORDS, N_GAINS, Law, Setting, law
from qrobot.servo.laws.names import DEFAULT_LAW, SHIPPED_LAWS, law_label
from qrobot.servo.laws.shipped import LAWS, find_law
from tests.support.bench_blocks import cycle_of_blocks
from tests.support.servo_bench import ServoBench, moving

ROBOT = load_robot("puma560")
N = 3
numbers = st.lists(st.floats(-1e3, 1e3), min_size=N, max_size=N).map(np.array)
terms = st.fixed_dictionaries(
    dict.fromkeys(("q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction", "kp", "kv", "m0"), numbers)
)


def call(one: Law, **given: Any) -> np.ndarray:
    n = given["q"].size
    vectors = ("q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction")
    tau = np.full(n, np.nan)
    one(
        *(given.get(name, np.zeros(n)) for name in vectors),
        given.get("sensors", np.zeros(8)),
        given.get("payload", np.zeros(10)),
        given.get("gains", np.zeros((N_GAINS, n))),
        one.values,
        given.get("memory", np.zeros(MEMORY_WORDS)),
        np.array([given.get("dt", 0.001)]),
        tau,
    )
    return tau


def torque(name: str, t: dict[str, Any]) -> np.ndarray:
    return call(find_law(name, ROBOT), **t, gains=np.array([t["kp"], t["kv"], t["m0"]]))


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


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("lqr", "there are pd, qrobot, qrobot\\+a, computed-torque"),
        ("computed torque", "did you mean 'computed-torque'?"),
    ],
)
def test_an_unknown_law_is_refused_with_the_names_there_are(name: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        find_law(name, ROBOT)


def test_the_default_law_is_the_papers() -> None:
    assert "QRobot's law (QRobot paper, section 6)" in (find_law(DEFAULT_LAW, ROBOT).__doc__ or "")


def test_a_label_fits_into_memory_and_leaves_folders_out() -> None:
    assert law_label("pd") == "pd"
    assert law_label("/somewhere/laws/spring.py:stiff") == "spring.py:stiff"
    assert len(law_label(f"{'x' * 80}.py:ä").encode()) <= 64


@law
def spring(q: Any, gravity: Any, memory: Any, tau: Any) -> None:
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


def test_every_name_of_a_shipped_law_has_its_law_and_every_law_its_name() -> None:
    assert tuple(LAWS) == SHIPPED_LAWS


def test_all_laws_share_one_compiled_cycle() -> None:
    first, *others = LAWS
    ServoBench(law=first).hold()
    if not jit_disabled():
        compiled = list(cycle_of_blocks.signatures)  # type: ignore[attr-defined]
        assert compiled
        for name in others:
            ServoBench(law=name).hold()
        assert cycle_of_blocks.signatures == compiled  # type: ignore[attr-defined]


def test_a_law_that_takes_something_else_is_refused_when_it_is_made() -> None:
    def wishful(q: Any, wind: Any, tau: Any) -> None: ...

    def idle(q: Any) -> None: ...

    with pytest.raises(ConfigError, match="law wishful takes 'wind', which is none of q_ref, v_ref"):
        law(wishful)
    with pytest.raises(ConfigError, match="law idle takes no tau"):
        law(idle)


@pytest.mark.skipif(jit_disabled(), reason="plain Python compiles anything")
def test_a_law_that_does_not_compile_is_refused_in_a_few_words() -> None:
    def not_a_number(tau: Any) -> None:
        tau[0] = "full"

    with pytest.raises(ConfigError, match="does not compile") as refusal:
        _ = law(not_a_number).address
    assert len(str(refusal.value)) < 600
    assert "test_law.py" in str(refusal.value)


@pytest.mark.skipif(jit_disabled(), reason="plain Python multiplies matrices")
def test_a_law_with_products_of_vectors_and_matrices_is_told_what_to_do_instead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)  # as where it is not installed

    def multiplies(q: Any, tau: Any) -> None:
        tau[:] = np.dot(np.eye(6), q)

    def solves(q: Any, tau: Any) -> None:
        tau[:] = np.linalg.solve(np.eye(6), q)

    def works(v: Any, tau: Any) -> None:
        tau[0] = np.dot(v, v)

    for function in (multiplies, solves, works):
        with pytest.raises(ConfigError, match=r"does not compile: linear algebra .* needs SciPy"):
            _ = law(function).address


def test_a_law_typed_at_a_prompt_works_too() -> None:
    scope: dict[str, Any] = {}
    exec("def weightless(tau):\n    for j in range(tau.size):\n        tau[j] = 0.0\n", scope)
    bench = ServoBench(law=law(scope["weightless"])).hold()
    bench.run(0.05)
    np.testing.assert_array_equal(bench.snapshot.tau, 0.0)


STIFFNESS, REACH = range(2)


@law(
    settings=(
        Setting("stiffness", 10.0, 0.0, 100.0, "N m/rad", "of the spring"),
        Setting("reach", 1.0, 0.5, 2.0, "rad", "where it ends"),
    )
)
def chosen_spring(q: Any, settings: Any, tau: Any) -> None:
    """A spring to zero of a stiffness that its user chooses."""
    for j in range(tau.size):
        tau[j] = -settings[STIFFNESS] * min(q[j], settings[REACH])


def test_settings_reach_the_law_and_those_left_out_keep_their_default() -> None:
    q = np.array([0.1, 2.0])
    np.testing.assert_allclose(call(chosen_spring, q=q), [-1.0, -10.0])
    stiffer = chosen_spring.with_settings({"stiffness": 50.0})
    np.testing.assert_allclose(call(stiffer, q=q), [-5.0, -50.0])
    assert stiffer.chosen == {"stiffness": 50.0, "reach": 1.0}
    assert chosen_spring.chosen["stiffness"] == 10.0


def test_settings_reach_the_law_in_the_cycle() -> None:
    bench = ServoBench(law=chosen_spring.with_settings({"stiffness": 3.0}), pose="ready").hold()
    bench.run(0.02)
    np.testing.assert_allclose(bench.snapshot.tau, -3.0 * np.minimum(bench.snapshot.q, 1.0), atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"stifness": 1.0}, "no setting 'stifness'; did you mean 'stiffness'?"),
        ({"mass": 1.0}, "no setting 'mass'; there are: stiffness, reach"),
        ({"reach": 2.5}, "reach = 2.5 rad: allowed are 0.5 to 2"),
        ({"reach": float("nan")}, "reach = nan rad"),
    ],
)
def test_settings_that_do_not_fit_are_refused(settings: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        chosen_spring.with_settings(settings)


def test_a_law_without_settings_says_so() -> None:
    with pytest.raises(ConfigError, match="no setting 'reach': it has none"):
        find_law("pd", ROBOT, {"reach": 1.0})


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
