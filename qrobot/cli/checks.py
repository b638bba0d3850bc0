"""Checks of `qrobot doctor`: each is a small function that yields findings, and none changes anything for good."""

from __future__ import annotations

import os
import platform
import shutil
import socket
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from qrobot.errors import ConfigError, LinkError
from qrobot.extras import EXTRAS
from qrobot.hwif.isa.permission import allow_ports
from qrobot.realtime.lasting_folder import look_at_lasting
from qrobot.realtime.machine import machine_steps
from qrobot.realtime.runtime_folder import MEMORY_FOLDER, passed_over, runtime_path, serve_in_folder, tidy_folder
from qrobot.realtime.setup import DMA_LATENCY, HIGHEST_PRIORITY, SetupStep, hold_dma_latency, may_lock_all, set_fifo
from qrobot.realtime.shared_memory import has_owner

LIBRARIES: Final = ("numpy", "numba", "llvmlite", "pydantic", "foxglove-sdk", "mcap")
SEGMENT_BYTES: Final = 64 << 20  # servo memory with its telemetry ring, board memory, and room for a second arm
NAMED: Final = 3  # of many that were left behind: the answer is below them
LEFT_BEHIND: Final = "left behind by a process that was killed (the next one reuses it)"
OLDEST_PYTHON: Final = (3, 11)


class Weight(Enum):
    """Consequence of a finding that is not in order."""

    NEEDED = "needed"  # nothing runs without it
    TIMING = "timing"  # it runs, with longer or rarer late cycles
    OPTIONAL = "optional"  # some feature is missing


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    group: str
    step: SetupStep
    weight: Weight

    @property
    def prevents_running(self) -> bool:
        """True when this must be fixed first."""
        return not self.step.ok and self.weight is Weight.NEEDED


def all_findings(ports: dict[str, tuple[str, int]], bases: Sequence[int] = ()) -> Iterator[Finding]:
    """Everything, group by group; `ports` are the addresses bridges want, by arm, `bases` those of ISA cards."""
    yield from software()
    yield from shared_memory(runtime_path())
    yield from (Finding("network", look_at_port(arm, *address), Weight.NEEDED) for arm, address in ports.items())
    yield from (Finding("board", step, Weight.NEEDED) for step in map(look_at_card, bases))
    yield from (Finding("real time", step, Weight.TIMING) for step in realtime_rights())
    yield from (Finding("machine", step, Weight.TIMING) for step in machine_steps())


def software() -> Iterator[Finding]:
    """Python, libraries, and where compiled code is kept."""
    yield Finding("software", look_at_python(), Weight.NEEDED)
    for name in LIBRARIES:
        yield Finding("software", look_at_library(name, "pip install qrobot"), Weight.NEEDED)
    for module, extra in EXTRAS.items():
        remedy = f"{extra.command} for {extra.purpose}"
        yield Finding("software", look_at_extra(module, extra.distribution or module, remedy), Weight.OPTIONAL)
    yield Finding("software", look_at_compile_cache(), Weight.OPTIONAL)


def look_at_python() -> SetupStep:
    """The interpreter."""
    good = sys.version_info >= OLDEST_PYTHON
    remedy = "" if good else "install Python 3.11 or later"
    return SetupStep("python", good, f"{platform.python_version()} on {platform.machine()}", remedy)


def look_at_library(name: str, remedy: str) -> SetupStep:
    """An installed distribution; it is not imported."""
    try:
        return SetupStep(name, True, version(name))
    except PackageNotFoundError:
        return SetupStep(name, False, "not installed", remedy)


def look_at_extra(module: str, distribution: str, remedy: str) -> SetupStep:
    """An installed distribution; where there is none of that name, the one that has brought the module."""
    step = look_at_library(distribution, remedy)
    if step.ok or find_spec(module) is None:
        return step
    found = packages_distributions()  # some seconds: it reads all that is installed
    return look_at_library(found.get(module, [distribution])[0], remedy)


def look_at_compile_cache() -> SetupStep:
    """Check where Numba keeps compiled code: NUMBA_CACHE_DIR, beside the source, or in the user's cache directory."""
    name = "compile cache"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    package = Path(__file__).resolve().parent.parent
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    for place in (Path(chosen),) if chosen else (package, user):
        if writable(place):
            return SetupStep(name, True, str(place))
    return SetupStep(
        name, False, "not writable: each start compiles anew", "set NUMBA_CACHE_DIR to a writable directory"
    )


def writable(place: Path) -> bool:
    """True when files can be made in `place`, or `place` itself can be made."""
    while not place.exists() and place != place.parent:
        place = place.parent
    return os.access(place, os.W_OK | os.X_OK)


