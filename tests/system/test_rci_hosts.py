"""Processors of RCI on other hosts, here another process on the loopback interface: tasks, messages, ends, access."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot import rci
from qrobot.errors import ConfigError, LinkBusy, LinkError, LinkLost, RogueTask
from qrobot.modecodes import Mode
from qrobot.rci import TaskDescriptor, TaskState
from qrobot.rci.hosts.remote_processor import RemoteProcessor
from qrobot.rci.hosts.session import answer_questions, connecting, open_session
from qrobot.rci.hosts.settings import HOSTS_VARIABLE, find_host
from tests.support import rci_on_host as functions
from tests.support.full_pipe import fill
from tests.support.patience import wait_until
from tests.support.processes import RunningArm, free_port

pytest.importorskip("zenoh")
pytestmark = pytest.mark.realtime
ROOT = Path(__file__).parents[2]
HOSTS = '[[host]]\nname = "lab2"\nendpoint = "{endpoint}"\n'


class RunningHost:
    """A host on the loopback interface."""

    def __init__(self, folder: Path, endpoint: str, rest: str = "", output: int = subprocess.PIPE) -> None:
        self.settings = folder / "lab2.toml"
        modules = f"modules = [{functions.__name__!r}]\n"
        self.settings.write_text(f'name = "lab2"\nendpoint = "{endpoint}"\n{modules}{rest}')
        command = [sys.executable, "-m", "qrobot.rci.hosts", str(self.settings)]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=output, text=True)
        if output == subprocess.PIPE:
            self.await_line("waits for a program")

    def await_line(self, text: str) -> str:
        """The next line of its output that has a text."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if text in line:
                return line
        raise AssertionError(f"the host has ended with {self.process.wait()}")

    def close(self) -> None:
        """End it."""
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="module")
def loopback(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningHost]:
    """A host that all tests here use, one after the other."""
    folder, endpoint = tmp_path_factory.mktemp("hosts"), f"tcp/127.0.0.1:{free_port()}"
    (folder / "hosts.toml").write_text(HOSTS.format(endpoint=endpoint))
    running = RunningHost(folder, endpoint)
    yield running
    running.close()


@pytest.fixture
def host(loopback: RunningHost, monkeypatch: pytest.MonkeyPatch) -> Iterator[RunningHost]:
    """A program that knows the host, of which nothing is left behind."""
    monkeypatch.setenv(HOSTS_VARIABLE, str(loopback.settings.parent / "hosts.toml"))
    rci.rci_clock(1000)
    yield loopback
    rci.rci_close()


def task(name: str, control, startup=None, where: str = "host:lab2") -> TaskDescriptor:
    td = rci.rci_create(name, where)
    rci.rci_control(td, control, None, startup)
    rci.rci_onclock(td, 5)
    return td


def heard() -> tuple[bytes, TaskDescriptor]:
    """The next message for the program."""
    found: list[tuple[bytes, TaskDescriptor]] = []

    def look() -> bool:
        data, sender = rci.rci_receive()
        if sender is not None:
            found.append((data, sender))
        return bool(found)

    rci.rci_wait(look)
    return found[0]


