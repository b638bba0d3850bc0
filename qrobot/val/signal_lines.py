"""The signals of an arm that have a line: what its deployment file tells, for the check of a program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from qrobot.config.deployment import DeployedArm
from qrobot.config.signals import N_BOARD_INPUTS, no_output
from qrobot.val.vocabulary import INPUTS, OUTPUTS

_BOARD_INPUTS: Final = range(INPUTS.start, INPUTS.start + N_BOARD_INPUTS)


@dataclass(frozen=True)
class SignalLines:
    """Outputs and inputs of an arm that lead somewhere.

    Attributes:
        outputs: numbers of the outputs that the deployment file configures, the board's own and those of modules.
        analog: least and most volts of its analogue outputs, by their numbers.
    """

    outputs: frozenset[int]
    analog: Mapping[int, tuple[float, float]] = field(default_factory=dict)

    def analog_refusal(self, number: int, volts: float | None) -> str:
        """Reason against an analogue output, and against volts of it where they are known; "" for none."""
        if number not in self.analog:
            there = ", ".join(map(str, sorted(self.analog))) or "none"
            return (
                f"analogue output {number} is not configured; the deployment file has {there}: "
                "add it to [[arm.board.analog_outputs]], or to a module's"
            )
        least, most = self.analog[number]
        if volts is not None and not least <= volts <= most:
            return f"analogue output {number}: {volts:g} V is not within {least:g} to {most:g} V"
        return ""

    def refusal(self, number: int) -> str:
        """Reason against an output or input that has no line; "" for none, and for signals of other kinds."""
        if number in OUTPUTS and number not in self.outputs:
            return no_output(f"output {number}", self.outputs)
        if number in INPUTS and number not in _BOARD_INPUTS:
            first, last = _BOARD_INPUTS[0], _BOARD_INPUTS[-1]
            return f"no line leads to input {number}; the board's are {first} to {last}, and modules stand for those"
        return ""


def signal_lines_of(arm: DeployedArm) -> SignalLines:
    """The lines of an arm of a deployment file."""
    return SignalLines(frozenset(each.output for each in arm.board.lines), arm.analog_ranges)
