"""The real processes of one arm, from a deployment file of their own, and looks into their shared memory.

Names and ports are fresh for every deployment, so nothing here meets an arm that runs on this machine already.
"""

from __future__ import annotations

import atexit
import os
import signal
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.errors import LogError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.hwif.bus import MemoryEndpoint
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, make_image
from qrobot.hwif.registers import DISCRETE_LINES, ENC_COUNT, STATUS, STATUS_POWER
from qrobot.hwif.trace import read_trace
from qrobot.log.read import read_log
from qrobot.modecodes import Mode
from qrobot.rccl.channel import Channel
from qrobot.rccl.connect import open_channel
from qrobot.rccl_bridge.arm_time import read_arm_time_ns
from qrobot.rci import TcpLink
from qrobot.realtime.runtime_folder import runtime_path
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.process_starter import ProcessStarter
from qrobot.rig.processes import ProcessRig
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import ServoSnapshot
from qrobot.servo.memory.servo_memory import attach_servo_memory
from qrobot.servo.memory.telemetry import Rows, TelemetryReader
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.stall_watch import StreamLostError, unless_stalled

GUARDIAN_MS = 200.0  # these tests ask what happens in which order: sooner than the bridge, and late for a busy machine
BOARD_MS = 500.0
FIRST_START_S = 3.0 * PATIENCE_S  # of a process that compiles everything
UNHURRIED_MS = 100.0  # the longest sample period, for tests that do not measure it
LEG_RAD_S = 1.05
REST_S, REST_COUNTS = 0.1, 2
CREEP_COUNTS = 10  # in a test, of a wrist that only friction holds; an arm that moves goes some thousands meanwhile
SERVING = ("board", "servo", "guardian", "bridge")  # processes of an arm, in the order they need each other

# It does not spin before its deadlines, which keeps a processor from others for a tenth of the time and more.
ARM = """
[[arm]]
name = "{name}"
robot = "puma560"
servo = {{ rate_hz = 1000, spin = false, guardian_timeout_ms = {guardian_ms}, board_timeout_ms = {board_ms} }}
board = {{ {board} }}
bridge = {{ period_ms = {period_ms}, port = {port} }}
log = {{ directory = "{log}" }}
"""


def free_port() -> int:
    """A TCP port nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def write_deployment(
    directory: Path, arms: int = 1, period_ms: float = UNHURRIED_MS, board: str = "", name: str = "", more: str = ""
) -> Path:
    """A deployment file of so many arms with fresh ports and names, or the `name` of the only one.

    `board` are keys of their board tables, `more` is text that follows each arm's.
    """
    tables = [
        ARM.format(
            name=name or f"t{uuid.uuid4().hex[:10]}",
            guardian_ms=GUARDIAN_MS,
            board_ms=BOARD_MS,
            board=board,
            port=free_port(),
            period_ms=period_ms,
            log=directory / "log",
        )
        for _ in range(arms)
    ]
    path = directory / "arms.toml"
    path.write_text("".join(f"{table}{more}" for table in tables))
    return path


def qrobot(*arguments: str | Path, stderr: Any = subprocess.PIPE) -> subprocess.Popen[str]:
    """Start a `qrobot` command; stdout is a pipe."""
    command = [sys.executable, "-m", "qrobot", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True)


def _interrupt(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE_S)


def left_behind(arm: str) -> list[str]:
    """Shared memory and processes that still carry an arm's name."""
    return [path.name for path in runtime_path().glob(f"{arm}-*")] + list(processes_of(arm).values())


def processes_of(arm: str) -> dict[int, str]:
    """Command lines of all processes that were told this arm's name, by process id."""
    return {pid: line for pid, line in _command_lines() if f"--arm {arm} " in f"{line} "}


def _command_lines() -> Iterator[tuple[int, str]]:
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            yield int(path.parent.name), path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has ended meanwhile
            continue


class Killing(NamedTuple):
    """When a process was killed, CLOCK_MONOTONIC: it lived at `before_ns` and is gone at `after_ns`."""

    before_ns: int
    after_ns: int


