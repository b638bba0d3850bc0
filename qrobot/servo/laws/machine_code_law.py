"""A control law as machine code from the process that tried it: nothing of its author's Python runs here."""

from __future__ import annotations

from functools import cached_property

from qrobot.arrays import Floats
from qrobot.realtime.machine_code import LoadedCode, MachineCode
from qrobot.servo.laws.law import Law, Setting


class LoadedLaw(Law):
    """A law whose code is loaded, with the settings that were chosen.

    Args:
        code: of a kernel of the signature of laws.
        settings, values, signals: see `Law`.
        doc: what the law's author says of it.
    """

    def __init__(
        self,
        code: MachineCode,
        settings: tuple[Setting, ...],
        values: Floats,
        doc: str | None,
        signals: tuple[str, ...] = (),
    ) -> None:
        super().__init__(_not_from_python, settings, values, signals)
        self.__doc__ = doc
        self._loaded = LoadedCode(code)

    @cached_property
    def address(self) -> int:
        """Address of the compiled code, while the law lives."""
        return self._loaded.address


def _not_from_python(*_arguments: Floats) -> None:
    raise TypeError("a loaded law is called by its address")
