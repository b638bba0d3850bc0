"""Files that are written whole, over old ones, links and devices, and when the disk is full."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

import pytest

from qrobot.whole_file import replace_file


def test_a_file_is_made_and_written_over_and_keeps_its_rights(tmp_path: Path) -> None:
    file = tmp_path / "a"
    replace_file(file, "one\r\n")
    assert stat.S_IMODE(file.stat().st_mode) == 0o644
    file.chmod(0o600)
    replace_file(file, "zwei µ\n")
    assert file.read_bytes() == "zwei µ\n".encode()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert os.listdir(tmp_path) == ["a"]


def test_a_link_goes_on_pointing_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    file, link = tmp_path / "there" / "file", tmp_path / "link"
    file.write_text("old")
    link.symlink_to(file)
    replace_file(link, "new")
    assert link.is_symlink()
    assert file.read_text() == "new"


def test_what_is_no_file_is_written_to() -> None:
    replace_file(Path("/dev/null"), "lost")
    assert Path("/dev/null").is_char_device()


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_when_the_disk_is_full_the_old_text_is_there_and_no_other_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    file = tmp_path / "a"
    file.write_text("old")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, failing, full)
    with pytest.raises(OSError, match="No space"):
        replace_file(file, "new")
    assert file.read_text() == "old"
    assert os.listdir(tmp_path) == ["a"]


def test_a_character_that_the_encoding_lacks_leaves_the_old_text(tmp_path: Path) -> None:
    file = tmp_path / "a"
    file.write_text("old")
    with pytest.raises(UnicodeEncodeError):
        replace_file(file, "µ", "ascii")
    assert file.read_text() == "old"