def test_a_task_on_another_host_answers_messages_and_interrupts_and_ends_there_when_it_turns_rogue(
    host: RunningHost,
) -> None:
    impostor, asked = open_session(connecting(find_host("lab2")), "the host"), list[object]()
    answer_questions(impostor, "lab2", "**", lambda data: asked.append(data) or b"")
    (info,) = (each for each in rci.rci_processors() if each.name == "host:lab2")
    assert (info.available, "Python" in info.description) == (True, True)
    td, wants = task("far", functions.answer, functions.introduce), task("wants", functions.reach)
    here = task("here", functions.answer, None, "host")
    rci.rci_shared_memory("counts", 8)
    with pytest.raises(ConfigError, match="define them in a module"):
        rci.rci_control(td, lambda _td: None)
    with pytest.raises(ConfigError, match="a device belongs to one host"):
        rci.rci_device_interrupt(td, 0)
    interrupts: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: interrupts.append(number))
    try:
        rci.rci_start(td.bit)
        process = int(heard()[0].removeprefix(b"process "))
        assert process == host.process.pid
        before_it = rci.rci_ticks()
        assert rci.rci_send(td.bit, b"how far") == 7
        answer, sender = heard()
        assert sender is td
        assert answer.startswith(b"HOW FAR ")
        assert before_it <= int(answer.split()[-1]) <= rci.rci_ticks() + 1
        rci.rci_send(td.bit, b"interrupt")
        rci.rci_wait(lambda: interrupts)
    finally:
        signal.signal(signal.SIGUSR1, before)
    with pytest.raises(LinkBusy, match="runs program"):
        RemoteProcessor("host:lab2", lambda: None)
    rci.rci_start(wants.bit)
    with pytest.raises(ConfigError, match="does not reach tasks on host lab2: send them messages"):
        rci.rci_wait(lambda: False)
    assert (wants.state, td.state) == (TaskState.ENDED, TaskState.ACTIVE)
    assert asked == []  # nobody answers in the place of the host
    impostor.close()
    rci.rci_release(td.bit)
    assert td.state is TaskState.RELEASED
    assert td.runs > 0
    with pytest.raises(ConfigError, match=r"module 'tests.support.processes' is not offered"):
        rci.rci_control(td, free_port)
    rci.rci_timeout(td, 0.05)
    rci.rci_control(td, functions.hang)
    rci.rci_start(td.bit | here.bit)
    with pytest.raises(RogueTask, match="far does not return"):
        rci.rci_wait(lambda: False)
    assert (td.state, here.state) == (TaskState.ENDED, TaskState.ACTIVE)
    rci.rci_close()
    host.await_line("waits for a program")


def test_memory_for_a_task_on_another_host_and_programs_of_others_are_refused_before_anything_starts(
    host: RunningHost, monkeypatch: pytest.MonkeyPatch
) -> None:
    td = task("far", functions.answer)
    rci.rci_shared_memory("numbers", 8, None, td.bit)
    with pytest.raises(ConfigError, match=r"'numbers' does not reach tasks on host lab2: send them messages"):
        rci.rci_start(td.bit)
    rci.rci_close()
    td = task("far", functions.answer)
    monkeypatch.setenv("QROBOT_TOKEN", "that of a bridge")  # is for no host
    monkeypatch.setattr("qrobot.rci.hosts.remote_processor.token_of_file", lambda *_: b"that of somebody else")
    with pytest.raises(LinkError, match="cannot read the token"):
        rci.rci_start(td.bit)


