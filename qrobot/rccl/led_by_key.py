"""Leading an arm by hand with a key of a terminal as the dead man's switch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, ServoFault
from qrobot.model.arm import Arm
from qrobot.rccl.database import DataBase
from qrobot.rccl.guiding import GuidedArm
from qrobot.rccl.held_key import HeldKey
from qrobot.rccl.jog import place
from qrobot.units import NS_PER_MS

LEAD, KEEP, QUIT = "g", "w", "q"
KEYS: Final = """\
g     HOLD to lead the arm by hand
w     keep this place
q     quit"""


class LedByKey:
    """Obeys keys.

    Args:
        arm: led by hand.
        read_keys: what has been typed since it was asked last; called at each sample, it must not wait.
        tell: takes a line for people.
        places: data base for the places that are kept; None for none.
    """

    def __init__(
        self,
        arm: GuidedArm,
        read_keys: Callable[[], str],
        tell: Callable[[str], None],
        places: DataBase | None = None,
    ) -> None:
        self._arm, self._read_keys, self._tell, self._places = arm, read_keys, tell, places
        self._keys, self._kinematics, self._was_led = HeldKey(), Arm(arm.robot), False

    def run(self) -> None:
        """Obey until `q`. Raises LinkError when the arm is lost; what the servo stops it for is told."""
        now_ms = 0.0
        while True:
            held = self._keys.hear(self._read_keys(), now_ms)
            try:
                now_ms = self._arm.step(held == LEAD).t_ns / NS_PER_MS
            except ServoFault as error:
                self._tell(f"error: {error}")
            self._tell_change()
            while self._keys.pressed:
                if (key := self._keys.pressed.pop(0)) == QUIT:
                    return
                self._obey(key)

    def _obey(self, key: str) -> None:
        if key == KEEP:
            self._keep()
        elif key != LEAD:
            self._tell(KEYS)

    def _keep(self) -> None:
        """Put the place of the arm into the data base; where that cannot be, it is told and the arm is led on."""
        if self._places is None or self._arm.how is None:
            self._tell("no data base was named: see --places")
            return
        value = self._kinematics.forward(np.array(self._arm.how.q))
        try:
            name = _put(self._places, value)
        except ConfigError as error:
            self._tell(f"error: {error}")
            return
        self._tell(f"kept {name}: {place(value)}")

    def _tell_change(self) -> None:
        if self._arm.led != self._was_led:
            self._was_led = self._arm.led
            self._tell("led by hand" if self._was_led else "held")


def _put(places: DataBase, value: Floats) -> str:
    """Put a pose, shape (4, 4), m, under the next free name, which is returned."""
    known = places.values()
    name = next(f"P{k}" for k in range(1, len(known) + 2) if f"P{k}" not in known)
    places.write(name, value)
    return name
