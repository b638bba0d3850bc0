"""The laws of impedance: springs about the setpoint, whose stiffness changes without a bump and without energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import PANEL_MICRO
from qrobot.modecodes import Mode
from qrobot.model.arm import Arm
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.table import load_table
from qrobot.servo.laws.impedance import RAMP_S
from qrobot.servo.laws.impedance_feedback import joint_feedback, tip_jacobians
from qrobot.servo.laws.law import MEMORY_WORDS, Law
from qrobot.servo.laws.law_swap import ask_for_settings
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.laws.stability import check_gains
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.thorough import examples
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
ARM, CONTROL, N = Arm(ROBOT), ROBOT.control, ROBOT.n
GAINS = np.array([CONTROL.kp, CONTROL.kv, CONTROL.inertia])
COULOMB = ROBOT.friction[CONTROL.friction_preset].coulomb_pos
JOINT, CARTESIAN = find_law("joint_impedance", ROBOT), find_law("cartesian_impedance", ROBOT)
BENT = np.array(ROBOT.poses["ready"]) + np.array([0.3, 0.2, 0.4, 0.3, 0.7, 0.1])
DT = 0.001
shares = st.lists(st.floats(0.0, 4.0), min_size=N, max_size=N).map(np.array)


def stiff(kp: np.ndarray) -> dict[str, float]:
    return {f"stiffness_{j + 1}": float(value) for j, value in enumerate(kp)}


def spring(law: Law, q: np.ndarray, q_ref: np.ndarray, **more: Any) -> np.ndarray:
    """Torque beyond what carries the arm."""
    return call(law, q=q, q_ref=q_ref, gains=GAINS, **more) - call(law, q=q, q_ref=q, gains=GAINS)


@given(shares, st.floats(0.3, 2.0), st.lists(st.floats(-0.2, 0.2), min_size=2 * N, max_size=2 * N).map(np.array))
def test_a_joint_is_a_spring_and_a_damper_about_its_setpoint(share: np.ndarray, zeta: float, e: np.ndarray) -> None:
    law = JOINT.with_settings({"damping_ratio": zeta, **stiff(share * CONTROL.kp)})
    kp, kv = joint_feedback(ROBOT, law.values, GAINS)
    found = spring(law, BENT - e[:N], BENT, v=-e[N:])
    np.testing.assert_allclose(found, kp * e[:N] + kv * e[N:], atol=1e-9)
    np.testing.assert_allclose(kv, 2.0 * zeta * np.sqrt(np.maximum(kp, 0.02 * CONTROL.kp) * CONTROL.inertia))


def tip_error(q: np.ndarray, q_ref: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Way from the flange at `q` to that at `q_ref`, and rotation between them, in the base frame."""
    T, T_ref = ARM.flange(q), ARM.flange(q_ref)
    return T_ref[:3, 3] - T[:3, 3], T[:3, :3].T @ T_ref[:3, :3]


def energy(q: np.ndarray, q_ref: np.ndarray, k: np.ndarray) -> float:
    way, turn = tip_error(q, q_ref)
    return float(0.5 * k[:3] @ way**2 + 0.5 * k[3] * (3.0 - np.trace(turn)))


@settings(max_examples=examples(20))
@given(st.lists(st.floats(-0.3, 0.3), min_size=N, max_size=N).map(np.array))
def test_the_springs_of_the_tool_are_the_gradient_of_their_energy(e: np.ndarray) -> None:
    k = np.array([3000.0, 500.0, 1500.0, 80.0])
    chosen = dict(zip(("stiffness_x", "stiffness_y", "stiffness_z", "stiffness_turn"), k.tolist(), strict=True))
    law = CARTESIAN.with_settings({**chosen, "null_stiffness": 0.0})
    q = BENT + e
    steps = 1e-5 * np.eye(N)
    slope = [(energy(q + step, BENT, k) - energy(q - step, BENT, k)) / 2e-5 for step in steps]
    np.testing.assert_allclose(spring(law, q, BENT), -np.array(slope), atol=1e-3)


