"""Named shared memory: one living owner, taken over from a dead one, gone after an orderly end."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from qrobot.errors import ConfigError, LinkBusy, LinkError
from qrobot.realtime import shared_memory
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory, discard_dead, segment_path
from tests.support.patience import PATIENCE_S

OWN_AND_WAIT = """
import sys
from qrobot.realtime import shared_memory
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory
segment = SharedMemory.create(sys.argv[1], 1, 64)
segment.words[HEADER_WORDS] = 42
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def name() -> Iterator[str]:
    name = f"test-{uuid.uuid4().hex[:12]}"
    yield name
    segment_path(name).unlink(missing_ok=True)


def start_owner(name: str) -> subprocess.Popen[str]:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    owner: subprocess.Popen[str] = subprocess.Popen([sys.executable, "-c", OWN_AND_WAIT, name], **pipes)  # type: ignore[call-overload]
    assert owner.stdout is not None
    assert owner.stdout.readline() == "ready\n"
    return owner


def kill(owner: subprocess.Popen[str]) -> None:
    owner.send_signal(signal.SIGKILL)
    owner.communicate()


def test_words_written_by_the_owner_are_read_by_a_peer_and_back(name: str) -> None:
    with SharedMemory.create(name, 1, 64) as owner, SharedMemory.attach(name, 1) as peer:
        owner.words[10] = 7
        peer.words[11] = 8
        assert (peer.words[10], owner.words[11], owner.header.owner_pid) == (7, 8, os.getpid())


def test_a_second_owner_is_refused_while_the_first_lives(name: str) -> None:
    with SharedMemory.create(name, 1, 64), pytest.raises(LinkBusy, match=name):
        SharedMemory.create(name, 1, 64)


def test_a_killed_owner_is_taken_over_and_peers_see_the_generation_rise(name: str) -> None:
    first = start_owner(name)
    peer = SharedMemory.attach(name, 1)
    assert peer.owner_alive
    assert peer.words[HEADER_WORDS] == 42
    kill(first)
    assert not peer.owner_alive
    with SharedMemory.create(name, 1, 64) as second:
        assert peer.is_current
        assert peer.owner_alive
        assert peer.header.generation == second.header.generation == 2
        assert peer.words[HEADER_WORDS] == 0
    peer.close()


def test_a_living_owner_in_another_process_is_not_disturbed(name: str) -> None:
    owner = start_owner(name)
    try:
        with pytest.raises(LinkBusy):
            SharedMemory.create(name, 1, 64)
        with SharedMemory.attach(name, 1) as peer:
            assert peer.words[HEADER_WORDS] == 42
    finally:
        kill(owner)


def test_a_peer_that_probes_for_the_owner_does_not_keep_a_new_one_out(name: str) -> None:
    kill(start_owner(name))
    probe = "import sys\nfrom qrobot.realtime.shared_memory import SharedMemory\np = SharedMemory.attach(sys.argv[1], 1)\nprint('ready', flush=True)\nwhile not p.owner_alive: pass"  # noqa: E501
    peer = subprocess.Popen([sys.executable, "-c", probe, name], stdout=subprocess.PIPE, text=True)
    assert peer.stdout is not None
    assert peer.stdout.readline() == "ready\n"
    with SharedMemory.create(name, 1, 64):
        peer.communicate(timeout=PATIENCE_S)
        assert peer.returncode == 0


def meanwhile(monkeypatch: pytest.MonkeyPatch, act: Callable[[], None]) -> None:
    """Do something after each call for a lock, as if the caller were kept from running there."""
    calls = {"fcntl": fcntl.fcntl, "flock": fcntl.flock}

    def kept(call: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any) -> Any:
            found = call(*arguments)
            with monkeypatch.context() as patch:
                for name, plain in calls.items():
                    patch.setattr(fcntl, name, plain)
                act()
            return found

        return called

    for name, call in calls.items():
        monkeypatch.setattr(fcntl, name, kept(call))


