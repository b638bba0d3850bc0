"""A program in C against the emulated board: register reads and writes through the header of the examples."""

from __future__ import annotations

import re
import signal
import subprocess
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.config import load_robot
from qrobot.errors import LinkBusy
from qrobot.hwif import board_memory, image, operations, registers
from qrobot.hwif.board_memory import (
    BOARD_MEMORY,
    LANE_CAPACITY,
    PANEL_MICRO,
    Lane,
    create_board_memory,
    publish_image,
)
from qrobot.hwif.image import IMAGE_WORDS
from qrobot.hwif.lanes import take_all_operations
from qrobot.hwif.memory_bus import board_memory_bus
from qrobot.hwif.operations import OP_FIELDS
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_CALIBRATED, DISCRETE_POWER
from qrobot.hwif.trace import read_trace
from qrobot.realtime import shared_memory
from qrobot.realtime.structure import WORD_BYTES, offset_of
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.server import EmulatedBoardServer
from tests.support.c_programs import needs_compiler, needs_cpp_compiler
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.stall_watch import ANY_TIME_S, StreamLostError, unless_stalled

SOURCES = Path(__file__).parents[2] / "examples" / "c"
INCLUDE = Path(__file__).parents[2] / "qrobot" / "wire" / "c"
MOVED = 5  # joint 6
AWAY_S = 0.1  # in which the path of the program goes on by a fraction of what is judged
PUMA = load_robot("puma560")

Program = subprocess.Popen[str]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("c") / "move_one_joint"
    flags = ["-O2", "-Wall", "-Wextra", "-Werror", f"-I{INCLUDE}"]
    subprocess.run(["cc", *flags, "-o", target, SOURCES / "move_one_joint.c", "-lm"], check=True)
    return target


@pytest.fixture
def arm() -> str:
    return f"test{uuid.uuid4().hex[:12]}"


@pytest.fixture
def server(arm: str) -> Iterator[EmulatedBoardServer]:
    with EmulatedBoardServer(arm, Emulator(load_robot("puma560"))) as server:
        yield server


