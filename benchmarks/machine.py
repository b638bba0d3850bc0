"""The machine a figure belongs to."""

from __future__ import annotations

import os
import platform
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any


def machine() -> dict[str, Any]:
    """Processor, kernel, load at this moment: what a reader needs to place the figures."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count() or 1,
        "kernel": f"{platform.system()} {platform.release()}",
        "preemption": _preemption(),
        "python": platform.python_version(),
        "load": round(os.getloadavg()[0], 2),
        "date": datetime.fromtimestamp(time.time(), UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }


def described(facts: dict[str, Any]) -> str:
    """The machine in one line."""
    return (
        f"{facts['cores']} x {facts['processor']}, {facts['kernel']} ({facts['preemption']}), "
        f"Python {facts['python']}, load {facts['load']} at the start, {facts['date']}"
    )


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _preemption() -> str:
    """How the kernel preempts, from its version line: PREEMPT_RT, PREEMPT_DYNAMIC, ..."""
    words = [word for word in platform.version().split() if word.startswith("PREEMPT")]
    return words[0] if words else "no preemption named"
