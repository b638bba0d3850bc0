"""The data base of a C program: transforms recorded by their names."""

from __future__ import annotations

from collections.abc import Callable

from qrobot.c_transport.message import CallMessage, Op
from qrobot.errors import ConfigError
from qrobot.rccl.c.object_registry import ObjectRegistry
from qrobot.rccl.channel import YES
from qrobot.rccl.database import DataBase


class RecordedTransforms:
    """The calls about the data base.

    Args:
        objects: the transforms of the program.
        say: prints lines at the program's terminal.

    Attributes:
        database: that the program has named, None before.
    """

    def __init__(self, objects: ObjectRegistry, say: Callable[[str], None]) -> None:
        self._objects, self._say = objects, say
        self.database: DataBase | None = None

    def makedb(self, message: CallMessage) -> None:
        """Use the data base in a file."""
        self.database = DataBase(message.text)

    @property
    def _base(self) -> DataBase:
        if self.database is None:
            raise ConfigError("no data base: name its file with makedb first")
        return self.database

    def getr(self, message: CallMessage) -> CallMessage:
        """Read a transform by its name; the answer is YES or NO."""
        return CallMessage(Op.REPLY, int(self._base.read(self._objects.transform(message.refs[0]))))

    def saver(self, message: CallMessage) -> CallMessage:
        """Record a transform under its name."""
        self._base.record(self._objects.transform(message.refs[0]))
        return CallMessage(Op.REPLY, YES)

    def dumpdb(self, _: CallMessage) -> None:
        """Show what is recorded."""
        for name in self._base.names():
            x, y, z = self._base.get(name).p
            self._say(f"{name:<14} {x:10.3f} {y:10.3f} {z:10.3f}")
