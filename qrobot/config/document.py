"""A TOML document checked against a model: every mistake at once, each with its path in the file."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from difflib import get_close_matches
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from qrobot.config.kinds import FileKind, refuse_other_kind
from qrobot.errors import ConfigError

M = TypeVar("M", bound=BaseModel)


class Table(BaseModel):
    """A TOML table: frozen once read, and closed, so that a misspelt key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True, strict=True)


class Section(Table):
    """A table whose every value names its source in the `[<section>.source]` table beside it."""

    source: dict[str, str]


def config_path(name_or_path: str | Path, wanted: FileKind, folder: str = "") -> Path:
    """Find a configuration file: a path to a `.toml`, or the name of a packaged one.

    Packaged files are in `qrobot/_config` of an installed wheel and in `config/` of a checkout.

    Raises:
        ConfigError: there is no such file, with the names of those that exist, or it is of another kind than `wanted`.
    """
    return packaged_path(name_or_path, wanted, folder, ".toml")


def packaged_path(name_or_path: str | Path, wanted: FileKind, folder: str, ending: str) -> Path:
    """Find a file as `config_path` does, among files with another `ending`. Raises ConfigError."""
    given = Path(name_or_path)
    if given.is_file():
        refuse_other_kind(given, wanted)
    if str(name_or_path).lower().endswith(ending):
        if given.is_file():
            return given
        raise ConfigError(f"no configuration file {given}")
    path = _packaged() / folder / f"{name_or_path}{ending}"
    if path.is_file():
        return path
    known = packaged_names(folder, ending)
    raise ConfigError(f"no configuration named {str(name_or_path)!r}{_nearest(str(name_or_path), known)}")


def packaged_names(folder: str, ending: str = ".toml") -> list[str]:
    """Names of the packaged files of one folder, in order."""
    return sorted(path.stem for path in (_packaged() / folder).glob(f"*{ending}"))


def _packaged() -> Path:
    package = Path(str(files("qrobot")))
    installed = package / "_config"
    return installed if installed.is_dir() else package.parent / "config"


def read_document(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises:
        ConfigError: it cannot be read or is not TOML; says where.
    """
    return parse_document(read_content(path), str(path))


def read_content(path: Path) -> bytes:
    """Read a file. Raises ConfigError: it cannot be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error}") from error


def parse_document(content: bytes, label: str) -> dict[str, Any]:
    """Parse the content of a TOML file; `label` stands in front of the mistakes. Raises ConfigError as above."""
    try:
        return deepcopy(_tables(content))
    except ValueError as error:  # no UTF-8, no TOML, or a number of thousands of digits
        raise ConfigError(f"{label}: {error}") from error
    except RecursionError:
        raise ConfigError(f"{label}: its values are nested too deeply to be read") from None


@lru_cache(maxsize=16)
def _tables(content: bytes) -> dict[str, Any]:
    """Parse a TOML file, for nobody to change: a robot's is often asked for, and a copy takes a tenth of it."""
    return tomllib.loads(content.decode("utf-8-sig"))  # editors put a mark of the byte order in front


def check_document(model: type[M], document: Mapping[str, Any], label: str, context: Any = None) -> M:
    """Make a `model` of `document`.

    Raises:
        ConfigError: lists every mistake, one a line, as `path.in.file: what is wrong`.
    """
    faults = list(_unsourced(model, document))
    try:
        made = model.model_validate(document, context=context)
    except ValidationError as error:
        faults += [_fault(model, e["loc"], e["type"], e["msg"]) for e in error.errors(include_url=False)]
    if faults:
        raise ConfigError(f"{label}: {len(faults)} mistake{'s' * (len(faults) > 1)}:\n  " + ";\n  ".join(faults))
    return made


def _fault(model: type[BaseModel], loc: tuple[int | str, ...], kind: str, message: str) -> str:
    path = ".".join(str(part) for part in loc) or "file"
    if kind == "extra_forbidden":
        return f"{path}: unknown key{_nearest(str(loc[-1]), _keys(_model_at(model, loc[:-1])))}"
    if kind == "missing":
        return f"{path}: missing"
    return f"{path}: {message.removeprefix('Value error, ')}"


def _nearest(word: str, known: list[str]) -> str:
    close = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(known) or 'none'}"


def _keys(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


def _model_at(model: type[BaseModel], loc: tuple[int | str, ...]) -> type[BaseModel]:
    """The model of the table at `loc`, passing through lists and dictionaries of tables."""
    for part in loc:
        model = _child(model, part) or model
    return model


def _annotation(model: type[BaseModel], key: int | str) -> Any:
    return next((f.annotation for name, f in model.model_fields.items() if key == (f.alias or name)), None)


def _child(model: type[BaseModel], key: int | str) -> type[BaseModel] | None:
    """The model of the table, or of the tables, that `model` keeps under `key`."""
    annotation = _annotation(model, key)
    candidates = (annotation, *get_args(annotation))
    return next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)


def _unsourced(model: type[BaseModel], table: Mapping[str, Any], path: str = "") -> Iterator[str]:
    """Values without a source and sources without a value, in every `Section` of the document."""
    if issubclass(model, Section):
        yield from _source_faults(table, path)
        return
    for key, value in table.items():
        child = _child(model, key)
        if child is None or not isinstance(value, Mapping):
            continue
        named_tables = get_origin(_annotation(model, key)) is dict
        for name, member in value.items() if named_tables else [("", value)]:
            if isinstance(member, Mapping):
                yield from _unsourced(child, member, ".".join(part for part in (path, key, name) if part))


def _source_faults(section: Mapping[str, Any], path: str) -> Iterator[str]:
    if not isinstance(sources := section.get("source"), Mapping):
        return  # the model says that it is missing
    values = set(section) - {"source"}
    yield from (f"{path}.source: {key!r} has no source" for key in sorted(values - set(sources)))
    yield from (f"{path}.source: {key!r} is not a value of [{path}]" for key in sorted(set(sources) - values))
