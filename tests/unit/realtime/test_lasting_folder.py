"""Whether a runtime folder stays when its account logs out, told before an arm runs in it."""

from __future__ import annotations

import os
import pwd
from pathlib import Path

import pytest

from qrobot.realtime.lasting_folder import LINGERING, SYSTEMD, lasting_advice, look_at_lasting

PERSON, SERVICE = 54321, 432  # of the first there is no name
SESSION, MEMORY = "/run/user/54321/qrobot", "/dev/shm/qrobot-54321"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A machine that systemd runs."""
    (tmp_path / SYSTEMD).mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("folder", "account", "stays"),
    [
        (SESSION, PERSON, False),
        (SESSION, SERVICE, False),
        (MEMORY, PERSON, False),
        (MEMORY, SERVICE, True),
        ("/run/qrobot", PERSON, True),
        ("/run/users-of-robots", PERSON, True),
        ("/mnt/memory", PERSON, True),
    ],
)
def test_what_logind_removes_goes_and_the_rest_stays(root: Path, folder: str, account: int, stays: bool) -> None:
    assert look_at_lasting(Path(folder), account, root).ok is stays


@pytest.mark.parametrize("folder", [SESSION, MEMORY])
def test_it_stays_for_an_account_that_lingers_and_without_systemd(root: Path, tmp_path: Path, folder: str) -> None:
    step = look_at_lasting(Path(folder), PERSON, root)
    assert "is removed when 54321 logs out" in step.detail
    assert "loginctl enable-linger 54321" in step.remedy
    (root / LINGERING).mkdir(parents=True)
    (root / LINGERING / str(PERSON)).touch()
    assert look_at_lasting(Path(folder), PERSON, root).ok
    assert look_at_lasting(Path(folder), PERSON, tmp_path / "without").ok


def test_who_starts_an_arm_is_told_with_what_to_do(root: Path) -> None:
    name = pwd.getpwuid(os.geteuid()).pw_name
    advice = lasting_advice(Path(SESSION), root)
    assert f"is removed when {name} logs out" in advice
    assert f"(loginctl enable-linger {name}, or" in advice
    assert lasting_advice(Path("/run/qrobot"), root) == ""
