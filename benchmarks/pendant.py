"""What a pendant with pages costs the arms that it shows: servo, server and the age of what a page gets.

    python -m benchmarks pendant two_arms

The arms of a deployment swing between two poses. In turns there is a pendant with four pages, two of which look at
every cycle of the servos ten times a second, or there is none; so a disturbance meets both. The servos tell of
themselves in their telemetry.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from benchmarks.stalls import slipped_s
from qrobot.config.deployment import DeployedArm, deployment_path, load_deployment
from qrobot.pendant.frames import HEAD, STATE_FRAME
from qrobot.pendant.gate import cookie_name
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.servo_memory import attach_servo_memory, servo_info
from qrobot.servo.memory.telemetry import TelemetryReader

PAGES: Final = 4
SCOPES: Final = 2  # pages that look at every cycle too
TURNS: Final = 2  # of each kind
LOOK_S: Final = 0.1
SETTLE_S: Final = 8.0  # [A] after a start: programs and the processes of a pendant compile nothing, and import much
PROGRAM: Final = """
from qrobot import rccl

with rccl.control("{robot}") as arm:
    while True:
        for name in ("ready", "park"):
            arm.move(arm.pose(name))
        arm.waitfor(arm.completed)
"""
TICKS_PER_S: Final = 100.0  # of /proc, USER_HZ on Linux

Numbers = NDArray[np.float64]


@dataclass
class PendantCost:
    """Figures of one run; ratios are those with the pendant over those without.

    Attributes:
        late_us, busy_us: wake-up error and computing time of the servos' cycles, 50th and 99th per cent, without and
            with the pendant.
        late_ratio, busy_ratio: of the 99th per cent.
        server_share: of one processor that the pendant and its processes took. age_ms: of a sample when a page got it.
        frames: samples that pages got. lost: of those that they should have got.
        ended: why an arm did not swing to the end of the last turn.
    """

    late_us: dict[str, tuple[float, float]]
    busy_us: dict[str, tuple[float, float]]
    late_ratio: float
    busy_ratio: float
    server_share: float
    age_ms: tuple[float, float, float]
    frames: int
    lost: float
    ended: list[str]


@dataclass
class PageGot:
    """What one page got.

    Attributes:
        ages_s: of each sample, by the servo's clock less what it stood still.
    """

    ages_s: list[float] = field(default_factory=list)


def compared(without: dict[str, Numbers], with_pendant: dict[str, Numbers], name: str) -> tuple[dict[str, Any], float]:
    """50th and 99th per cent of a field in us, by kind of turn, and the ratio of the 99th."""
    kinds = {"without": without[name], "with": with_pendant[name]}
    told = {kind: tuple(np.percentile(values, (50, 99)) * 1e-3) for kind, values in kinds.items()}
    return {kind: (round(a, 2), round(b, 2)) for kind, (a, b) in told.items()}, float(
        told["with"][1] / told["without"][1]
    )


class CycleCounter:
    """Late and busy times of the cycles of some servos, from their rings."""

    def __init__(self, arms: list[str]) -> None:
        self._segments = [attach_servo_memory(arm) for arm in arms]

    def read(self, seconds: float) -> dict[str, Numbers]:
        """Those of the next so many seconds, all arms together, ns."""
        readers = []
        for segment in self._segments:
            info = servo_info(segment.words)
            place = (info.telemetry_base, info.telemetry_capacity, info.n)
            readers.append(TelemetryReader(segment.words, *place, from_oldest=False))
        time.sleep(seconds)
        found: dict[str, list[Numbers]] = {"late_ns": [], "busy_ns": []}
        for reader in readers:
            while (rows := reader.read()).size:
                for name, blocks in found.items():
                    blocks.append(rows[name].astype(float))
        return {name: np.concatenate(blocks) for name, blocks in found.items()}


class PendantServer:
    """`qrobot pendant` of a deployment, and pages that look at it until `close`."""

    def __init__(self, deployment: Path, arms: list[DeployedArm], folder: Path) -> None:
        command = [sys.executable, "-m", "qrobot", "pendant", "--deployment", str(deployment), "--port", "0"]
        command += ["--taught", str(folder / "taught.db")]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self._process.stdout is not None
        address = self._process.stdout.readline().strip()
        self._host, _, query = address.removeprefix("http://").partition("/?")
        token = query.removeprefix("token=")
        self._cookie = f"{cookie_name(token)}={token}"
        self._arms, self._over = [arm.name for arm in arms], threading.Event()
        self.pages = [PageGot() for _ in range(PAGES)]
        work = [partial(self._look, page) for page in self.pages]
        work += [partial(self._ask, number % len(arms)) for number in range(SCOPES)]
        self._threads = [threading.Thread(target=each, daemon=True) for each in work]
        for thread in self._threads:
            thread.start()

    def processor_s(self) -> float:
        """Time of processors that the pendant and its processes took so far."""
        return sum(_ticks(pid) for pid in _family(self._process.pid)) / TICKS_PER_S

    def close(self) -> None:
        """End it."""
        self._over.set()
        self._process.terminate()
        self._process.communicate()
        for thread in self._threads:
            thread.join()

    def _look(self, page: PageGot) -> None:
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect

        headers, origin = {"Cookie": self._cookie}, cast("Any", f"http://{self._host}")
        line = connect(f"ws://{self._host}/live", origin=origin, additional_headers=headers)
        with suppress(ConnectionClosed), line as messages:
            looked_s, slipped = 0.0, [0.0] * len(self._arms)
            for message in messages:
                now_s = time.monotonic()
                if now_s - looked_s > 0.2:
                    looked_s, slipped = now_s, [slipped_s(arm) for arm in self._arms]
                if isinstance(message, bytes) and message[0] == STATE_FRAME:
                    page.ages_s.append(now_s - slipped[message[1]] - HEAD.unpack_from(message)[-1])

    def _ask(self, arm: int) -> None:
        url = f"http://{self._host}/ask/scope/look?arm={arm}&seconds=1&points=1400"
        while not self._over.wait(LOOK_S):
            with suppress(OSError):
                urllib.request.urlopen(urllib.request.Request(url, headers={"Cookie": self._cookie})).read()


def pendant(deployment: str, folder: Path, seconds: float) -> PendantCost:
    """Start the arms of a deployment, swing them, and take turns. Raises what they fail by."""
    path = Path(deployment_path(deployment)).resolve()
    arms = list(load_deployment(path).arm)
    got: dict[str, list[dict[str, Numbers]]] = {"without": [], "with": []}
    pages: list[PageGot] = []
    took_s = 0.0
    with ProcessRig(folder) as rig:
        for arm in arms:
            ArmProcesses(rig, str(path), arm).start_all()
        counter = CycleCounter([arm.name for arm in arms])
        with swinging(path, arms, folder) as programs:
            for _ in range(TURNS):
                got["without"].append(counter.read(seconds))
                server = PendantServer(path, arms, folder)
                try:
                    time.sleep(SETTLE_S)
                    for page in server.pages:
                        page.ages_s.clear()
                    before_s = server.processor_s()
                    got["with"].append(counter.read(seconds))
                    took_s += server.processor_s() - before_s
                    pages += [PageGot(list(page.ages_s)) for page in server.pages]
                finally:
                    server.close()
            ended = [arm.name for arm, program in zip(arms, programs, strict=True) if program.poll() is not None]
            why = [f"{name}: {(folder / f'{name}.txt').read_text()[-300:]}" for name in ended]
    expected = TURNS * PAGES * sum(seconds * 1e3 / arm.bridge.period_ms for arm in arms)
    return _cost(got, pages, took_s / (TURNS * seconds), expected, why)


def _cost(
    got: dict[str, list[dict[str, Numbers]]], pages: list[PageGot], share: float, expected: float, ended: list[str]
) -> PendantCost:
    joined = {
        kind: {name: np.concatenate([turn[name] for turn in turns]) for name in turns[0]} for kind, turns in got.items()
    }
    late, late_ratio = compared(joined["without"], joined["with"], "late_ns")
    busy, busy_ratio = compared(joined["without"], joined["with"], "busy_ns")
    ages_ms = 1e3 * np.concatenate([page.ages_s for page in pages])
    p50, p99, most = (round(float(value), 2) for value in (*np.percentile(ages_ms, (50, 99)), ages_ms.max()))
    lost = max(0.0, 1.0 - ages_ms.size / expected)
    return PendantCost(late, busy, round(late_ratio, 3), round(busy_ratio, 3), round(share, 4), (p50, p99, most),
                       ages_ms.size, round(lost, 4), ended)  # fmt: skip


@contextmanager
def swinging(deployment: Path, arms: list[DeployedArm], folder: Path) -> Iterator[list[subprocess.Popen[str]]]:
    """Programs, a process each, that swing the arms until the end of the block."""
    programs = []
    try:
        for arm in arms:
            source = folder / f"{arm.name}.py"
            source.write_text(PROGRAM.format(robot=arm.robot))
            command = [sys.executable, "-m", "qrobot", "run", "--deployment", str(deployment), "--arm", arm.name]
            output = (folder / f"{arm.name}.txt").open("w")
            programs.append(subprocess.Popen([*command, str(source)], stdout=output, stderr=output, text=True))
        time.sleep(SETTLE_S)
        yield programs
    finally:
        for program in programs:
            program.send_signal(signal.SIGINT)
            program.wait()


def _family(root: int) -> list[int]:
    """A process and what it has started, and so on."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parents[int(path.parent.name)] = int(path.read_text().rpartition(")")[2].split()[1])
    found = [root]
    for pid in found:
        found += [child for child, parent in parents.items() if parent == pid]
    return found


def _ticks(pid: int) -> float:
    """Processor time of a process so far, proc(5): utime and stime."""
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return float(fields[11]) + float(fields[12])
    return 0.0
