"""The phases of a motion: the table, and that every motion keeps to it."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.motion import Duration, MoveRequest, Termination
from qrobot.motion.path.phase import TRANSITIONS, Phase, PhaseStep, mermaid
from tests.support.motion import generator

STOPS = {Phase.PATH_STOP, Phase.PATH_STOP_ENDING, Phase.JOINT_STOP}


def test_every_phase_has_a_row_and_leads_back_to_rest() -> None:
    assert set(TRANSITIONS) == set(Phase)
    reached = {Phase.RESTING}
    while more := {phase for phase, row in TRANSITIONS.items() if set(row.values()) & reached} - reached:
        reached |= more
    assert reached == set(Phase)


def test_a_stop_is_left_only_into_rest_or_into_its_own_end_or_off_the_path() -> None:
    for phase in STOPS:
        assert phase.stopping
        assert PhaseStep.ENTER not in TRANSITIONS[phase]
        assert set(TRANSITIONS[phase].values()) <= {Phase.RESTING, Phase.PATH_STOP_ENDING, Phase.JOINT_STOP}
    assert set(TRANSITIONS[Phase.JOINT_STOP].values()) == {Phase.RESTING}
    assert not any(phase.stopping for phase in set(Phase) - STOPS)


def test_the_picture_has_an_arrow_for_each_entry() -> None:
    arrows = [line for line in mermaid().splitlines() if "-->" in line and "[*]" not in line]
    assert len(arrows) == sum(len(row) for row in TRANSITIONS.values())


def phases(at_tick: dict[int, str], ticks: int = 200) -> list[Phase]:
    """Phases of a motion, each once in a row, when methods of the generator are called before some samples."""
    gen = generator()
    gen.push(MoveRequest("a", np.array([1.0, 0.0]), Duration(1.4), 0.14))
    seen = [gen.phase]
    for tick in range(1, ticks):
        match at_tick.get(tick):
            case "stop":
                gen.stop()
            case "abort":
                gen.abort(Termination.SINGULAR)
            case "push":
                gen.push(MoveRequest("b", np.array([0.0, 0.2]), Duration(1.4), 0.14))
        gen.update(tick)
        if gen.phase is not seen[-1]:
            seen.append(gen.phase)
    return seen


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        ({}, [Phase.MOVING, Phase.ENDING]),
        ({5: "push"}, [Phase.MOVING, Phase.ENDING]),
        ({20: "stop"}, [Phase.MOVING, Phase.PATH_STOP]),
        ({55: "stop"}, [Phase.MOVING, Phase.ENDING, Phase.PATH_STOP_ENDING]),
        ({20: "abort"}, [Phase.MOVING, Phase.JOINT_STOP]),
        ({20: "stop", 21: "abort"}, [Phase.MOVING, Phase.PATH_STOP]),
    ],
)
def test_a_motion_goes_through_its_phases_and_rests(calls, expected) -> None:
    assert phases(calls) == [Phase.RESTING, *expected, Phase.RESTING]
