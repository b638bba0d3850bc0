"""How closely a guardian may watch a servo: at each rate, with the shortest time-out of a deployment file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.config.deployment import CYCLES_TO_MISS, ServoChoice, guardian_objection
from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.isa.card import NO_CARD, make_card
from qrobot.servo.memory.servo_memory import local_servo_memory, servo_front
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.servo.process.guardian import LOOKS_PER_TIMEOUT, N_OWN, N_SAFE_OPS, TRIPPED, look

RATES_HZ = (100, 125, 200, 250, 400, 1000, 4000)
CYCLES = 400
LATE, BUSY = 0.5, 0.45  # of a period: how late a cycle begins that is not too late, and how long it computes, at most


def beats(period_ns: int, random: np.random.Generator) -> Iterator[tuple[int, int]]:
    """When a servo publishes its heartbeats, and which time each tells: that at which its cycle began."""
    for k in range(CYCLES):
        began_ns = k * period_ns + int(random.uniform(0.0, LATE) * period_ns)
        yield began_ns + int(random.uniform(0.0, BUSY) * period_ns), began_ns


def trip_ns(period_ns: int, timeout_ns: int, seed: int) -> tuple[int, int]:
    """When a guardian took the board from a servo that ends after its last beat, and the time of that beat."""
    front = servo_front(local_servo_memory("puma560", "qrobot", 6, period_ns, SMALLEST_RING))
    own, ops = np.zeros(N_OWN, dtype=np.int64), np.zeros((N_SAFE_OPS, 3), dtype=np.int64)
    board, card = local_board_memory(), make_card(NO_CARD)
    waiting = list(beats(period_ns, np.random.default_rng(seed)))
    last_ns = waiting[-1][1]
    _, front.heartbeat.t_ns = waiting.pop(0)
    front.heartbeat.armed = 1
    now_ns = int(front.heartbeat.t_ns)
    while not own[TRIPPED]:
        while waiting and waiting[0][0] <= now_ns:
            _, front.heartbeat.t_ns = waiting.pop(0)
        look(own, front, board, card, ops, now_ns, timeout_ns)
        now_ns += timeout_ns // LOOKS_PER_TIMEOUT
    return now_ns - timeout_ns // LOOKS_PER_TIMEOUT, last_ns


def test_the_least_patience_that_is_told_is_taken() -> None:
    for rate_hz in range(100, 2001):
        told = guardian_objection(rate_hz, 0.0).rpartition("at least ")[2]
        assert guardian_objection(rate_hz, float(told)) == ""
        assert float(told) < 1.001 * CYCLES_TO_MISS * 1000.0 / rate_hz
        assert ServoChoice(rate_hz=rate_hz).guardian_patience_ms == max(5.0, float(told))


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("seed", range(3))
def test_a_servo_whose_cycles_are_late_keeps_its_board_and_one_that_ends_loses_it(rate_hz: int, seed: int) -> None:
    period_ns = round(1e9 / rate_hz)
    least_ns = CYCLES_TO_MISS * period_ns
    assert guardian_objection(rate_hz, least_ns * 1e-6) == ""
    taken_ns, last_ns = trip_ns(period_ns, least_ns, seed)
    assert least_ns < taken_ns - last_ns <= (1.0 + 1.0 / LOOKS_PER_TIMEOUT) * least_ns
    assert f"at least {least_ns * 1e-6:g}" in guardian_objection(rate_hz, 0.99 * least_ns * 1e-6)
    taken_ns, last_ns = trip_ns(period_ns, period_ns, seed)
    assert taken_ns < last_ns  # while it ran


def test_a_rate_that_is_too_low_for_the_guardian_of_the_file_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "quiet.toml"
    path.write_text('[[arm]]\nname = "quiet"\nrobot = "puma560"\nbridge = { port = 5999 }\n')
    assert run_app(make_app("servo"), ["servo", str(path), "--rate", "200"]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "guardian_timeout_ms 5 is too short for a servo of 200 Hz: at least 10" in said