def shared_memory(directory: Path) -> Iterator[Finding]:
    """The runtime folder, where servo and board meet, and what earlier processes left there."""
    yield Finding("shared memory", look_at_folder(), Weight.NEEDED)
    yield Finding("shared memory", look_at_lasting(directory, os.geteuid()), Weight.OPTIONAL)
    if (session := passed_over()) is not None:
        step = SetupStep("$XDG_RUNTIME_DIR", False, f"{session} is not taken", "it has to be yours, and on a tmpfs")
        yield Finding("shared memory", step, Weight.OPTIONAL)
    existing = next((place for place in (directory, directory.parent) if place.is_dir()), MEMORY_FOLDER)
    yield Finding("shared memory", look_at_room(existing), Weight.NEEDED)
    if directory.is_dir():
        yield from (Finding("shared memory", step, Weight.OPTIONAL) for step in look_at_segments(directory))


def look_at_folder() -> SetupStep:
    """Whether the runtime folder is ours alone, and in memory."""
    try:
        with serve_in_folder() as folder:
            detail = str(folder.path)
    except (LinkError, ConfigError, OSError) as error:
        return SetupStep("runtime folder", False, str(error), "see docs/how-to/install.md, What is written where")
    tidy_folder(folder.path)
    return SetupStep("runtime folder", True, detail)


def look_at_room(directory: Path) -> SetupStep:
    """Room in shared memory, and the right to write there."""
    name = str(directory)
    if not (directory.is_dir() and os.access(directory, os.W_OK | os.X_OK)):
        return SetupStep(
            name, False, "missing or not writable", f"mount a tmpfs on {directory} (docker: --shm-size=256m)"
        )
    free = shutil.disk_usage(directory).free
    good = free >= SEGMENT_BYTES
    remedy = "" if good else f"mount -o remount,size=256M {directory} (docker: --shm-size=256m)"
    return SetupStep(name, good, f"{free >> 20} MB free", remedy)


def look_at_segments(directory: Path) -> Iterator[SetupStep]:
    """Segments of this program: in use, or left by processes that were killed, of which a few are named."""
    paths = sorted(filter(_is_segment, directory.iterdir()))
    owned = {path: has_owner(path) for path in paths}
    for path in filter(owned.get, paths):
        yield SetupStep(path.name, True, "in use")
    dead = [path for path in paths if not owned[path]]
    for path in dead[:NAMED]:
        yield SetupStep(path.name, False, LEFT_BEHIND, f"rm {path}, or leave it")
    if more := dead[NAMED:]:
        yield SetupStep(f"{len(more)} more", False, LEFT_BEHIND, f"look with ls {directory}, or leave them")


def running_servos(directory: Path) -> list[str]:
    """Arms whose servo runs on this machine."""
    return [path.name.removesuffix("-servo") for path in sorted(directory.glob("*-servo")) if has_owner(path)]


def _is_segment(path: Path) -> bool:
    return path.name.endswith(("-board", "-servo", "-commander"))


def look_at_port(arm: str, host: str, port: int, directory: Path | None = None) -> SetupStep:
    """The address the bridge of an arm listens on; that it is taken is right when the arm runs."""
    name = f"bridge of {arm}"
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if has_owner((directory or runtime_path()) / f"{arm}-servo"):
                return SetupStep(name, True, f"{host}:{port} is in use, and so is the arm")
            remedy = "stop what listens there, or choose another port in the deployment file"
            return SetupStep(name, False, f"{host}:{port}: {error.strerror}", remedy)
    return SetupStep(name, True, f"{host}:{port} is free")


def look_at_card(base: int) -> SetupStep:
    """May the ports of a card be used? Asked in a thread that ends at once, and its right with it."""
    steps: list[SetupStep] = []
    thread = threading.Thread(target=lambda: steps.append(allow_ports(base)))
    thread.start()
    thread.join()
    return steps[0]


def realtime_rights() -> list[SetupStep]:
    """Try the real-time rights that servo and guardian would get, in a thread that ends at once."""
    steps: list[SetupStep] = []

    def attempt() -> None:
        steps.append(set_fifo(HIGHEST_PRIORITY))
        with hold_dma_latency(DMA_LATENCY) as step:
            steps.append(step)

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    remedy = "run as root, or set memlock to unlimited in /etc/security/limits.d"
    lock = may_lock_all()
    steps.append(SetupStep("memory", lock, "may be locked" if lock else "may not be locked", "" if lock else remedy))
    return steps
