"""The transform symbol table: transforms by name, to and from a file (Corke & Kirkham, section 2.9).

The file is that of RCCL's data base: a line for each transform, millimetres and degrees, which people can edit.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from qrobot.arcl.trans import CONST, Trans, new_trans_value, trans_assign
from qrobot.errors import ConfigError, MotionError
from qrobot.motion import TransformKind, Trsf
from qrobot.transform_file import TransformFile

_table: Final[dict[str, Trans]] = {}


def sym_enter(trans: Trans) -> Trans:
    """Put a transform into the table under its name, in place of another of that name; returns it."""
    if not isinstance(trans, Trans):
        raise MotionError(f"sym_enter: a transform is needed, not {trans!r}")
    _table[trans.name] = trans
    return trans


def sym_lookup(name: str) -> Trans | None:
    """The transform of that name, None when there is none."""
    return _table.get(name)


def sym_delete(name: str) -> bool:
    """Take a transform out of the table; False when there was none of that name."""
    return _table.pop(name, None) is not None


def sym_names() -> list[str]:
    """Names in the table, in the order in which they were entered."""
    return list(_table)


def sym_dump(path: str | Path) -> int:
    """Write all transforms, as they are now, to a file, which keeps what else stands there; how many.

    Raises:
        ConfigError: the file cannot be read or written, or a name cannot stand in it; nothing is written then.
    """
    TransformFile(path).write_all({name: trans.value for name, trans in _table.items()})
    return len(_table)


def sym_load(path: str | Path, kind: TransformKind = CONST) -> int:
    """Read the transforms of a file; how many.

    One whose name is in the table gets the value, and stays the object that equations name; others are made.

    Raises:
        ConfigError: there is no such file, or a line cannot be read; the table stays as it was.
    """
    if not Path(path).exists():
        raise ConfigError(f"cannot read {path}: there is no such file")
    values = TransformFile(path).values()
    for name, value in values.items():
        if (trans := _table.get(name)) is None:
            sym_enter(new_trans_value(name, value, kind))
        else:
            trans_assign(trans, Trsf(name, value=value))
    return len(values)
