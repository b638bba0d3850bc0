"""Counters of coupled motors: what joints within their speeds make of them is no jump, and twice as much is one."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from tests.support.servo_bench import ServoBench

PUMA = load_robot("puma560")
N, CYCLES = PUMA.n, 12
RATES_HZ = (250.0, 500.0, 1000.0, 4000.0)


def coupled(coupling: np.ndarray, v_max: np.ndarray) -> Robot:
    """A PUMA 560 with other couplings of its motors and other speeds of its joints."""
    transmission = PUMA.transmission.model_copy(update={"coupling": coupling})
    limits = PUMA.limits.model_copy(update={"v_max": v_max})
    return PUMA.model_copy(update={"transmission": transmission, "limits": limits})


def drawn(seed: int) -> Robot:
    """Couplings of -1 to 1 that can be undone, and speeds of 1 to 8 rad/s."""
    random = np.random.default_rng(seed)
    while True:
        coupling = (
            np.eye(N) + np.triu(random.uniform(-1.0, 1.0, (N, N)), 1) + np.tril(random.uniform(-1, 1, (N, N)), -1)
        )
        if np.linalg.cond(coupling) < 50.0:
            return coupled(coupling, random.uniform(1.0, 8.0, N))


def wrist_in_a_row() -> Robot:
    """The last motor turns with all joints of the wrist, each as fast as the others."""
    coupling = np.eye(N)
    coupling[5, 3:] = 1.0
    return coupled(coupling, np.full(N, 5.2))


def differential_wrist() -> Robot:
    """Two motors turn with the sum and the difference of a fast and a slow joint."""
    coupling, v_max = np.eye(N), np.array(PUMA.limits.v_max)
    coupling[4:, 4:] = [[1.0, 1.0], [1.0, -1.0]]
    v_max[4:] = 1.0, 6.0
    return coupled(coupling, v_max)


ROBOTS = {"in a row": wrist_in_a_row, "differential": differential_wrist} | {
    f"drawn {seed}": lambda seed=seed: drawn(seed) for seed in range(4)
}


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("make", ROBOTS.values(), ids=ROBOTS)
def test_joints_at_their_greatest_speeds_are_no_jump_of_any_counter(make, rate_hz: float) -> None:
    robot = make()
    for motor in range(N):
        bench = ServoBench(robot, rate_hz=rate_hz).tick(3)
        step = np.sign(robot.transmission.coupling[motor]) * robot.limits.v_max / rate_hz
        for _ in range(CYCLES):
            bench.q = bench.q + step
            bench.tick()
            assert bench.state.glitches == 0
        np.testing.assert_allclose(bench.state.q, bench.q, atol=1e-3 + np.abs(step).max())


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("make", ROBOTS.values(), ids=ROBOTS)
def test_a_counter_that_goes_twice_as_far_as_a_jump_may_is_held_back(make, rate_hz: float) -> None:
    robot = make()
    fastest = np.abs(robot.transmission.coupling) @ robot.limits.v_max / np.abs(robot.transmission.rad_per_count)
    for motor in range(N):
        bench = ServoBench(robot, rate_hz=rate_hz).tick(3)
        bench.slip[motor] = round(4.0 * fastest[motor] / rate_hz) + 50
        bench.tick()
        assert bench.state.glitches == 1
