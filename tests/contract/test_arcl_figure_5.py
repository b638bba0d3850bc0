"""Figure 5 of the ARCL paper, to the character, and what it fixes: dT 56 ms, Tseg + dT, 4858 samples (section 4)."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl.stream import RecordKind, Stream, read_stream
from tests.support.arcl import PARK, run_example

pytestmark = pytest.mark.usefixtures("arcl_alone")

DONE = "ami_offl: done at t=272.048\n"
TRANSFORMS = """\
base : x:0.000 y:0.000 z:862.000 RPY r:0.000 p:-0.000 y:0.000
tool : x:0.000 y:0.000 z:170.000 RPY r:0.000 p:-0.000 y:0.000
p : x:500.000 y:600.000 z:800.000 RPY r:0.000 p:30.000 y:0.000
"""
MOTIONS = """\
request PARK: t=0, traj=1, Ta=100, Tseg=300, Vt=0, Vr=0
request pos: t=0, traj=1, Ta=100, Tseg=0, Vt=10, Vr=10
request PARK: t=0, traj=1, Ta=100, Tseg=0, Vt=10, Vr=10, conf=run
exec(stdtg) PARK: t=0.00, stat=0, j Ta1=112, Ta2=112, Tseg=280, dT=56
exec(stdtg) pos: t=0.34, stat=0, j Ta1=112, Ta2=112, Tseg=0, dT=56
exec(stdtg) PARK: t= 136.19, stat=0, j Ta1=112, Ta2=112, Tseg=0, dT=56
request STOP: t=272048, traj=1, Ta=100, Tseg=300, Vt=10, Vr=10
"""


Run = Callable[..., tuple[str, Stream]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """What the program prints with these switches, and its stream: a run of each is enough."""

    @cache
    def once(*switches: str) -> tuple[str, Stream]:
        folder = tmp_path_factory.mktemp("figure")
        with redirect_stdout(StringIO()) as said:
            run_example("s14_figure_5.py", folder, "+nolim", *switches)
        return said.getvalue(), read_stream(folder / "puma560.arcl")

    return once


@pytest.mark.parametrize(
    ("switches", "printed"), [((), DONE), (("+tr",), TRANSFORMS + DONE), (("+m",), MOTIONS + DONE)]
)
def test_the_figure_is_printed_to_the_character(run: Run, switches: tuple[str, ...], printed: str) -> None:
    assert run(*switches)[0] == printed


@pytest.fixture
def stream(run: Run) -> Stream:
    return run()[1]


def test_the_run_takes_4858_samples_of_56_ms_and_ends_at_rest_at_park(stream: Stream) -> None:
    times, joints = stream.table(RecordKind.JOINTS, 6)
    assert stream.start.period_us == 56000
    assert len(times) - 1 == round(times[-1] / 0.056) == 4858
    assert np.allclose(np.degrees(joints[[0, -1]]), PARK, atol=1e-9)
    speeds = np.abs(np.diff(joints, axis=0)).max(axis=1)
    assert speeds[-1] < 0.05 * speeds.max()


def test_a_segment_takes_tseg_and_one_sample_more(stream: Stream) -> None:
    begins = [record.t_ms for record in stream.of(RecordKind.EXEC)]
    assert np.allclose(np.diff([*begins, 272048.0]) / 56.0, [6, 2426, 2426])


def test_the_goal_needs_a_joint_5_that_no_puma_has_so_the_papers_run_did_not_look_at_its_range(stream: Stream) -> None:
    _, joints = stream.table(RecordKind.JOINTS, 6)
    assert np.degrees(np.abs(joints[:, 4]).max()) == pytest.approx(118.0, abs=1.0)


def test_with_the_ranges_of_the_joints_the_goal_is_an_error(tmp_path: Path) -> None:
    from qrobot.errors import JointLimit

    with pytest.raises(JointLimit, match="joint 5"):
        run_example("s14_figure_5.py", tmp_path)
