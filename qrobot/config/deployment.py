"""A deployment: which arms run on this machine, on which board, how fast, and who may reach them.

One `[[arm]]` table per arm. Every process, mailbox and log carries the arm's name, so two arms of the same kind run
side by side from one file.
"""

from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from qrobot.config.bridge import BridgeChoice
from qrobot.config.can import CanTransport
from qrobot.config.can_sensor import CanSensor
from qrobot.config.document import Table, check_document, config_path, read_document
from qrobot.config.drives import DrivesTransport
from qrobot.config.fences import FencesChoice, Stand
from qrobot.config.force_calibration import ForceCalibration
from qrobot.config.kinds import FileKind
from qrobot.config.modbus import ModbusTransport
from qrobot.config.modbus_io import ModbusIo
from qrobot.config.outputs import AnalogOutputLine, BoardAnalogOutput, BoardOutput, OutputLine
from qrobot.config.scene import ForceSensor, Scene
from qrobot.config.signals import NamedSignal
from qrobot.config.transport import PortTransport
from qrobot.config.values import GivenName

TRANSPORTS = (
    "port",
    "can",
    "modbus",
    "drives",
)  # kinds of boards that are not emulated here; each has a table of its name
EXCHANGES_TO_MISS = 2  # before a servo may take the board behind a gateway for gone
GUARDIAN_TIMEOUT_MS = 5.0  # as hostmot2's watchdog; 120 s of soak on a loaded PC showed 3.2 ms at worst
SLOWEST_SERVO_HZ = 100
LEAST_GB, MOST_GB = 0.01, 1e6  # [A] of all logs of an arm
CYCLES_TO_MISS = 2  # from one heartbeat on, before a guardian may take the servo for silent: a cycle may come late
Millimetres = Annotated[float, Field(ge=-2000, le=2000, allow_inf_nan=False)]
Velocity = Literal["difference", "observer"]
Interpolation = Literal["linear", "cubic", "quintic", "b-spline"]


def guardian_objection(rate_hz: float, timeout_ms: float) -> str:
    """Reason for which a guardian cannot watch a servo of that rate so closely; "" when it can."""
    if timeout_ms >= (least_ms := _least_timeout_ms(rate_hz)):
        return ""
    return f"servo.guardian_timeout_ms {timeout_ms:g} is too short for a servo of {rate_hz:g} Hz: at least {least_ms:g}"


def _least_timeout_ms(rate_hz: float) -> float:
    """The shortest time-out, in whole microseconds, so that it is told exactly."""
    return math.ceil(CYCLES_TO_MISS * 1e6 / rate_hz) / 1e3


