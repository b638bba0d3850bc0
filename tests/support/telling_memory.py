"""Memory that tells of each store, and the same memory by attributes that Python finds quickly; without the JIT."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, ClassVar, Final

import numpy as np

from qrobot.realtime.structure import WORD_BYTES, view_words


class Shared(np.ndarray[Any, np.dtype[np.int64]]):
    """Words that others see; `stored` is called after each store, while it is set."""

    stored: Callable[[], None] | None = None

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__(key, value)
        if self.stored is not None:
            self.stored()


class QuickRecord(np.record):
    """A record that knows its fields first: NumPy's tries every name as an attribute and catches the error."""

    def __getattribute__(self, name: str) -> Any:
        fields: Any = _DTYPE(self).fields
        if name not in fields:
            return super().__getattribute__(name)
        found = _ITEM(self, name)
        block = fields[name][0].base
        return found if block.names is None else found.view((type(self), block))

    def __setattr__(self, name: str, value: Any) -> None:
        _SET_ITEM(self, name, value)


_DTYPE: Final[Callable[[Any], np.dtype[Any]]] = np.void.dtype.__get__
_ITEM: Final[Callable[[Any, str], Any]] = np.void.__getitem__
_SET_ITEM: Final[Callable[[Any, str, Any], None]] = np.void.__setitem__


class SharedRecord(QuickRecord):
    """A record that others see, and its parts; `told` is called after each store, while it is set."""

    told: ClassVar[Callable[[], None] | None] = None

    def __getattribute__(self, name: str) -> Any:
        found = super().__getattribute__(name)
        plain = isinstance(found, np.ndarray) and found.dtype.names is None
        return found.view(SharedField) if plain else found

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        tell()

    def __setitem__(self, name: Any, value: Any) -> None:
        super().__setitem__(name, value)
        tell()


class SharedField(np.ndarray[Any, np.dtype[np.int64]]):
    """An array in such a record."""

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__(key, value)
        tell()


def tell() -> None:
    """Call whoever wants to know of a store."""
    if SharedRecord.told is not None:
        SharedRecord.told()


def shared(record: Any) -> Any:
    """The same memory as a record that tells of stores."""
    return view_words(record).view(np.dtype((SharedRecord, record.dtype)))[0]


class Fields:
    """A record's fields by name, as views of its words that tell nobody: of a record itself Python finds them slowly.

    Attributes:
        words: all of it. floats: the same, as float64.
    """

    words: Any
    floats: Any


def fields_of(words: Any, dtype: Any) -> Any:
    """Those of a record of this type in these words."""
    found = _kind(dtype)()
    found.words, found.floats = words, words.view(np.float64)
    for name, (field, at, *_) in dtype.fields.items():
        if not _is_number(field):
            part = words[at // WORD_BYTES : (at + field.itemsize) // WORD_BYTES]
            vars(found)[name] = _part(part, field)
    return found


def _is_number(field: Any) -> bool:
    return field in (np.int64, np.float64)


def _part(words: Any, field: Any) -> Any:
    if field.base.names is None:
        return words.view(field.base).reshape(field.shape)
    return Elements(words, field.base) if field.shape else fields_of(words, field)


@cache
def _kind(dtype: Any) -> type[Fields]:
    """A class with a property for each number of a record."""
    numbers = {
        name: _number(at // WORD_BYTES, "words" if field == np.int64 else "floats")
        for name, (field, at, *_) in dtype.fields.items()
        if _is_number(field)
    }
    return type("Fields", (Fields,), numbers)


def _number(place: int, view: str) -> property:
    def get(fields: Any) -> Any:
        return getattr(fields, view)[place]

    def put(fields: Any, value: Any) -> None:
        getattr(fields, view)[place] = value

    return property(get, put)


class Elements:
    """An array of records; the fields of each are found when it is asked for first."""

    def __init__(self, words: Any, dtype: Any) -> None:
        self._words, self._dtype = words.reshape(-1, dtype.itemsize // WORD_BYTES), dtype
        self._found: dict[int, Any] = {}

    def __getitem__(self, place: int) -> Any:
        if place not in self._found:
            self._found[place] = fields_of(self._words[place], self._dtype)
        return self._found[place]

    def __iter__(self) -> Iterator[Any]:
        return (self[place] for place in range(len(self._words)))


class Follower:
    """The fields of the record that it is shown, found once while that is the same."""

    def __init__(self) -> None:
        self._record: Any = None

    def of(self, record: Any) -> Any:
        if record is not self._record:
            self._record, self._fields = record, fields_of(view_words(record), record.dtype)
        return self._fields


class Copier:
    """Copies records of one kind into the same memory: new memory costs more than the copying."""

    def __init__(self, record: Any) -> None:
        self._copy = fields_of(np.zeros_like(view_words(record)), record.dtype)

    def copied(self, fields: Any) -> Any:
        """The fields of a copy, which lasts until the next one."""
        np.copyto(self._copy.words, fields.words)
        return self._copy
