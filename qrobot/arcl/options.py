"""The attributes of a motion: those that stick, and those of this motion alone (Corke & Kirkham, section 2.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import isfinite
from typing import Any, Final

from qrobot.arcl.attributes import TRAJ_CART, TRAJ_JOINT, Attribute, attribute_values
from qrobot.arcl.kinematics import config_word
from qrobot.errors import MotionError
from qrobot.motion import Trsf
from qrobot.rci.arguments import as_float, shown

DEFAULT_TACC_MS: Final = 100.0  # Ta of the requests in Figure 5
LONGEST_TACC_MS: Final = 60_000.0  # [A] no arm needs a second
DEFAULT_SHARE: Final = 30.0  # [A] per cent of the joints' speed, where nothing was said


class SpeedBy(Enum):
    """The attribute that gave the speed of motions last."""

    SHARE = "share"
    TOOL = "tool"
    JOINT = "joint"


@dataclass(frozen=True, eq=False)
class MotionOptions:
    """Attributes as in `Attribute`; in ms, mm, degrees and per cent.

    The first group sticks, from `tseg_ms` on they are those of one motion.
    """

    traj: int = TRAJ_JOINT
    tacc_ms: float | None = None
    vt: float = 0.0
    vr: float = 0.0
    jvel: float = 0.0
    share: float = DEFAULT_SHARE
    speed_by: SpeedBy = SpeedBy.SHARE
    tseg_ms: float = 0.0
    config: str | None = None
    sync: bool = False
    doneproc: Callable[..., object] | None = None
    notify: Callable[..., object] | None = None
    feedback: Callable[..., object] | None = None
    offset: Trsf | None = None
    update: Trsf | None = None
    name: str | None = None

    @property
    def ta_ms(self) -> float:
        """Ta, as it is asked for."""
        return DEFAULT_TACC_MS if self.tacc_ms is None else self.tacc_ms

    def sticky(self) -> MotionOptions:
        """The options with which the next motion begins."""
        kept = (self.traj, self.tacc_ms, self.vt, self.vr, self.jvel, self.share, self.speed_by)
        return MotionOptions(*kept)

    def changed_by(self, call: str, given: Sequence[Any]) -> MotionOptions:
        """The options with the attributes of a list. Raises MotionError: one is unknown, or its value cannot be."""
        options = self
        for attribute, values in attribute_values(call, given).items():
            options = replace(options, **_field(attribute, *values))
        return options


def _field(attribute: Attribute, *values: Any) -> dict[str, Any]:
    """The fields that an attribute sets."""
    field, check = _FIELDS[attribute]
    checked = {field: check(attribute, *values)}
    return checked | ({"speed_by": _SPEEDS[attribute]} if attribute in _SPEEDS else {})


def _traj(attribute: Attribute, value: Any) -> int:
    if value not in (TRAJ_JOINT, TRAJ_CART):
        raise MotionError(f"{attribute.name}: TRAJ_JOINT or TRAJ_CART is needed, not {shown(value)}")
    return int(value)


def _number(attribute: Attribute, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(as_float(value)) or value < 0:
        raise MotionError(f"{attribute.name}: a finite number from 0 on is needed, not {shown(value)}")
    return float(value)


def _positive(attribute: Attribute, value: Any) -> float:
    if not (number := _number(attribute, value)) > 0.0:
        raise MotionError(f"{attribute.name}: a number above 0 is needed, not {value!r}")
    return number


def _transition(attribute: Attribute, value: Any) -> float:
    if (number := _number(attribute, value)) > LONGEST_TACC_MS:
        raise MotionError(f"{attribute.name}: at most {LONGEST_TACC_MS:g} ms are possible, not {value!r}")
    return number


def _share(attribute: Attribute, value: Any) -> float:
    if (number := _positive(attribute, value)) > 100.0:
        raise MotionError(f"{attribute.name}: above 0 to 100 per cent are possible, not {value!r}")
    return number


def _letters(_attribute: Attribute, value: Any) -> str:
    config_word(value)
    return str(value)


def _flag(_attribute: Attribute) -> bool:
    return True


def _function(attribute: Attribute, value: Any) -> Any:
    if not callable(value):
        raise MotionError(f"{attribute.name}: a function is needed, not {value!r}")
    return value


def _trans(attribute: Attribute, value: Any) -> Trsf:
    if not isinstance(value, Trsf):
        raise MotionError(f"{attribute.name}: a transform is needed, not {value!r}")
    return value


def _name(attribute: Attribute, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise MotionError(f"{attribute.name}: a name is needed, not {value!r}")
    return value


_SPEEDS: Final = {
    Attribute.MOV_VT: SpeedBy.TOOL,
    Attribute.MOV_VR: SpeedBy.TOOL,
    Attribute.MOV_JVEL: SpeedBy.JOINT,
    Attribute.MOV_SHARE: SpeedBy.SHARE,
}
_FIELDS: Final[dict[Attribute, tuple[str, Callable[..., Any]]]] = {
    Attribute.MOV_TRAJ: ("traj", _traj),
    Attribute.MOV_TIME: ("tseg_ms", _positive),
    Attribute.MOV_TACC: ("tacc_ms", _transition),
    Attribute.MOV_VT: ("vt", _number),
    Attribute.MOV_VR: ("vr", _number),
    Attribute.MOV_JVEL: ("jvel", _positive),
    Attribute.MOV_SHARE: ("share", _share),
    Attribute.MOV_CONFIG: ("config", _letters),
    Attribute.MOV_SYNC: ("sync", _flag),
    Attribute.MOV_DONEPROC: ("doneproc", _function),
    Attribute.MOV_NOTIFY: ("notify", _function),
    Attribute.MOV_FEEDBACK: ("feedback", _function),
    Attribute.MOV_OFFSET: ("offset", _trans),
    Attribute.MOV_UPDATE: ("update", _trans),
    Attribute.MOV_NAME: ("name", _name),
}
