"""Boards over Modbus between processes: a client that is not ours moves the emulated arm, and a gateway reaches it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from qrobot.cli.board import GATEWAY_PRIORITY
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.errors import LinkBusy
from qrobot.hwif.board_memory import (
    attach_board_memory,
    command_board_memory,
    create_board_memory,
    fetch_image,
)
from qrobot.hwif.image import IMAGE_COUNT, make_image
from qrobot.hwif.memory_bus import board_memory_bus
from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    ENC_COUNT,
    N_DACS,
)
from qrobot.model.transmission import signed_word
from qrobot.rig.processes import ProcessPlan, ProcessRig, board_ready, bridge_ready
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.processes import free_port, shared_starter

pytestmark = pytest.mark.realtime

MBPOLL = shutil.which("mbpoll") or ""  # of libmodbus
needs_mbpoll = pytest.mark.skipif(
    not MBPOLL and "CI" not in os.environ, reason="no client to compare with: apt install mbpoll"
)
WATCHDOG_MS = 60_000  # a joint that has been pushed goes on moving however slow the client is
POWERED = DISCRETE_POWER | DISCRETE_HAND_RELAXED | DISCRETE_CALIBRATED
PUSH = 800  # DAC counts, twice joint 1's friction
MOVED = 200  # encoder counts, a hundred times what a brake lets through
PERIOD_MS = 4.0


@dataclass(frozen=True)
class Served:
    """An emulated board served over Modbus, and a rig for what else runs."""

    rig: ProcessRig
    folder: Path
    arm: str
    port: int

    def deployment(self, arm: str, board: str) -> str:
        path = self.folder / f"{arm}.toml"
        path.write_text(f'[[arm]]\nname = "{arm}"\nrobot = "puma560"\nbridge = {{ port = 5600 }}\n{board}')
        return str(path)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder, arm, port = tmp_path_factory.mktemp("modbus"), f"far{uuid.uuid4().hex[:8]}", free_port()
    with ProcessRig(folder, shared_starter()) as rig:
        served = Served(rig, folder, arm, port)
        address = f"modbus=127.0.0.1:{port}@{WATCHDOG_MS}"
        arguments = ["board", served.deployment(arm, ""), "--serve", address]
        rig.start(ProcessPlan("far", arguments, lambda _: bridge_ready("127.0.0.1", port)))
        yield served


class Mbpoll:
    """The command-line client of libmodbus; registers counted from 0."""

    def __init__(self, port: int) -> None:
        self._command = [MBPOLL, "-m", "tcp", "-p", str(port), "-a", "1", "-0", "-1", "-q", "-o", "2"]

    def read(self, kind: int, first: int, count: int) -> list[int]:
        """`kind`: 0 coils, 1 discrete inputs, 3 input registers, 4 holding registers."""
        text = self._run("-t", str(kind), "-r", str(first), "-c", str(count), "127.0.0.1")
        values = dict(re.findall(r"^\[(\d+)\]:\s+(-?\d+)", text, re.MULTILINE))
        return [int(values[str(first + i)]) & 0xFFFF for i in range(count)]

    def write(self, first: int, *values: int) -> None:
        self._run("-t", "4", "-r", str(first), "127.0.0.1", *(str(value) for value in values))

    def _run(self, *arguments: str) -> str:
        done = subprocess.run(
            [*self._command, *arguments], capture_output=True, text=True, timeout=PATIENCE_S, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout


@needs_mbpoll
def test_a_client_that_is_not_ours_reads_counts_writes_a_converter_and_moves_a_joint(served: Served) -> None:
    client = Mbpoll(served.port)
    before = client.read(3, ENC_COUNT // 2, 6)
    client.write(DISCRETE // 2, POWERED, DAC_ZERO - PUSH, *[DAC_ZERO] * (N_DACS - 1))
    assert client.read(4, DAC // 2, 1) == [DAC_ZERO - PUSH]
    assert client.read(0, 0, 1) == [1]
    wait_until(lambda: abs(signed_word(client.read(3, ENC_COUNT // 2, 1)[0] - before[0] & 0xFFFF)) >= MOVED, "joint 1")
    assert client.read(1, 15, 1) == [1]
    client.write(DISCRETE // 2, DISCRETE_HAND_RELAXED | DISCRETE_CALIBRATED, *[DAC_ZERO] * N_DACS)
    assert client.read(1, 15, 1) == [0]


def test_a_board_that_is_served_has_its_controller_at_the_other_end(served: Served) -> None:
    with pytest.raises(LinkBusy, match="is served to one"):
        board_memory_bus(served.arm).connect()


def test_a_board_that_somebody_here_controls_is_not_served(served: Served, capsys: pytest.CaptureFixture[str]) -> None:
    arm, port = f"kept{uuid.uuid4().hex[:8]}", free_port()
    file = served.deployment(arm, "")
    killed = create_board_memory(arm)
    with command_board_memory(arm):
        killed.close()  # its controller waits for the next one
        assert run_app(make_app(), ["board", file, "--serve", f"modbus=127.0.0.1:{port}"]) == 1
    assert f"the board of {arm} has a controller already" in capsys.readouterr().err
    killed.path.unlink(missing_ok=True)


def may_be_real_time() -> bool:
    """Whether this machine lets a process of this account have a real-time priority."""
    ask = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({GATEWAY_PRIORITY}))"
    return subprocess.run([sys.executable, "-c", ask], capture_output=True, check=False).returncode == 0


def test_a_gateway_process_is_the_board_of_its_arm_and_follows_the_server(served: Served) -> None:
    arm = f"near{uuid.uuid4().hex[:8]}"
    table = f"{{ port = {served.port}, period_ms = {PERIOD_MS}, timeout_ms = 500.0 }}"
    module = f"io = [{{ host = '127.0.0.1', port = {free_port()}, inputs = [{{ address = 0, input = 2 }}] }}]"
    transport = f"[arm.board]\nkind = 'modbus'\nmodbus = {table}\n{module}\n"
    deployment = served.deployment(arm, transport + "[arm.servo]\nrate_hz = 250\nboard_timeout_ms = 20.0\n")
    served.rig.start(ProcessPlan("near", ["board", deployment], partial(board_ready, arm)))
    with attach_board_memory(arm) as memory:
        assert memory.memory.facts.period_ns == PERIOD_MS * 1e6
        image = make_image()
        assert fetch_image(memory.memory, image)
        first = int(image[IMAGE_COUNT])
        wait_until(lambda: fetch_image(memory.memory, image) and image[IMAGE_COUNT] >= first + 20, "images come")
    threads = Path(f"/proc/{served.rig.children['near'].process.pid}/task").iterdir()
    policies = [os.sched_getscheduler(int(each.name)) & ~os.SCHED_RESET_ON_FORK for each in threads]
    exchanges_reports_and_asks_the_module = 3  # each may hold the interpreter's lock
    assert (policies.count(os.SCHED_FIFO) >= exchanges_reports_and_asks_the_module) is may_be_real_time()
    other = ModbusBus(ModbusLine("127.0.0.1", served.port, timeout_s=1.0))
    with pytest.raises(LinkBusy, match="another client has the control"):
        other.connect()
    other.close()
    served.rig.end("near")
    assert "board found at Modbus" in (served.folder / "near.txt").read_text()
