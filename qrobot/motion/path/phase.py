"""The phases of a motion. The table below *is* the state machine; its picture in the docs is generated from it.

Rules:

* a segment begins from rest, or out of another segment: on time round its via point, or at once after a skip;
* when nothing follows, a segment ends in the transition to rest at its goal, and then in rest;
* a path stop slows path time down: a segment may begin its transition to rest meanwhile;
* a joint stop leaves the path; it may also begin at rest, when the goal that is followed moves too fast;
* a stop is never left but into rest: no segment begins during one, and no other stop, except that a path stop on a
  Cartesian path goes over into a joint stop when the path turns out not to be for the arm, or is aborted, or when the
  joints are to come to rest sooner than that stop does;
* a path stop that was to take its time becomes a shorter one, on the same path, when that is asked for.
"""

from __future__ import annotations

from enum import Enum
from typing import Final


class Phase(Enum):
    """Ways in which an arm is moved at present."""

    RESTING = "resting"  # at rest, or with a goal that moves
    MOVING = "moving"  # into a segment and along its straight line
    ENDING = "ending"  # in the transition to rest at its goal
    PATH_STOP = "path stop"  # along a segment, path time slowing down
    PATH_STOP_ENDING = "path stop, ending"  # the same in its transition to rest
    JOINT_STOP = "joint stop"  # the joints come to rest wherever they can

    @property
    def stopping(self) -> bool:
        """An absolute stop is under way."""
        return self in (Phase.PATH_STOP, Phase.PATH_STOP_ENDING, Phase.JOINT_STOP)

    @property
    def ending(self) -> bool:
        """The transition to rest at a goal has begun."""
        return self in (Phase.ENDING, Phase.PATH_STOP_ENDING)


class PhaseStep(Enum):
    """Steps from one phase into the next."""

    ENTER = "enter a segment"
    END = "end the segment"
    PATH_STOP = "path stop"
    JOINT_STOP = "joint stop"
    REST = "rest"


TRANSITIONS: Final[dict[Phase, dict[PhaseStep, Phase]]] = {
    Phase.RESTING: {
        PhaseStep.ENTER: Phase.MOVING,
        PhaseStep.JOINT_STOP: Phase.JOINT_STOP,
    },
    Phase.MOVING: {
        PhaseStep.ENTER: Phase.MOVING,
        PhaseStep.END: Phase.ENDING,
        PhaseStep.PATH_STOP: Phase.PATH_STOP,
        PhaseStep.JOINT_STOP: Phase.JOINT_STOP,
    },
    Phase.ENDING: {
        PhaseStep.ENTER: Phase.MOVING,
        PhaseStep.PATH_STOP: Phase.PATH_STOP_ENDING,
        PhaseStep.JOINT_STOP: Phase.JOINT_STOP,
        PhaseStep.REST: Phase.RESTING,
    },
    Phase.PATH_STOP: {
        PhaseStep.END: Phase.PATH_STOP_ENDING,
        PhaseStep.JOINT_STOP: Phase.JOINT_STOP,
        PhaseStep.REST: Phase.RESTING,
    },
    Phase.PATH_STOP_ENDING: {
        PhaseStep.JOINT_STOP: Phase.JOINT_STOP,
        PhaseStep.REST: Phase.RESTING,
    },
    Phase.JOINT_STOP: {
        PhaseStep.REST: Phase.RESTING,
    },
}


def mermaid() -> str:
    """The state diagram of the documentation."""
    lines = ["stateDiagram-v2", f"    [*] --> {Phase.RESTING.name}"]
    for phase, row in TRANSITIONS.items():
        lines += [f"    {phase.name} --> {target.name}: {step.value}" for step, target in row.items()]
    return "\n".join(lines) + "\n"