def test_an_arm_stops_when_its_program_is_silent_and_when_its_host_is(host: RunningHost, arm: RunningArm) -> None:
    """A stopped process is a host or a program whose link is silent: nothing is closed."""
    rci.rci_robot("arm", "puma560", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
    td, here = task("arm", functions.swing), task("here", functions.answer, None, "host")
    rci.rci_onclock(td, 100)
    rci.rci_start(td.bit | here.bit)
    rci.rci_wait(lambda: td.runs > 5)
    assert arm.mode is Mode.TRACKING
    assert td.how.n == 6
    os.kill(host.process.pid, signal.SIGSTOP)
    with pytest.raises(LinkLost, match=r"processor host:lab2 is lost: host lab2 at .* does not answer"):
        rci.rci_wait(lambda: False)
    assert (td.state, here.state) == (TaskState.ENDED, TaskState.ACTIVE)
    arm.wait_for(Mode.HOLDING)
    runs = here.runs
    rci.rci_wait(lambda: here.runs > runs + 5)
    os.kill(host.process.pid, signal.SIGCONT)
    host.await_line("is silent; its robots are stopped")
    rci.rci_close()
    host.await_line("waits for a program")


def test_a_host_that_is_not_there_or_is_another_is_refused(
    host: RunningHost, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match="no host 'lab3'"):
        rci.rci_create("far", "host:lab3")
    monkeypatch.setattr("qrobot.rci.hosts.remote_processor.FRESH_S", 0.0)
    path = tmp_path / "hosts.toml"
    monkeypatch.setenv(HOSTS_VARIABLE, str(path))
    path.write_text(f'[[host]]\nname = "lab2"\nendpoint = "tcp/127.0.0.1:{free_port()}"\n')
    with pytest.raises(LinkLost, match="cannot be reached"):
        rci.rci_create("far", "host:lab2")
    path.write_text((host.settings.parent / "hosts.toml").read_text().replace("lab2", "lab4"))
    with pytest.raises(LinkError, match="does not answer"):
        rci.rci_create("far", "host:lab4")


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


def certificate(folder: Path, name: str) -> None:
    """A certificate of this name for the loopback interface, signed by the authority of the folder."""
    openssl(folder, "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", f"{name}.key")
    openssl(folder, "req", "-new", "-key", f"{name}.key", "-subj", f"/CN={name}", "-out", f"{name}.csr")
    (folder / "extensions").write_text("subjectAltName=IP:127.0.0.1\n")
    signed_by = ("-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-days", "2", "-extfile", "extensions")
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", *signed_by, "-out", f"{name}.pem")


def authority(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    openssl(folder, "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", "ca.key")
    openssl(folder, "req", "-x509", "-new", "-key", "ca.key", "-subj", "/CN=authority", "-days", "2", "-out", "ca.pem")


@pytest.mark.skipif(shutil.which("openssl") is None, reason="certificates are made by openssl")
def test_a_host_that_asks_for_certificates_serves_the_programs_of_its_list_alone_until_it_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trusted, foreign = tmp_path / "trusted", tmp_path / "foreign"
    for folder in (trusted, foreign):
        authority(folder)
        certificate(folder, "planner")
    for name in ("lab2", "stranger"):
        certificate(trusted, name)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    own = '[tls]\nauthority = "ca.pem"\ncertificate = "lab2.pem"\nkey = "lab2.key"\n'
    host = RunningHost(trusted, endpoint, f'allow = ["planner"]\n{own}')
    monkeypatch.setattr("qrobot.rci.hosts.remote_processor.FRESH_S", 0.0)
    monkeypatch.setenv(HOSTS_VARIABLE, str(tmp_path / "hosts.toml"))

    def asked(who: str, authority: str = "trusted/ca.pem") -> None:
        tls = f'authority = "{authority}", certificate = "{who}.pem", key = "{who}.key"'
        table = f'[[host]]\nname = "lab2"\nendpoint = "{endpoint}"\ntls = {{ {tls} }}\n'
        (tmp_path / "hosts.toml").write_text(table)
        td = task("far", functions.answer, functions.introduce)
        rci.rci_start(td.bit)
        assert heard()[0].startswith(b"process ")

    try:
        with pytest.raises(LinkError, match="has not the certificate of this program"):
            asked("trusted/stranger")
        for who, authority_ in (("foreign/planner", "trusted/ca.pem"), ("trusted/planner", "foreign/ca.pem")):
            with pytest.raises(LinkError):
                asked(who, authority_)
            rci.rci_close()
        asked("trusted/planner")
        host.process.kill()
        with pytest.raises(LinkLost, match="processor host:lab2 is lost"):
            rci.rci_wait(lambda: False)
    finally:
        rci.rci_close()
        host.close()


@pytest.mark.thorough
def test_a_host_whose_output_nobody_reads_serves_one_program_after_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hosts.toml").write_text(HOSTS.format(endpoint=(endpoint := f"tcp/127.0.0.1:{free_port()}")))
    monkeypatch.setenv(HOSTS_VARIABLE, str(tmp_path / "hosts.toml"))

    def served() -> bool:
        rci.rci_clock(1000)
        try:
            rci.rci_start(task("far", functions.answer).bit)
        except LinkError:  # it begins, or begins anew
            return False
        finally:
            rci.rci_close()
        return True

    source, sink = os.pipe()
    fill(sink)
    host = RunningHost(tmp_path, endpoint, output=sink)
    try:
        for _ in range(2):
            wait_until(served, "the host serves a program")
    finally:
        os.close(source)
        os.close(sink)
        host.close()
