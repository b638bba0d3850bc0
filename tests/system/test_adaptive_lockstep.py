"""The law `adaptive` with a load in the hand that nobody told it of, in lock-step."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.adaptive import LOAD, SPREAD
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator

PUMA = load_robot("puma560")
LOAD_KG = 2.0


def ran(law: str, load_kg: float) -> LockstepRig:
    rig = LockstepRig(PUMA, ServoSettings(rate_hz=1000.0, law=law), Emulator(PUMA, payload_kg=load_kg))
    run_program(rig, program_path())
    return rig


def rms(rig: LockstepRig) -> np.ndarray:
    """While the arm moves. Shape (n,)."""
    rows = rig.rows()
    moving = rows[rows["v_ref"].any(axis=1)]
    return np.sqrt(((moving["q_ref"] - moving["q"]) ** 2).mean(axis=0))


@pytest.fixture(scope="module")
def loaded() -> LockstepRig:
    return ran("adaptive", LOAD_KG)


def test_the_load_is_found_within_its_deviations(loaded: LockstepRig) -> None:
    memory = np.array(loaded.state.memory)
    mass, *moment = memory[LOAD:SPREAD]
    spread = memory[SPREAD : SPREAD + 4]
    assert spread[0] < 0.2
    assert mass == pytest.approx(LOAD_KG, abs=spread[0])
    true = [0.0, 0.0, LOAD_KG * PUMA.geometry.flange_m]
    assert (np.abs(np.array(moment) - true) < spread[1:]).all()


def test_elbow_and_wrist_track_better_than_without_knowing_it(loaded: LockstepRig) -> None:
    adaptive, ignorant = rms(loaded), rms(ran("computed-torque", LOAD_KG))
    assert (adaptive[[2, 4]] < 0.7 * ignorant[[2, 4]]).all()


def test_an_empty_hand_is_found_empty() -> None:
    assert abs(ran("adaptive", 0.0).state.memory[LOAD]) < 0.05
