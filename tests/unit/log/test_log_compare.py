"""Two logs side by side: the shift between them, ratios of their errors, and what they say was different."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import LogError
from qrobot.log.compare import Difference, compare_logs, tracking_time
from qrobot.log.header import Attachment, LogHeader
from qrobot.log.overlay import comparison_figure
from qrobot.log.plot import save_figure
from qrobot.log.read import Log
from qrobot.log.record import write_log
from qrobot.modecodes import Mode
from qrobot.realtime.setup import SetupStep
from tests.support.log_samples import PERIOD_NS, make_header, make_rows

N_ROWS = 6000
ROBOT = b"[control]\nkp = [1, 2]\nkv = 3\n[[link]]\nmass = 1\n"


def make_log(error: float = 1e-3, first: int = 0, n: int = 3, header: LogHeader | None = None) -> Log:
    """A run that tracks from row 100 on, its path begun `first` rows into that of the sample rows."""
    rows = make_rows(N_ROWS, n, first)
    rows["mode"][:100] = Mode.HOLDING
    rows["q"] = rows["q_ref"] - error
    return Log(Path(f"{first}.mcap"), header or make_header(n), rows)


def test_a_log_beside_itself_shows_no_shift_no_difference_and_ratios_of_one() -> None:
    comparison = compare_logs(make_log(), make_log())
    assert comparison.shift_s == 0.0
    assert comparison.differences == ()
    for joint in comparison.joints:
        assert (joint.max_ratio, joint.rms_ratio, joint.setpoints_differ) == (1.0, 1.0, 0.0)


def test_ratios_are_b_over_a_and_say_nothing_where_a_has_no_error() -> None:
    comparison = compare_logs(make_log(error=1e-3), make_log(error=3e-3))
    assert comparison.joints[0].max_ratio == pytest.approx(3.0)
    assert comparison.joints[0].rms_ratio == pytest.approx(3.0)
    perfect = compare_logs(make_log(error=0.0), make_log())
    assert math.isnan(perfect.joints[0].rms_ratio)
    assert json.loads(json.dumps(perfect.to_dict(), allow_nan=False))["joints"][0]["rms_ratio"] is None


@pytest.mark.parametrize("rows", [-400, -28, 13, 700])
def test_the_shift_between_two_runs_of_one_motion_is_found(rows: int) -> None:
    ahead = make_log(first=1000 - rows)  # its motion is `rows` cycles less far
    comparison = compare_logs(make_log(first=1000), ahead)
    assert comparison.shift_s == pytest.approx(rows * PERIOD_NS * 1e-9, abs=1e-4)
    assert max(joint.setpoints_differ for joint in comparison.joints) < 1e-3


def test_logs_of_different_rates_are_laid_over_each_other_by_time() -> None:
    slow = make_log()
    slow = replace(slow, header=make_header(3, period_ns=4 * PERIOD_NS), rows=slow.rows[::4])
    comparison = compare_logs(make_log(), slow)
    assert comparison.shift_s == pytest.approx(0.0, abs=1e-4)
    assert max(joint.setpoints_differ for joint in comparison.joints) < 1e-3
    assert Difference("period_ns", PERIOD_NS, 4 * PERIOD_NS) in comparison.differences


def test_time_counts_from_the_first_tracking_cycle() -> None:
    assert tracking_time(make_log())[100] == 0.0
    assert tracking_time(make_log())[0] == pytest.approx(-100 * PERIOD_NS * 1e-9)


def test_what_headers_and_attached_files_record_differently_is_told_key_by_key() -> None:
    kernel, refused = SetupStep("kernel", True, "", ""), SetupStep("scheduler", False, "", "")
    a = replace(
        make_log(header=replace(make_header(3), setup=(kernel,))),
        attachments={"arm.toml": ROBOT, "only-here.toml": b""},
    )
    b = replace(
        make_log(header=replace(make_header(3), law="pd", setup=(kernel, refused))),
        attachments={"arm.toml": ROBOT.replace(b"kv = 3", b"kv = 4").replace(b"mass = 1", b"mass = 2")},
    )
    assert compare_logs(a, b).differences == (
        Difference("law", "", "pd"),
        Difference("set-up: scheduler", None, False),
        Difference("arm.toml: control.kv", 3, 4),
        Difference("arm.toml: link[1].mass", 1, 2),
    )


def test_an_attached_file_that_is_no_toml_is_compared_as_a_whole() -> None:
    a, b = (replace(make_log(), attachments={"arm.toml": data}) for data in (b"a = = 1", b"\xff"))
    assert [difference.what for difference in compare_logs(a, b).differences] == ["arm.toml: contents"]


def test_a_law_that_was_edited_is_told_by_its_digest_and_not_by_its_lines() -> None:
    a, b = (replace(make_log(), attachments={"mine.py": b"def law(q):\n    return %d * q\n" % k}) for k in (1, 3))
    [told] = compare_logs(a, b).differences
    assert told.what == "mine.py: contents"
    assert told.a != told.b
    assert str(told.a).startswith("sha256 ")
    assert compare_logs(a, a).differences == ()


def test_files_of_one_kind_and_other_names_are_compared_and_a_model_that_one_has_alone_is_told() -> None:
    model = b"robot_digest = '%d'\n"
    a = replace(make_log(), attachments={"left.toml": b"[[arm]]\nrate_hz = 1000\n"})
    b = replace(make_log(), attachments={"right.toml": b"[[arm]]\nrate_hz = 2000\n", "found.toml": model % 1})
    assert compare_logs(a, b).differences == (
        Difference("left.toml and right.toml: arm[1].rate_hz", 1000, 2000),
        Difference("model", None, "found.toml"),
    )
    c = replace(b, attachments={**a.attachments, "other.toml": model % 2})
    assert Difference("found.toml and other.toml: robot_digest", "1", "2") in compare_logs(b, c).differences


def test_logs_of_different_robots_are_refused() -> None:
    with pytest.raises(LogError, match=r"only logs of one robot.*0\.mcap is of sample .*0\.mcap is of other"):
        compare_logs(make_log(), make_log(header=replace(make_header(3), robot="other")))
    with pytest.raises(LogError, match="only logs of one robot"):
        compare_logs(make_log(n=3), make_log(n=2))


def test_a_log_that_never_tracked_is_refused() -> None:
    idle = make_log()
    idle.rows["mode"] = Mode.HOLDING
    with pytest.raises(LogError, match="no cycle in which the arm tracked"):
        compare_logs(make_log(), idle)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("n", [1, 3, 7])
def test_the_figure_has_one_panel_of_positions_and_one_of_errors_per_joint(tmp_path: Path, n: int) -> None:
    comparison = compare_logs(make_log(n=n), make_log(n=n, first=40))
    figure = comparison_figure(comparison)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 1 + n
    assert len(shown[0].lines) == 2 * n
    assert all(len(axes.lines) == 2 for axes in shown[1:])
    error = np.asarray(shown[1].lines[1].get_ydata())
    np.testing.assert_allclose(error, 1.0, atol=1e-9)  # 1 mrad
    save_figure(figure, tmp_path / "both.png")
    assert (tmp_path / "both.png").stat().st_size > 10_000


# ------------------------------------------------------------------------------------------------------- the command


@pytest.fixture
def two_files(tmp_path: Path) -> tuple[str, str]:
    for name, error, law in (("a", 1e-3, "pd"), ("b", 2e-3, "qrobot")):
        log = make_log(error)
        header = replace(log.header, law=law)
        write_log(tmp_path / f"{name}.mcap", log.rows, header, [Attachment("arm.toml", ROBOT)])
    return str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap")


def test_compare_prints_errors_ratios_and_differences(
    two_files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_app(make_app(), ["log", "compare", *two_files]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("joint1 1.000 2.000 2.00 1.000 2.000 2.00 0.000", "law pd qrobot", "late cycles 0 0", "0.0 ms later"):
        assert words in text


def test_compare_prints_no_ratio_to_a_joint_that_stood(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(tmp_path / "stood.mcap"), str(tmp_path / "moved.mcap")]
    for file, error in zip(files, (1e-12, 2e-3), strict=True):
        log = make_log(error=error)
        write_log(Path(file), log.rows, log.header, [Attachment("arm.toml", ROBOT)])
    assert run_app(make_app(), ["log", "compare", *files]) == 0
    assert "joint1 0.000 2.000 > 1000 0.000 2.000 > 1000" in " ".join(capsys.readouterr().out.split())


def test_compare_prints_json_and_draws(two_files: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    figure = Path(two_files[0]).with_name("both.png")
    assert run_app(make_app(), ["log", "compare", *two_files, "--json", "--plot", str(figure)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["joints"][2]["rms_ratio"] == pytest.approx(2.0)
    assert found["differences"] == [{"what": "law", "a": "pd", "b": "qrobot"}]
    assert found["b"]["wakeup_us"].keys() == {"p50", "p99", "max"}
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_comparing_logs_of_different_robots_is_one_line_and_status_1(
    two_files: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(Path(two_files[1]), make_rows(10, 2), make_header(2))
    assert run_app(make_app(), ["log", "compare", *two_files]) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "only logs of one robot" in error
