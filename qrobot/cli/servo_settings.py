"""Settings of an arm's servo, out of its deployment file and command-line options."""

from __future__ import annotations

from collections.abc import Iterable

from qrobot.arrays import Floats
from qrobot.cli.arms import fences_of_arm, robot_of_arm, tool_of_arm
from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.config.drives import POSITION_END
from qrobot.config.force_calibration import ForceCalibration, calibration_of_emulated
from qrobot.config.outputs import BoardAnalogOutput, BoardOutput
from qrobot.errors import ConfigError
from qrobot.servo.analog_lines import AnalogWire, analog_params
from qrobot.servo.calibration.table import CalibrationTable, load_table
from qrobot.servo.laws.file import load_law
from qrobot.servo.laws.names import check_law_name, is_file_law, whole_law_name
from qrobot.servo.output_lines import OutputWire
from qrobot.servo.settings import COUNTED_ONLY, Overrun, ServoSettings
from qrobot.units import MM_PER_M

REDUCED_SPEED_MM_S = 250.0  # ISO 10218-1: the most of a tool with a person within reach


def calibration_of_arm(arm: DeployedArm) -> CalibrationTable | None:
    """The calibration table an arm names, if any. Raises ConfigError when it is damaged or another arm's."""
    name = arm.board.calibration_table
    return None if name is None else load_table(name, robot_of_arm(arm))


def refuse_emulated_table(arm: DeployedArm, table: CalibrationTable | None) -> None:
    """Raise ConfigError when the table of an arm that a servo is to drive is an emulated arm's, and the arm is none.

    Index pulses come at the same places of a turn: every check would agree with counters that are whole turns off.
    """
    if table is not None and table.emulated and not arm.board.emulated:
        raise ConfigError(
            f"calibration_table {arm.board.calibration_table!r} is that of an emulated arm, and {arm.name} is none "
            f"(kind = {arm.board.kind!r}): its table has to be measured on it, by the board vendor's driver. Where an "
            "emulated board is behind its gateway, copy the table without the comment that says so"
        )


def servo_settings(
    arm: DeployedArm,
    rate_hz: float | None = None,
    law: str | None = None,
    velocity: str | None = None,
    interpolation: str | None = None,
    reduced_speed: bool = False,
) -> ServoSettings:
    """Settings of the deployment file, with what the command line overrides.

    Raises:
        ConfigError: drives do not fit the robot file, or what the file names is damaged or another robot's.
    """
    check_drives(arm)
    check_channels(arm)
    return ServoSettings(
        rate_hz=arm.servo.rate_hz if rate_hz is None else rate_hz,
        law=arm.servo.law if law is None else law,
        law_settings=arm.servo.law_settings if law is None else {},
        velocity=velocity or arm.servo.velocity,
        interpolation=interpolation or arm.servo.interpolation,
        guardian_timeout_ms=arm.servo.guardian_patience_ms,
        board_timeout_ms=arm.servo.board_timeout_ms,
        emulated=arm.board.emulated,
        board_slips=arm.board.slips,
        cpu=arm.servo.cpu,
        sensor_channels=arm.servo.sensor_channels,
        force_sensor=force_calibration_of(arm),
        exchange_ms=arm.board.period_ms,
        unchecked_gains=arm.servo.unchecked_gains,
        unchecked_rate=arm.servo.unchecked_rate,
        spin=arm.servo.spin,
        black_box_s=arm.log.black_box_s,
        reduced_speed_m_s=_reduced_speed(arm, reduced_speed) / MM_PER_M,
        tool_m=tool_of_arm(arm),
        position_drives=arm.board.position_drives,
        outputs=outputs_of(arm),
        analog_outputs=analog_outputs_of(arm),
        overrun=overrun_of(arm),
        calibration=calibration_of_arm(arm),
        pots=arm.board.has_pots,
        fences=fences_of_arm(arm),
    )


def check_drives(arm: DeployedArm) -> None:
    """Raise ConfigError when there is not one drive for each joint, or one would turn its motor the wrong way round.

    One without a joint would be let operate with the others: its brake opens, and it never gets torque.
    """
    drives = arm.board.drives
    if drives is None:
        return
    robot = robot_of_arm(arm)
    count = len(drives.nodes)
    if count != robot.n:
        raise ConfigError(f"drives.nodes of {arm.name} names {count} drives, {robot.name} has {robot.n} joints")
    if drives.absolute:
        _require_positions_within(POSITION_END, drives.positions_over(robot), arm.name)
    right = drives.torque_for(robot)
    if wrong := [joint + 1 for joint, each in enumerate(right) if each != drives.torque_permille[joint]]:
        raise ConfigError(
            f"drives.torque_permille of {arm.name} has the wrong sign for joint {', '.join(map(str, wrong))}, which "
            f"would run away: by the scales of {robot.name} and increments_per_count it is "
            f"[{', '.join(f'{each:g}' for each in right)}], where positive torque lets each drive's position rise; "
            "that is set in the drive (its polarity), not here"
        )


