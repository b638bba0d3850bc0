"""The wrist's force sensor up to the board: bridges of strain gauges, their amplifiers, and the channels they end on.

    volts += (zero + gain * load + noise * N(0, 1) - volts) * share,    share = 1 - exp(-2 pi filter_hz dt)

for each component that is wired; the load is that of the plant, the noise is filtered with it. The sensor itself is
stiff. It feels its tool: weight, inertia and all that touches it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.config.scene import FORCE_AXES, ForceSensor
from qrobot.errors import ConfigError
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.analog import Analog
from qrobot.sim_board.random_lcg import first_state, normal

_N_FORCES: Final = 3
NO_VOLTS: Final = 1e-12  # less is none: without noise the filter would decay into denormal numbers [A]


class Wrist(NamedTuple):
    """A force sensor at the flange, of which k components are wired; without a sensor k is 0."""

    load: NDArray[np.float64]  # [6] force and torque on the tool, N and N m: the plant's
    axis: NDArray[np.int64]  # [k] index into `load`
    channel: NDArray[np.int64]  # [k] ADC channel
    gain: NDArray[np.float64]  # [k] V per N or N m; of the tool on the flange, hence negative
    random: NDArray[np.int64]  # [1] state of the generator
    zero: float  # V
    noise: float  # V rms before the filter
    share: float  # of the filter, 0..1


def no_wrist() -> Wrist:
    """Wrist without a force sensor."""
    none = np.zeros(0, np.int64)
    return Wrist(np.zeros(6), none, none, np.zeros(0), first_state(0), 0.0, 0.0, 0.0)


def make_wrist(sensor: ForceSensor, load: NDArray[np.float64], analog: Analog, dt: float, seed: int) -> Wrist:
    """A sensor that reads `load`, shape (6,), every `dt` seconds.

    Raises:
        ConfigError: it is wired to a channel that carries a potentiometer.
    """
    for name, channel in sensor.channels.items():
        if analog.pot_of[channel] >= 0:
            free = np.flatnonzero(analog.pot_of < 0).tolist()
            raise ConfigError(
                f"force sensor {name} on ADC channel {channel}: it carries the potentiometer of joint "
                f"{analog.pot_of[channel] + 1}; free are {free}"
            )
    axes = [FORCE_AXES.index(name) for name in sensor.channels]
    per_volt = [sensor.newton_per_volt if axis < _N_FORCES else sensor.newton_metre_per_volt for axis in axes]
    return Wrist(
        load=load,
        axis=np.array(axes),
        channel=np.array(list(sensor.channels.values())),
        gain=-1.0 / np.array(per_volt),
        random=first_state(seed),
        zero=sensor.zero_v,
        noise=sensor.noise_v,
        share=1.0 - math.exp(-2.0 * math.pi * sensor.filter_hz * dt),
    )


@lean_kernel
def sense_wrist(wrist: Wrist, external: NDArray[np.float64]) -> None:
    """One time step of the amplifiers; their outputs are `external`, V at the ADC channels. Shape (8,)."""
    for i in range(wrist.axis.size):
        volts = wrist.zero + wrist.gain[i] * wrist.load[wrist.axis[i]] + wrist.noise * normal(wrist.random)
        channel = wrist.channel[i]
        external[channel] += (volts - external[channel]) * wrist.share
        if abs(external[channel]) < NO_VOLTS:
            external[channel] = 0.0
