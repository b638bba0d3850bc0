"""The recording of the tutorial on identification: an emulated arm, drawn at random, makes the motions of a plan.

Made by `python docs/unknown_arm.py`, in lock-step, which prints the digest that a test knows.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from qrobot.config import load_robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.plan import make_plan
from qrobot.ident.regressor import gravity_regressor
from qrobot.ident.shipped import Recording, load_recording, save_recording
from qrobot.rig.identify import record_lockstep
from qrobot.rig.unknown import UnknownArm
from qrobot.servo.settings import ServoSettings

FILE: Final = Path(__file__).parents[1] / "config/data/unknown_arm.npz"
SEED: Final = 7
POSES: Final = 12
RATE_HZ: Final = 250.0  # a quarter of the usual one, and of its rows


def recorded(name: str = "puma560") -> Recording:
    """The arm's recording, with the truth beside it."""
    robot, settings = load_robot(name), ServoSettings(rate_hz=RATE_HZ)
    regressor = gravity_regressor(robot)
    plan = make_plan(robot, regressor, base_of_robot(robot, regressor), POSES)
    arm = UnknownArm.drawn(robot, SEED)
    rows = record_lockstep(robot, name, settings, arm.emulator(), plan)
    facts = {
        "made_by": "docs/unknown_arm.py",
        "payload_kg": arm.payload_kg,
        "links": dict(zip(regressor.names, arm.parameters(regressor).tolist(), strict=True)),
        "friction": arm.friction.tolist(),
    }
    return Recording(robot, rows, settings.period_ns * 1e-9, facts)


def digest(recording: Recording) -> str:
    """Of its rows as they are read back."""
    return hashlib.sha256(recording.rows.tobytes()).hexdigest()


if __name__ == "__main__":
    save_recording(FILE, recorded())
    print(f"{FILE.name}: {FILE.stat().st_size} bytes, rows sha256 {digest(load_recording(FILE))}")
