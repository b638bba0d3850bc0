"""The keys of robot and deployment files, read from the models that check them."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from tables import table

from qrobot.config.deployment import Deployment
from qrobot.config.robot import Robot
from qrobot.config.values import HEAVIEST_LINK_KG, LONGEST_LINK_M, STRONGEST_GRAVITY_M_S2

PER_JOINT: Final = {
    "PerJoint": "numbers",
    "PerJointPositive": "numbers above zero",
    "PerJointNotNegative": "numbers from zero",
    "PerJointNonzero": "numbers other than zero",
    "PerJointInts": "whole numbers",
    "PerJointCounts": "whole numbers above zero",
    "PerJointSigns": "signs, 1 or -1",
    "PerJointChannels": "different ADC channels, 0 to 7",
    "PerJointFlags": "of true or false",
    "PerJointLengths": f"numbers from {-LONGEST_LINK_M:g} to {LONGEST_LINK_M:g}",
    "PerJointMasses": f"numbers from 0 to {HEAVIEST_LINK_KG:g}",
    "PerJointPlaces": f"rows of 3 numbers from {-LONGEST_LINK_M:g} to {LONGEST_LINK_M:g}",
    "PerJointInertia": "rows of 3 numbers from zero",
    "Degrees": "angles in degrees",
    "JointDegrees": "angles in degrees (metres on a sliding joint)",
    "JointDegreesPositive": "speeds in degrees/s (m/s on a sliding joint)",
}
WORDS: Final = {str: "text", int: "whole number", float: "number", bool: "true or false"}
BOUNDS: Final = {
    "ge": "from {}", "gt": "above {}", "le": "to {}", "lt": "below {}", "multiple_of": "that is a multiple of {}",
}  # fmt: skip


def deployment_keys() -> str:
    """One table per section of a deployment file."""
    return "\n\n".join(_sections(Deployment, ""))


def robot_keys() -> str:
    """One table per section of a robot file."""
    return "\n\n".join(_sections(Robot, ""))


def _sections(model: type[BaseModel], path: str) -> Iterator[str]:
    """The section at `path`, then those inside it; the `source` tables are told in the text of the page."""
    plain = [(key, field) for key, field in _fields(model) if _inner(field) is None and key != "source"]
    if plain:
        heading = f"## `{path}`" if path else "## At the top"
        rows = ((f"`{key}`", _describe(model, key, field), _default(field)) for key, field in plain)
        yield f"{heading}\n\n{_about(model)}\n\n{table(('key', 'value', 'default'), rows)}"
    elif path:
        yield f"## `{path}`\n\n{_about(model)}"
    for key, field in _fields(model):
        if (inner := _inner(field)) is not None:
            yield from _sections(inner, _inner_path(path, key, field))


def _fields(model: type[BaseModel]) -> Iterator[tuple[str, FieldInfo]]:
    return ((field.alias or name, field) for name, field in model.model_fields.items())


def _inner(field: FieldInfo) -> type[BaseModel] | None:
    """The model of the section, or of the sections, behind a key."""
    candidates = (field.annotation, *get_args(field.annotation))
    return next((each for each in candidates if isinstance(each, type) and issubclass(each, BaseModel)), None)


def _inner_path(path: str, key: str, field: FieldInfo) -> str:
    name = f"{path.strip('[]')}.{key}".lstrip(".")
    if get_origin(field.annotation) is tuple:
        return f"[[{name}]]"
    return f"[{name}.NAME]" if get_origin(field.annotation) is dict else f"[{name}]"


def _about(model: type[BaseModel]) -> str:
    return re.sub(r"\s*\n\s*\n\s*", "\n\n", inspect.getdoc(model) or "")


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    default = None if field.default is PydanticUndefined else field.default
    return "-" if default is None else f"`{json.dumps(default)}`"


def _describe(model: type[BaseModel], key: str, field: FieldInfo) -> str:
    return " ".join([_kind(_annotation_name(model, key), field.annotation), *_bounds(field)])


def _bounds(field: FieldInfo) -> Iterator[str]:
    for constraint in field.metadata:
        for name, words in BOUNDS.items():
            if hasattr(constraint, name):
                yield words.format(f"{getattr(constraint, name):g}")


def _annotation_name(model: type[BaseModel], key: str) -> str:
    """The annotation as it is written in the source, where the aliases of `values` still have their names."""
    name = next(name for name, field in model.model_fields.items() if key == (field.alias or name))
    return str(inspect.get_annotations(model).get(name, "")).removesuffix(" | None")


def _kind(alias: str, annotation: Any) -> str:
    if alias in PER_JOINT:
        return f"n {PER_JOINT[alias]}"
    if alias == "OneOrPerJoint":
        return "number, or n numbers"
    if alias == "Scale":
        return "number other than 0"
    if alias == "Gravity":
        return f"3 numbers from {-STRONGEST_GRAVITY_M_S2:g} to {STRONGEST_GRAVITY_M_S2:g}"
    if alias == "Coupling":
        return "table of `k<motor><joint>`: the coefficients of q_j = r_j - sum over i of k_ij r_i"
    return _plain(annotation)


def _plain(annotation: Any) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " or ".join(f"`{json.dumps(each)}`" for each in arguments)
    if origin in (Union, UnionType):
        return _plain(next(each for each in arguments if each is not type(None)))
    if origin is Annotated:
        return _plain(arguments[0])
    if origin is dict:
        return _by_name(*arguments)
    return _listed(arguments) if origin is tuple else WORDS[annotation]


def _by_name(names: Any, value: Any) -> str:
    return f"table of {_plain(value)}, by {'name' if names is str else _plain(names)}"


def _listed(arguments: tuple[Any, ...]) -> str:
    """Values of a list, as many as there are or a certain number."""
    if Ellipsis not in arguments:
        return f"{len(arguments)} {_plain(arguments[0])}s"
    inner = _plain(arguments[0])
    return f"list of {'lists of ' if inner[0].isdigit() else ''}{inner}"
