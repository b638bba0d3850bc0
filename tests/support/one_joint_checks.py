"""The servo of an arm with one sliding joint, for `tests/system/test_servo_without_jit.py`.

As plain Python: for another number of joints the whole cycle would be compiled once more, which takes a minute.
"""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest

from qrobot.config import Robot
from qrobot.config.robot import robot_of
from qrobot.hwif.registers import DAC_ZERO
from qrobot.modecodes import Mode
from tests.support.servo_bench import ServoBench, cruise, play

ONE_SLIDE = """
name = "slide"
about = "one sliding joint"
[joints]
names = ["slide"]
kinds = ["prismatic"]
[geometry]
family = "generic"
alpha_deg = [0]
a_m = [0]
d_m = [0]
theta_deg = [0]
base_height_m = 0.0
flange_m = 0.0
gravity_m_s2 = [0, 0, -9.81]
[limits]
q_min_deg = [0.0]
q_max_deg = [0.5]
v_max_deg_s = [0.4]
a_max = [3.0]
[poses]
park = [0.1]
ready = [0.1]
end = [0.4]
[transmission]
gear = [400]
rotor_inertia = [1e-5]
coupling = {}
counts_per_rev = [1000]
count_sign = [1]
count_offset = [0]
q_offset_deg = [0]
dac_per_Nm = [10.0]
brake = [true]
index_phase = [0]
pot_at_zero = [8192]
pot_per_rev = 150.0
scales = "gear"
[links]
mass = [2.0]
com = [[0, 0, 0]]
inertia = [[0.01, 0.01, 0.01]]
[friction.corke]
viscous = [5.0]
coulomb_pos = [2.0]
coulomb_neg = [3.0]
stiction_factor = 1.0
[control]
kp = [4000]
kv = [200]
inertia = [3.0]
velocity_filter_hz = 40.0
gravity_joints = [true]
friction_preset = "corke"
friction_velocity = [0.02]
[guard]
tau_max = [150.0]
velocity_factor = 1.1
following_error = [0.02]
start_tolerance = 0.005
range_margin = [0.005]
a_stop = [2.5]
[board]
revision = "F"
"""


def sourced(section: dict[str, Any]) -> dict[str, Any]:
    """A section of a robot file with the source that every key has to have."""
    return section | {"source": dict.fromkeys(section, "[A] made up for this test")}


@pytest.fixture(scope="module")
def slide() -> Robot:
    document = tomllib.loads(ONE_SLIDE)
    for name in ("geometry", "limits", "poses", "transmission", "links", "control", "guard", "board"):
        document[name] = sourced(document[name])
    document["friction"] = {name: sourced(preset) for name, preset in document["friction"].items()}
    return robot_of(document, "slide")


def test_an_arm_of_one_sliding_joint_is_held_against_gravity_and_follows(slide: Robot) -> None:
    bench = ServoBench(slide).hold()
    bench.run(0.05)
    assert bench.snapshot.tau[0] == pytest.approx(2.0 * 9.81, abs=0.5)
    assert np.all(bench.dac[1:] == DAC_ZERO)
    play(bench, cruise(bench.q, np.array([0.2]), ramp_s=0.2))
    bench.run(0.4)
    assert bench.mode is Mode.TRACKING
    assert bench.snapshot.v[0] == pytest.approx(0.2, rel=0.02)


def test_an_arm_of_one_sliding_joint_is_stopped_before_its_end(slide: Robot) -> None:
    bench = ServoBench(slide, pose="end").hold()
    play(bench, cruise(bench.q, np.array([0.3])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert 0.45 < bench.q[0] <= 0.5
