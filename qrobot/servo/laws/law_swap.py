"""Another law or other gains while the arm holds, without the arm noticing.

Two laws rarely ask for the same torque: one carries the arm's weight, the next leaves that to its feedback. So at the
swap the difference is kept as a *bias* on what the new law says: the torque goes on as it was, to the last bit, and so
does the arm. The bias stays for as long as the arm holds and fades away once it moves (`FADE_S`), where the new law's
own error has to show. It is gone at the next power-up, and when the law fails.

The words here belong to the servo's process alone: an address that somebody else can write is an address anybody can
jump to. A swap is asked for by the daemon's main thread and done by the loop, between two cycles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.pointer import function_at
from qrobot.servo.kernels.velocity import at_rest
from qrobot.servo.laws.law import LAW_SIGNATURE, MEMORY_WORDS, N_GAINS, N_SETTINGS, Law

FADE_S: Final = 1.0  # time constant of the bias while the arm tracks

SWAPPED, NOT_NOW, NO_TORQUE, OUT_OF_BOUNDS = range(4)  # values of `result`

law_at = function_at(LAW_SIGNATURE)


@dataclass(eq=False)
class SwapState:
    """The law in force and the one asked for. Vectors have shape (n,) and SI units."""

    gains: Any  # in force, (3, n)
    last_gains: Any  # of the law before it, when it was left, (3, n)
    first_gains: Any  # of the law that was in force from the start, when it was left, (3, n)
    next_gains: Any  # (3, n)
    settings: Any  # of the law in force, (32,)
    last_settings: Any  # of the law before it, (32,)
    first_settings: Any  # of the first law, when it was left, (32,)
    next_settings: Any  # (32,)
    bias: Any  # N m (N), added to what the law says
    trial: Any  # what the law asked for says
    trial_memory: Any  # (64,)
    law_at: int = 0  # address of the law in force
    asked: int = 0  # raised to ask for a swap
    done: int = 0  # the request last dealt with
    result: int = 0  # what became of it
    next_law_at: int = 0  # address of the law asked for
    done_tick: int = 0  # the cycle that dealt with it
    done_t_ns: int = 0  # time of that cycle
    last_law_at: int = 0  # address of the law before the one in force, 0 for none
    first_law_at: int = 0  # address of the first law, behind which there is none
    compliant: int = 0  # 1: the law in force lets the arm give way
    last_compliant: int = 0  # of the law before it
    first_compliant: int = 0  # of the first law
    next_compliant: int = 0  # of the law asked for
    only_settings: int = 0  # 1: asked for are other settings of the law in force, which goes over to them by itself


def make_swap_state(law: Law, gains: Any) -> SwapState:
    """A law in force from the start; `gains` has shape (3, n)."""
    n = gains.shape[1]
    return SwapState(
        law_at=law.address,
        first_law_at=law.address,
        compliant=int(law.compliant),
        first_compliant=int(law.compliant),
        gains=np.array(gains),
        last_gains=np.zeros((N_GAINS, n)),
        first_gains=np.array(gains),
        next_gains=np.zeros((N_GAINS, n)),
        settings=np.array(law.values),
        last_settings=np.zeros(N_SETTINGS),
        first_settings=np.array(law.values),
        next_settings=np.zeros(N_SETTINGS),
        bias=np.zeros(n),
        trial=np.zeros(n),
        trial_memory=np.zeros(MEMORY_WORDS),
    )


def ask_for_law(swap: SwapState, law: Law, gains: Any) -> None:
    """Ask the loop for another law, which has to live on. Call again only when that is done (`maybe_swap_result`)."""
    swap.next_law_at = law.address
    swap.next_gains[:] = gains
    swap.next_settings[:] = law.values
    swap.next_compliant, swap.only_settings = int(law.compliant), 0
    _ask(swap)


def ask_for_settings(swap: SwapState, law: Law) -> None:
    """Ask the loop for the settings of `law`, which is in force and has to be compliant; in any mode."""
    swap.next_law_at = law.address
    swap.next_settings[:] = law.values
    swap.only_settings = 1
    _ask(swap)


def maybe_swap_result(swap: SwapState) -> int | None:
    """SWAPPED, NOT_NOW, NO_TORQUE or OUT_OF_BOUNDS; None while the request waits for the next cycle."""
    return None if swap_asked(swap) else int(swap.result)


@lean_kernel
def _ask(swap: Any) -> None:
    store_release(swap, "asked", swap.asked + 1)


@lean_kernel
def swap_asked(swap: Any) -> bool:
    """A request waits."""
    return bool(swap.asked != load_acquire(swap, "done"))


@lean_kernel
def forget_bias(swap: Any) -> None:
    """Set the bias to zero: the law's own torque is all there is."""
    for j in range(swap.bias.size):
        swap.bias[j] = 0.0


