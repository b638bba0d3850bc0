"""Whether a change kept the numbers: `python -m tests.same_bits keep FILE`, the change, `... compare FILE`.

For work that means to change no behaviour. What is compared to the last bit: every field of the telemetry of the
paper's experiment in lock-step, under several laws and both plants, and the setpoints of every example in Python and
in C. A field that was renamed shows up as one that is gone and one that is new, with the same digest.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from tests.golden.test_lockstep_tracking import fly

EXAMPLES = Path(__file__).parents[1] / "examples"
LAWS = [("qrobot", 1000.0), ("pd", 1000.0), ("computed-torque", 1000.0), ("qrobot", 4000.0)]
PLANTS = ["nominal", "mismatched"]
SCENES = {
    "07_guarded_approach": "table",
    "08_crank": "crank",
    "s06_crank": "crank",
    "09_peg_in_hole": "peg",
}
LEFT_OUT = {
    "14_identify",
    "15_rci_tasks",
    "16_mirror",
    "17_spring",
    "18_four_places",
    "22_two_hands",
    "s08_all_calls",
    "s09_assembly_cell",
    "24_teach_and_replay",
    "27_compiled_mirror",
}  # move nothing, or want an operator who types

Digests = dict[str, str]


def digest(data: bytes) -> str:
    """The first half of the SHA-256 of some bytes, in hexadecimal."""
    return hashlib.sha256(data).hexdigest()[:32]


def experiment() -> Iterator[tuple[str, str]]:
    """Name and digest of each field of the experiment's telemetry."""
    for law, rate_hz in LAWS:
        for plant in PLANTS:
            rows = fly(rate_hz, law, plant).rows
            for name in rows.dtype.names or ():
                yield f"{law} {rate_hz:.0f} Hz {plant}: {name}", digest(np.ascontiguousarray(rows[name]).tobytes())


def qrobot(*words: str) -> str:
    """Why a command failed, which is a result as well, or nothing. A program that asks is answered by <return>."""
    keyboard, sys.stdin = sys.stdin, io.StringIO("\n" * 8)
    told = io.StringIO()
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            status = run_app(make_app(words[0]), list(words))
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    finally:
        sys.stdin = keyboard
    return "" if status == 0 else f"status {status}: {told.getvalue()[-300:]}"


def setpoints_of(program: Path, folder: Path) -> str:
    """The digest of the setpoints of a program in lock-step, in the scene it is written for."""
    scene = SCENES.get(program.stem, "empty")
    failed = qrobot("run", "--lockstep", "--scene", scene, "--output", str(folder), str(program))
    return failed or digest((folder / "setpoints.csv").read_bytes())


def examples(folder: Path) -> Iterator[tuple[str, str]]:
    """Name and digest of the setpoints of each example that moves an arm."""
    for source in sorted([*EXAMPLES.glob("*.py"), *(EXAMPLES / "c").glob("s0*.c")]):
        if source.stem in LEFT_OUT:
            continue
        program = folder / source.stem if source.suffix == ".c" else source
        failed = qrobot("cc", str(source), "-o", str(program)) if source.suffix == ".c" else ""
        yield source.name, failed or setpoints_of(program, folder / f"{source.stem}_out")


def measure() -> Digests:
    """All digests, told as they come."""
    found: Digests = {}
    with tempfile.TemporaryDirectory() as folder:
        for part in (experiment(), examples(Path(folder))):
            for name, value in part:
                found[name] = value
                print(f"{value:34} {name}", file=sys.stderr, flush=True)
    return found


def differences(before: Digests, after: Digests) -> list[str]:
    """What is not as it was, a line each."""
    return [
        f"{name}: {before.get(name, 'was not there')} -> {after.get(name, 'is gone')}"
        for name in sorted(before.keys() | after.keys())
        if before.get(name) != after.get(name)
    ]


def main() -> int:
    """Status 0 when everything is as it was, else 1 and what is not."""
    parser = argparse.ArgumentParser(prog="python -m tests.same_bits", description=__doc__)
    parser.add_argument("what", choices=["keep", "compare"])
    parser.add_argument("file", type=Path)
    asked = parser.parse_args()
    after = measure()
    if asked.what == "keep":
        asked.file.write_text(json.dumps(after, indent=1))
        return 0
    changed = differences(json.loads(asked.file.read_text()), after)
    print("\n".join(changed) or f"{len(after)} digests, all as they were")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
