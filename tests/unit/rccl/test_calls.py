"""The calls of RCCL are stated once, as methods of `Channel`: functions, C header and C dispatcher agree with them."""

from __future__ import annotations

import inspect
import re
import types
import typing
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.c_transport.message import Op
from qrobot.cli import toolchain
from qrobot.errors import LinkError
from qrobot.motion import Trsf
from qrobot.multi_rccl.c import dispatcher as manip_dispatcher
from qrobot.rccl import Channel, Position, Transform, program
from qrobot.rccl.c.dispatcher import CALLS

HEADER = (toolchain.INCLUDE / "rccl.h").read_text()
PROTOTYPES = dict(re.findall(r"^(?:int|POS_PTR) (?:rccl_)?(\w+)\((\w[^;]*)\);", HEADER, re.MULTILINE))
ARM_CALLS = [name for name in rccl.__all__ if hasattr(Channel, name)]
OF_THE_ARM = sorted(set(ARM_CALLS) - {"completed", "there", "how", "chg", "nbrequest", "release"})
PYTHON_OF_C = {
    "double": {float},
    "int": {bool, int},
    "char *": {str},
    "POS_PTR": {Position},
    "TRSF_PTR": {Trsf, Transform},
    "VALUES": {float},
}
# C has variables (nextmove), macros (waitfor, waitas) and letters (setmode) in their place, or nothing at all.
ONLY_PYTHON = {
    "each_sample",
    "finish",
    "pose",
    "setjvel",
    "collision",
    "setload",
    "signal",
    "log_signal",
    "nextmove",
    "waitas",
    "waitfor",
    "setmode",
    "CLOSE",
    "OPEN",
}


def signature(call: Callable[..., object]) -> list[inspect.Parameter]:
    return [parameter for parameter in inspect.signature(call).parameters.values() if parameter.name != "self"]


def c_types(arguments: str) -> list[str]:
    """Types of a prototype; a count and the array behind it are one thing."""
    folded = re.sub(r"int count, double \*\w+", "VALUES values", arguments)
    found = [re.sub(r"\s*\w+$", "", part.strip()) for part in folded.split(",") if part != "void"]
    return [re.sub(r"\s*\*$", " *", kind) for kind in found]


@pytest.mark.parametrize("name", OF_THE_ARM)
def test_a_function_has_signature_and_docstring_of_the_method(name) -> None:
    function, method = getattr(rccl, name), getattr(Channel, name)
    assert signature(function) == signature(method)
    assert list(inspect.signature(function).parameters) == [parameter.name for parameter in signature(method)]
    assert function.__doc__ == method.__doc__
    assert function.__name__ == name


def test_what_the_guide_lists_is_of_the_arm_and_of_the_module() -> None:
    page = (Path(__file__).parents[3] / "docs/how-to/write-a-program.md").read_text()
    table = page[page.index("| call | does |") : page.index("All are methods")]
    of_channel = set(dir(Channel)) | {"completed", "there"}  # attributes that are made with it
    cells = [line.split(" | ")[0] for line in table.splitlines()[2:]]
    names = {name for cell in cells for name in re.findall(r"(?<=`)\w+(?=[`(])", cell)}
    assert {"move", "joints", "analog"} < names
    assert names - of_channel == {"control", "teach"}
    assert {name for name in names if name not in rccl.__all__ and name not in program.VARIABLES} == set()


def test_a_variable_is_what_the_arm_has(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = types.SimpleNamespace(**{name: object() for name in program.VARIABLES}, pose=lambda name: f"pose {name}")
    monkeypatch.setattr(program, "_arm", arm)
    assert {name: getattr(rccl, name) for name in program.VARIABLES} == {
        name: "pose park" if name == "park" else getattr(arm, name) for name in program.VARIABLES
    }


def test_without_an_arm_a_function_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(program, "_arm", None)  # whatever a test before has left under control
    with pytest.raises(LinkError, match="no arm is under control"):
        rccl.setvel(100, 90)


@pytest.mark.parametrize("name", sorted(set(OF_THE_ARM) - ONLY_PYTHON - {"evalfn"}))
def test_the_prototype_in_c_takes_what_the_method_takes(name) -> None:
    hints = typing.get_type_hints(getattr(Channel, name), localns={"np": np})
    taken = [hints[parameter.name] for parameter in signature(getattr(Channel, name))]
    given = c_types(PROTOTYPES[name])
    assert len(given) == len(taken)
    for c_type, python_type in zip(given, taken, strict=True):
        kinds = set(typing.get_args(python_type) or (python_type,)) - {types.NoneType}  # left out in Python alone
        assert kinds <= PYTHON_OF_C[c_type]


def test_every_message_that_asks_for_something_has_its_row_and_no_other() -> None:
    asked = {op for op in Op if Op.HELLO < op < Op.REPLY} - {Op.ARCL_CALL, Op.ARCL_WORD}  # a library of its own
    of_manipulators = {op for op in asked if op >= Op.MANIP_OPEN}
    assert set(CALLS) == asked - of_manipulators
    assert of_manipulators < set(manip_dispatcher.CALLS) < asked


def test_what_waits_in_python_waits_in_c() -> None:
    waiting = {op.name for op, call in CALLS.items() if call.waits}
    assert waiting == {
        "CONTROL",
        "RELEASE",
        "SAMPLE_PERIOD",
        "NEXT_SAMPLE",
        "TEACH",
        "STEPMODE",
        "ANALOG",
        "COLLISION",
        "SETLOAD",
    }
