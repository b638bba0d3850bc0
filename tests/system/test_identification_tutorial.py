"""The recording that comes with QRobot, the tutorial's program, and its notebook."""

from __future__ import annotations

import contextlib
import json
import re
import runpy
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.document import packaged_path
from qrobot.config.kinds import FileKind
from qrobot.errors import ConfigError, IdentificationError
from qrobot.ident.base import base_of_robot
from qrobot.ident.compact_recording import CompactRecording, load_recording, save_recording
from qrobot.ident.regressor import inertial_regressor

PUMA = load_robot("puma560")
ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/14_identify.py"
DIGESTS = {
    "unknown_arm": "0fe8c7e435011f12f39255d8573d2a5b4211047b9150c0a71845afda6384c519",
    "unknown_arm_fast": "4d903258cadae7f54a93f4cd26de8f84151441e5103611d6c8de5383e0f2095b",
}
MADE = runpy.run_path(str(ROOT / "docs/unknown_arm.py"))


@pytest.fixture(scope="module")
def printed() -> str:
    said = StringIO()
    with redirect_stdout(said):
        runpy.run_path(str(EXAMPLE), run_name="__main__")
    return said.getvalue()


def numbers(line: str) -> list[float]:
    return [float(number) for number in re.findall(r"(?<![\w.])-?\d+\.\d+", line)]


def words(line: str) -> list[str]:
    """The same line but for its numbers; names with a digit are none."""
    return re.sub(r"(?<![\w.])-?\d+\.\d+", "#", line).split()


def shown(page: Path) -> Iterator[str]:
    """Output that a page shows."""
    return (line.strip() for line in page.read_text().splitlines() if line.startswith("    "))


@pytest.mark.parametrize(("name", "digest"), DIGESTS.items())
def test_the_recordings_are_those_that_are_known_and_small(name: str, digest: str) -> None:
    recording = load_recording(name)
    assert MADE["digest"](recording) == digest
    assert (MADE["FOLDER"] / f"{name}.npz").stat().st_size < 500_000
    assert recording.facts["made_by"] == "docs/unknown_arm.py"


def test_the_page_shows_what_the_program_prints(printed: str) -> None:
    found = list(shown(ROOT / "docs/tutorials/identification.md"))
    assert len(found) == 6
    for line in found:
        like = next(each for each in printed.splitlines() if words(each) == words(line))
        np.testing.assert_allclose(numbers(like), numbers(line), rtol=0.05, atol=2e-4)


def test_the_model_of_the_program_is_a_thousand_times_nearer_to_the_truth_than_the_robot_file(printed: str) -> None:
    before, after = (numbers(line)[0] for line in printed.splitlines() if line.startswith("gravity by"))
    assert after < 1e-3 * before


def test_the_inertia_that_is_shown_is_the_arms_and_not_the_files(printed: str) -> None:
    facts, regressor = load_recording("unknown_arm_fast").facts, inertial_regressor(PUMA)
    base = base_of_robot(PUMA, regressor)
    truth = dict(zip(base.leaders, base.K @ [facts["links"][name] for name in regressor.names], strict=True))
    shown = {line.split()[0]: numbers(line) for line in printed.splitlines() if line.startswith("Izz")}
    assert set(shown) == {"Izz1", "Izz2", "Izz3"}
    for name, (value, half_width, before) in shown.items():
        assert value == pytest.approx(truth[name], abs=half_width + 0.001)
        assert abs(value - truth[name]) < 0.1 * abs(before - truth[name])


@pytest.mark.thorough
def test_the_notebook_runs_cell_by_cell_and_says_the_same(printed: str) -> None:
    notebook = json.loads(EXAMPLE.with_suffix(".ipynb").read_text())
    said, names = StringIO(), {"__name__": "__main__"}
    with redirect_stdout(said):
        for cell in notebook["cells"]:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
    assert said.getvalue() == printed


def test_a_recording_comes_back_but_for_rounding(tmp_path: Path) -> None:
    kept = load_recording("unknown_arm")
    part = CompactRecording(kept.robot, kept.rows[5000:5400].copy(), kept.period_s, {"note": "part"})
    part.rows["v_ref"] += 0.3e-4
    path = tmp_path / "deep" / "part.npz"
    save_recording(path, part)
    read = load_recording(path)
    assert (read.period_s, read.facts) == (kept.period_s, {"note": "part"})
    for name in ("tick", "mode", "flags", "counts", "dac", "q", "q_ref", "a_ref"):
        np.testing.assert_array_equal(read.rows[name], part.rows[name])
    np.testing.assert_allclose(read.rows["v_ref"], part.rows["v_ref"], atol=0.5e-4)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'unknown_arm'"):
        load_recording("unknow_arm")
    for name, content in (("text.npz", b"hello"), ("empty.npz", b"")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(ConfigError, match=rf"{name} is no recording for identification"):
            load_recording(path)
    whole, rng = packaged_path("unknown_arm", FileKind.RECORDING, "data", ".npz").read_bytes(), np.random.default_rng(4)
    for _ in range(40):
        damaged = bytearray(whole)
        damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        (tmp_path / "damaged.npz").write_bytes(damaged)
        with contextlib.suppress(ConfigError):
            load_recording(tmp_path / "damaged.npz")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(ConfigError, match="is no recording for identification"):
        load_recording(tmp_path / "other.npz")
    with pytest.raises(IdentificationError, match="cannot write the recording"):
        save_recording(tmp_path / "text.npz" / "x.npz", load_recording("unknown_arm"))
