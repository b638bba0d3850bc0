"""Files in each other's places: whatever is given where another kind of file is wanted is told for what it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from qrobot.config import load_deployment, load_robot
from qrobot.config.document import packaged_path
from qrobot.config.identified import load_model
from qrobot.config.kinds import FileKind, kind_of_content, kind_of_file
from qrobot.errors import ConfigError, LogError, QRobotError
from qrobot.ident.compact_recording import load_recording
from qrobot.log.header import header_for
from qrobot.log.read import read_log
from qrobot.log.record import write_log
from qrobot.servo.calibration.table import load_table
from qrobot.servo.memory.telemetry import TelemetryLayout
from qrobot.sim_board.faults import FaultPlan

PUMA = load_robot("puma560")
PACKAGED = {
    FileKind.ROBOT: ("puma560", "robots", ".toml"),
    FileKind.DEPLOYMENT: ("emulator", "", ".toml"),
    FileKind.CALIBRATION: ("puma560", "calibration", ".txt"),
    FileKind.RECORDING: ("unknown_arm", "data", ".npz"),
}
READERS: dict[FileKind, Callable[[Path], Any]] = {
    FileKind.ROBOT: load_robot,
    FileKind.MODEL: lambda path: load_model(path, PUMA),
    FileKind.DEPLOYMENT: load_deployment,
    FileKind.CALIBRATION: lambda path: load_table(path, PUMA),
    FileKind.FAULTS: FaultPlan.load,
    FileKind.RECORDING: load_recording,
    FileKind.LOG: read_log,
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[FileKind, Path]:
    """One of each kind."""
    folder = tmp_path_factory.mktemp("kinds")
    made = {kind: packaged_path(name, kind, where, ending) for kind, (name, where, ending) in PACKAGED.items()}
    made[FileKind.LOG] = write_log(
        folder / "run.mcap", TelemetryLayout(PUMA.n).empty(3), header_for(PUMA, 10**6, "qrobot")
    )[0]
    made[FileKind.URDF], made[FileKind.MJCF] = folder / "arm.urdf", folder / "arm.xml"
    made[FileKind.URDF].write_text(
        '<?xml version="1.0"?>\n<!-- <mujoco/> -->\n<robot name="r"><link name="a"/></robot>\n'
    )
    made[FileKind.MJCF].write_text('<mujoco model="r"/>\n')
    made[FileKind.MODEL], made[FileKind.FAULTS] = folder / "model.toml", folder / "faults.toml"
    made[FileKind.MODEL].write_text('robot = "puma560"\nrobot_digest = "0"\n')
    made[FileKind.FAULTS].write_text('faults = ["encoder:1 off"]\n')
    return made


@pytest.mark.parametrize("kind", FileKind)
def test_each_kind_is_known_by_its_contents_whatever_its_name(
    kind: FileKind, files: dict[FileKind, Path], tmp_path: Path
) -> None:
    renamed = tmp_path / "nameless"
    renamed.write_bytes(files[kind].read_bytes())
    assert kind_of_file(renamed) is kind


@pytest.mark.parametrize("wanted", READERS)
@pytest.mark.parametrize("given", FileKind)
def test_a_file_of_another_kind_is_told_for_what_it_is(
    wanted: FileKind, given: FileKind, files: dict[FileKind, Path], tmp_path: Path
) -> None:
    if wanted is given:
        return
    as_wanted = tmp_path / f"disguised{files[wanted].suffix}"
    as_wanted.write_bytes(files[given].read_bytes())
    for path in (files[given], as_wanted):
        with pytest.raises((ConfigError, LogError)) as caught:
            READERS[wanted](path)
        assert f"is {given.called}, not {wanted.called}" in str(caught.value)
        assert given.wanted_at in str(caught.value)


@pytest.mark.parametrize(
    "contents", [b"", b"\x00\xff" * 50, b"nonsense", b"a = 1", b"# only a comment\n", b"\x89MCA", b"<launch/>"]
)
@pytest.mark.parametrize("wanted", READERS)
def test_what_is_of_no_kind_is_an_error_of_its_reader(wanted: FileKind, contents: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(contents)
    assert kind_of_file(path) is None
    with pytest.raises(QRobotError):
        READERS[wanted](path)


def test_comments_without_end_before_a_root_take_no_time() -> None:
    comments = "<!-- so -->\n" * 2_000
    assert kind_of_content(f"{comments}<robot/>".encode()) is FileKind.URDF
    assert kind_of_content(f"{comments}<!DOCTYPE a [<!ENTITY b 'c'>]>".encode()) is None


def test_a_file_that_is_not_there_is_of_no_kind(tmp_path: Path) -> None:
    assert kind_of_file(tmp_path / "nowhere") is None
    assert kind_of_file(tmp_path) is None