@pytest.mark.parametrize("wrist", [0.0, 0.7])
def test_joints_that_cannot_move_the_tool_are_held_and_damped_at_a_singularity(wrist: float) -> None:
    q = BENT.copy()
    q[4] = wrist
    free = np.zeros(N)
    free[3], free[5] = 0.1, -0.1  # joints 4 and 6 against each other: with a straight wrist the tool stands still
    soft = CARTESIAN.with_settings({"stiffness_turn": 0.0, "null_stiffness": 0.5})
    slack = CARTESIAN.with_settings({"stiffness_turn": 0.0, "null_stiffness": 0.0})
    held = spring(soft, q - free, q) - spring(slack, q - free, q)
    expected = 0.5 * CONTROL.kp * free
    if wrist == 0.0:
        np.testing.assert_allclose(held[[3, 5]], expected[[3, 5]], rtol=0.1)
        assert free @ spring(CARTESIAN, q, q, v=-free) > 0.0  # damped
    else:
        assert np.abs(held[[3, 5]]).max() < 0.2 * np.abs(expected).max()
    for pose in (*ROBOT.poses.values(), np.zeros(N)):
        assert np.isfinite(call(CARTESIAN, q=np.array(pose), q_ref=np.array(pose) + 0.2, gains=GAINS)).all()


@pytest.mark.parametrize("law", [JOINT, CARTESIAN], ids=["joint", "Cartesian"])
def test_the_jump_of_a_setting_is_no_jump_of_torque(law: Law) -> None:
    rng, memory = np.random.default_rng(4), np.zeros(MEMORY_WORDS)
    q_ref, v = BENT + rng.uniform(-0.1, 0.1, N), rng.uniform(-0.3, 0.3, N)
    carried = call(law, q=BENT, q_ref=BENT, gains=GAINS)
    before = call(law, q=BENT, q_ref=q_ref, v=v, gains=GAINS, memory=memory) - carried
    most = np.abs(before)
    for cycle in range(600):
        if cycle % 20 == 0:
            law = law.with_settings({s.name: rng.uniform(s.low, min(s.high, 20 * s.default)) for s in law.settings})
            law.values[-1 if law.settings[-1].name == "reach" else 31] = 0.0  # a tool of another length is a jump
            most = np.maximum(most, np.abs(call(law, q=BENT, q_ref=q_ref, v=v, gains=GAINS) - carried))
        now = call(law, q=BENT, q_ref=q_ref, v=v, gains=GAINS, memory=memory) - carried
        assert (np.abs(now - before) <= 3.0 * DT / RAMP_S * most.max()).all()
        before = now


@settings(max_examples=examples(20))
@given(st.lists(st.tuples(shares, st.integers(5, 60)), min_size=3, max_size=8), shares)
def test_no_change_of_stiffness_gives_more_energy_than_its_power_allows(
    changes: list[tuple[np.ndarray, int]], start: np.ndarray
) -> None:
    power, m0 = 0.5, CONTROL.inertia
    law = JOINT.with_settings({"stiffening": power, **stiff(0.1 * CONTROL.kp)})
    memory, e, v, t = np.zeros(MEMORY_WORDS), 0.05 * (start - 2.0), np.zeros(N), 0.0
    weight = call(law, q=BENT, q_ref=BENT, gains=GAINS)
    first = 0.5 * 0.1 * CONTROL.kp @ e**2
    call(law, q=BENT, q_ref=BENT + e, gains=GAINS, memory=memory)
    for share, cycles in changes:
        law = law.with_settings(stiff(0.5 * share * CONTROL.kp))
        for _ in range(cycles):
            tau = call(law, q=BENT, q_ref=BENT + e, v=v, gains=GAINS, memory=memory) - weight
            v += DT / m0 * tau
            e -= DT * v
            t += DT
            kept = 0.5 * m0 @ v**2 + 0.5 * memory[56 : 56 + N] @ e**2
            assert kept <= first + power * t + 0.02 * first  # a sampled spring is not quite one


@pytest.mark.parametrize(
    ("law", "chosen", "hertz", "refused"),
    [
        ("joint_impedance", {}, 500.0, False),
        ("joint_impedance", stiff(np.zeros(N)), 500.0, False),
        ("joint_impedance", {"stiffness_5": 1700.0, "damping_ratio": 2.0}, 1000.0, True),
        ("cartesian_impedance", {}, 500.0, False),
        ("cartesian_impedance", {"stiffness_x": 20000.0}, 1000.0, False),
        ("cartesian_impedance", {"stiffness_turn": 2000.0, "damping_ratio": 2.0}, 1000.0, True),
    ],
)
def test_what_the_rate_of_the_servo_cannot_hold_is_refused(
    law: str, chosen: dict[str, float], hertz: float, refused: bool
) -> None:
    servo = ServoSettings(rate_hz=hertz, law=law, law_settings=chosen)
    if not refused:
        check_gains(ROBOT, servo)
        return
    with pytest.raises(ConfigError, match=rf"CFG_GAIN: law {law} .*less stiffness"):
        check_gains(ROBOT, servo)
    check_gains(ROBOT, ServoSettings(rate_hz=hertz, law=law, law_settings=chosen, unchecked_gains=True))


