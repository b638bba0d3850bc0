"""A servo whose drives close their own loop: what it posts for them, and what it no longer judges."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.operations import REFERENCE_PER_COUNT
from qrobot.hwif.registers import DAC_ZERO
from qrobot.modecodes import Mode
from qrobot.model.transmission import counts_to_joint, transmission_params
from qrobot.servo.parameters import servo_parameters
from qrobot.servo.settings import ServoSettings
from tests.support.servo_bench import ServoBench, moving

ROBOT = load_robot("puma560")


@pytest.fixture(scope="module")
def bench() -> ServoBench:
    return ServoBench(position_drives=True).hold()


def test_the_reference_is_posted_as_counters_with_a_fraction_and_no_torque_is(bench: ServoBench) -> None:
    bench.tick(2)
    posted = np.array([bench.references[joint] for joint in range(ROBOT.n)]) / REFERENCE_PER_COUNT
    q = np.zeros(ROBOT.n)
    counts_to_joint(posted, transmission_params(ROBOT), q)  # type: ignore[arg-type]
    np.testing.assert_allclose(q, bench.state.q_ref, rtol=0.0, atol=1e-8)
    assert (bench.dac[: ROBOT.n] == DAC_ZERO).all()


@pytest.mark.parametrize("stopped_s", [None, 0.0, 0.01])
def test_drives_that_stood_while_their_servo_slept_are_led_on_from_there(stopped_s: float | None) -> None:
    """A reference of now would be a step of all the way that the path has gone meanwhile."""
    bench, speed = ServoBench(position_drives=True), 0.5
    moving(bench, speed)
    if stopped_s is not None:
        bench.mailbox.request_stop()
        bench.run(stopped_s)
    before = bench.state.q_ref[0]
    bench.skip(30)
    bench.tick()
    assert 0.0 < bench.state.q_ref[0] - before < 2.1 * speed * bench.settings.period_ns * 1e-9
    assert bench.event is FaultCode.NONE
    bench.run(3.0)
    assert bench.mode is (Mode.TRACKING if stopped_s is None else Mode.HOLDING)
    steps = np.diff(bench.rows()["q_ref"][:, 0])
    assert steps.max() < 2.1 * speed * bench.settings.period_ns * 1e-9
    assert steps.min() > -1e-6  # never back


def test_an_arm_that_no_torque_explains_is_no_fault(bench: ServoBench) -> None:
    bench.run(0.5)  # it stands against its weight, with no torque from here
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.NONE)


def test_a_law_for_such_drives_is_refused() -> None:
    with pytest.raises(ConfigError, match="law pd means nothing to drives in position mode"):
        ServoSettings(position_drives=True, law="pd")


def test_a_servo_without_such_drives_posts_no_reference() -> None:
    bench = ServoBench().hold()
    bench.tick(2)
    assert bench.references == {}


def test_only_what_is_judged_by_torque_is_not_watched() -> None:
    torque = servo_parameters(ROBOT, ServoSettings())
    position = servo_parameters(ROBOT, ServoSettings(position_drives=True))
    assert np.isinf(position.watch.unexplained).all()
    assert np.isinf(position.watch.impossible).all()
    for name in ("following_error", "v_max", "q_min", "q_max", "range_margin", "unchanged_images"):
        assert np.array_equal(getattr(position, name), getattr(torque, name))


def test_a_fault_takes_the_reference_away_with_the_power() -> None:
    bench = ServoBench(position_drives=True).hold()
    bench.estop_ok = False
    bench.tick(3)
    assert bench.safe
    bench.references.clear()
    bench.tick(3)
    assert bench.references == {}
