"""Rows of the tables of calls that RCCL and Multi-RCCL serve, and those that are the same in both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeAlias, TypeVar

from qrobot.c_transport.message import CallMessage, Op
from qrobot.rccl.c.object_registry import ObjectRegistry
from qrobot.rccl.c.recorded_transforms import RecordedTransforms

CallReply: TypeAlias = "CallMessage | None"
D_contra = TypeVar("D_contra", contravariant=True)


@dataclass(frozen=True)
class CallRow(Generic[D_contra]):
    """A call that a dispatcher of type `D_contra` serves.

    Attributes:
        handler: does what is asked.
        waits: it lets samples pass, or takes or releases an arm, so no function that is called at a sample may ask it.
    """

    handler: Callable[[D_contra, CallMessage], CallReply]
    waits: bool = False


class WithObjects(Protocol):
    """A dispatcher of a program that has transforms and positions.

    Attributes:
        objects: they.
        recorded: those in data bases.
    """

    objects: ObjectRegistry
    recorded: RecordedTransforms


def on_objects(call: Callable[[ObjectRegistry, CallMessage], CallReply]) -> CallRow[WithObjects]:
    """A call about transforms and positions."""
    return CallRow(lambda dispatcher, message: call(dispatcher.objects, message))


def _recorded(call: Callable[[RecordedTransforms, CallMessage], CallReply]) -> CallRow[WithObjects]:
    """A call about the data base."""
    return CallRow(lambda dispatcher, message: call(dispatcher.recorded, message))


OBJECT_CALLS: Final[dict[Op, CallRow[WithObjects]]] = {
    Op.NEWTRANS: on_objects(ObjectRegistry.newtrans),
    Op.FREETRANS: on_objects(ObjectRegistry.freetrans),
    Op.FREEPOS: on_objects(ObjectRegistry.freepos),
    Op.MAKE: on_objects(ObjectRegistry.make),
    Op.TRMULT: on_objects(ObjectRegistry.trmult),
    Op.INVERT: on_objects(ObjectRegistry.invert),
    Op.MAKEDB: _recorded(RecordedTransforms.makedb),
    Op.GETR: _recorded(RecordedTransforms.getr),
    Op.SAVER: _recorded(RecordedTransforms.saver),
    Op.DUMPDB: _recorded(RecordedTransforms.dumpdb),
}
"""Calls that are the same in both libraries."""