def holding(law: str, chosen: dict[str, float], q: np.ndarray) -> LockstepRig:
    """An arm that holds `q` under a law, with potentiometers that tell a held joint from a dead encoder."""
    table = load_table("puma560", ROBOT)
    servo = ServoSettings(law=law, law_settings=chosen, calibration=table)
    rig = LockstepRig(ROBOT, servo, Emulator(ROBOT, start=q, physics="rigid"))
    rig.run_for(0.3)
    rig.mailbox.request_power(True)
    rig.run_for(0.4)
    return rig


def push(rig: LockstepRig, tau: np.ndarray, seconds: float) -> None:
    """Push at the joints, N m."""
    rig.board.panel.push[:N] = np.round(tau * PANEL_MICRO).astype(np.int64)
    rig.run_for(seconds)


def test_a_pushed_arm_gives_way_by_force_over_stiffness_and_takes_new_stiffness_while_pushed() -> None:
    kp = np.array([300.0, 600.0, 300.0, 60.0, 60.0, 60.0])
    rig = holding("joint_impedance", stiff(kp), BENT)
    start, tau = rig.emulator.q.copy(), np.array([45.0, 70.0, 35.0, 8.0, 8.0, 8.0])
    push(rig, tau, 1.5)
    np.testing.assert_array_less(np.abs(kp * (rig.emulator.q - start) - tau), COULOMB + 0.5)
    assert (rig.emulator.q - start > 0.05).all()
    for share in (2.0, 0.7):
        ask_for_settings(rig.state.swap, JOINT.with_settings(stiff(share * kp)))
        rig.run_for(2.5)
        np.testing.assert_array_less(np.abs(share * kp * (rig.emulator.q - start) - tau), 1.3 * COULOMB + 0.5)
    rows = rig.rows()
    assert not rows["fault"].any()
    assert rows["mode"][-1] == Mode.HOLDING
    held = rows["tau"][rows["mode"] == Mode.HOLDING]
    np.testing.assert_array_less(np.abs(np.diff(held[100:], axis=0)).max(axis=0), 0.05 * ROBOT.guard.tau_max)
    rig.emulator.faults.add("encoder:2 off")  # its spring does not pull it back any more
    push(rig, -tau, 1.0)
    assert rig.mailbox.snapshot().fault == FaultCode.ENC_STUCK


def test_the_tool_gives_way_along_the_axis_on_which_it_is_pushed() -> None:
    chosen = {"stiffness_x": 1500.0, "stiffness_y": 3000.0, "stiffness_z": 1500.0, "null_stiffness": 0.0}
    rig = holding("cartesian_impedance", chosen, BENT)
    q, force = rig.emulator.q.copy(), np.array([60.0, -120.0, 90.0])
    J = ARM.jacobian(q)
    lever = ARM.flange(q)[:3, 3] - ARM.forward(q)[:3, 3]
    across = J[:3] + np.cross(J[3:].T, lever).T
    push(rig, across.T @ force, 1.5)
    moved = tip_error(q, rig.emulator.q)[0]
    k = np.array([1500.0, 3000.0, 1500.0])
    lost = np.abs(np.linalg.pinv(across[:, :3].T)) @ COULOMB[:3] + 25.0  # N that friction of the joints may hold
    assert (np.abs(k * moved - force) <= lost).all()
    assert moved @ force > 0.0
    assert not rig.rows()["fault"].any()
    assert rig.rows()["mode"][-1] == Mode.HOLDING


def test_the_jacobians_of_the_check_are_those_of_the_tip() -> None:
    J = tip_jacobians(ROBOT, 0.1)[0]
    q = next(iter(ROBOT.poses.values()))
    for j, step in enumerate(1e-6 * np.eye(N)):
        ends = [ARM.flange(q + s * step) @ [0.0, 0.0, 0.1, 1.0] for s in (1, -1)]
        np.testing.assert_allclose(J[:3, j], (ends[0] - ends[1])[:3] / 2e-6, atol=1e-6)