class RunningArm:
    """Processes of one arm and what they show. Shared memory is mapped anew at every look, as restarts replace it."""

    def __init__(self, rig: ProcessRig, deployment: Path, arm: DeployedArm) -> None:
        self.deployment, self.arm, self.name = deployment, arm, arm.name
        self.processes = ArmProcesses(rig, str(deployment), arm)
        self._rig = rig

    # ------------------------------------------------------------------------------------------------ processes

    def pid(self, command: str) -> int:
        return self._rig.children[self.processes.name_of(command)].process.pid

    def running(self) -> dict[str, int]:
        """Process ids of what runs, by command."""
        children = self._rig.children.values()
        return {child.name.removeprefix(f"{self.name}-"): child.process.pid for child in children if child.alive}

    def kill(self, command: str) -> Killing:
        """kill -9 for one of its processes, and wait until it is gone. Times are the arm's."""
        return self.kill_process(self._rig.children[self.processes.name_of(command)].process)

    def kill_process(self, process: subprocess.Popen[Any]) -> Killing:
        """The same for a program of its own."""
        before_ns = time.monotonic_ns()
        process.kill()
        process.wait()
        after_ns = time.monotonic_ns()
        slipped_ns = self.word("heartbeat", "slipped_ns")
        return Killing(before_ns - slipped_ns, after_ns - slipped_ns)

    def signal(self, command: str, number: signal.Signals) -> int:
        """Send a signal; returns the arm's time just before."""
        t_ns = self.now_ns()
        os.kill(self.pid(command), number)
        return t_ns

    def said(self, command: str) -> str:
        """What a process has printed so far."""
        return self._rig.children[self.processes.name_of(command)].output.read_text()

    @contextmanager
    def program(self, path: Path) -> Iterator[subprocess.Popen[str]]:
        """A program that runs against this arm until the block ends."""
        process = self._start(path)
        try:
            yield process
        finally:
            _interrupt(process)

    @contextmanager
    def moving(
        self, path: Path, rad_s: float, once: Callable[[], bool] = lambda: True
    ) -> Iterator[subprocess.Popen[str]]:
        """A program that has brought a joint to this speed, `once` something is so.

        One that this machine's stall has stopped on the way there begins again.
        """
        process = unless_stalled(lambda: self._set_out(path, rad_s, once))
        try:
            yield process
        finally:
            _interrupt(process)

    def _start(self, path: Path) -> subprocess.Popen[str]:
        return qrobot("run", "--deployment", self.deployment, "--arm", self.name, path)

    def _set_out(self, path: Path, rad_s: float, once: Callable[[], bool]) -> subprocess.Popen[str]:
        """See `moving`. Raises StreamLostError: servo or program was kept from running for too long."""
        process = self._start(path)
        try:
            wait_until(lambda: process.poll() is not None or once(), "the program comes to its way")
            wait_until(lambda: process.poll() is not None or self._faster_than(rad_s), f"{rad_s} rad/s")
            if process.poll() is None:
                return process
        except BaseException:
            _interrupt(process)
            raise
        said = process.communicate()[1]
        if any(code.name in said for code in (FaultCode.FOLLOWING, FaultCode.STREAM_LOST)):
            raise StreamLostError(said)
        raise AssertionError(said)

    @contextmanager
    def control(self, period_ms: float = UNHURRIED_MS) -> Iterator[Channel]:
        """This process commands the arm, a fault cleared: it does so sooner than a program that has to be started."""
        self.wait_for_rest()  # that a program's start leaves time for
        address = (self.arm.bridge.host, self.arm.bridge.port)
        link = partial(TcpLink, address=address)
        with open_channel(link, self.arm.robot, period_ms, clear_fault=True) as channel:
            yield channel

    @contextmanager
    def swinging(self, rad_s: float) -> Iterator[Channel]:
        """The same, and it has brought a joint to this speed. At the end it goes all its way, unless it is stopped."""
        with self.control() as channel:
            channel.setjvel(LEG_RAD_S)
            for name in ("end", "park"):
                channel.move(channel.pose(name))
            wait_until(lambda: self._faster_than(rad_s), f"{rad_s} rad/s")
            yield channel

    def _faster_than(self, rad_s: float) -> bool:
        snapshot = self.snapshot()
        return snapshot.mode == Mode.TRACKING and bool(np.abs(snapshot.v).max() > rad_s)

    def start_missing(self) -> None:
        """Start again what has ended."""
        running = self.running()
        self.processes.start(*(command for command in SERVING if command not in running))
        if "log" not in running:
            self.processes.rig.start(self.processes.log("--output", self.arm.log.directory))

    # ------------------------------------------------------------------------------------------------ looking at it

    def snapshot(self) -> ServoSnapshot:
        with attach_servo_memory(self.name) as segment:
            return ServoMailbox(segment.words).snapshot()

    @property
    def mode(self) -> Mode:
        return Mode(self.snapshot().mode)

    def wait_for(self, *modes: Mode) -> None:
        wanted = "/".join(mode.name for mode in modes)
        wait_until(lambda: self.mode in modes, lambda: f"{wanted}, but {self.told()}")

    def told(self) -> str:
        """How the servo is, for a test that fails."""
        snapshot = self.snapshot()
        processes = ", ".join(self.running())
        fault, event = FaultCode(snapshot.fault), FaultCode(snapshot.event)
        return f"{Mode(snapshot.mode).name}, fault {fault.name}, event {event.name}; {processes} run"

    def wait_for_rest(self) -> None:
        """Until what falls without power has come to rest: the servo powers no arm that moves."""
        wait_until(self._rests, "the arm stands still")

    def _rests(self) -> bool:
        before = self.encoders()
        time.sleep(REST_S)
        return bool(np.abs(np.subtract(self.encoders(), before)).max() <= REST_COUNTS)

    def now_ns(self) -> int:
        """The arm's time: CLOCK_MONOTONIC, less what did not count of it."""
        return read_arm_time_ns(lambda: self.word("heartbeat", "slipped_ns"))

    def word(self, block: str, name: str) -> int:
        """A field of the servo's memory."""
        with attach_servo_memory(self.name) as segment:
            return int(getattr(getattr(segment.front, block), name))

    @contextmanager
    def new_cycles(self) -> Iterator[Callable[[], Rows]]:
        """Gives the cycles since it was called last, from now on: to wait for something among them costs little."""
        with self._telemetry_reader(from_oldest=False) as reader:
            yield reader.read

    def telemetry(self) -> Rows:
        """Every cycle still in the ring, oldest first."""
        with self._telemetry_reader(from_oldest=True) as reader:
            blocks = []
            while (block := reader.read()).size:
                blocks.append(block)
            return np.concatenate(blocks)

    def told_of_the_stop(self) -> str:
        """The latest cycles, and the setpoints missed, of the second before the arm was last stopped on its way."""
        rows = self.telemetry()
        on_its_way = np.flatnonzero(rows["mode"] == Mode.TRACKING)
        if not on_its_way.size:
            return "it was not on its way"
        rows = rows[: on_its_way[-1] + 2][-1000:]  # with the cycle that stopped it
        gaps, ends = np.diff(rows["t_ns"]) * 1e-6, rows["t_ns"][-1]
        told = [f"{-(ends - rows['t_ns'][k]) * 1e-6:.0f} ms: {gaps[k]:.0f} ms" for k in np.flatnonzero(gaps > 4.0)]
        missed = int((rows["flags"] >> 16).max())
        behind = np.abs(rows["q_ref"] - rows["q"])[-50::10].max(axis=1)
        return (
            f"late by {rows['late_ns'].max() * 1e-6:.1f} ms at most, longer cycles {told}, {missed} setpoints missed "
            f"in a row, behind by {np.round(behind, 4).tolist()} rad every 10 ms before"
        )

    @contextmanager
    def _telemetry_reader(self, from_oldest: bool) -> Iterator[TelemetryReader]:
        with attach_servo_memory(self.name) as segment:
            info = ServoMailbox(segment.words).info
            yield TelemetryReader(segment.words, info.telemetry_base, info.telemetry_capacity, info.n, from_oldest)

    def newest_log(self) -> Path:
        """The file the recorder writes."""
        return max(Path(self.arm.log.directory).glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)

    def log_of_now(self) -> Path:
        """The same, once it holds a cycle of the servo that runs: a recorder may still be ending the file before."""
        now_ns, looked_at = self.snapshot().t_ns, list[Path]()

        def holds_one() -> bool:
            looked_at[:] = [self.newest_log()]
            with suppress(LogError):  # it has just begun
                rows = read_log(looked_at[0]).rows
                return bool(rows.size and rows["t_ns"][-1] >= now_ns)
            return False

        wait_until(holds_one, "the log has come to what happens now")
        return looked_at[0]

    def trace(self) -> Any:
        """DAC and DISCRETE writes the board has stamped. Shape (k, 4): t_ns, lane, offset, value."""
        with attach_board_memory(self.name) as segment:
            return read_trace(segment.memory)

    def _image(self) -> Any:
        return self._whole_image()[IMAGE_INPUTS:]

    def _whole_image(self) -> Any:
        image = make_image()
        with attach_board_memory(self.name) as segment:
            MemoryEndpoint(segment.memory).read_image(image)
        return image

    @property
    def image_count(self) -> int:
        """Number of the newest image that a board has shown."""
        return int(self._whole_image()[IMAGE_COUNT])

    @property
    def powered(self) -> bool:
        """Arm power is on, as the board sees it: brakes are open."""
        return bool(self._image()[STATUS // 2] & STATUS_POWER)

    @property
    def lamps(self) -> tuple[int, int]:
        """Outputs as the emulated panel shows them, output 1 in bit 0; and the board's own lines, bits of DISCRETE."""
        with attach_board_memory(self.name) as segment:
            return int(segment.memory.panel.outputs), int(segment.memory.panel.discrete) & DISCRETE_LINES

    def encoders(self) -> list[int]:
        """Encoder words of all joints, as the board shows them."""
        return [int(word) for word in self._image()[ENC_COUNT // 2 :][:6]]


def events_of(rows: Rows) -> set[int]:
    """Numbers of events that come in these rows: one that came before is told until power is asked for again."""
    told = rows["fault"]
    return set(told[1:][np.diff(told) != 0].tolist()) - {FaultCode.NONE}


@cache
def shared_starter() -> ProcessStarter:
    """Starts the processes of all tests: they import nothing."""
    starter = ProcessStarter()
    atexit.register(starter.close)
    return starter


@contextmanager
def running_arms(
    directory: Path, arms: int = 1, period_ms: float = UNHURRIED_MS, board: str = "", name: str = "", more: str = ""
) -> Iterator[list[RunningArm]]:
    """All processes of so many arms, up and ready; see `write_deployment`."""
    deployment = write_deployment(directory, arms, period_ms, board, name, more)
    with ProcessRig(directory / "processes", shared_starter()) as rig:
        running = [RunningArm(rig, deployment, arm) for arm in load_deployment(deployment).arm]
        for arm in running:
            arm.processes.start_all()
        yield running
    for arm in running:
        assert left_behind(arm.name) == []
