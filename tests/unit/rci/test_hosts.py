"""What processors on other hosts refuse, by themselves: settings, packets, functions, messages."""

from __future__ import annotations

import errno
import json
import os
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot import rci
from qrobot.errors import ConfigError, RemoteProtocolError, RogueTask, ServoFault
from qrobot.rci.descriptor import TaskDescriptor, local_area
from qrobot.rci.hosts import host_server, packets
from qrobot.rci.hosts.__main__ import main
from qrobot.rci.hosts.functions import function_named, name_of
from qrobot.rci.hosts.host_server import HostServer
from qrobot.rci.hosts.mail import Letterbox, collected
from qrobot.rci.hosts.session import connecting, listening
from qrobot.rci.hosts.settings import HOSTS_VARIABLE, find_host, load_host_settings
from qrobot.rci.task_runner import nothing
from qrobot.rci.task_table import TaskTable
from qrobot.wire import RobotState
from tests.support import rci_on_host
from tests.support.patience import PATIENCE_S
from tests.support.rci_tasks import pass_ticks, virtual_program

TOKEN = "0123456789abcdef" * 2
TLS = '\n[tls]\nauthority = "ca.pem"\ncertificate = "lab2.pem"\nkey = "lab2.key"\n'
PLAIN = 'name = "lab2"\nmodules = ["my_tasks"]\n'


