"""The recordings of the tutorial on identification: an emulated arm, drawn at random, makes the motions of two plans.

Made by `python docs/unknown_arm.py`, in lock-step, which prints the digests that a test knows.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from numpy.lib.recfunctions import repack_fields

from qrobot.config import Robot, load_robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.compact_recording import CompactRecording, load_recording, save_recording
from qrobot.ident.excitation import FEWEST, Excitation, make_excitation
from qrobot.ident.plan import ExcitationPlan, make_plan
from qrobot.ident.regressor import gravity_regressor, inertial_regressor, known_parameters
from qrobot.rig.identify import record_lockstep
from qrobot.rig.perturbed_arm import PerturbedArm
from qrobot.servo.settings import ServoSettings

FOLDER: Final = Path(__file__).parents[1] / "config/data"
SLOW, FAST = "unknown_arm", "unknown_arm_fast"
SEED: Final = 7
POSES: Final = 12
RATE_HZ: Final = 250.0  # a quarter of the usual one, and of its rows


def plans(robot: Robot) -> dict[str, ExcitationPlan | Excitation]:
    """Steady passes, and the fewest runs that tell inertia."""
    gravity, inertia = gravity_regressor(robot), inertial_regressor(robot)
    return {
        SLOW: make_plan(robot, gravity, base_of_robot(robot, gravity), POSES),
        FAST: make_excitation(robot, inertia, base_of_robot(robot, inertia), FEWEST),
    }


def recorded(plan: ExcitationPlan | Excitation, name: str = "puma560") -> CompactRecording:
    """The arm's recording of a plan, with the truth beside it."""
    robot, settings, regressor = load_robot(name), ServoSettings(rate_hz=RATE_HZ), inertial_regressor(load_robot(name))
    arm = PerturbedArm.drawn(robot, SEED)
    rows = record_lockstep(robot, name, settings, arm.emulator(), plan)
    facts = {
        "made_by": "docs/unknown_arm.py",
        "payload_kg": arm.payload_kg,
        "links": dict(zip(regressor.names, known_parameters(arm.told, regressor).tolist(), strict=True)),
        "friction": arm.friction.tolist(),
    }
    return CompactRecording(robot, rows, settings.period_ns * 1e-9, facts)


# What a recording can hold: a row has had these fields from the first.
FIELDS = [
    "tick",
    "t_ns",
    "late_ns",
    "busy_ns",
    "mode",
    "fault",
    "setpoint_seq",
    "flags",
    "q_ref",
    "v_ref",
    "a_ref",
    "q",
    "v",
    "tau",
    "counts",
    "dac",
]


def digest(recording: CompactRecording) -> str:
    """Of its rows as they are read back."""
    return hashlib.sha256(repack_fields(recording.rows[FIELDS]).tobytes()).hexdigest()


if __name__ == "__main__":
    for name, plan in plans(load_robot("puma560")).items():
        file = FOLDER / f"{name}.npz"
        save_recording(file, recorded(plan))
        print(f"{file.name}: {file.stat().st_size} bytes, rows sha256 {digest(load_recording(file))}")