class BoardChoice(Table):
    """The board of an arm; `emulator` is the only kind that needs no hardware.

    Every other kind has a table of its own name that says where the board is: with `kind = "can"` there has to be
    `[arm.board.can]`, though it may be empty.

    `revision` defaults to the robot file's. With `pots = false` the arm has no potentiometers, as the PUMA 200 series,
    and their ADC channels are free inputs: it is needed too where something else is on channels of potentiometers.
    Separate drives never have any, whatever `pots` says.
    `calibration_table` is a packaged table or a `.txt`; without one the servo cannot calibrate the arm, and its
    potentiometers only watch over their encoders. With `calibrate_at_start`, `qrobot up` calibrates an arm
    whose board has lost its counters, as the supervisor of the papers did: it moves. `plant` is the physics behind the
    emulated board: the robot file's own (`nominal`) or one fixed draw of wrong friction, gravity, torque gain and
    stiction (`mismatched`). `calibrated` is the state of the counters at chassis power-up. `adc_idle` and `index_idle`
    are the levels that STATUS bits 14 and 8-13 of the emulated board show while their masks are off, which no source
    tells. With `time_slip` an emulated arm's time stands still while this machine keeps its processes from running;
    without, the arm goes on meanwhile, as a real one would.
    """

    kind: Literal["emulator", "port", "can", "modbus", "drives"] = "emulator"
    plant: Literal["nominal", "mismatched"] = "nominal"
    calibrated: bool = True
    time_slip: bool = True
    revision: Literal["E", "F"] | None = None
    start_pose: str = "park"
    seed: int = Field(default=0, ge=0)
    pots: bool = True
    adc_idle: Literal[0, 1] = 0
    index_idle: Literal[0, 1] = 0
    calibration_table: str | None = None
    calibrate_at_start: bool = False
    scene: Scene = Scene()
    force_sensor: ForceSensor | None = None
    port: PortTransport | None = None
    can: CanTransport | None = None
    modbus: ModbusTransport | None = None
    drives: DrivesTransport | None = None
    can_sensor: CanSensor | None = None
    outputs: tuple[BoardOutput, ...] = Field(default=(), strict=False)
    analog_outputs: tuple[BoardAnalogOutput, ...] = Field(default=(), strict=False)
    io: tuple[ModbusIo, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _has_the_table_of_its_kind(self) -> BoardChoice:
        for transport in TRANSPORTS:
            given = getattr(self, transport) is not None
            if given and self.kind != transport:
                raise ValueError(f"a table {transport!r} needs kind = {transport!r}, not {self.kind!r}")
            if not given and self.kind == transport:
                raise ValueError(f"kind = {transport!r} needs a table [arm.board.{transport}]")
        return self

    @property
    def places(self) -> frozenset[str]:
        """Places of the board that no other arm can have; none of an emulated one."""
        transport = None if self.kind == "emulator" else getattr(self, self.kind)
        return frozenset() if transport is None else transport.places

    @property
    def written_places(self) -> frozenset[str]:
        """Coils and registers of modules that no other arm can write."""
        return frozenset[str]().union(*(module.written_places for module in self.io))

    @model_validator(mode="after")
    def _has_a_table_to_calibrate_with(self) -> BoardChoice:
        if self.calibrate_at_start and self.calibration_table is None:
            raise ValueError("calibrate_at_start needs a calibration_table")
        if self.calibration_table is not None and self.kind == "drives":
            raise ValueError("separate drives have no potentiometers and no index pulses: leave calibration_table out")
        return self

    @model_validator(mode="after")
    def _has_a_gateway_for_its_sensor(self) -> BoardChoice:
        if self.can_sensor is not None and not self.period_ms:
            raise ValueError(f"a sensor on CAN needs a board behind a gateway, and kind = {self.kind!r} has none")
        return self

    @model_validator(mode="after")
    def _has_a_place_for_its_modules(self) -> BoardChoice:
        inputs = [each.input for module in self.io for each in module.inputs]
        if twice := [each for each in inputs if inputs.count(each) > 1]:
            raise ValueError(f"two remote inputs stand for the same input {twice[0]}")
        channels = [each.channel for module in self.io for each in module.analog]
        channels += [each.channel for each in self.can_sensor.signals] if self.can_sensor else []
        if twice := [each for each in channels if channels.count(each) > 1]:
            raise ValueError(f"two remote analogue inputs stand for the same channel {twice[0]}")
        for one, other in combinations(self.io, 2):
            if shared := one.written_places & other.written_places:
                raise ValueError(f"two modules write {min(shared)}")
        if self.io and self.kind == "port":
            raise ValueError("modules need an emulated board or one behind a gateway, and kind = 'port' has none")
        return self

    @model_validator(mode="after")
    def _has_outputs_of_its_own(self) -> BoardChoice:
        if self.outputs and self.kind == "drives":
            raise ValueError("separate drives have no output lines of a board: use those of a module, [[arm.board.io]]")
        for what in ("output", "label", "bit"):
            given = [getattr(each, what) for each in (self.outputs if what == "bit" else self.lines)]
            if twice := [each for each in given if given.count(each) > 1]:
                raise ValueError(f"two outputs have the same {'name' if what == 'label' else what} {twice[0]}")
        return self

    @model_validator(mode="after")
    def _has_analog_outputs_of_its_own(self) -> BoardChoice:
        if self.analog_outputs and self.kind == "drives":
            raise ValueError("separate drives have no converters of a board: use those of a module, [[arm.board.io]]")
        for what in ("output", "label", "dac"):
            given = [getattr(each, what) for each in (self.analog_outputs if what == "dac" else self.analog_lines)]
            if twice := [each for each in given if given.count(each) > 1]:
                raise ValueError(f"two analogue outputs have the same {'name' if what == 'label' else what} {twice[0]}")
        return self

    @property
    def analog_lines(self) -> tuple[AnalogOutputLine, ...]:
        """All analogue outputs of the arm, the board's own and those of modules."""
        return (*self.analog_outputs, *(each for module in self.io for each in module.analog_outputs))

    @property
    def lines(self) -> tuple[OutputLine, ...]:
        """All outputs of the arm, the board's own and those of modules."""
        return (*self.outputs, *(each for module in self.io for each in module.outputs))

    @property
    def period_ms(self) -> float:
        """Time between two exchanges with a board behind a gateway; 0 for a board without one."""
        transport = getattr(self, self.kind, None)
        return float(getattr(transport, "period_ms", 0.0))

    @property
    def emulated(self) -> bool:
        """No hardware is behind the board, and nothing is hurt."""
        return self.kind == "emulator"

    @property
    def slips(self) -> bool:
        """The board may let time stand still: only an emulated one can."""
        return self.emulated and self.time_slip

    @property
    def has_pots(self) -> bool:
        """The arm's potentiometers are wired to channels of the board's converter."""
        return self.pots and self.kind != "drives"

    @property
    def position_drives(self) -> bool:
        """The arm's drives close the position loop, and the control law has no say."""
        return self.drives is not None and self.drives.mode == "position"


class OverrunChoice(Table):
    """Late cycles that stop an arm: so many in a row (0: no number), or more than a share of a window (1: never)."""

    misses_in_a_row: int = Field(default=3, ge=0)
    late_share: float = Field(default=0.01, ge=0, le=1, allow_inf_nan=False)
    window_s: float = Field(default=1.0, ge=0.01, le=60, allow_inf_nan=False)


class ServoChoice(Table):
    """The servo of an arm: rate, control law, processor, and the patience with a silent servo or board.

    `law` is a shipped law or one of yours, `path/to/file.py:name`, from this file's folder; `law_settings` are its own
    numbers.

    `velocity` is how velocities are estimated and `interpolation` the path between setpoints; the page on estimation
    and interpolation compares them.

    Without `overrun` late cycles of an emulated arm are only counted.

    `model` is the arm's identified model, a `.toml` that `qrobot identify fit` wrote; one that is damaged or another
    robot's is told and not used.

    `unchecked_gains` signs for gains that are not stable with margin at this rate, which the servo refuses otherwise.

    `reduced_speed_mm_s` bounds the speed of the tool's tip, `tool_mm` from the flange in its frame: what asks for more
    is stopped. 250 is the most for a person within reach (ISO 10218-1); this is no safety function.

    `guardian_timeout_ms` is two cycles at least. Where it is left out it is 5 ms, two cycles of a servo below 400 Hz.

    At start the loop runs for a moment by itself. A rate that this machine does not keep is refused on a real board
    or with `require_realtime`, else told; `unchecked_rate` signs for it. Without `spin` the loop sleeps to its
    deadline: it needs less of the processor, and is later.

    `sensor_channels` are the ADC channels the servo samples all the time, round robin, for laws that use sensors.
    `force_sensor` makes the force and torque at the wrist of them, which programs and logs see.
    """

    rate_hz: int = Field(default=1000, ge=SLOWEST_SERVO_HZ, le=10_000)
    law: str = "qrobot"
    law_settings: dict[str, float] = Field(default={}, strict=False)
    model: str | None = None
    velocity: Velocity = "difference"
    interpolation: Interpolation = "quintic"
    cpu: int | None = Field(default=None, ge=0)
    guardian_timeout_ms: float | None = Field(default=None, ge=0.5, le=1000, allow_inf_nan=False)
    board_timeout_ms: float = Field(default=1.0, gt=0, le=1000, allow_inf_nan=False)
    require_realtime: bool = False
    overrun: OverrunChoice | None = None
    unchecked_gains: bool = False
    unchecked_rate: bool = False
    spin: bool = True
    reduced_speed_mm_s: float | None = Field(default=None, ge=1, le=10_000, allow_inf_nan=False)
    tool_mm: tuple[Millimetres, Millimetres, Millimetres] = Field(default=(0.0, 0.0, 0.0), strict=False)
    sensor_channels: tuple[int, ...] = Field(default=(), strict=False)
    force_sensor: ForceCalibration | None = None

    @model_validator(mode="after")
    def _keeps_its_guardian_quiet(self) -> ServoChoice:
        if objection := guardian_objection(self.rate_hz, self.guardian_patience_ms):
            raise ValueError(objection)
        return self

    @property
    def guardian_patience_ms(self) -> float:
        """Age of the servo's heartbeat at which the guardian acts, ms, also where the file does not say it."""
        if self.guardian_timeout_ms is not None:
            return self.guardian_timeout_ms
        return max(GUARDIAN_TIMEOUT_MS, _least_timeout_ms(self.rate_hz))


class LogChoice(Table):
    """Folder of the logs; an empty directory name switches them off.

    The servo keeps the last `black_box_s` seconds of every cycle in shared memory, recorded or not: 49 MB at 1 kHz and
    195 MB at 4 kHz for six joints and a minute. Less is kept where there is room for less.

    With `keep_gb` the oldest files of the arm's logs are removed when all together would be more, but for one that
    is being written. Without it all are kept, until the disk is full. Incidents stay, each with its cycles around a
    fault.
    """

    directory: str = "out"
    black_box_s: float = Field(default=60.0, ge=1, le=600, allow_inf_nan=False)
    keep_gb: float | None = Field(default=None, ge=LEAST_GB, le=MOST_GB, allow_inf_nan=False)


class DeployedArm(Table):
    """One arm: its instance name, its robot file and its processes."""

    name: GivenName
    robot: str
    board: BoardChoice = BoardChoice()
    servo: ServoChoice = ServoChoice()
    bridge: BridgeChoice
    log: LogChoice = LogChoice()
    fences: FencesChoice | None = None
    stand: Stand | None = None
    signals: tuple[NamedSignal, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _has_what_its_signals_name(self) -> DeployedArm:
        names = [each.name for each in self.named_signals]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"two signals or outputs have the same name {twice[0]!r}")
        there = {each.output for each in self.board.lines}
        analog = {each.output for each in self.board.analog_lines}
        for each in self.signals:
            first, last = each.outputs or (1, 0)
            if missing := set(range(first, last + 1)) - there:
                raise ValueError(
                    f"signal {each.name!r}: the arm has no output {min(missing)}; see [[arm.board.outputs]]"
                )
            if each.analog_output is not None and each.analog_output not in analog:
                raise ValueError(
                    f"signal {each.name!r}: the arm has no analogue output {each.analog_output}; see "
                    "[[arm.board.analog_outputs]]"
                )
            if each.analog is not None and each.analog not in self.servo.sensor_channels:
                raise ValueError(f"signal {each.name!r}: channel {each.analog} is not in servo.sensor_channels")
        return self

    @model_validator(mode="after")
    def _is_patient_with_its_transport(self) -> DeployedArm:
        least = EXCHANGES_TO_MISS * self.board.period_ms
        if self.servo.board_timeout_ms < least:
            raise ValueError(
                f"servo.board_timeout_ms {self.servo.board_timeout_ms:g} is too short for a board that is asked every "
                f"{self.board.period_ms:g} ms: at least {least:g}"
            )
        return self

    @model_validator(mode="after")
    def _has_a_law_that_is_obeyed(self) -> DeployedArm:
        given = {"law", "law_settings"} & self.servo.model_fields_set
        if given and self.board.position_drives:
            raise ValueError(f"servo.{min(given)} means nothing to drives in position mode: leave it out")
        return self

    @property
    def analog_ranges(self) -> dict[int, tuple[float, float]]:
        """Least and most volts of the analogue outputs, by their numbers from 1."""
        return {each.output: (each.min_v, each.max_v) for each in self.board.analog_lines}

    @property
    def named_signals(self) -> tuple[NamedSignal, ...]:
        """Everything that has a name for programs: `signals`, and each output that has one of its own."""
        board = self.board
        own = (NamedSignal(name=each.name, outputs=(each.output, each.output)) for each in board.lines if each.name)
        analog = (NamedSignal(name=each.name, analog_output=each.output) for each in board.analog_lines if each.name)
        return (*self.signals, *own, *analog)


class Deployment(Table):
    """All arms of one machine."""

    arm: tuple[DeployedArm, ...] = Field(strict=False)

    @model_validator(mode="after")
    def _is_some(self) -> Deployment:
        if not self.arm:  # min_length would complain of an arm with a mistake in it as well
            raise ValueError("at least one [[arm]] is needed")
        return self

    @model_validator(mode="after")
    def _do_not_collide(self) -> Deployment:
        names = [arm.name for arm in self.arm]
        if len(set(names)) != len(names):
            raise ValueError("two arms have the same name")
        ports = [arm.bridge.port for arm in self.arm]
        if len(set(ports)) != len(ports):
            raise ValueError("two arms have the same bridge.port")
        for one, other in combinations(self.arm, 2):
            if shared := one.board.places & other.board.places:
                raise ValueError(f"{one.name} and {other.name} have one board or bus: {min(shared)}")
            if shared := one.board.written_places & other.board.written_places:
                raise ValueError(f"{one.name} and {other.name} both write {min(shared)}")
        return self

    @model_validator(mode="after")
    def _know_where_others_stand(self) -> Deployment:
        stands = {arm.name: arm.stand for arm in self.arm}
        for arm in self.arm:
            for other in () if arm.fences is None else arm.fences.arms:
                if other not in stands or other == arm.name:
                    raise ValueError(f"fences.arms of {arm.name} names {other!r}, which is no other arm of the file")
                if lost := [name for name in (arm.name, other) if stands[name] is None]:
                    raise ValueError(f"{arm.name} keeps off {other}: [arm.stand] of {lost[0]} is missing")
                if stands[arm.name] == stands[other]:
                    raise ValueError(f"{arm.name} and {other} have the same stand")
        return self


def deployment_path(name_or_path: str | Path) -> Path:
    """Path of a deployment file, packaged (by name) or given (ending in `.toml`).

    Raises:
        ConfigError: there is none; names the nearest known one.
    """
    return config_path(name_or_path, FileKind.DEPLOYMENT)


def load_deployment(name_or_path: str | Path) -> Deployment:
    """Load and validate a deployment. Files that it names by relative paths are sought from its own folder.

    Raises:
        ConfigError: no such file, or every mistake in it with its path in the file.
    """
    path = deployment_path(name_or_path)
    deployment = check_document(Deployment, read_document(path), path.name)
    folder = path.resolve().parent
    return deployment.model_copy(update={"arm": tuple(_with_whole_paths(arm, folder) for arm in deployment.arm)})


def _with_whole_paths(arm: DeployedArm, folder: Path) -> DeployedArm:
    """An arm whose files have their whole paths: those that it names by relative ones are sought from `folder`."""
    servo, board = arm.servo, arm.board
    law, colon, name = servo.law.rpartition(":") if ":" in servo.law else (servo.law, "", "")
    files = {"law": f"{_whole(law, '.py', folder)}{colon}{name}", "model": _whole(servo.model, ".toml", folder)}
    table = _whole(board.calibration_table, ".txt", folder)
    return arm.model_copy(
        update={
            "robot": _whole(arm.robot, ".toml", folder),
            "servo": servo.model_copy(update=files),
            "board": board.model_copy(update={"calibration_table": table}),
            "bridge": _with_whole_token_path(arm.bridge, folder),
        }
    )


def _with_whole_token_path(bridge: BridgeChoice, folder: Path) -> BridgeChoice:
    if bridge.link is None:
        return bridge
    link = bridge.link.model_copy(update={"token_file": str(folder / bridge.link.token_file)})
    return bridge.model_copy(update={"link": link})


def _whole(path: str | None, ending: str, folder: Path) -> str | None:
    """The path of a file; a name without its ending is that of something packaged."""
    return str(folder / path) if path is not None and path.lower().endswith(ending) else path
