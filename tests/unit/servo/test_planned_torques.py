"""What planned motions may put on the joints of an arm that differs from its model, and what is told when they do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.model.dynamics import DynamicsParams, dynamics_params, dynamics_work, inverse_dynamics, with_payload
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.checks.dead_encoder import LAG_S
from qrobot.servo.checks.encoder_monitor import SCALE_SHARE
from qrobot.servo.checks.fault_monitors import OVERTAXED_S, OVERTAXED_SHARE
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.operator.motion_requests import REACTIONS
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.campaign import PUMA, FastLeg, N
from tests.support.hard_streams import stream

BARE = dynamics_params(PUMA)
LOADED = with_payload(BARE, PUMA.limits.payload_kg, np.array([0.0, 0.0, PUMA.geometry.flange_m]))
INERTIA = PUMA.control.inertia
PERIOD_MS = 7


def moving_torque(model: DynamicsParams, q: Floats, v: Floats, a: Floats) -> Floats:
    """Torque that moves the arm of `model`, without weight. Shape (n,)."""
    tau = np.zeros(N)
    inverse_dynamics(q, v, a, model._replace(gravity=np.zeros(3)), dynamics_work(N), tau)
    return tau


def ready(plant: Emulator) -> LockstepRig:
    rig = LockstepRig(PUMA, ServoSettings(), plant)
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    return rig


def flight(rig: LockstepRig, seed: int, seconds: float, share: float = 0.9) -> Iterator[None]:
    """Play a hard legal stream, cycle by cycle."""
    rows = stream(np.random.default_rng(seed), PERIOD_MS / 1000, share, 1.0)
    for seq, q in enumerate(rows[: round(seconds * 1000 / PERIOD_MS)]):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, PERIOD_MS * 1_000_000, [POSITION_SETPOINT] * N, q.tolist())
        for _ in range(PERIOD_MS):
            yield
            rig.ticks(1)


def test_rotors_that_other_joints_turn_belong_to_the_momentum_of_a_joint() -> None:
    rig = ready(Emulator(PUMA, start="end", physics="rigid"))
    gear, coupling = PUMA.transmission.gear, PUMA.transmission.coupling
    rotors = coupling.T @ np.diag(gear**2 * PUMA.transmission.rotor_inertia) @ coupling
    assert rotors[4, 5] == pytest.approx(0.035, abs=1e-3)
    inertia = rotors - np.diag(np.diag(rotors)) + np.diag(INERTIA)
    for _ in flight(rig, 1, 0.3):
        found = rig.state.watch.expected + rig.state.watch.push / rig.params.watch.pace
        assert found == pytest.approx(inertia @ rig.state.v, abs=1e-9)


def test_the_heaviest_load_and_a_wrong_scale_of_torque_are_allowed_for_while_the_arm_speeds_up() -> None:
    rig = ready(Emulator(PUMA, start="end", physics="rigid"))
    expected, before = np.zeros(N), None
    for _ in flight(rig, 1, 0.3):
        if before is not None:
            mode, v, a = before
            q, planned = np.array(rig.state.q), np.zeros(N)
            if mode == Mode.TRACKING:
                load = moving_torque(LOADED, q, v, a) - moving_torque(BARE, q, v, a)
                planned = np.abs(load) + SCALE_SHARE * INERTIA * np.abs(a)
            expected = np.maximum(planned, expected * (1.0 - 1e-3 / LAG_S))
            assert rig.state.watch.planned == pytest.approx(expected, abs=1e-6)
        before = rig.state.mode, np.array(rig.state.v_ref), np.array(rig.state.a_ref)
    assert expected.max() > 10.0


def test_an_arm_that_is_held_is_allowed_none_of_it() -> None:
    rig = ready(Emulator(PUMA, start="end", physics="rigid"))
    rig.run_for(1.0)
    assert not rig.state.watch.planned.any()


def test_what_a_motion_is_allowed_goes_with_its_power() -> None:
    rig = ready(Emulator(PUMA, start="end", physics="rigid"))
    for _ in flight(rig, 1, 0.3):
        pass
    watch = rig.state.watch
    kept = (watch.planned, watch.jolt, watch.late, watch.bend, watch.drive)
    assert watch.planned.max() > 1.0
    rig.mailbox.request_power_off()
    rig.run_for(1.0)
    assert rig.mailbox.snapshot().mode == Mode.OFF
    assert not any(each.any() for each in kept)


@pytest.mark.parametrize("asked", [0.0, 60.0, 500.0])
def test_a_lower_threshold_that_was_asked_for_is_kept_on_the_way_too(asked: float) -> None:
    leg = FastLeg(1000.0)
    leg.rig.mailbox.request_collision([asked] * N, 0)
    leg.power_on()
    leg.fly(13)
    planned = float(leg.rig.state.watch.planned[1])
    assert planned > 1.0
    leg.suffer("arm:2 pushed -160 +15ms", 14)
    told = read_incident(leg.rig.state.watch.incident)
    assert told is not None
    assert (told.code, told.joint) == (FaultCode.COLLISION, 1)
    usual = PUMA.guard.unexplained_torque_or_default[1]
    if asked == 60.0:
        assert told.limit == pytest.approx(asked)
    else:
        assert usual < told.limit < usual + 2.0 * planned


@pytest.mark.parametrize("reaction", REACTIONS)
def test_a_joint_without_the_torque_for_its_motion_is_stopped_for_that_before_its_power_is_cut(reaction: str) -> None:
    """Joint 3 of this plant gives a fifth less torque than it should. A soft arm would let its load sink."""
    mismatch = PlantMismatch.mismatched(N, seed=0)
    rig = ready(Emulator(PUMA, start="end", physics="rigid", mismatch=mismatch, payload_kg=2.5))
    rig.mailbox.request_collision((), REACTIONS.index(reaction))
    most = PUMA.guard.following_error[2]
    for _ in flight(rig, 1, 1.2, share=0.5):
        if rig.state.mode == Mode.STOPPING:
            break
        lag = abs(rig.state.q_ref[2] - rig.state.q[2])
        assert lag < most
    told = read_incident(rig.state.watch.incident)
    assert told is not None
    assert (told.code, told.joint, told.limit) == (FaultCode.SATURATED, 2, OVERTAXED_S)
    assert OVERTAXED_S < told.value < OVERTAXED_S + 0.02
    assert lag > 0.95 * OVERTAXED_SHARE * most
    rig.run_for(0.5)
    assert (rig.state.mode, rig.state.fault) == (Mode.HOLDING, FaultCode.NONE)
    assert rig.emulator.powered
    assert np.abs(rig.emulator.v).max() < 0.02
