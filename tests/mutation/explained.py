"""Mutants that no test can notice, and why: (gate, change) -> reason."""

from __future__ import annotations

from typing import Final

EXPLAINED: Final[dict[tuple[str, str], str]] = {
    ("stop_categories", "256  ->  257"): "room for one more code that there is not",
    ("stop_categories", "0 <= code < _CATEGORY_BY_NUMBER.size  ->  0 < code < _CATEGORY_BY_NUMBER.size"): (
        "code 0 has category 0 in the table and outside it"
    ),
    ("stop_categories", "0  ->  1"): "the same: code 0 has category 0 in the table and outside it",
    (
        "limit_checks",
        "tau[j] > 0.0  ->  tau[j] >= 0.0",
    ): "a torque of zero is within every limit and ends above",
    ("motor_fault_diagnosis", "push * drive > 0.0  ->  push * drive >= 0.0"): (
        "without a push or a drive the size of the push is refused below"
    ),
    ("motor_fault_diagnosis", "push * drive  ->  push / drive"): "the sign is the same",
    ("motor_fault_diagnosis", "v * drive  ->  v / drive"): "the sign is the same",
    ("motor_fault_diagnosis", "push * v > 0.0  ->  push * v >= 0.0"): "a joint at rest does not outrun anything",
    ("timing_checks", "2  ->  3"): "a short cut: the division below finds the same",
}