def _require_positions_within(end: int, positions: Floats, arm: str) -> None:
    """Raise ConfigError for the first joint whose drive would show `end` or more at one end of its range, (2, n)."""
    for joint, (one, other) in enumerate(positions.T.tolist(), 1):
        if max(abs(one), abs(other)) >= end:
            raise ConfigError(
                f"drives.counts_at_zero of {arm}: the position of joint {joint}'s drive goes from {one:.0f} to "
                f"{other:.0f} over its range, and begins anew at {end}: after power-up there its counter would be "
                "wrong; home the drive, or set its position offset, so that it shows less, and counts_at_zero by that"
            )


def force_calibration_of(arm: DeployedArm) -> ForceCalibration | None:
    """Calibration of an arm's force sensor, volts to forces; an emulated sensor gives its own when the file has none.

    Raises ConfigError when one of its channels carries a potentiometer.
    """
    emulated, given = arm.board.force_sensor, arm.servo.force_sensor
    if given is None:
        return calibration_of_emulated(emulated) if emulated is not None else None
    _require_free_channels(arm, "servo.force_sensor", given.channels)
    return given


def check_channels(arm: DeployedArm) -> None:
    """Raise ConfigError when a sensor or a module takes the place of a potentiometer."""
    sensor = arm.board.can_sensor
    _require_free_channels(arm, "board.can_sensor", [each.channel for each in sensor.signals] if sensor else [])
    _require_free_channels(arm, "board.io", [each.channel for module in arm.board.io for each in module.analog])


def _require_free_channels(arm: DeployedArm, what: str, channels: Iterable[int]) -> None:
    pots = robot_of_arm(arm).transmission.pot_channels.tolist() if arm.board.has_pots else []
    for channel in channels:
        if channel in pots:
            raise ConfigError(
                f"{what}: channel {channel} carries the potentiometer of joint {pots.index(channel) + 1}: take "
                "another, or say pots = false in [arm.board] of an arm without potentiometers"
            )


def _reduced_speed(arm: DeployedArm, asked: bool) -> float:
    """mm/s, 0 for no limit: the file's, and where somebody asks for it T1's when the file has none, or more."""
    chosen = arm.servo.reduced_speed_mm_s
    if not asked:
        return chosen or 0.0
    return REDUCED_SPEED_MM_S if chosen is None else min(chosen, REDUCED_SPEED_MM_S)


def outputs_of(arm: DeployedArm) -> tuple[OutputWire, ...]:
    """The lines that programs of an arm may switch, in the order of their numbers."""
    wires = [
        OutputWire(each.output, each.label, each.on_stop == "hold", each.bit if isinstance(each, BoardOutput) else None)
        for each in arm.board.lines
    ]
    return tuple(sorted(wires, key=lambda wire: wire.output))


def analog_outputs_of(arm: DeployedArm) -> tuple[AnalogWire, ...]:
    """The analogue outputs of an arm, in the order of their numbers. Raises ConfigError: one would drive a motor."""
    wires = [
        AnalogWire(
            each.output, each.label, each.min_v, each.max_v, each.off_volts, each.on_stop == "hold",
            each.dac if isinstance(each, BoardAnalogOutput) else None,
        )
        for each in arm.board.analog_lines
    ]  # fmt: skip
    if wires:
        analog_params(wires, robot_of_arm(arm).n)
    return tuple(sorted(wires, key=lambda wire: wire.output))


def overrun_of(arm: DeployedArm) -> Overrun:
    """The file's choice; without one a real arm stops at a few late cycles, and an emulated one counts them."""
    chosen = arm.servo.overrun
    if chosen is None:
        return COUNTED_ONLY if arm.board.emulated else Overrun()
    return Overrun(chosen.misses_in_a_row, chosen.late_share, chosen.window_s)


def check_law(name: str, robot: Robot) -> str:
    """The whole name of a law that is there for a robot, so that nothing begins without it; its file is run.

    Raises:
        ConfigError: there is no such law, or its file fails.
    """
    check_law_name(name)
    if is_file_law(name):
        load_law(name, robot)
    return whole_law_name(name)