def start(program: Path, arm: str) -> Program:
    return subprocess.Popen([program, arm], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def moving(server: EmulatedBoardServer) -> bool:
    return abs(float(server.emulator.v[MOVED])) > 0.05


class Trip(NamedTuple):
    """What one run of the program leaves.

    Attributes:
        status, printed, complaint: of the program.
        begin, far: where joint 6 was at first, and how far from there it was seen, counts.
        powered: at the end.
        trace: of the board.
        away_s: longest time between two looks, or between two torques of the joint as the board has stamped them.
    """

    status: int
    printed: str
    complaint: str
    begin: int
    far: int
    powered: bool
    trace: NDArray[np.int64]
    away_s: float


def trip(program: Path, arm: str) -> Trip:
    """One run, with a board of its own."""
    with EmulatedBoardServer(arm, Emulator(PUMA)) as server, start(program, arm) as process:
        counts, looks = [int(np.int16(server.emulator.counters[MOVED]))], [time.monotonic()]
        while process.poll() is None:
            time.sleep(0.01)
            counts.append(int(np.int16(server.emulator.counters[MOVED])))
            looks.append(time.monotonic())
        printed, complaint = process.communicate()
        trace = read_trace(server.segment.memory).copy()
        torques_ns = trace[trace[:, 2] == DAC + 2 * MOVED, 0][1:]  # without the one before power
        away_s = max(np.diff(looks).max(), 1e-9 * np.diff(torques_ns).max(initial=0))
        far, powered = max(counts) - counts[0], server.emulator.powered
    return Trip(process.returncode, printed, complaint, counts[0], far, powered, trace, float(away_s))


def test_the_header_says_what_the_board_memory_is() -> None:
    text = (SOURCES / "trc004.h").read_text()
    defined = {name: int(value, 0) for name, value in re.findall(r"#define TRC004_(\w+) (0x[0-9A-F]+|\d+)\b", text)}
    del defined["TIMEOUT_NS"]
    lanes = BOARD_MEMORY["lanes"].base
    slots = lanes["ring"].base
    places = {  # fields of the type, in words from the start, or within a lane
        "IMAGE_SEQ": (BOARD_MEMORY, "shown.sequence"),
        "IMAGE_START": (BOARD_MEMORY, "shown.image"),
        "LANE": (BOARD_MEMORY, f"lanes[{int(Lane.TOOL)}].head"),
        "LANE_FORGET": (lanes, "forget"),
        "LANE_TAIL": (lanes, "tail"),
        "LANE_RING": (lanes, "ring"),
        "OP_KIND": (slots, "kind"),
        "OP_OFFSET": (slots, "offset"),
        "OP_VALUE": (slots, "value"),
        "OP_COUNTS_NS": (slots, "counts_ns"),
    }
    elsewhere = {"MAGIC": shared_memory.MAGIC_VALUE, "LANE_FIELDS": slots.itemsize // WORD_BYTES}
    elsewhere |= {name: offset_of(dtype, path) // WORD_BYTES for name, (dtype, path) in places.items()}
    for name, value in defined.items():
        found = {vars(module)[name] for module in (operations, image, registers, board_memory) if name in vars(module)}
        found |= {elsewhere[name] for _ in (1,) if name in elsewhere}
        assert found == {value}, name
    assert len(defined) == text.count("#define TRC004_") - 2  # the guard of the header, and the time-out


@needs_compiler
@pytest.mark.realtime
def test_the_program_powers_the_arm_moves_one_joint_there_and_back_and_leaves_it_without_torque_and_power(
    program: Path, arm: str
) -> None:
    """How far it came is judged of a trip on which nobody was kept from running for long, all else of every trip."""
    made = unless_stalled(lambda: undisturbed_trip(program, arm))
    assert made.far == pytest.approx(1500, abs=100)


def undisturbed_trip(program: Path, arm: str) -> Trip:
    """One run that went well. Raises StreamLostError: the program, its board or who looks on was kept from running."""
    made = trip(program, arm)
    assert (made.status, made.complaint) == (0, "")
    assert f"{made.begin}" in made.printed
    assert not made.powered
    trace = made.trace
    assert (trace[:8, 2:] == [(DAC + 2 * channel, DAC_ZERO) for channel in range(8)]).all()  # before any power
    assert trace[8, 2] == DISCRETE
    assert trace[8, 3] & DISCRETE_POWER
    assert (trace[-9:-1, 3] == DAC_ZERO).all()
    assert not trace[-1, 3] & DISCRETE_POWER
    assert trace[-1, 3] & DISCRETE_CALIBRATED
    if made.away_s >= AWAY_S:
        raise StreamLostError(f"{made.away_s:.3f} s between two torques, or two looks", ANY_TIME_S)
    return made


@needs_compiler
@pytest.mark.realtime
def test_ctrl_c_takes_torque_and_power_off(program: Path, arm: str, server: EmulatedBoardServer) -> None:
    with start(program, arm) as process:
        wait_until(lambda: moving(server), "joint 6 moves")
        process.send_signal(signal.SIGINT)
        assert process.wait() == 1
    assert not server.emulator.powered
    assert (server.emulator.bundle.board.dac == DAC_ZERO).all()


@needs_compiler
@pytest.mark.realtime
def test_a_board_that_goes_away_ends_the_program_with_a_word(program: Path, arm: str) -> None:
    with EmulatedBoardServer(arm, Emulator(load_robot("puma560"))) as server, start(program, arm) as process:
        wait_until(lambda: moving(server), "joint 6 moves")
        server.__exit__(None, None, None)
        assert process.wait() == 1
        assert process.communicate()[1] == f"the board of {arm} has gone\n"


@pytest.fixture(
    scope="module",
    params=[("cc", "-std=c99"), pytest.param(("c++", "-std=c++11", "-x", "c++"), marks=needs_cpp_compiler)],
    ids=["C", "C++"],
)
def pots(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program that reads the converter, as C99 and as C++11, without a warning."""
    compiler, *flags = request.param
    target = tmp_path_factory.mktemp("pots") / "read_pots"
    strict = ["-O2", "-Wall", "-Wextra", "-Werror", "-D_GNU_SOURCE", f"-I{INCLUDE}"]
    subprocess.run([compiler, *strict, *flags, "-o", target, SOURCES / "read_pots.c"], check=True)
    return target


@needs_compiler
@pytest.mark.realtime
@pytest.mark.parametrize("revision", ["E", "F"])
def test_a_program_reads_every_channel_by_the_sequence_of_either_revision(pots: Path, arm: str, revision: str) -> None:
    options = BoardOptions(revision_f=revision == "F")
    with EmulatedBoardServer(arm, Emulator(PUMA, options=options)) as server:
        for channel, volts in ((6, 1.25), (7, 3.75)):
            server.segment.memory.panel.analog[channel] = round(volts * PANEL_MICRO)
        for _ in range(5):
            done = subprocess.run([pots, arm, revision], capture_output=True, text=True, check=True)
            volts = [float(line.split()[1]) for line in done.stdout.splitlines()]
            assert len(volts) == 8
            assert volts[6:] == pytest.approx([1.25, 3.75], abs=0.011)
            assert all(0.0 < volt < 5.0 for volt in volts[:6])


@needs_compiler
@pytest.mark.realtime
def test_a_thousand_writes_without_a_read_are_all_taken(tmp_path: Path, arm: str, server: EmulatedBoardServer) -> None:
    source = tmp_path / "flood.c"
    source.write_text(
        """#include "trc004.h"
        int main(int argc, char **argv)
        {
            struct trc004 board;
            if (argc != 2 || trc004_open(&board, argv[1]) != 0)
                return 2;
            for (int i = 0; i < 3000; i++)
                trc004_outw(&board, TRC004_DAC + 14, 0x800 + i % 7);
            if (trc004_inw(&board, 0x20) != 0xFFFF || trc004_inw(&board, -2) != 0xFFFF
                || trc004_inw(&board, 1) != 0xFFFF)
                return 3;
            trc004_outw(&board, TRC004_DAC + 14, 0x800);
            trc004_inw(&board, TRC004_STATUS);
            return board.lost;
        }"""
    )
    target = tmp_path / "flood"
    subprocess.run(["cc", "-D_GNU_SOURCE", "-I", SOURCES, "-I", INCLUDE, "-o", target, source], check=True)
    assert subprocess.run([target, arm], check=False).returncode == 0
    assert len(read_trace(server.segment.memory)) == 3001
    assert server.emulator.bundle.board.dac[7] == DAC_ZERO


@needs_compiler
@pytest.mark.realtime
def test_conversions_that_are_started_without_anything_between_do_not_fill_the_lane_for_good(
    tmp_path: Path, arm: str, server: EmulatedBoardServer
) -> None:
    source = tmp_path / "starts.c"
    source.write_text(
        f"""#include "trc004.h"
        int main(int argc, char **argv)
        {{
            struct trc004 board;
            if (argc != 2 || trc004_open(&board, argv[1]) != 0)
                return 2;
            for (int i = 0; i < {2 * LANE_CAPACITY + 1}; i++)
                trc004_inb(&board, TRC004_ADC_START);
            trc004_outw(&board, TRC004_DAC + 14, 0x801);
            trc004_inw(&board, TRC004_STATUS);
            return board.lost;
        }}"""
    )
    target = tmp_path / "starts"
    subprocess.run(["cc", "-D_GNU_SOURCE", "-I", SOURCES, "-I", INCLUDE, "-o", target, source], check=True)
    assert subprocess.run([target, arm], check=False, timeout=PATIENCE_S).returncode == 0
    assert server.emulator.bundle.board.dac[7] == 0x801


WAY_OUT = [*((DAC + 2 * channel, DAC_ZERO) for channel in range(8)), (DISCRETE, DISCRETE_CALIBRATED)]


@pytest.fixture(scope="module")
def deaf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program that writes so many torques, reads or not, then goes its way out, and reads again."""
    folder = tmp_path_factory.mktemp("deaf")
    (folder / "deaf.c").write_text(
        """#include <stdlib.h>
        #include "trc004.h"
        int main(int argc, char **argv)
        {
            struct trc004 board;
            if (argc != 4 || trc004_open(&board, argv[1]) != 0)
                return 2;
            for (int i = 0; i < atoi(argv[2]); i++)
                trc004_outw(&board, TRC004_DAC, 0x7FF);
            if (atoi(argv[3]) && trc004_inw(&board, TRC004_STATUS) != 0xFFFF)
                return 3;
            for (int channel = 0; channel < 8; channel++)
                trc004_outw(&board, TRC004_DAC + 2 * channel, TRC004_DAC_ZERO);
            trc004_outw(&board, TRC004_DISCRETE, TRC004_DISCRETE_CALIBRATED);
            return trc004_inw(&board, TRC004_STATUS) != 0xFFFF || !board.lost;
        }"""
    )
    include = ["-D_GNU_SOURCE", "-I", SOURCES, "-I", INCLUDE]
    subprocess.run(["cc", *include, "-o", folder / "deaf", folder / "deaf.c"], check=True)
    return folder / "deaf"


@needs_compiler
@pytest.mark.parametrize(
    ("torques", "reads"),
    [
        (8, False),
        (8, True),
        (LANE_CAPACITY - 1, False),
        (LANE_CAPACITY, True),
        (2 * LANE_CAPACITY, False),
        (5 * LANE_CAPACITY - 4, False),
    ],
)
def test_a_board_that_goes_on_takes_the_newest_of_what_was_written_while_it_stood(
    deaf: Path, arm: str, torques: int, reads: bool
) -> None:
    taken, lanes = np.zeros((LANE_CAPACITY, OP_FIELDS), np.int64), np.zeros(LANE_CAPACITY, np.int64)
    with create_board_memory(arm) as segment:
        publish_image(segment.memory, np.ones(IMAGE_WORDS, np.int64))
        assert subprocess.run([deaf, arm, str(torques), str(int(reads))], check=False).returncode == 0
        n = take_all_operations(segment.memory, taken, lanes)
        assert segment.memory.facts.dropped == 0
    assert [(offset, value) for _, offset, value in taken[n - len(WAY_OUT) : n].tolist()] == WAY_OUT
    assert n >= min(torques, LANE_CAPACITY // 2)


@needs_compiler
@pytest.mark.realtime
def test_a_board_has_one_controller_whoever_comes_first(program: Path, arm: str, server: EmulatedBoardServer) -> None:
    bus = board_memory_bus(arm)
    bus.connect()
    with start(program, arm) as late:
        told = late.communicate()[1]
    assert late.returncode == 1
    assert told == (
        f"the board of {arm} has a controller already, a servo or another program, or is served to one "
        "(`qrobot board --serve`): end that one first\n"
    )
    bus.close()
    with start(program, arm) as first:
        wait_until(lambda: moving(server), "joint 6 moves")
        with pytest.raises(LinkBusy, match="has a controller already"):
            bus.connect()
        with start(program, arm) as second:
            assert second.communicate()[1] == told
        first.send_signal(signal.SIGTERM)
        assert first.wait() == 1
    bus.connect()  # free again
    bus.close()
    assert not server.emulator.powered


@needs_compiler
@pytest.mark.parametrize("writes", [False, True])
def test_nothing_is_taken_for_the_first_image_of_a_board_that_begins_or_writes_just_now(
    program: Path, arm: str, writes: bool
) -> None:
    with create_board_memory(arm) as segment:
        if writes:
            publish_image(segment.memory, np.ones(IMAGE_WORDS, np.int64))
            segment.memory.shown.sequence += 1
        with start(program, arm) as process:
            assert process.communicate()[1] == f"the board of {arm} shows nothing: does it still run?\n"
    assert process.returncode == 1


@needs_compiler
def test_without_a_board_it_says_how_to_start_one(program: Path, arm: str) -> None:
    with start(program, arm) as process:
        assert process.communicate()[1] == f"no board of {arm}: start one with `qrobot board`\n"
    assert process.returncode == 1
