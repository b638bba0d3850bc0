"""Settings of a servo out of the deployment file, independent of the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from qrobot.config.deployment import GUARDIAN_TIMEOUT_MS
from qrobot.config.force_calibration import ForceCalibration
from qrobot.errors import ConfigError
from qrobot.fences.fence_set import FenceSet
from qrobot.hwif.registers import N_ADCS
from qrobot.servo.analog_lines import AnalogWire
from qrobot.servo.calibration.table import CalibrationTable
from qrobot.servo.kernels.interpolation_polynomials import DEFAULT_FORM, find_form
from qrobot.servo.kernels.velocity import DEFAULT_ESTIMATOR, find_estimator
from qrobot.servo.laws.names import DEFAULT_LAW, check_law_name
from qrobot.servo.neighbour import Neighbour
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.rates import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from qrobot.units import NS_PER_S

FASTEST_TOOL_M_S, LONGEST_TOOL_M = 10.0, 2.0  # [A] beyond these somebody meant another unit


@dataclass(frozen=True)
class Overrun:
    """Number of late cycles that are too many while the motors carry torque.

    Attributes:
        misses_in_a_row: cycles one after the other that were late or followed skipped ones; 0 is never too many.
        late_share: share of a window's cycles that may be late or skipped; 1 is never too many.
        window_s: length of the window.
    """

    misses_in_a_row: int = 3
    late_share: float = 0.01
    window_s: float = 1.0

    def __post_init__(self) -> None:
        if not (self.misses_in_a_row >= 0 and 0.0 <= self.late_share <= 1.0 and 0.01 <= self.window_s <= 60.0):
            raise ConfigError(f"{self}: allowed are 0 or more misses, a share of 0 to 1, a window of 0.01 to 60 s")


COUNTED_ONLY = Overrun(misses_in_a_row=0, late_share=1.0)  # for emulated arms: nothing is hurt by a late cycle


@dataclass(frozen=True)
class ServoSettings:
    """Choices of one servo daemon.

    Attributes:
        rate_hz: cycles per second; the period is rounded to whole nanoseconds.
        law: name of the control law, see `servo.laws`.
        law_settings: numbers of the law's own that were chosen, by name.
        velocity: how velocities are estimated, see `servo.kernels.velocity.ESTIMATORS`.
        interpolation: form of the path between setpoints, see `servo.kernels.interpolation_polynomials.FORMS`.
        guarded: a guardian is required; without one the servo refuses power.
        guardian_timeout_ms: age of the servo's heartbeat at which the guardian acts.
        board_timeout_ms: time without a new image, in cycles that ran, after which the board counts as gone.
        emulated: the board is emulated; only where real time is required a rate that is not kept is refused then.
        board_slips: the board is emulated and lets time stand still while nobody could control the arm.
        overrun: late cycles that are too many.
        spin: sleep short of each deadline and spin the rest; costs CPU, gains precision.
        cpu: processor for the loop thread, None for the last one allowed.
        priority: SCHED_FIFO priority of the loop thread.
        black_box_s: how much the telemetry ring holds, at least, where shared memory has room for it.
        unchecked_rate: somebody has signed for a rate that the self-test of `servo.process.rate_test` would refuse.
        sensor_channels: ADC channels sampled all the time, for laws that use sensors.
        force_sensor: how volts become force and torque at the wrist; its channels are sampled all the time, too.
        position_drives: the arm's drives close the loop themselves (cyclic synchronous position): they get the
            reference, no law but the default may be named and it gives no torque, and what is judged by torques is not
            watched.
        exchange_ms: time between two exchanges with a board behind a gateway; 0 for a board without one.
        unchecked_gains: somebody has signed for gains that `servo.laws.stability` would refuse.
        reduced_speed_m_s: the most that the tool's tip may move, 0 for no such limit.
        tool_m: the tool's tip from the flange, in its frame.
        outputs: lines that programs may switch.
        analog_outputs: those that programs may set.
        calibration: the arm's table; without one it cannot be calibrated.
        pots: the arm has potentiometers. Without a table they watch over encoders that have died, and nothing else.
        fences: that the arm is stopped before; None for none.
        neighbours: other arms that it keeps off.
    """

    rate_hz: float = 1000.0
    law: str = DEFAULT_LAW
    law_settings: Mapping[str, float] = field(default_factory=dict)
    velocity: str = DEFAULT_ESTIMATOR
    interpolation: str = DEFAULT_FORM
    guarded: bool = True
    guardian_timeout_ms: float = GUARDIAN_TIMEOUT_MS
    board_timeout_ms: float = 1.0
    emulated: bool = False
    board_slips: bool = False
    overrun: Overrun = Overrun()
    spin: bool = True
    cpu: int | None = None
    priority: int = 80
    black_box_s: float = 60.0
    unchecked_rate: bool = False
    sensor_channels: tuple[int, ...] = ()
    force_sensor: ForceCalibration | None = None
    position_drives: bool = False
    exchange_ms: float = 0.0
    unchecked_gains: bool = False
    reduced_speed_m_s: float = 0.0
    tool_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    outputs: tuple[OutputWire, ...] = ()
    analog_outputs: tuple[AnalogWire, ...] = ()
    calibration: CalibrationTable | None = None
    pots: bool = True
    fences: FenceSet | None = None
    neighbours: tuple[Neighbour, ...] = ()

    def __post_init__(self) -> None:
        if not LOWEST_RATE_HZ <= self.rate_hz <= HIGHEST_RATE_HZ:
            raise ConfigError(
                f"RATE: servo rate {self.rate_hz:g} Hz: allowed are {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g} Hz"
            )
        if not 0.0 <= self.exchange_ms <= 1000.0:
            raise ConfigError(f"exchanges every {self.exchange_ms} ms: allowed are 0 to 1000 ms")
        if not 0.5 <= self.guardian_timeout_ms <= 1000.0:
            raise ConfigError(f"guardian time-out {self.guardian_timeout_ms} ms: allowed are 0.5 to 1000 ms")
        if not 0.0 < self.board_timeout_ms <= 1000.0:
            raise ConfigError(f"board time-out {self.board_timeout_ms} ms: allowed are 0 to 1000 ms")
        if not 1.0 <= self.black_box_s <= 600.0:
            raise ConfigError(f"black box of {self.black_box_s:g} s: allowed are 1 to 600 s")
        if not set(self.sensor_channels) <= set(range(N_ADCS)):
            raise ConfigError(f"sensor channels {self.sensor_channels}: the board has 0 to {N_ADCS - 1}")
        if not 0.0 <= self.reduced_speed_m_s <= FASTEST_TOOL_M_S:
            raise ConfigError(f"reduced speed {self.reduced_speed_m_s:g} m/s: 0 to {FASTEST_TOOL_M_S:g} are allowed")
        if len(self.tool_m) != 3 or not all(abs(x) <= LONGEST_TOOL_M for x in self.tool_m):
            raise ConfigError(f"tool {self.tool_m}: three numbers within {LONGEST_TOOL_M:g} m are needed")
        check_law_name(self.law)
        if self.position_drives and (self.law != DEFAULT_LAW or self.law_settings):
            raise ConfigError(f"law {self.law} means nothing to drives in position mode: leave it out")
        find_estimator(self.velocity)
        find_form(self.interpolation)

    @property
    def analog_ranges(self) -> dict[int, tuple[float, float]]:
        """Least and most volts of the analogue outputs, by their numbers from 1."""
        return {wire.output: (wire.least_v, wire.most_v) for wire in self.analog_outputs}

    @property
    def sampled_channels(self) -> frozenset[int]:
        """ADC channels that are sampled all the time."""
        force = self.force_sensor.channels if self.force_sensor is not None else ()
        return frozenset((*self.sensor_channels, *force))

    @property
    def telemetry_capacity(self) -> int:
        """Rows of the telemetry ring, a power of two."""
        return 1 << max(4, math.ceil(math.log2(self.black_box_s * self.rate_hz)))

    @property
    def period_ns(self) -> int:
        """Length of a cycle in nanoseconds."""
        return round(NS_PER_S / self.rate_hz)
