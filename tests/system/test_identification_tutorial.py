"""The recording that comes with QRobot, the tutorial's program, and its notebook."""

from __future__ import annotations

import json
import re
import runpy
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import ConfigError, IdentificationError
from qrobot.ident.shipped import Recording, load_recording, save_recording

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/14_identify.py"
DIGEST = "0fe8c7e435011f12f39255d8573d2a5b4211047b9150c0a71845afda6384c519"
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


def test_the_recording_is_the_one_that_is_known_and_small() -> None:
    recording = load_recording("unknown_arm")
    assert MADE["digest"](recording) == DIGEST
    assert MADE["FILE"].stat().st_size < 500_000
    assert recording.facts["made_by"] == "docs/unknown_arm.py"


def test_the_page_shows_what_the_program_prints(printed: str) -> None:
    found = list(shown(ROOT / "docs/tutorials/identification.md"))
    assert len(found) == 5
    for line in found:
        like = next(each for each in printed.splitlines() if words(each) == words(line))
        np.testing.assert_allclose(numbers(like), numbers(line), rtol=0.05, atol=0.003)


def test_the_model_of_the_program_is_a_thousand_times_nearer_to_the_truth_than_the_robot_file(printed: str) -> None:
    before, after = (numbers(line)[0] for line in printed.splitlines() if line.startswith("gravity by"))
    assert after < 1e-3 * before


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
    part = Recording(kept.robot, kept.rows[5000:5400].copy(), kept.period_s, {"note": "part"})
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
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with pytest.raises(ConfigError, match="is no recording for identification"):
        load_recording(tmp_path / "other.npz")
    with pytest.raises(IdentificationError, match="cannot write the recording"):
        save_recording(tmp_path / "text.npz" / "x.npz", load_recording("unknown_arm"))