def test_two_who_look_at_once_do_not_take_each_other_for_the_owner(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    kill(start_owner(name))
    seen = []
    with (
        SharedMemory.attach(name, 1) as first,
        SharedMemory.attach(name, 1) as second,
        monkeypatch.context() as patch,
    ):
        meanwhile(patch, lambda: seen.append(second.owner_alive))
        assert not first.owner_alive
    assert seen
    assert not any(seen)


def test_an_owner_begins_at_once_wherever_one_who_looks_is_kept_from_running(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kill(start_owner(name))
    begun = []

    def begin() -> None:
        with SharedMemory.create(name, 1, 64) as heir:
            begun.append(int(heir.header.generation))

    monkeypatch.setattr(shared_memory, "sleep_between_looks", lambda _: pytest.fail("it waited"))
    with SharedMemory.attach(name, 1) as peer, monkeypatch.context() as patch:
        meanwhile(patch, begin)
        assert not peer.owner_alive
    assert begun == [2]


@pytest.mark.parametrize("layout", [1, 2])
def test_an_owner_of_a_version_that_knew_another_lock_is_not_disturbed(name: str, layout: int) -> None:
    kill(start_owner(name))
    with segment_path(name).open("r+b") as old:
        fcntl.flock(old, fcntl.LOCK_EX)
        with pytest.raises(LinkBusy):
            SharedMemory.create(name, layout, 64)
        discard_dead(name)
        assert segment_path(name).exists()
        with SharedMemory.attach(name, 1) as peer:
            assert peer.words[HEADER_WORDS] == 42
    SharedMemory.create(name, layout, 64).close(unlink=True)


def test_what_a_killed_owner_left_is_discarded_and_what_a_living_one_has_is_not(name: str) -> None:
    owner = start_owner(name)
    discard_dead(name)
    assert segment_path(name).exists()
    kill(owner)
    discard_dead(name)
    assert not segment_path(name).exists()
    discard_dead(name)  # there is nothing


def test_one_peer_at_a_time_commands_and_another_is_refused_until_it_has_closed(name: str) -> None:
    with SharedMemory.create(name, 1, 16), SharedMemory.attach(name, 1) as other:
        first = SharedMemory.attach(name, 1)
        first.claim()
        first.claim()  # what is ours already is no obstacle
        with pytest.raises(LinkBusy, match="commanded by another process already"):
            other.claim()
        SharedMemory.attach(name, 1).close()  # another mapping of the same process takes nothing away
        with pytest.raises(LinkBusy):
            other.claim()
        first.close()
        other.claim()
    with pytest.raises(LinkError, match="is closed"):
        other.claim()


def test_an_orderly_end_removes_the_file_and_a_peer_notices(name: str) -> None:
    owner = SharedMemory.create(name, 1, 64)
    peer = SharedMemory.attach(name, 1)
    owner.close(unlink=True)
    assert not segment_path(name).exists()
    assert not peer.is_current
    assert not peer.owner_alive
    with SharedMemory.create(name, 1, 64) as other:
        assert not peer.is_current
        assert other.is_current
    peer.close()


def test_a_peer_with_other_fields_under_the_same_layout_is_refused(name: str) -> None:
    with SharedMemory.create(name, 1, 64, digest=7), SharedMemory.attach(name, 1, digest=7):
        for digest in (0, 8):
            with pytest.raises(LinkError, match="layout 1 with other fields"):
                SharedMemory.attach(name, 1, digest=digest)


def test_a_successor_with_other_fields_leaves_its_file_to_the_peers_of_a_dead_owner(name: str) -> None:
    kill(start_owner(name))
    peer = SharedMemory.attach(name, 1)
    with SharedMemory.create(name, 1, 64, digest=7) as successor:
        successor.words[HEADER_WORDS] = 1
        assert (peer.words[HEADER_WORDS], peer.is_current, successor.header.generation) == (42, False, 1)
    peer.close()


def test_a_peer_of_another_layout_or_without_an_owner_is_refused(name: str) -> None:
    with pytest.raises(LinkError, match="start the process that serves it"):
        SharedMemory.attach(name, 1)
    with SharedMemory.create(name, 1, 64), pytest.raises(LinkError, match="layout 1, this version expects 2"):
        SharedMemory.attach(name, 2)


def test_a_file_of_another_size_is_replaced_so_that_old_peers_keep_theirs(name: str) -> None:
    kill(start_owner(name))
    peer = SharedMemory.attach(name, 1)
    with SharedMemory.create(name, 2, 128) as owner:
        assert owner.words.size == 128
        assert peer.words[HEADER_WORDS] == 42
        assert not peer.is_current
    peer.close()


@pytest.mark.parametrize("bad", ["", "../etc", "a b", ".hidden", "a/b"])
def test_a_name_that_is_no_plain_file_name_is_refused(bad: str) -> None:
    with pytest.raises(ConfigError, match="cannot name shared memory"):
        segment_path(bad)


@pytest.mark.parametrize("short", ["file system", "memory"])
def test_no_room_in_shared_memory_is_an_error_and_leaves_the_name_free(name: str, short: str, monkeypatch) -> None:
    """Nothing is taken first: where the file system is as large as the memory, the kernel would kill for the rest."""
    free = os.statvfs("/dev/shm")
    too_many = (free.f_bavail * free.f_frsize) // 8 + (1 << 20)
    if short == "memory":
        monkeypatch.setattr("qrobot.realtime.shared_memory.available_bytes", lambda: 100_000)
        too_many = 100_000 // 8 + 1
    monkeypatch.setattr(os, "posix_fallocate", lambda *_: pytest.fail("room was taken"))
    with pytest.raises(LinkError, match="no room"):
        SharedMemory.create(name, 1, too_many)
    monkeypatch.undo()
    with SharedMemory.create(name, 1, 64) as owner:
        assert owner.words.size == 64


def test_what_a_dead_owner_has_left_is_no_room_that_is_wanted_and_stays_for_its_peers(name: str, monkeypatch) -> None:
    """A guardian that keeps a board safe looks at it still: a file cut short would end it by SIGBUS."""
    words = 1 << 16
    owner = SharedMemory.create(name, 1, words)
    owner.words[-1] = 5
    peer = SharedMemory.attach(name, 1)
    owner.close()
    monkeypatch.setattr("qrobot.realtime.shared_memory.available_bytes", lambda: 4096)
    again = SharedMemory.create(name, 1, words)
    assert peer.words.size == again.words.size == words
    again.words[-1] = 5
    again.close()

    def refuse(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", refuse)
    with pytest.raises(LinkError, match="no room"):
        SharedMemory.create(name, 1, words)
    assert peer.words[-1] in (0, 5)  # and no SIGBUS
    peer.close()


def test_closing_the_owner_frees_the_name_although_a_forked_child_lives(name: str) -> None:
    owner = SharedMemory.create(name, 1, 64)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(write)
        os.read(read, 1)  # until the parent closes its end
        os._exit(0)
    os.close(read)
    try:
        owner.close()
        with SharedMemory.create(name, 1, 64) as second:
            assert second.header.generation == 2
    finally:
        os.close(write)
        os.waitpid(child, 0)
