"""What `qrobot board check` refuses before it looks at a board."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app

CARD = """[[arm]]
name = "carded"
robot = "puma560"
bridge = { port = 5999 }
[arm.board]
kind = "port"
[arm.board.port]
read_only = true
"""


def test_a_card_that_is_read_only_by_its_file_is_not_walked_as_one_that_is_written_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "card.toml"
    path.write_text(CARD)
    assert run_app(make_app(), ["board", "check", str(path), "--yes", "--power"]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "read_only = true in [arm.board.port]" in told
    assert "--read-only" in told
