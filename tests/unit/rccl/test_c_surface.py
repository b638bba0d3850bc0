"""What programs in C include, beside the page about it and the engine's idea of it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qrobot.c_transport import message
from qrobot.c_transport.memory import numbers_of, value_of
from qrobot.c_transport.message import CallMessage, Op, decode
from qrobot.cli import toolchain
from qrobot.config import load_robot
from qrobot.motion import Blend, TransformKind, motion_limits
from qrobot.motion.path.blend import PEAK
from qrobot.motion.planning.timing import DEFAULT_TRANSITION_S
from qrobot.motion.world.limits import PLANNED_SHARE
from qrobot.rccl.c.shared import SharedTransform
from qrobot.rccl.parameters import DEFAULT_SPEED
from qrobot.rccl.transforms import gentr_rpy
from qrobot.wire.vocabulary import MAX_JOINTS

WORLD = (toolchain.INCLUDE / "rccl_world.h").read_text()
HEADERS = {"1.0": toolchain.INCLUDE / "rccl.h", "multi": toolchain.MULTI_INCLUDE / "rccl.h"}
SHIM = (toolchain.SOURCES / "channel.h").read_text()
PAGE = (Path(__file__).parents[3] / "docs/reference/c-surface.md").read_text()
PRIVATE = re.compile(r"rccl_|RCCL_")


def names(header: str) -> set[str]:
    """Functions, variables, types and macros that a header offers to programs."""
    functions = re.findall(r"^[\w ]+?[ *](\w+)\([^()]*(?:\([^()]*\)[^()]*)*\);", header, re.MULTILINE)
    variables = [
        name.strip(" *") for line in re.findall(r"^extern (?:volatile )?(?:struct )?\w+ (.*?);", header, re.MULTILINE)
        for name in line.split(",")
    ]  # fmt: skip
    types = [*re.findall(r"^} (\w+), \*(\w+);", header, re.MULTILINE), ("real", "event")]
    macros = re.findall(r"^#define (\w+)", header, re.MULTILINE)
    found = {*functions, *variables, *macros, *(name for pair in types for name in pair)}
    return {name for name in found if not PRIVATE.match(name)}


@pytest.mark.parametrize(("release", "least"), [("1.0", 80), ("multi", 65)])
def test_every_name_of_the_header_stands_on_the_page(release: str, least: int) -> None:
    described = set(re.findall(r"\b\w+\b", " ".join(re.findall(r"`([^`]+)`", PAGE))))
    offered = names(HEADERS[release].read_text()) | names(WORLD)
    assert len(offered) > least
    assert sorted(offered - described) == []


def test_the_accelerations_on_the_page_are_those_of_the_arm() -> None:
    limits = motion_limits(load_robot("puma560"))
    peak = PEAK[Blend.QUARTIC] / 2.0  # of the change of speed over Ta
    text = " ".join(PAGE.split())
    assert f"Its peak is {peak:g} of the change over `ta`" in text
    assert f"accelerates by {peak / DEFAULT_TRANSITION_S:g} of that per second" in text
    assert f"{limits.v_max[0] * peak / DEFAULT_TRANSITION_S:.1f} rad/s² on the waist of the PUMA 560" in text
    assert f"{PLANNED_SHARE:.0%} of the `a_max`".replace("%", " %") in text
    assert f"{limits.a_planned[0]:.1f} rad/s² on the waist |" in text
    assert f"at {DEFAULT_SPEED.share:.0%} of its own full speed".replace("%", " %") in text


def test_engine_and_library_number_their_messages_alike() -> None:
    numbered, number = {}, 0
    for name, value in re.findall(r"^    OP_(\w+)(?: = (\d+))?,$", SHIM, re.MULTILINE):
        number = int(value) if value else number + 1
        numbered[name] = number
    assert numbered == {op.name: op.value for op in Op}


def test_engine_and_library_have_the_same_sizes() -> None:
    defined = dict(re.findall(r"#define (SHIM_\w+) (\d+)", SHIM))
    for name in ("VERSION", "REFS", "NUMBERS", "TEXT"):
        assert int(defined[f"SHIM_{name}"]) == getattr(message, name)
    assert f"#define RCCL_JOINTS {MAX_JOINTS} " in WORLD


def test_a_message_arrives_as_it_was_sent_and_long_texts_are_cut() -> None:
    sent = CallMessage(Op.MAKE, -3, (1, -1), (0.5, 1e-300), "x" * 300)
    got = decode(sent.encode())
    assert (got.op, got.n, list(got.refs[:2]), list(got.numbers[:2])) == (Op.MAKE, -3, [1, -1], [0.5, 1e-300])
    assert got.text == "x" * 255


def test_fields_and_poses_are_one_and_the_same() -> None:
    value = gentr_rpy("T", 10, -20, 30, 40, 50, 60).value
    assert value_of(numbers_of(value)) == pytest.approx(value, abs=1e-15)
    assert numbers_of(value)[9:] == pytest.approx([10.0, -20.0, 30.0])


def test_the_exact_number_counts_until_the_program_changes_its_field() -> None:
    fields = np.zeros(12, dtype=np.float32)
    shared = SharedTransform("T", TransformKind.VARB, fields)
    value = gentr_rpy("T", 0.1, 0.2, 0.3, 10, 20, 30).value
    shared.set(value)
    assert fields[9] == np.float32(0.1)
    assert np.array_equal(shared.value, value)
    fields[10] = 7.0
    changed = value.copy()
    changed[1, 3] = np.float64(np.float32(7.0)) / 1000.0
    assert np.array_equal(shared.value[:3, :3], value[:3, :3])
    assert shared.value == pytest.approx(changed, abs=1e-15)


def test_a_freed_transform_keeps_its_value_whatever_its_memory_is_used_for() -> None:
    fields = np.zeros(12, dtype=np.float32)
    shared = SharedTransform("T", TransformKind.VARB, fields)
    shared.set(gentr_rpy("T", 1, 2, 3, 0, 0, 0).value)
    shared.part()
    fields[:] = 5.0
    assert shared.value[:3, 3] == pytest.approx([0.001, 0.002, 0.003])