def written(folder: Path, text: str) -> Path:
    for name in ("ca.pem", "lab2.pem", "lab2.key"):
        (folder / name).write_text("")
    (folder / "lab2.toml").write_text(text)
    return folder / "lab2.toml"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('endpoint = "tcp/192.168.7.2:7447"\n', "certificates of both ends are required"),
        ('endpoint = "tls/192.168.7.2:7447"\n', "go together"),
        ('endpoint = "tls/192.168.7.2:7447"\n' + TLS, "allow: name the programs"),
        ('endpoint = "tcp/127.0.0.1:7447"\nallow = ["planner"]\n', "known by their certificates"),
        ('endpoint = "udp/127.0.0.1:7447"\n', "tls/ADDRESS:PORT is needed"),
        ('endpoint = "tcp/127.0.0.1:99999"\n', "tls/ADDRESS:PORT is needed"),
        ('endpoint = "tcp/0.0.0.0:7447"\n', "beyond the loopback interface"),
        ('endpoint = "tls/127.0.0.1:7447"\nallow = ["planner"]\n' + TLS.replace("ca.pem", "no.pem"), "no file"),
        ('endpoint = "tcp/127.0.0.1:7447"\nallowed = []\n', "did you mean 'allow'"),
    ],
)
def test_a_host_that_anybody_could_reach_is_refused(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        load_host_settings(written(tmp_path, PLAIN + text))


def test_beyond_the_loopback_interface_both_ends_ask_for_certificates_and_the_host_for_known_ones(
    tmp_path: Path,
) -> None:
    text = PLAIN + 'endpoint = "tls/192.168.7.2:7447"\nallow = ["planner"]\n' + TLS
    settings = load_host_settings(written(tmp_path, text))
    entries = listening(settings)
    assert entries["transport/link/tls"]["enable_mtls"]
    assert entries["access_control"]["default_permission"] == "deny"
    assert entries["access_control"]["subjects"][0]["cert_common_names"] == ["planner"]
    answers = {rule["id"]: rule["flows"] for rule in entries["access_control"]["rules"]}
    assert answers == {"ask": ["ingress"], "answer": ["egress"]}
    assert connecting(settings)["transport/link/tls"]["verify_name_on_connect"]
    for each in (entries, connecting(settings)):
        assert not each["scouting/multicast/enabled"]
        assert each["transport/link/protocols"] == ["tls"]


def test_on_virtual_time_tasks_of_another_host_run_in_the_thread_of_the_program() -> None:
    with virtual_program() as runs:
        td = rci.rci_create("far", "host:lab2")
        rci.rci_control(td, lambda _td: runs.append((rci.rci_ticks(), "far")))
        rci.rci_onclock(td, 5)
        rci.rci_start(td.bit)
        pass_ticks(11)
    assert [tick for tick, _ in runs] == [0, 5, 10]


def test_hosts_are_known_from_the_file_that_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(HOSTS_VARIABLE, raising=False)
    with pytest.raises(ConfigError, match="QROBOT_HOSTS names no file"):
        find_host("lab2")
    path = tmp_path / "hosts.toml"
    path.write_text('[[host]]\nname = "lab2"\nendpoint = "tcp/127.0.0.1:7447"\n')
    monkeypatch.setenv(HOSTS_VARIABLE, str(path))
    assert find_host("lab2").on_loopback
    with pytest.raises(ConfigError, match="names lab2"):
        find_host("lab3")
    path.write_text(2 * '[[host]]\nname = "lab2"\nendpoint = "tcp/127.0.0.1:7447"\n')
    with pytest.raises(ConfigError, match="two hosts of one name"):
        find_host("lab2")


@pytest.mark.parametrize("full", [True, False])
def test_the_robots_of_a_silent_program_are_stopped_also_while_nobody_can_be_told(
    full: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its output is a file on a full disk, or a terminal that is held."""
    done: list[str] = []
    let_go, of_others = threading.Event(), set(threading.enumerate())

    def write(_text: str) -> None:
        if full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        assert let_go.wait(PATIENCE_S)

    def run(server: HostServer) -> None:
        server._program = SimpleNamespace(  # type: ignore[assignment]
            name="planner", look_after=lambda: None, farewell=lambda: done.append("farewell")
        )
        server._look_after()

    monkeypatch.setattr(HostServer, "run", run)
    monkeypatch.setattr(host_server, "time", SimpleNamespace(monotonic=lambda: 2.0 * host_server.SILENCE_S))
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(write=write, flush=lambda: None))
    assert main([str(written(tmp_path, PLAIN + 'endpoint = "tcp/127.0.0.1:7447"\n'))]) == 0
    let_go.set()
    for thread in set(threading.enumerate()) - of_others:
        if thread.name == "report":
            thread.join()  # it prints to an output that goes with this test
    assert done == ["farewell"]


# --- packets ---------------------------------------------------------------------------------------------------------


EXCHANGE = packets.ExchangePacket(
    session=TOKEN,
    mail=[packets.Mail(to=2, sender=1, data=bytes(range(256)))],
    room=True,
    allowed=[packets.AllowedTime(bit=2, ns=1)],
)


def test_packets_come_back_as_they_were() -> None:
    assert packets.decode_request(packets.encode(EXCHANGE)) == EXCHANGE
    q = (0.1, np.nextafter(1.0, 2.0), -1e-300)
    how = RobotState(t_ns=1 << 62, mode=2, q=q, v=q, tau=q, q_setpoint=q)
    assert packets.how_of(json.loads(json.dumps(packets.sample_of(how))), 3) == how
    with pytest.raises(RemoteProtocolError, match="a robot's state with q "):
        packets.how_of(packets.sample_of(how), 4)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_packet_are_refused(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match="no packet"):
        packets.decode_request(data)


json_values = st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), st.lists, max_leaves=4)


@given(st.sampled_from(sorted(packets.ExchangePacket.model_fields)), json_values)
def test_a_packet_with_a_field_of_any_other_kind_is_refused_or_is_that_packet(field: str, value: object) -> None:
    data = json.dumps(json.loads(packets.encode(EXCHANGE)) | {field: value}).encode()
    try:
        found = packets.decode_request(data)
    except RemoteProtocolError:
        return
    assert getattr(found, field) == value


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"session": "0"}, "session"),
        ({"mail": [{"to": 2, "sender": 1, "data": ""}]}, "mail.0.data"),
        ({"mail": [{"to": 2, "sender": 1, "data": "A" * 6000}]}, "mail.0.data"),
        ({"mail": [{"to": 0, "sender": 1, "data": "AA=="}]}, "mail.0.to"),
        ({"mail": [{"to": 2, "sender": 1, "data": "AA=="}] * 65}, "mail"),
        ({"more": 1}, "more"),
        ({"kind": "run"}, "tag"),
    ],
)
def test_what_exceeds_the_limits_of_a_packet_is_named(change: dict[str, object], named: str) -> None:
    with pytest.raises(RemoteProtocolError, match=named):
        packets.decode_request(json.dumps(json.loads(packets.encode(EXCHANGE)) | change).encode())
    with pytest.raises(RemoteProtocolError, match="are the most"):
        packets.decode_request(bytes(packets.MOST_BYTES + 1))


def test_errors_stay_of_our_own_tree_and_others_become_text() -> None:
    fault = packets.error_of(packets.failure_of(ServoFault(7, "following error")), "lab2")
    assert isinstance(fault, ServoFault)
    assert (fault.code, str(fault)) == (7, "following error")
    assert isinstance(packets.error_of(packets.failure_of(RogueTask("late")), "lab2"), RogueTask)
    assert str(packets.error_of(packets.failure_of(LookupError("no sensor")), "lab2")) == (
        "LookupError on host lab2: no sensor"
    )


# --- functions and messages ------------------------------------------------------------------------------------------


def test_a_host_calls_no_function_but_those_that_its_modules_define() -> None:
    name = name_of(rci_on_host.answer, "task")
    assert function_named(name, [rci_on_host.__name__]) is rci_on_host.answer
    assert function_named(name_of(nothing, "task"), []) is nothing
    for refused in ("os:system", "tests.support.rci_on_host:os", "tests.support.rci_on_host:rci.rci_send", "no_module"):
        with pytest.raises(ConfigError, match=r"not offered|defines no function"):
            function_named(refused, [rci_on_host.__name__])
    with pytest.raises(ConfigError, match="no_module fails on this host"):
        function_named("no_module:run", ["no_module"])
    with pytest.raises(ConfigError, match="define them in a module"):
        name_of(lambda: None, "task")


def test_messages_arrive_in_their_order_and_wait_for_room() -> None:
    """A lane has room for fewer messages than are sent here."""
    tables, stamps = [TaskTable(iter(range(10**6)).__next__) for _ in range(2)], [b"%3d" % k * 300 for k in range(8)]
    (here, there), (_, copy) = (
        [TaskDescriptor(name, bit, "host", local_area()) for name, bit in (("parent", 1), ("far", 2))] for _ in tables
    )
    for table, tds in zip(tables, ((here, there), (here, copy)), strict=True):
        for td in tds:
            table.add(td)
    box = Letterbox({2: copy}, {1}, iter(range(10**6)).__next__)
    got: list[bytes] = []
    for data in stamps:
        assert tables[0].send(here, 2, data) == len(data)
        box.take(collected(tables[0], [there]))
    assert not box.room
    while not box.room or len(got) < len(stamps):
        got.append(tables[1].receive(copy, 1)[0])
        box.take([])
    assert got == stamps
    with pytest.raises(RemoteProtocolError, match="which are no such tasks"):
        box.take([packets.Mail(to=2, sender=4, data=b"x")])
