"""`qrobot board`: a TRC004 board as a process: an emulated one, or the gateway to one behind a transport."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from cyclopts import App, Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, choose_arms, robot_of_arm
from qrobot.cli.board_check import check
from qrobot.cli.board_replay import replay
from qrobot.cli.board_show import force, show
from qrobot.cli.console import note
from qrobot.cli.option_types import OutputNewGrowing
from qrobot.cli.servo_settings import check_drives
from qrobot.config.deployment import DeployedArm
from qrobot.config.scene import SceneKind
from qrobot.errors import ConfigError
from qrobot.report import QueuedReport

if TYPE_CHECKING:
    from qrobot.hwif.board_memory import BoardSegment

GATEWAY_PRIORITY: Final = 70  # below the servo's, which waits for nobody; above an emulated board's

app = App(name="board", help_format="plaintext", group_commands="Commands")
app.command(check)
app.command(replay)
app.command(show)
app.command(force)


@app.default
def board(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    plant: Literal["nominal", "mismatched"] | None = None,
    calibrated: Annotated[bool | None, Parameter(negative="--uncalibrated")] = None,
    fault: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    faults: Path | None = None,
    scene: SceneKind | None = None,
    serve: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    record: OutputNewGrowing | None = None,
) -> None:
    """Emulate a TRC004 board and the arm behind it, or be the gateway to a board, until Ctrl-C.

    The board lives in shared memory under the arm's name and runs on the wall clock, whoever connects or dies. Where
    the file's board is of another kind than `emulator`, its image is exchanged with the real one instead. A card on
    this machine's own bus (kind = "port") needs no such process: the servo reaches it.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    plant
        Overrides the file: the robot file's own friction, gravity and torque, or one fixed draw of wrong ones.
    calibrated
        Overrides the file: counters hold the true position, or were zeroed where the arm stands.
    fault
        Something that breaks, times counted from the start: "encoder:2 stuck @5s +0.5s". May be given again.
        `qrobot inject --list` tells what can break; `qrobot inject` breaks it in a board that runs.
    faults
        TOML file with the keys `faults`, a list of such lines, and `seed`, of what is random in them.
    scene
        Overrides the file: what stands around the arm. Its other settings are the file's.
    serve
        Serve the emulated board over a transport as well, as `can=INTERFACE:CHANNEL` (names of python-can; @NODE may
        follow) or `modbus=HOST:PORT` (@MS may follow: the client's silence after which the board is made safe, 100 if
        left out, 0 for never; then +CLIENT,...: addresses or networks of other machines that may connect).
        Whoever is at the other end then is this board's one controller: a servo, or another program, is refused. May be
        given again.
    record
        Write every register access of a board behind a transport to this file; `qrobot board replay` reads it.
    """
    chosen = choose_arm(deployment, arm)
    if not chosen.board.emulated:
        refuse_options(chosen, plant=plant, calibrated=calibrated, fault=fault, faults=faults, scene=scene, serve=serve)
        run_gateway(chosen, record)
        return
    if record is not None:
        raise ConfigError(
            f"--record: the emulated board of {chosen.name} is behind no transport; its log has every cycle"
        )
    beside = [each.name for each in choose_arms(deployment, None) if each.board.slips and each.name != chosen.name]
    run_emulator(
        chosen, beside, plant=plant, calibrated=calibrated, fault=fault, faults=faults, scene=scene, serve_over=serve
    )


def refuse_options(arm: DeployedArm, **options: object) -> None:
    """Raise ConfigError when an option is given that only an emulated board has."""
    given = ", ".join(f"--{name}" for name, value in options.items() if value not in (None, ()))
    if given:
        raise ConfigError(f"{given}: only for an emulated board, and that of {arm.name} is of kind {arm.board.kind!r}")


def run_emulator(
    arm: DeployedArm,
    beside: Sequence[str],
    *,
    plant: Literal["nominal", "mismatched"] | None = None,
    calibrated: bool | None = None,
    fault: tuple[str, ...] = (),
    faults: Path | None = None,
    scene: SceneKind | None = None,
    serve_over: tuple[str, ...] = (),
) -> None:
    """The process of an emulated board and the arm behind it.

    Args:
        arm: as the deployment file has it.
        beside: names of the emulated arms with which it keeps one time.
        plant: overrides the file unless it is None; so do `calibrated` and `scene`.
        fault: lines that tell what breaks, besides those of the file `faults`.
        serve_over: transports over which the board is served as well, each as `TRANSPORT=ADDRESS`.

    Raises:
        ConfigError: robot file, faults, scene or transports are wrong, or something that they need is not installed.
        LinkBusy: a board serves that arm already, or this one has a controller and cannot be served over a transport.
        LinkError: there is no room for its memory, or an address of a transport is in use or not there.
    """
    from qrobot.hwif.board_memory import claim_board
    from qrobot.hwif.bus import MemoryEndpoint
    from qrobot.hwif.transports import check_servers, modules_beside, servers
    from qrobot.servo.memory.servo_memory import arm_is_driven
    from qrobot.sim_board.deployed import emulator_of_arm
    from qrobot.sim_board.faults import FaultPlan
    from qrobot.sim_board.server import serve

    check_servers(serve_over)
    robot = robot_of_arm(arm)
    plan = FaultPlan.load(faults) if faults else FaultPlan()
    plan = FaultPlan(plan.faults + FaultPlan.parse(fault).faults, plan.seed)
    emulator = emulator_of_arm(arm, robot, plant=plant, calibrated=calibrated, scene=scene, faults=plan)

    @contextmanager
    def served(segment: BoardSegment) -> Iterator[None]:
        if serve_over:
            claim_board(segment, arm.name)
        memory = segment.memory
        with modules_beside(arm.board, memory, told), servers(serve_over, MemoryEndpoint(memory), told):
            yield

    with QueuedReport(note) as told:
        serve(
            arm.name,
            emulator,
            lambda: told(f"board of {arm.name} ({robot.name}) runs"),
            served,
            arm.board.slips,
            beside,
            lambda line: told(f"{arm.name}: {line}"),
            partial(arm_is_driven, arm.name),
        )


def run_gateway(arm: DeployedArm, record: Path | None = None) -> None:
    """The gateway process of a board that is elsewhere.

    Raises:
        ConfigError: drives do not fit the robot file. LogError: there is no writing to `record`.
    """
    from qrobot.hwif.gateway import serve
    from qrobot.hwif.recorder import BusRecorder
    from qrobot.hwif.transports import open_transport
    from qrobot.realtime.setup import hard_to_delay, set_fifo
    from qrobot.realtime.startup_order import await_turn
    from qrobot.servo.memory.servo_memory import arm_is_driven

    check_drives(arm)
    await_turn()
    needed = partial(arm_is_driven, arm.name)
    begin = partial(set_fifo, GATEWAY_PRIORITY)  # of all threads: each may hold the interpreter's lock
    with QueuedReport(lambda line: note(f"{arm.name}: {line}"), begin) as report:
        bus, period_ns, module_losses, settle = open_transport(arm.board, report, arm.servo.board_timeout_ms, begin)
        held = sum(1 << each.bit for each in arm.board.outputs if each.on_stop == "hold")
        if record is None:
            with hard_to_delay(GATEWAY_PRIORITY):
                serve(arm.name, bus, period_ns, report, module_losses, held, needed, settle)
            return
        with BusRecorder(bus, record, begin) as recorder, hard_to_delay(GATEWAY_PRIORITY):
            serve(arm.name, recorder, period_ns, report, module_losses, held, needed, settle)
        if recorder.problem:
            report(f"{record} is not complete: {recorder.problem}")
