"""Both physics behind the same emulator and servo: the paper's experiment at every frame, and bit-identical runs."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.config import load_robot
from qrobot.rig.experiment import program_path, run_program
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.sim_board.plant import Physics

PUMA, ROOT = load_robot("puma560"), Path(__file__).parents[2]
AGREEMENT_RAD = 1e-4


class Watched(LockstepRig):
    """Notes the true positions after every frame."""

    def __init__(self, physics: Physics, mismatch: PlantMismatch, rate_hz: int) -> None:
        emulator = Emulator(PUMA, mismatch=mismatch, physics=physics)
        super().__init__(PUMA, ServoSettings(rate_hz=rate_hz), emulator)
        self.seen: list[NDArray[np.float64]] = []

    def ticks(self, n: int) -> None:
        super().ticks(n)
        self.seen.append(self.emulator.q)


def experiment(physics: Physics, mismatch: PlantMismatch, rate_hz: int = 4000) -> Watched:
    rig = Watched(physics, mismatch, rate_hz)
    run_program(rig, program_path())
    return rig


@pytest.mark.parametrize("mismatch", [PlantMismatch.nominal(6), PlantMismatch.mismatched(6)], ids=["nominal", "wrong"])
def test_the_papers_experiment_moves_both_arms_alike(mismatch: PlantMismatch) -> None:
    rigid, mujoco = (experiment(physics, mismatch).seen for physics in ("rigid", "mujoco"))
    assert len(rigid) == len(mujoco) > 200
    assert np.ptp(rigid, axis=0).max() > 0.5
    assert np.abs(np.subtract(rigid, mujoco)).max() <= AGREEMENT_RAD


def run_digest(seconds: float) -> str:
    """Digest of all telemetry of a run that starts and holds, with the rigid plant."""
    rig = LockstepRig(PUMA, ServoSettings(rate_hz=1000), Emulator(PUMA, physics="rigid", payload_kg=1.0))
    rig.run_for(seconds)
    return hashlib.sha256(rig.rows().tobytes() + rig.emulator.q.tobytes()).hexdigest()


@pytest.mark.thorough
def test_runs_with_the_rigid_plant_are_bit_identical_also_with_the_jit_off() -> None:
    command = [sys.executable, "-c", "from tests.system.test_plants_agree import run_digest; print(run_digest(0.02))"]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, env=environment, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    assert done.stdout.strip() == run_digest(0.02) == run_digest(0.02) != run_digest(0.021)
