"""An arm one joint of which stands beyond its range: it is stopped and turned elsewhere as one that stands inside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.motion import HERE, Generator, JointSpeed, MoveRequest
from tests.support.motion import LIMITS, PERIOD_S, ended, generator, run

BEYOND_M = 0.04
INSIDE, OUTSIDE = 0.3, float(LIMITS.q_max[1]) + BEYOND_M
SPEED = JointSpeed(1.0)


def stand(gen: Generator, slide: float) -> None:
    gen.push(MoveRequest("here", HERE, SPEED))
    gen.skip(3)


def turn_back(gen: Generator, slide: float) -> None:
    gen.push(MoveRequest("back", np.array([-1.0, slide]), SPEED))
    gen.skip(3)


DEEDS: dict[str, Callable[[Generator, float], None]] = {
    "stop": lambda gen, slide: gen.stop(),  # noqa: ARG005
    "slow stop": lambda gen, slide: gen.stop(0.5),  # noqa: ARG005
    "skip": lambda gen, slide: gen.skip(3),  # noqa: ARG005
    "here": stand,
    "next": turn_back,
}


def motion(begin: float, way: float, deed: str, when: int, override: float) -> tuple[Floats, list[tuple[str, int]]]:
    """Setpoints (k, 2) less those at the begin, and what ended.

    The waist turns, and the slide goes by `way` from `begin`; then `deed` is done before sample `when`.
    """
    gen = generator((0.0, begin))
    gen.override = override
    gen.push(MoveRequest("there", np.array([2.0, begin + way]), SPEED))
    outputs = list(run(gen, lambda tick: DEEDS[deed](gen, begin + way) if tick == when else None))
    return np.array([output.q - [0.0, begin] for output in outputs]), ended(outputs)


@pytest.mark.sampled(15)
@pytest.mark.parametrize("override", [1.0, 0.4])
@pytest.mark.parametrize("way", [0.0, -0.5 * BEYOND_M, -5.0 * BEYOND_M], ids=["stands", "stays outside", "comes back"])
@pytest.mark.parametrize("deed", DEEDS)
def test_where_a_joint_stands_changes_nothing_of_how_a_motion_is_ended(deed, way, override) -> None:
    for when in range(4, 72, 9):
        inside, outside = (motion(begin, way, deed, when, override) for begin in (INSIDE, OUTSIDE))
        assert outside[1] == inside[1], when
        assert outside[0] == pytest.approx(inside[0], abs=1e-9), when


def test_an_arm_with_a_joint_outside_its_range_stops_in_tenths_of_a_second() -> None:
    path, codes = motion(OUTSIDE, 0.0, "stop", 20, 1.0)
    assert codes == [("there", -2)]
    assert (len(path) - 20) * PERIOD_S < 0.4


def test_what_would_lead_a_joint_farther_out_is_not_turned_to_in_motion() -> None:
    outside = np.array([0.0, OUTSIDE])
    assert LIMITS.allow(np.vstack((outside, np.zeros((2, 2)))), outside)
    assert not LIMITS.allow(np.vstack((np.add(outside, [0.0, 1e-6]), np.zeros((2, 2)))), outside)
    assert not LIMITS.allow(np.vstack((outside, np.zeros((2, 2)))))
