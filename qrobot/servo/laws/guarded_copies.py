"""Guarded copies of a law's arguments, with guarded words between them.

A law is compiled without bounds checks. What it writes past the end of an array, or into one that it may only read,
stays in the copies: it reaches neither the servo nor another argument of the next cycle. Words that nobody may write
stand around each copy; as floats they are NaN, so that a law that reads them gives no finite torque, which the guard
sees. What a law writes further away than `EDGE_WORDS` only its trial can show, see `servo.laws.trial_process`.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.hwif.registers import N_ADCS
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.laws.law import MEMORY_WORDS, N_GAINS, N_SETTINGS
from qrobot.servo.memory.telemetry import N_PAYLOAD

GUARDED: Final = 0x7FF8_4C41_5700_0001  # a quiet NaN
GAP_WORDS: Final = 4  # between two copies
EDGE_WORDS: Final = 32  # before the first and after the last one: three small arms' vectors


class LawCopies(NamedTuple):
    """Arguments of a law in their order, float64, and guarded words around each, int64."""

    edge_before: Any
    q_ref: Any
    after_q_ref: Any
    v_ref: Any
    after_v_ref: Any
    a_ref: Any
    after_a_ref: Any
    q: Any
    after_q: Any
    v: Any
    after_v: Any
    gravity: Any
    after_gravity: Any
    friction: Any
    after_friction: Any
    sensors: Any
    after_sensors: Any
    payload: Any
    after_payload: Any
    gains: Any
    after_gains: Any
    settings: Any
    after_settings: Any
    memory: Any
    after_memory: Any
    dt: Any
    after_dt: Any
    tau: Any
    edge_after: Any


def make_law_copies(n: int) -> LawCopies:
    """Copies for `n` joints, with all guarded words whole."""
    vectors = {name: np.zeros(n) for name in ("q_ref", "v_ref", "a_ref", "q", "v", "gravity", "friction", "tau")}
    others = {
        "sensors": np.zeros(N_ADCS), "payload": np.zeros(N_PAYLOAD), "gains": np.zeros((N_GAINS, n)),
        "settings": np.zeros(N_SETTINGS),
        "memory": np.zeros(MEMORY_WORDS), "dt": np.zeros(1),
    }  # fmt: skip
    guarded = {name: np.full(GAP_WORDS, GUARDED, dtype=np.int64) for name in LawCopies._fields if name[:6] == "after_"}
    edges = {name: np.full(EDGE_WORDS, GUARDED, dtype=np.int64) for name in ("edge_before", "edge_after")}
    return LawCopies(**vectors, **others, **guarded, **edges)


@lean_kernel
def copy_vector(to: Any, source: Any) -> None:
    """Fill `to` with `source`; shapes are equal."""
    for k in range(to.size):
        to[k] = source[k]


@lean_kernel
def broken(words: Any) -> int:
    """Number of guarded words that have been written; they are guarded again afterwards."""
    count = 0
    for k in range(words.size):
        count += words[k] != GUARDED
    if count != 0:
        for k in range(words.size):
            words[k] = GUARDED
    return count


@lean_kernel
def broken_words(copies: Any) -> int:
    """Number of all guarded words that the law has written; they are guarded again afterwards."""
    return (
        broken(copies.edge_before) + broken(copies.edge_after)
        + broken(copies.after_q_ref) + broken(copies.after_v_ref) + broken(copies.after_a_ref)
        + broken(copies.after_q) + broken(copies.after_v)
        + broken(copies.after_gravity) + broken(copies.after_friction) + broken(copies.after_sensors)
        + broken(copies.after_payload) + broken(copies.after_gains) + broken(copies.after_settings)
        + broken(copies.after_memory) + broken(copies.after_dt)
    )  # fmt: skip
