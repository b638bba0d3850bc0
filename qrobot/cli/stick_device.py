"""A device of Linux input, opened by python-evdev, as `rccl.held_stick` sees it."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from qrobot.errors import ConfigError, LinkError, error_text
from qrobot.rccl.held_stick import DROPPED, KEY, REL, SYN, StickAxis, StickCode, StickEvent, StickLayout

EV_KEY, EV_REL, EV_ABS = KEY, REL, 3  # of <linux/input-event-codes.h>, as the codes below
BTN_0, BTN_1, BTN_SOUTH, BTN_TL, BTN_TR = 0x100, 0x101, 0x130, 0x136, 0x137
X, Y, Z, RX, RY, RZ = range(6)  # the same for both kinds of axes

# A gamepad: the left stick moves along x and y, the right one along z and turns about it. Up is below zero.
GAMEPAD: Final = {Y: ("dx", -1.0), X: ("dy", -1.0), RY: ("dz", -1.0), RX: ("rz", -1.0)}
# A SpaceMouse: pushed away is y below zero, pressed down z above zero.
SPACE_MOUSE: Final = {
    Y: ("dx", -1.0),
    X: ("dy", -1.0),
    Z: ("dz", -1.0),
    RY: ("rx", -1.0),
    RX: ("ry", -1.0),
    RZ: ("rz", -1.0),
}
REL_STROKE: Final = 350  # [A] of a SpaceMouse whose axes have no range


class StickDevice:
    """An open device.

    Args:
        device: an `evdev.InputDevice`, or what answers as one.

    Raises:
        ConfigError: it is no gamepad and no SpaceMouse.
    """

    def __init__(self, device: Any) -> None:
        self._device = device
        self.layout = layout_of(str(device.name), device.capabilities(absinfo=True))

    def read(self) -> Iterable[StickEvent]:
        """Events since the last call; never waits. Raises LinkError: the device is gone."""
        try:
            events = [StickEvent(event.type, event.code, event.value) for event in self._device.read()]
            if any((event.kind, event.code) == (SYN, DROPPED) for event in events):
                events += [self._now(code) for kind, code in self.layout.axes if kind == EV_ABS]
            return events
        except BlockingIOError:
            return ()
        except OSError as error:
            raise LinkError(f"{self.layout.name} is gone: {error_text(error)}") from None

    def _now(self, code: int) -> StickEvent:
        """Place of an absolute axis, whose events may be among those that were lost."""
        return StickEvent(EV_ABS, code, self._device.absinfo(code).value)


def open_stick(path: Path) -> StickDevice:
    """Open a device such as /dev/input/event5, and keep its events from others.

    Raises:
        ConfigError: it cannot be opened, or is of another kind. ModuleNotFoundError: there is no python-evdev.
    """
    from evdev import InputDevice

    try:
        device = InputDevice(str(path))
        found = StickDevice(device)
        device.grab()
    except OSError as error:
        hint = "; may this user read it (group input)?" if isinstance(error, PermissionError) else ""
        raise ConfigError(f"cannot open {path}: {error_text(error)}{hint}") from None
    return found


def layout_of(name: str, capabilities: dict[int, Any]) -> StickLayout:
    """Layout of a device with these capabilities. Raises ConfigError: it has not what is needed."""
    buttons, axes = set(capabilities.get(EV_KEY, ())), dict[StickCode, tuple[int, int, int | None]]()
    for code, info in capabilities.get(EV_ABS, ()):
        if info.max > info.min:
            axes[EV_ABS, code] = info.min, info.max, info.value
    axes |= {(EV_REL, code): (-REL_STROKE, REL_STROKE, None) for code in capabilities.get(EV_REL, ())}
    if {BTN_SOUTH, BTN_TL} <= buttons:
        return _layout(name, GAMEPAD, axes, BTN_TL, BTN_TR if BTN_TR in buttons else None)
    if BTN_0 in buttons and all(any((kind, code) in axes for kind in (EV_ABS, EV_REL)) for code in SPACE_MOUSE):
        return _layout(name, SPACE_MOUSE, axes, BTN_0, BTN_1 if BTN_1 in buttons else None)
    raise ConfigError(f"{name} is neither a gamepad with sticks and shoulder buttons nor a SpaceMouse")


def _layout(
    name: str,
    wanted: dict[int, tuple[str, float]],
    found: dict[StickCode, tuple[int, int, int | None]],
    button: int,
    turn: int | None,
) -> StickLayout:
    axes = {
        (kind, code): StickAxis(wanted[code][0], low, high, wanted[code][1], value)
        for (kind, code), (low, high, value) in found.items()
        if code in wanted
    }
    if not axes:
        raise ConfigError(f"{name} has no sticks")
    return StickLayout(name, axes, button, turn)
