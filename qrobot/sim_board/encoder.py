"""Quadrature counters and index latches of the TRC004.

A shaft position is an integer: the number of the last quadrature edge passed, counted from the robot's encoder zero.
The counter is 16 bits wide, wraps, and counts from whatever was loaded into it. Once per motor revolution, at edge
number `phase` modulo `counts_per_rev`, the encoder gives an index pulse [V: index spacing of the vendor's table].
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.hwif.registers import N_ENCODERS
from qrobot.realtime.jit import lean_kernel

COUNTER_MASK: Final = 0xFFFF


class Encoders(NamedTuple):
    """Six channels; every array int64[6]. Channels without an encoder stand still."""

    counter: NDArray[np.int64]  # 0..65535, what ENC_COUNT shows
    edge: NDArray[np.int64]  # what was counted of the shaft until the last sample, counts
    shaft: NDArray[np.int64]  # where the shaft was then, counts
    latch: NDArray[np.int64]  # 0..65535, what ENC_INDEX shows
    counts_per_rev: NDArray[np.int64]  # per motor revolution; joint 6 has half since revision E [V]
    phase: NDArray[np.int64]  # position of the index pulse, modulo counts_per_rev
    pulses: NDArray[np.int64]  # index pulses per revolution: 1; by a fault 0, or 2 with one more half-way
    odd: NDArray[np.int64]  # index pulses such a fault swallowed or added when a latch waited for one


def make_encoders(counts_per_rev: NDArray[np.int64], phase: NDArray[np.int64]) -> Encoders:
    """Counters at zero for the given joints (at most six); the channels left over never move."""
    revolution, index = np.ones(N_ENCODERS, np.int64), np.zeros(N_ENCODERS, np.int64)
    revolution[: counts_per_rev.size] = counts_per_rev
    index[: phase.size] = phase
    counter, edge, shaft, latch, odd = np.zeros((5, N_ENCODERS), np.int64)
    return Encoders(counter, edge, shaft, latch, revolution, index, np.ones(N_ENCODERS, np.int64), odd)


@lean_kernel
def first_index(old: int, new: int, period: int, phase: int) -> int:
    """First position congruent to `phase` met on the way from `old` (not met) to `new` (met); may lie beyond `new`."""
    if new > old:
        return old + 1 + (phase - old - 1) % period
    return old - 1 - (old - 1 - phase) % period


@lean_kernel
def last_index(old: int, new: int, period: int, phase: int) -> int:
    """Last position congruent to `phase` met on the way from `old` to `new`; may lie before the way begins."""
    if new > old:
        return new - (new - phase) % period
    return new + (phase - new) % period


@lean_kernel
def latch_index(encoders: Encoders, channel: int, turned: int, counted: int, take_last: int) -> int:
    """Latch the count at the first index pulse on the shaft's way to `turned`, or at the last; 1 when there was any.

    The pulse is a mark on the shaft, wherever the counter has got to: on the way to `turned` it goes on by `counted`.
    """
    old, phase, pulses = encoders.shaft[channel], encoders.phase[channel], encoders.pulses[channel]
    turn = encoders.counts_per_rev[channel]
    period = turn // max(1, pulses)
    first = first_index(old, turned, period, phase)
    if abs(first - old) > abs(turned - old):
        return 0
    at = last_index(old, turned, period, phase) if take_last else first
    if pulses == 0 or (at - phase) % turn != 0:
        encoders.odd[channel] += 1
    if pulses == 0:
        return 0
    share = (at - old) * counted // (turned - old)
    encoders.latch[channel] = (encoders.counter[channel] + share) & COUNTER_MASK
    return 1


@lean_kernel
def sample_encoders(
    encoders: Encoders, shaft: NDArray[np.float64], counted: NDArray[np.float64], pending: int, armed: int
) -> int:
    """Move all shafts to `shaft` and latch the counts at index pulses passed on the way.

    Args:
        encoders: the channels.
        shaft: positions now, counts; float64[6].
        counted: what the counters make of them: the same, but for faults. Edges counted are the nearest integers.
        pending: bit per channel whose latch waits for its first index: it keeps the first one met.
        armed: bit per channel whose latch takes every index: it keeps the last one met. Whether a latch that has seen
            its index takes another is unknown [A].

    Returns:
        Bit per channel that latched.
    """
    counter, edge = encoders.counter, encoders.edge
    latched = 0
    for channel in range(N_ENCODERS):
        turned, new = math.floor(shaft[channel] + 0.5), math.floor(counted[channel] + 0.5)
        step = new - edge[channel]
        if turned != encoders.shaft[channel] and (pending | armed) >> channel & 1:
            latched |= latch_index(encoders, channel, turned, step, armed >> channel & 1) << channel
        counter[channel] = (counter[channel] + step) & COUNTER_MASK
        edge[channel], encoders.shaft[channel] = new, turned
    return latched