@lean_kernel
def fade_bias(swap: Any, dt: float) -> None:
    """Let the bias decay for `dt` seconds."""
    share = math.exp(-dt / FADE_S)
    for j in range(swap.bias.size):
        swap.bias[j] = at_rest(swap.bias[j] * share)


@lean_kernel
def install(swap: Any) -> int:
    """Put the law asked for in force, as it is; the one before and the first one stay at hand."""
    if swap.law_at != swap.next_law_at:
        swap.last_law_at, swap.last_compliant = swap.law_at, swap.compliant
        _copy(swap.gains, swap.last_gains)
        _copy_settings(swap.settings, swap.last_settings)
        if swap.law_at == swap.first_law_at:
            _copy(swap.gains, swap.first_gains)
            _copy_settings(swap.settings, swap.first_settings)
    swap.law_at, swap.compliant = swap.next_law_at, swap.next_compliant
    _copy(swap.next_gains, swap.gains)
    return take_settings(swap)


@lean_kernel
def _copy(gains: Any, to: Any) -> None:
    for k in range(gains.shape[0]):
        for j in range(gains.shape[1]):
            to[k, j] = gains[k, j]


@lean_kernel
def _copy_settings(settings: Any, to: Any) -> None:
    for k in range(settings.size):
        to[k] = settings[k]


@lean_kernel
def take_settings(swap: Any) -> int:
    """Put the settings asked for in force."""
    _copy_settings(swap.next_settings, swap.settings)
    return SWAPPED


@lean_kernel
def fall_back(swap: Any) -> None:
    """Put the law before the one in force back, for the one in force has failed; should that fail too, the first one.

    Its gains come back with it: those that were changed meanwhile have been judged for the other law.
    """
    if swap.last_law_at != 0:
        swap.law_at, swap.last_law_at, swap.compliant = swap.last_law_at, 0, swap.last_compliant
        _copy(swap.last_gains, swap.gains)
        _copy_settings(swap.last_settings, swap.settings)
    elif swap.law_at != swap.first_law_at:
        swap.law_at, swap.compliant = swap.first_law_at, swap.first_compliant
        _copy(swap.first_gains, swap.gains)
        _copy_settings(swap.first_settings, swap.settings)


@lean_kernel
def install_after_trial(swap: Any, tau: Any, memory: Any) -> int:
    """Put the law tried in force; what it says less than `tau` becomes the bias. A law without torque is refused.

    Args:
        tau: torque of the law before, bias included; stays as it is. Shape (n,).
        memory: becomes that of the new law. Shape (64,).
    """
    for j in range(tau.size):
        if not abs(swap.trial[j]) < np.inf:
            return NO_TORQUE
    for j in range(tau.size):
        swap.bias[j] = tau[j] - swap.trial[j]
    for k in range(memory.size):
        memory[k] = swap.trial_memory[k]
    return install(swap)


@lean_kernel
def answer_swap(swap: Any, result: int, tick: int, now_ns: int) -> None:
    """Say what became of the request, in cycle number `tick` planned for `now_ns`."""
    swap.result, swap.done_tick, swap.done_t_ns = result, tick, now_ns
    store_release(swap, "done", swap.asked)
