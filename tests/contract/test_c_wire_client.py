"""The client in C says what the codec says, judges what it hears as the Python client does, and survives every server.

The program of tests/support/wire_client.c is built with the sanitizers: whatever they find ends it with an error.
"""

from __future__ import annotations

import os
import random
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from math import nan
from pathlib import Path
from zlib import crc32

import pytest

from qrobot.errors import RemoteProtocolError
from qrobot.printable import CONTROL_RANGES, printable
from qrobot.wire import (
    AnalogOutputs,
    Bye,
    ClientRole,
    Collision,
    CollisionReaction,
    Command,
    Connection,
    Conversation,
    ErrorCode,
    Hello,
    Payload,
    RobotFlag,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
    WireEvent,
)
from qrobot.wire.codec import encode
from qrobot.wire.vocabulary import Request
from tests.support.bridge import Bridge
from tests.support.mutants import N, mutant
from tests.support.packets import resting
from tests.support.patience import PATIENCE_MS, PATIENCE_S, give_time, wait_until

ROOT = Path(__file__).parents[2]
PERIOD_NS = 5_000_000  # of the sample periods that "talk" of the program asks for
HEADER = ROOT / "qrobot/wire/c"
COMPILERS = [found for name in ("gcc", "clang") if (found := shutil.which(name))] or [shutil.which("cc") or ""]
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
SANITIZED = ["-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
PATIENT = f"-DQROBOT_LINGER_MS={PATIENCE_MS:.0f}"
HEARD = (Conversation.GREETING, Conversation.ANSWERING, Conversation.COMMANDING, Conversation.OBSERVING)
OK, TIMEOUT, LOST, REFUSED, BROKEN, INVALID = 0, -1, -2, -3, -4, -5

pytestmark = pytest.mark.skipif(not COMPILERS[0], reason="no C compiler: apt install gcc")


def build(compiler: str, source: Path, target: Path, *flags: str) -> Path:
    command = [compiler, *STRICT, *flags, f"-I{HEADER}", "-o", target, source, "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return target


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("c") / "wire_client"
    return build(COMPILERS[0], ROOT / "tests/support/wire_client.c", target, *SANITIZED, PATIENT)


NO_NUMBERS = " ".join(["nan"] * 8)  # signals of a command
ASAN_OPTIONS = "detect_leaks=0:verify_asan_link_order=0"  # a library is preloaded where the clock is scaled


def address_of(bridge: Bridge) -> str:
    host, port = bridge.server.address
    return f"{host}:{port}"


def ran(client: Path, *arguments: str, data: bytes = b"", bridge: str = "") -> tuple[int, str, list[str]]:
    """Status of the program, what it complains of, and the lines that it prints."""
    environment = os.environ | {"QROBOT_BRIDGE": bridge, "ASAN_OPTIONS": ASAN_OPTIONS}
    answer = subprocess.run(
        [client, *arguments], input=data, capture_output=True, timeout=PATIENCE_S, env=environment, check=False
    )
    return answer.returncode, answer.stderr.decode(), answer.stdout.decode().splitlines()


def ask(client: Path, *arguments: str, data: bytes = b"", bridge: str = "") -> list[str]:
    """Lines that the program prints; whatever a sanitizer has to say fails the test."""
    status, complaint, lines = ran(client, *arguments, data=data, bridge=bridge)
    assert (status, complaint) == (0, "")
    return lines


# --------------------------------------------------------------------------------------------------- the header itself


@pytest.mark.parametrize("compiler", COMPILERS, ids=lambda path: Path(path).name)
@pytest.mark.parametrize("level", ["-O0", "-O2"])
def test_header_and_example_compile_without_a_warning(compiler: str, level: str, tmp_path: Path) -> None:
    example = ROOT / "examples/c/swing_one_joint.c"
    program = build(compiler, example, tmp_path / "swing", level)
    assert subprocess.run([program], capture_output=True, check=False).returncode == 2


def test_headers_of_the_system_that_hide_what_it_needs_are_told_of(tmp_path: Path) -> None:
    source = tmp_path / "late.c"
    source.write_text('#include <stdio.h>\n#include "qrobot_wire.h"\nint main(void) { return 0; }\n')
    with pytest.raises(subprocess.CalledProcessError) as refused:
        build(COMPILERS[0], source, tmp_path / "late")
    assert "include qrobot_wire.h before the system's headers" in refused.value.stderr
    build(COMPILERS[0], source, tmp_path / "late", "-D_POSIX_C_SOURCE=200809L")


REACHING = """
#include "qrobot_wire.h"
#include <string.h>
int main(int argc, char **argv)
{
    static struct qrobot_link link = {.fd = -1};

    qrw_find_token(&link, "127.0.0.1", 1);
    if (argc != 2 || strcmp(link.token, "cell") != 0)
        return 1;
    return qrw_reach(&link, "127.0.0.1", atoi(argv[1])) == 0 && link.fd > 2 ? 0 : 2;
}
"""


def test_a_connection_is_no_standard_stream_and_blanks_are_no_part_of_a_token(tmp_path: Path) -> None:
    """A program that was started with its stdout closed would print to the bridge."""
    source = tmp_path / "reach.c"
    source.write_text(REACHING)
    program = build(COMPILERS[0], source, tmp_path / "reach", *SANITIZED)
    environment = os.environ | {"QROBOT_TOKEN": " cell\r\n", "ASAN_OPTIONS": ASAN_OPTIONS}
    with socket.create_server(("127.0.0.1", 0)) as listener:
        command = ["sh", "-c", 'exec "$@" <&- >&-', "sh", program, str(listener.getsockname()[1])]
        assert subprocess.run(command, env=environment, check=False).returncode == 0


def test_the_program_of_the_page_shows_where_the_joints_are(tmp_path: Path) -> None:
    page = (ROOT / "docs/how-to/connect-an-existing-rccl.md").read_text()
    source = tmp_path / "look.c"
    source.write_text(page.split("```c\n")[1].split("```")[0])
    program = build(COMPILERS[0], source, tmp_path / "look")
    with Bridge() as bridge:
        shown: list[str] = []

        def shows_them() -> bool:  # it waits for 2 s, in which a bridge may have no turn
            status, complaint, shown[:] = ran(program, bridge=address_of(bridge))
            assert (status, complaint) == (0, "") or "has fallen silent" in complaint
            return status == 0

        wait_until(shows_them, "the bridge answers")
    assert shown == [f"joint {joint} of puma560: 0.0000" for joint in range(1, 7)]


# ------------------------------------------------------------------------------------------------------------- bytes


def a_command(rng: random.Random) -> Command:
    n = rng.randint(1, 32)
    words = [rng.getrandbits(32) for _ in range(4)]
    return Command(
        words[0], tuple(rng.randint(0, 2) for _ in range(n)), tuple(rng.uniform(-1e6, 1e6) for _ in range(n)),
        *(rng.random() < 0.5 for _ in range(3)), stream=words[1], hand=rng.randint(0, 2), outputs=words[2],
        ack=words[3], t_ns=rng.randint(-(1 << 63), (1 << 63) - 1), signals=tuple(rng.gauss(0, 1) for _ in range(8)),
    )  # fmt: skip


def written(command: Command) -> str:
    """A command as the program reads it."""
    requests = command.power | command.clear_fault << 1 | command.stop << 2
    joints = " ".join(f"{m} {s.hex()}" for m, s in zip(command.modes, command.setpoints, strict=True))
    head = (command.n, command.seq, command.ack, command.t_ns, command.stream, command.outputs, requests, command.hand)
    return " ".join((*map(str, head), joints, *(signal.hex() for signal in command.signals)))


def test_commands_made_in_c_are_those_of_the_codec_byte_by_byte(client: Path) -> None:
    rng = random.Random(7)
    commands = [a_command(rng) for _ in range(300)]
    lines = ask(client, "commands", data="\n".join(map(written, commands)).encode())
    assert lines == [f"made {encode(command).hex()}" for command in commands]


@pytest.mark.parametrize(
    ("text", "objection"),
    [
        ("1 1 0 0 0 0 1 0 1 nan", "a setpoint is not a number of sane size"),
        ("1 1 0 0 0 0 1 0 1 -inf", "a setpoint is not a number of sane size"),
        ("1 1 0 0 0 0 3 0 1 1.1e6", "a setpoint is not a number of sane size"),
        ("1 1 0 0 0 0 0 0 3 0.0", "there is no such joint mode"),
        ("1 1 0 0 0 0 0 3 1 0.0", "there is no such state of the hand"),
        ("1 1 0 0 0 0 65536 0 1 0.0", "requests have 16 bits"),
    ],
)
def test_a_command_nobody_could_follow_is_not_sent(client: Path, text: str, objection: str) -> None:
    assert ask(client, "commands", data=f"{text} {NO_NUMBERS}".encode()) == [f"refused command 1: {objection}"]


@pytest.mark.parametrize("requests", range(32))
def test_a_stop_and_a_power_off_are_sent_whatever_the_setpoint_beside_them(client: Path, requests: int) -> None:
    text = "\n".join(f"1 1 0 0 0 0 {requests} 0 1 {wrong} {NO_NUMBERS}" for wrong in ("nan", "inf", "-1.1e6"))
    takes_away = not requests & Request.POWER or requests & Request.STOP
    answers = ask(client, "commands", data=text.encode())
    assert [answer.split()[0] for answer in answers] == ["made" if takes_away else "refused"] * 3


def test_what_is_said_beside_the_periods_is_what_the_codec_makes_of_it(client: Path) -> None:
    load = Payload(2.5, (0.1, 0.2, 0.3), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 3)
    names = tuple(str(k) * 30 for k in "abcdefgh")
    met = Collision((30.0, 40.0, 20.0, 2.0, 2.0, 0.0), CollisionReaction.COMPLY, 5)
    volts = AnalogOutputs((nan, 2.5, nan, nan, nan, nan, nan, -1.0), 6)
    packets = Stop(t_ns=1), load, met, volts, Signals(names, 2), Stop(power_off=True, t_ns=4)
    lines = ask(client, "others", " ".join(names), "2.5")
    assert lines == [f"made {encode(packet).hex()}" for packet in packets]
    for wrong in ("1st", "two  blanks", " before", "behind ", "grö", "x" * 32, "a b c d e f g h i", "ab a b ab"):
        assert ask(client, "others", wrong, "1")[4].startswith("refused signals")


@pytest.mark.parametrize("reason", ["", "done", "x" * 512, "x" * 600, "x" * 511 + "é"])
def test_greeting_and_farewell_are_those_of_the_codec(client: Path, reason: str) -> None:
    lines = ask(client, "greet", "1", "puma560", "prüfung", "28000", reason, "0")
    packets = Hello(ClientRole.COMMANDER, "puma560", "prüfung", 28_000, t_ns=7), Bye(reason, 8)
    assert lines == [f"made {encode(packet).hex()}" for packet in packets]


@pytest.mark.parametrize(
    ("role", "robot", "objection"), [("3", "puma560", "unknown role 3"), ("1", "x" * 65, "names have at most 64 bytes")]
)
def test_a_greeting_that_does_not_fit_is_not_sent(client: Path, role: str, robot: str, objection: str) -> None:
    assert ask(client, "greet", role, robot, "", "0", "", "0") == [f"refused {objection}"]


def test_a_greeting_asks_for_samples_in_step_as_the_codec_does(client: Path) -> None:
    lines = ask(client, "greet", "1", "puma560", "twin", "28000", "", "1")
    packet = Hello(ClientRole.COMMANDER, "puma560", "twin", 28_000, t_ns=7, in_step=True)
    assert lines[0] == f"made {encode(packet).hex()}"


# ---------------------------------------------------------------------------------------------------------- judgement


def doubles(numbers: Sequence[float]) -> str:
    return " ".join(struct.pack(">d", number).hex() for number in numbers)


def told(event: WireEvent) -> str:
    """An event as the program prints it."""
    match event:
        case Welcome():
            return f"welcome {event.role} {event.n} {event.period_us} robot {event.robot.encode().hex()}"
        case State(robot=robot):
            flags = robot.flags | RobotFlag.YOU_COMMAND * event.you_command | RobotFlag.COMMANDED * event.commanded
            head = (
                event.seq, event.ack, robot.t_ns, robot.n, robot.mode, robot.fault, robot.event, robot.event_joint,
                flags, robot.late_cycles, robot.missed_frames, event.dropped, robot.inputs, robot.hand,
                robot.outputs,
            )  # fmt: skip
            numbers = robot.speed_limit, robot.tool_speed_limit, robot.override, robot.payload_mass
            vectors = (*robot.q, *robot.v, *robot.tau, *robot.q_setpoint, *robot.force, *numbers, *robot.sensors)
            return f"state {' '.join(str(int(x)) for x in head)} {doubles(vectors)}"
        case WireError():
            word = f"complaint {event.code:d} warning" if not event.fatal else "refused" if event.code else "over"
            return f"{word} {event.text.encode()[:512].hex()}"
        case Bye():
            return f"over {event.text.encode()[:512].hex()}"
    raise AssertionError(f"a client never hears {event}")


def judged(phase: Conversation, data: bytes) -> list[str]:
    """What the Python client makes of these bytes."""
    connection, lines = Connection(Side.CLIENT), []
    connection.conversation, connection.n = phase, N
    try:
        connection.receive_data(data)
        while (event := connection.next_event()) is not None:
            lines.append(told(event))
    except RemoteProtocolError:
        lines.append("broken")
    return lines


def record(phase: Conversation, data: bytes) -> bytes:
    return struct.pack("<BBH", HEARD.index(phase), N, len(data)) + data


def test_whatever_comes_both_clients_judge_it_alike(client: Path) -> None:
    """The corpus of tests/property/test_wire_fuzz.py, one to four packets in a row."""
    rng = random.Random(59)
    talks = [(rng.choice(HEARD), b"".join(mutant(rng) for _ in range(rng.randint(1, 4)))) for _ in range(15_000)]
    lines = ask(client, "judge", data=b"".join(record(*talk) for talk in talks))
    expected = [judged(*talk) for talk in talks]
    assert lines == [line for answer in expected for line in (*answer, ".")]
    heard = Counter(line.split()[0] for answer in expected for line in answer)
    assert min(heard[word] for word in ("welcome", "state", "refused", "over", "broken")) > 100


def test_noise_without_any_structure_is_no_packet(client: Path) -> None:
    rng = random.Random(60)
    noise = [rng.randbytes(rng.randrange(8, 2_000)) for _ in range(500)]
    lines = ask(client, "judge", data=b"".join(record(Conversation.COMMANDING, data) for data in noise))
    assert lines == ["broken", "."] * len(noise)


CONTROLS = "".join(chr(code) for first, last in CONTROL_RANGES for code in range(max(1, first - 1), last + 2))
PLAIN = ["", "ok", "x" * 512, "x" * 600, "x" * 511 + "é", "\u20ac" * 300, "\U0001f916"]


@pytest.mark.parametrize("text", [*PLAIN, CONTROLS, "x" * 511 + "\x1b[2J", "\u202e" * 600])
def test_texts_are_cut_after_a_whole_character_and_control_characters_are_replaced(client: Path, text: str) -> None:
    warning = WireError(ErrorCode.SERVO_GONE, "", fatal=False)
    frame = bytearray(encode(warning)[:-4]) + text.encode() + bytes(-len(text.encode()) % 4)
    frame[6:8] = (len(frame) + 4).to_bytes(2, "little")
    lines = ask(client, "judge", data=record(Conversation.OBSERVING, bytes(frame) + crc32(frame).to_bytes(4, "little")))
    read = printable(text).encode()[:512].decode(errors="ignore")
    assert lines == [f"complaint {ErrorCode.SERVO_GONE:d} warning {read.encode().hex()}", "."]


# ------------------------------------------------------------------------------------------------------------- sockets


@contextmanager
def server(serve: Callable[[socket.socket], object]) -> Iterator[str]:
    """Serves one client in a thread; gives the address."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(PATIENCE_S)

        def accept() -> None:
            with suppress(OSError), listener.accept()[0] as near:
                near.settimeout(PATIENCE_S)
                serve(near)

        thread = threading.Thread(target=accept)
        thread.start()
        yield f"127.0.0.1:{listener.getsockname()[1]}"
        thread.join()


def talk(
    client: Path,
    bridge: str,
    periods: int = 1_000,
    robot: str = "puma560",
    patience_ms: int = round(PATIENCE_MS),
    in_step: bool = False,
):
    """(status, refusal, seq, ack, error) of a program that holds the arm for so many periods."""
    (line,) = ask(client, "talk", robot, str(periods), str(patience_ms), str(int(in_step)), bridge=bridge)
    status, refusal, seq, ack, error = line.split(" ", 4)
    return int(status), int(refusal), int(seq), int(ack), error


def welcome(near: socket.socket) -> Connection:
    connection = Connection(Side.SERVER)
    connection.receive_data(near.recv(4096))
    assert isinstance(connection.next_event(), Hello)
    near.sendall(connection.send(Welcome(ClientRole.COMMANDER, "puma560", 2, 5_000)))
    return connection


@pytest.mark.realtime
def test_every_state_is_answered_and_the_bridge_takes_every_answer(client: Path) -> None:
    with Bridge() as bridge:
        status, _, seq, ack, error = talk(client, address_of(bridge), periods=50)
        assert (status, error) == (OK, "")
        wait_until(lambda: len(bridge.port.frames) == 50, "each answer")
        answered = [frame.seq for frame in bridge.port.frames]
    assert answered == sorted(set(answered))
    assert seq > answered[-1]
    assert ack in answered[-3:]  # of a STATE that left before the newest ones came, where both ends are late


@pytest.mark.realtime
def test_in_step_the_number_of_a_state_is_that_of_its_period_on_the_bridges_clock(client: Path) -> None:
    with Bridge() as bridge:
        before = time.monotonic_ns() // PERIOD_NS
        status, _, seq, *_ = talk(client, address_of(bridge), periods=5, in_step=True)
        assert status == OK
        assert before + 5 <= seq <= time.monotonic_ns() // PERIOD_NS + 1


def test_a_refusal_arrives_with_its_code_and_reason(client: Path) -> None:
    with Bridge() as bridge:
        address = address_of(bridge)
        status, refusal, *_, error = talk(client, address, robot="stanford")
        assert (status, refusal) == (REFUSED, ErrorCode.WRONG_ROBOT)
        assert error == f"the bridge at {address} refused: this is 'puma560', not 'stanford'"
        with bridge.connect() as first:
            first.join()
            assert talk(client, address)[:2] == (REFUSED, ErrorCode.COMMANDER_BUSY)


def end_when_commanded(bridge: Bridge) -> None:
    wait_until(lambda: bridge.port.frames)
    bridge.begin_to_end()


def test_a_bridge_that_ends_says_goodbye(client: Path) -> None:
    with Bridge() as bridge:
        ending = threading.Thread(target=end_when_commanded, args=(bridge,))
        ending.start()
        status, *_, error = talk(client, address_of(bridge), periods=1_000_000)
        ending.join()
    assert status == REFUSED
    assert "said goodbye" in error


def test_a_servo_that_is_away_is_a_silence_with_last_words(client: Path) -> None:
    last_words = "has fallen silent; its last words: the servo of puma560 does not run; this connection waits for it"
    patience_ms = (1_000 << k for k in range(10))  # until it is enough for a bridge that may have no turn
    with Bridge() as bridge:
        bridge.port.running = False

        def tells_them() -> bool:
            status, *_, error = talk(client, address_of(bridge), patience_ms=next(patience_ms))
            assert status in (TIMEOUT, REFUSED)  # such a bridge may still have the program before
            return error.endswith(last_words)

        wait_until(tells_them, "its last words")


def test_a_server_that_says_nothing_is_given_up(client: Path) -> None:
    with server(lambda near: near.recv(4096) and near.recv(4096)) as address:
        status, *_, error = talk(client, address, patience_ms=50)
    assert (status, error) == (TIMEOUT, f"the bridge at {address} has fallen silent")


def test_a_server_that_hangs_up_is_a_lost_link(client: Path) -> None:
    with server(welcome) as address:
        status, *_, error = talk(client, address)
    assert status == LOST
    assert f"the bridge at {address}" in error


def test_a_server_that_talks_nonsense_is_said_to(client: Path) -> None:
    with server(lambda near: near.sendall(b"HTTP/1.1 400 Bad Request\r\n")) as address:
        status, *_, error = talk(client, address)
    assert (status, error) == (BROKEN, f"the bridge at {address} sent what is no packet")


def test_packets_arrive_in_pieces_of_any_size(client: Path) -> None:
    def dribble(near: socket.socket) -> None:
        connection = welcome(near)
        for seq in range(1, 5):
            for byte in connection.send(State(seq, resting((0.1, 0.2)))):
                near.sendall(bytes([byte]))
            near.recv(4096)  # the command that answers it; after the last one the farewell

    with server(dribble) as address:
        status, _, seq, _, error = talk(client, address, periods=3)
    assert (status, seq, error) == (OK, 4, "")


def test_of_several_states_the_newest_counts(client: Path) -> None:
    def burst(near: socket.socket) -> None:
        connection = welcome(near)
        near.sendall(b"".join(connection.send(State(seq, resting((0.1, 0.2)))) for seq in range(1, 200)))
        while near.recv(4096):
            pass

    with server(burst) as address:
        status, _, seq, *_ = talk(client, address, periods=0)
    assert (status, seq) == (OK, 199)


def test_a_goodbye_arrives_though_states_were_left_unread(client: Path) -> None:
    heard = []

    def late(near: socket.socket) -> None:
        connection = welcome(near)
        near.sendall(b"".join(connection.send(State(seq, resting((0.1, 0.2)))) for seq in range(1, 20)))
        near.recv(4096, socket.MSG_PEEK)
        for seq in range(20, 23):
            give_time(0.01)  # for a client that would not wait
            near.sendall(connection.send(State(seq, resting((0.1, 0.2)))))
        connection.receive_data(near.recv(4096))
        heard.append(connection.next_event())

    with server(late) as address:
        assert talk(client, address, periods=0)[0] == OK
    assert heard == [Bye("done", heard[0].t_ns)]


def test_nobody_at_the_address_is_one_clear_line(client: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
        status, *_, error = talk(client, address)
    told = f"no answer of the bridge at {address}: Connection refused; start one with `qrobot up`"
    assert (status, error) == (LOST, told)


def test_a_name_that_nobody_knows_is_told_by_its_resolver(client: Path) -> None:
    with pytest.raises(socket.gaierror) as raised:
        socket.getaddrinfo(b"no..where", 5600, type=socket.SOCK_STREAM)
    status, *_, error = talk(client, "no..where:5600")
    assert (status, error) == (LOST, f"no address of the bridge at no..where:5600: {raised.value.strerror}")


@pytest.mark.parametrize("address", ["lab:0", "lab:65536", "x" * 200])
def test_an_impossible_address_is_refused(client: Path, address: str) -> None:
    status, *_, error = talk(client, address)
    assert (status, error) == (INVALID, f'"{address}" is no address; host:port is needed, as in 127.0.0.1:5600')
