"""Record of the servo's last stop for a reason, for the log; written within the cycle.

One record of int64 words, floats as bit patterns. The cycle fills it and then raises its number; a reader in the same
process takes a copy that was not written to meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.faultcodes import Quantity, explain, fault_name, of_joint, quantity_of
from qrobot.modecodes import mode_name
from qrobot.realtime.flat_record import float_bits
from qrobot.realtime.jit import lean_kernel

(NUMBER, T_NS, TICK, CODE, JOINT, VALUE, LIMIT, MODE_FROM, MODE_TO, FRAME_SEQ, INCIDENT_WORDS) = range(11)

_UNITS: Final = {
    Quantity.POSITION: ("rad", "m"),
    Quantity.SPEED: ("rad/s", "m/s"),
    Quantity.TOOL_SPEED: ("m/s", "m/s"),
    Quantity.TORQUE: ("N m", "N"),
    Quantity.DISTANCE: ("m", "m"),
    Quantity.CYCLES: ("cycles", "cycles"),
    Quantity.SECONDS: ("s", "s"),
    Quantity.FAULTS: ("page faults", "page faults"),
    Quantity.NOTHING: ("", ""),
}


@dataclass(frozen=True)
class Incident:
    """Reason for which the servo left a mode.

    Attributes:
        number: counts incidents from 1 since the servo started.
        t_ns, tick: planned time and number of the cycle that decided.
        code: see `faultcodes.FaultCode`. joint: index of the joint it speaks of, NO_JOINT when of none.
        value, limit: what was measured and what was allowed, in the unit of the code; both 0 when nothing was measured.
        mode_from, mode_to: modes before and after that cycle.
        frame_seq: sequence number of the setpoint being played.
    """

    number: int
    t_ns: int
    tick: int
    code: int
    joint: int
    value: float
    limit: float
    mode_from: int
    mode_to: int
    frame_seq: int

    def measured(self, prismatic: Sequence[bool] | NDArray[np.bool_]) -> str:
        """Measured and allowed values, such as "joint 3: 4.51 rad/s, limit 4.1 rad/s"; empty for a mere event.

        `prismatic` says of each joint whether it slides; empty when none does.
        """
        quantity = quantity_of(self.code)
        if quantity is Quantity.NOTHING or self.value == self.limit == 0.0:
            return ""
        slides = 0 <= self.joint < len(prismatic) and prismatic[self.joint]
        unit = _UNITS[quantity][int(slides)]
        return f"{of_joint(self.joint)}{self.value:.4g} {unit}, limit {self.limit:.4g} {unit}"

    def why(self, prismatic: Sequence[bool] | NDArray[np.bool_]) -> str:
        """One line for people: what was measured, what happened, what to do."""
        measured = self.measured(prismatic)
        return f"{measured}; {explain(self.code)}" if measured else explain(self.code, self.joint)

    def line(self, prismatic: Sequence[bool] | NDArray[np.bool_]) -> str:
        """The same after the modes it came between."""
        return f"{mode_name(self.mode_from)} -> {mode_name(self.mode_to)}: {self.why(prismatic)}"

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON, with the names of code and modes."""
        names = {"name": fault_name(self.code), "from": mode_name(self.mode_from), "to": mode_name(self.mode_to)}
        return vars(self) | names

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Incident:
        """Inverse of `to_dict`. Raises KeyError for a missing value."""
        return cls(**{field.name: values[field.name] for field in fields(cls)})


@lean_kernel
def note_incident(
    record: Any, t_ns: int, tick: int, code: int, joint: int, value: float, limit: float,
    mode_from: int, mode_to: int, frame_seq: int,
) -> None:  # fmt: skip
    """Writer: fill the record, int64[INCIDENT_WORDS], then raise its number."""
    record[T_NS], record[TICK], record[CODE], record[JOINT] = t_ns, tick, code, joint
    record[VALUE], record[LIMIT] = float_bits(value), float_bits(limit)
    record[MODE_FROM], record[MODE_TO], record[FRAME_SEQ] = mode_from, mode_to, frame_seq
    record[NUMBER] += 1


def read_incident(record: Any) -> Incident | None:
    """The newest incident, or None when there was none yet."""
    while True:
        words = np.array(record)
        if np.array_equal(words, record):
            break
    if words[NUMBER] == 0:
        return None
    plain = words.tolist()
    plain[VALUE], plain[LIMIT] = (float(words[i : i + 1].view(np.float64)[0]) for i in (VALUE, LIMIT))
    return Incident(*plain)
