"""ARCL programs through bridge, servo, emulated board and plant, on virtual time; and the same ones off line (D-19)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.arcl import (
    ARCL_AMI,
    ARCL_BRIDGE,
    ARCL_PERIOD,
    ARCL_ROBOT,
    ARCL_START,
    ARCL_STREAM,
    EQ,
    EVENT_FAULT,
    FNDEF,
    GRIP_CLOSE,
    GRIP_CLOSE_BY,
    IOD_IN,
    IOD_OUT,
    MOV_CONFIG,
    MOV_SHARE,
    MOV_TIME,
    MOV_TRAJ,
    MOVE_STOP,
    OK,
    T6,
    TL,
    TRAJ_CART,
    ami_treal,
    arcl_close,
    arcl_errproc,
    arcl_open,
    arcl_setload,
    arcl_wait,
    gripper,
    iod_read,
    iod_set_value,
    iod_value,
    iod_write,
    joint_pos,
    makeposition,
    move,
    named_iod,
    new_iod,
    new_trans,
    stop,
    sym_enter,
    sym_lookup,
    teach,
)
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.stream import RecordKind, Stream, cartesian_table, read_stream
from qrobot.cli.arms import choose_arm
from qrobot.cli.run import machine_of
from qrobot.cli.servo_settings import servo_settings
from qrobot.cli.teach_pendant import teach_by_keys, terminal_pendant
from qrobot.errors import ConfigError, LinkBusy, LinkError, MotionError, ServoFault
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.io import RemoteModule
from qrobot.hwif.modbus.panel import PanelModules
from qrobot.hwif.modbus.server import ModbusServer
from qrobot.hwif.registers import DAC, DAC_COUNTS_PER_VOLT, DAC_ZERO, ENC_COUNT
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.arcl import HELD, at, forget_programs, keys_of_a_terminal, run_example
from tests.support.paper_board import PaperBoard
from tests.support.patience import PATIENCE_MS
from tests.support.puma import ROBOT
from tests.support.virtual_clock import VirtualClock

pytestmark = pytest.mark.usefixtures("arcl_alone")

SAMPLE_US = 28_000
MEASURED = 0.02  # rad: the servo's error on the way, and half a sample of it
PUMP = DAC // 2 + 3  # register of a module
AWAY = (20.0, 120.0, -10.0, 10.0, 60.0, -160.0)


@contextmanager
def arms(n: int = 1) -> Iterator[list[LockstepRig]]:
    """Emulated arms; each robot that a program opens gets the next one."""
    rigs = [LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)) for _ in range(n)]
    free = iter(rigs)
    with rci.use(lambda hello: link_factory(next(free), SAMPLE_US, hello)):
        yield rigs
        forget_programs()


def following_error(stream: Stream) -> float:
    """The farthest that a joint was from its setpoint, rad, at the lag at which it follows best."""
    (_, asked), (_, measured) = (stream.table(kind, 6) for kind in (RecordKind.JOINTS, RecordKind.MEASURED))
    return float(min(np.abs(measured[lag:] - asked[:-lag]).max() for lag in (1, 2, 3)))


def test_the_papers_program_moves_an_arm_that_follows_s11(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with arms() as (rig,):
        run_example("s11_first_program.py", tmp_path, ami="bridge")
        assert not rig.rows()["fault"].any()
    said = re.search(r"T6 at ([-\d. ]+) mm", capsys.readouterr().out)
    assert said is not None
    assert np.allclose([float(word) for word in said[1].split()], [415.0, 150.0, 397.8], atol=2.0)
    stream = read_stream(tmp_path / "puma560.arcl")
    assert (stream.start.machine, stream.damage) == ("bridge", "")
    assert following_error(stream) < MEASURED


def test_the_tool_weaves_s12(tmp_path: Path) -> None:
    with arms() as (rig,):
        run_example("s12_weave.py", tmp_path, ami="bridge")
        assert not rig.rows()["fault"].any()
    stream = read_stream(tmp_path / "puma560.arcl")
    assert following_error(stream) < MEASURED


def test_two_arms_share_a_place_s13(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with arms(2) as rigs:
        run_example("s13_two_arms.py", tmp_path, ami="bridge")
        assert not any(rig.rows()["fault"].any() for rig in rigs)
    said = re.findall(r"arm (\d) (enters|is done)", capsys.readouterr().out)
    assert said in (
        [("1", "enters"), ("1", "is done"), ("2", "enters"), ("2", "is done")],
        [("2", "enters"), ("2", "is done"), ("1", "enters"), ("1", "is done")],
    )


def test_arms_of_one_kind_are_told_apart_by_the_addresses_of_their_bridges() -> None:
    places = ("127.0.0.1:5600", "127.0.0.1:5601")
    rigs = [LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)) for _ in places]
    ways = {place: partial(link_factory, rig, SAMPLE_US) for place, rig in zip(places, rigs, strict=True)}
    named = {"puma560": ways[places[0]], "second": ways[places[1]]}
    with rci.use(named | ways):  # as `qrobot run --lockstep` gives them
        one, other = arcl_open(ARCL_BRIDGE, ":5601", 0), arcl_open(ARCL_BRIDGE, "127.0.0.1:5600", 0)
        move(one, joint_pos(one, "away", AWAY), 0)
        arcl_wait(one)
        with pytest.raises(ConfigError, match=r"'puma560' at 127\.0\.0\.1:5602"):
            arcl_open(ARCL_BRIDGE, ":5602", 0)
        arcl_close(one)
        arcl_close(other)
        forget_programs()
    stood, moved = (np.ptp(rig.rows()["q"], axis=0).max() for rig in rigs)
    assert stood < 0.01
    assert moved > 0.1


@pytest.mark.parametrize(
    ("address", "error"), [(5600, MotionError), ("there:99999", ConfigError), ("a:b:1", ConfigError)]
)
def test_what_is_no_address_of_a_bridge_is_refused(address: object, error: type[Exception]) -> None:
    with pytest.raises(error, match="host:port is needed"):
        arcl_open(ARCL_AMI, "offline", ARCL_BRIDGE, address, 0)


def program(*attributes: object) -> None:
    """Joints, a straight line, a via point, a stop."""
    rp = arcl_open(*attributes, 0)
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
    move(rp, joint_pos(rp, "via", (-20.0, *AWAY[1:])), MOV_SHARE, 30, 0)
    move(rp, at(450, -100, 250), MOV_CONFIG, "run", MOV_TIME, 3000, 0)
    move(rp, at(450, 100, 250), MOV_TRAJ, TRAJ_CART, MOV_TIME, 2000, 0)
    arcl_wait(rp, lambda: ami_treal() > 6500.0)
    stop(rp)
    arcl_close(rp)


def test_the_same_program_asks_for_the_same_setpoints_off_line_and_of_an_arm(tmp_path: Path) -> None:
    """What was asked of the arm, sample by sample, is what the off-line run wrote down before (D-19)."""
    with arms():
        program(ARCL_STREAM, str(tmp_path / "arm.arcl"))
    _, asked = read_stream(tmp_path / "arm.arcl").table(RecordKind.JOINTS, 6)
    start = tuple(np.degrees(asked[0]))
    program(ARCL_AMI, "offline", ARCL_PERIOD, 28, ARCL_START, start, ARCL_STREAM, str(tmp_path / "off.arcl"))
    _, alone = read_stream(tmp_path / "off.arcl").table(RecordKind.JOINTS, 6)
    n = min(len(asked), len(alone))
    assert n > 230
    assert abs(len(asked) - len(alone)) <= 20  # the goodbye takes the arm a few samples
    assert np.abs(asked[:n] - alone[:n]).max() < 1e-9


def test_the_operator_slows_a_motion_down_and_holds_it_on_its_path() -> None:
    with arms() as (rig,):
        rp, held = arcl_open(0), set()
        goal = joint_pos(rp, "away", AWAY)
        rig.mailbox.request_override(0.5)
        move(rp, goal, MOV_TIME, 800, 0)
        begin = ami_treal()

        def done() -> bool:
            ms = ami_treal() - begin
            rig.mailbox.request_pause(600.0 <= ms < 1800.0)
            if 1500.0 < ms < 1800.0:
                held.add(tuple(rp.ami.sample.q.round(4)))
            return not rp.busy

        arcl_wait(rp, done)
        seconds = (ami_treal() - begin) / 1e3
        assert np.degrees(rp.ami.sample.q) == pytest.approx(AWAY, abs=0.5)
        arcl_close(rp)
        assert not rig.rows()["fault"].any()
    assert 1 <= len(held) <= 3  # but for the last steps of the encoders
    assert next(iter(held))[0] == pytest.approx(np.radians(10.0), abs=np.radians(8.0))
    assert seconds == pytest.approx(2 * 0.8 + 1.2, abs=0.4)


def test_the_hand_closes_and_knows_no_positions() -> None:
    with arms():
        rp = arcl_open(0)
        gripper(rp, GRIP_CLOSE)
        end = ami_treal() + 300
        arcl_wait(rp, lambda: ami_treal() > end)
        assert rp.ami.sample.hand == 2
        with pytest.raises(MotionError, match="no positions"):
            gripper(rp, GRIP_CLOSE_BY, 40.0)


NAMED = """
[[arm]]
name = "arm"
robot = "puma560"
bridge = { port = 5600 }
servo = { sensor_channels = [6] }
signals = [
  { name = "lamps", outputs = [1, 2] },
  { name = "switches", inputs = [1, 3] },
  { name = "power", analog_output = 1, per_volt = 20.0, unit = "percent" },
  { name = "pressure", analog = 6, per_volt = 2.0, zero_v = 0.5, unit = "bar" },
]

[arm.board]
outputs = [{ output = 1, name = "grip", bit = 4 }, { output = 2, name = "glue", bit = 5 }]
analog_outputs = [{ output = 1, dac = 7, min_v = 0.0, max_v = 5.0 }, { output = 2, dac = 6, name = "fan" }]
"""


def test_lines_and_channels_reach_the_board_and_come_from_it_by_number_and_by_name(tmp_path: Path) -> None:
    (tmp_path / "here.toml").write_text(NAMED)
    arm = choose_arm(str(tmp_path / "here.toml"), None)
    rig = LockstepRig(ROBOT, servo_settings(arm))
    with machine_of((arm,), "bridge", None), rci.use(partial(link_factory, rig, SAMPLE_US)):
        rp = arcl_open(0)
        out, switches = new_iod(rp, IOD_OUT, 1, 2), new_iod(rp, IOD_IN, 2, 3)
        for direction, first, count, why in (
            (IOD_OUT, 2, 2, r"output 3 of puma560 is not configured; the deployment file has 1, 2: add it to"),
            (IOD_IN, 1, 7, "no line leads to input line 7 of puma560; there are lines 1 to 6"),
        ):
            with pytest.raises(MotionError, match=why):
                new_iod(rp, direction, first, count)
        iod_write(named_iod(rp, "lamps"), 0b11)
        rig.board.panel.inputs = 0b1010
        rig.board.panel.analog[6] = 2_500_000  # microvolts
        end = ami_treal() + 300
        arcl_wait(rp, lambda: ami_treal() > end)
        assert (iod_read(out), iod_read(switches)) == (0b11, 0b101)
        assert iod_read(named_iod(rp, "switches")) == 0b101
        assert (iod_read(named_iod(rp, "glue")), iod_value(named_iod(rp, "glue"))) == (1, 1.0)
        assert rig.board.panel.discrete & 0x30 == 0x30
        pressure = named_iod(rp, "pressure")
        assert (iod_value(pressure), pressure.unit) == (pytest.approx(4.0, abs=0.02), "bar")
        with pytest.raises(MotionError, match="pressure is an analogue channel, in bar: iod_value reads it"):
            iod_read(pressure)
        with pytest.raises(MotionError, match="pressure is an analogue input"):
            iod_write(pressure, 1)
        assert fans_and_power(rig) == (0.0, 0.0)
        power, fan = named_iod(rp, "power"), named_iod(rp, "fan")
        assert np.isnan(iod_value(power))
        iod_set_value(power, 50.0)
        iod_set_value(fan, 0.0)
        with pytest.raises(MotionError, match="cannot carry that"):
            arcl_setload(rp, 9.0)
        iod_set_value(fan, -3.0)  # another thing than what was refused
        pass_ms(300.0, rp)
        assert fans_and_power(rig) == pytest.approx((-3.0, 2.5), abs=0.003)
        assert (iod_value(power), iod_value(fan)) == (50.0, -3.0)
        for wrong in (100.1, -0.1, np.nan, np.inf):
            with pytest.raises(MotionError, match=r"is not within 0 to 5 V|a number is needed"):
                iod_set_value(power, wrong)
        with pytest.raises(MotionError, match="power is an analogue output, in percent: iod_set_value writes it"):
            iod_write(power, 1)
        with pytest.raises(MotionError, match="pressure is an analogue input"):
            iod_set_value(pressure, 1.0)
        rig.mailbox.request_power_off()
        with pytest.raises(ServoFault):
            pass_ms(2000.0, rp)
        assert fans_and_power(rig) == (0.0, 0.0)


def fans_and_power(rig: LockstepRig) -> tuple[float, float]:
    """Volts at the converters 6 and 7 of the board."""
    fan, power = ((DAC_ZERO - rig.emulator.bundle.board.dac[6:]) / DAC_COUNTS_PER_VOLT).tolist()
    return fan, power


def pass_ms(ms: float, rp: ArclRobot) -> None:
    """Let so much time pass."""
    end = ami_treal() + ms
    arcl_wait(rp, lambda: ami_treal() > end)


def test_a_name_that_there_is_not_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    (tmp_path / "here.toml").write_text(NAMED)
    arm = choose_arm(str(tmp_path / "here.toml"), None)
    with use_machine(MachineChoice("offline", None, ROBOT, arm.named_signals)):
        rp = arcl_open(0)
        with pytest.raises(ConfigError, match="it has fan, glue, grip, lamps, power, pressure, switches"):
            named_iod(rp, "presure")
        arcl_close(rp)


MODULE = """
[[arm.board.io]]
host = "127.0.0.1"
port = {port}
inputs = [{{ address = 15, input = 1 }}, {{ address = 0, input = 2 }}]
analog = [{{ address = {register}, channel = 6, volt_per_count = 0.001 }}]
analog_outputs = [{{ address = {heater}, output = 1, volt_per_count = 0.01, off_v = 1.0, on_stop = "hold" }}]
outputs = [
  {{ address = 3, output = 1, name = "red", on = 0, off = 1 }},
  {{ address = {pump}, output = 2, name = "green", kind = "register", on = 700 }},
]
"""


def test_names_reach_the_lines_and_channels_of_a_module_on_modbus(tmp_path: Path) -> None:
    paper, clock = PaperBoard(), VirtualClock()
    paper.inputs[ENC_COUNT // 2] = 2500  # of 1 mV
    paper.status = 1
    with ExitStack() as stack:
        server = stack.enter_context(ModbusServer(ModbusDevice(paper, watchdog_ms=0, now_ns=clock)))
        text = NAMED.split("[arm.board]", maxsplit=1)[0] + MODULE.format(
            port=server.address[1], register=ENC_COUNT // 2, pump=PUMP, heater=PUMP + 1
        )
        (tmp_path / "here.toml").write_text(text)
        arm = choose_arm(str(tmp_path / "here.toml"), None)
        (choice,) = arm.board.io
        module = RemoteModule(choice.model_copy(update={"timeout_ms": PATIENCE_MS}), now_ns=clock)
        stack.callback(module.close)
        rig = LockstepRig(ROBOT, servo_settings(arm))
        wires = PanelModules(rig.board, [module])

        def asked() -> bool:
            module.poll()
            wires.step(clock())
            return ami_treal() > end

        chosen = MachineChoice("bridge", None, ROBOT, arm.named_signals, analog_ranges=arm.analog_ranges)
        stack.enter_context(use_machine(chosen))
        stack.enter_context(rci.use(partial(link_factory, rig, SAMPLE_US)))
        rp = arcl_open(0)
        iod_write(named_iod(rp, "lamps"), 0b10)
        iod_set_value(named_iod(rp, "power"), 70.0)
        end = ami_treal() + 300
        arcl_wait(rp, asked)
        assert iod_read(named_iod(rp, "switches")) == 0b010  # of three lines from the first on, the second is on
        assert iod_value(named_iod(rp, "pressure")) == pytest.approx(4.0, abs=0.02)
        assert (iod_read(named_iod(rp, "red")), iod_read(named_iod(rp, "green"))) == (0, 1)
        assert [value for _, offset, value in paper.applied if offset == 2 * PUMP][-1] == 700
        assert [value for _, offset, value in paper.applied if offset == 2 * PUMP + 2][-1] == 350
        iod_write(named_iod(rp, "lamps"), 0)
        end = ami_treal() + 300
        arcl_wait(rp, asked)
        assert [value for _, offset, value in paper.applied if offset == 2 * PUMP][-1] == 0
        arcl_close(rp)
        for ask, shown in ((lambda: None, 350), (rig.mailbox.request_power_off, 100)):  # it holds while there is power
            ask()
            rig.run_for(2.0)
            wires.step(clock())
            module.poll()
            assert [value for _, offset, value in paper.applied if offset == 2 * PUMP + 2][-1] == shown


def test_a_person_teaches_places_by_the_pendant_and_the_program_goes_on_from_where_the_arm_is(tmp_path: Path) -> None:
    taught, told = [], []

    def learn(T6, rp):
        taught.append((T6, rp.name))
        return MOVE_STOP if len(taught) == 2 else OK

    keys = keys_of_a_terminal((0.0, "3"), *HELD, (2900.0, "\n"), (3400.0, "?"), (3900.0, "\n"), (9e3, "q"))
    pendant = partial(teach_by_keys, read_keys=keys, tell=told.append)
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    chosen = use_machine(MachineChoice("bridge", None, ROBOT, (), pendant))
    with chosen, rci.use(partial(link_factory, rig, SAMPLE_US)):
        rp = arcl_open(ARCL_STREAM, str(tmp_path / "taught.arcl"))
        move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
        assert teach(rp, learn) == 2
        moved = rp.joints - AWAY
        assert 3.0 < moved[2] < 15.0  # 0.1 rad/s for a second
        assert np.abs(np.delete(moved, 2)).max() < 0.2
        first, second = (T6.value for T6, _ in taught)
        assert np.allclose(first, rp.fkine(rp.joints).value, atol=1e-3)
        assert np.allclose(first, second, atol=1e-4)
        sym_enter(taught[0][0])
        move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
        move(rp, makeposition(T6, EQ, sym_lookup("T1"), TL, T6), MOV_TIME, 1500, 0)
        arcl_wait(rp)
        end = ami_treal() + 300
        arcl_wait(rp, lambda: ami_treal() > end)
        assert np.allclose(rp.where().value, first, atol=1e-3)
        nobody = use_machine(MachineChoice("bridge", None, ROBOT, (), terminal_pendant))
        with nobody, pytest.raises(ConfigError, match="needs a terminal"):
            teach(rp, learn)
        move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 500, 0)  # the program has the arm again
        arcl_close(rp)
        assert not rig.rows()["fault"].any()
    assert [line for line in told if line.startswith("error")] == []
    assert "ENTER       take where the arm is" in told[0]
    stream = read_stream(tmp_path / "taught.arcl")
    times, _ = stream.table(RecordKind.JOINTS, 6)
    assert not stream.damage
    assert (np.diff(times) > 0.0).all()


def test_places_that_were_taught_in_one_run_are_gone_through_in_the_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = keys_of_a_terminal((0.0, "\n"), (50.0, "2"), *HELD, (2900.0, "\n"), (3400.0, "q"))
    pendant = partial(teach_by_keys, read_keys=keys, tell=lambda _: None)
    program, places = "../24_teach_and_replay.py", str(tmp_path / "places.db")
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
    with rci.use(partial(link_factory, rig, SAMPLE_US)):
        run_example(program, tmp_path, places, ami="bridge", pendant=pendant)
        assert not rig.rows()["fault"].any()
    said = capsys.readouterr().out
    taught = [tuple(map(float, each)) for each in re.findall(r"T\d: x (\S+) y (\S+) z (\S+) mm", said)]
    assert len(taught) == 2
    assert np.linalg.norm(np.subtract(*taught)) > 20.0
    assert said.endswith("at T1\nat T2\n")
    forget_programs()
    run_example(program, tmp_path / "again", places)
    assert "at T1\nat T2\n" in capsys.readouterr().out
    path = cartesian_table(read_stream(tmp_path / "again" / "puma560.arcl"))
    there = np.column_stack([path[f"{axis}_mm"] for axis in "xyz"])
    for place in taught:
        assert np.linalg.norm(there - place, axis=1).min() < 25.0  # passed on the way, rounded


def test_a_transform_that_a_sensor_drives_moves_the_goal(tmp_path: Path) -> None:
    (tmp_path / "here.toml").write_text(NAMED)
    arm = choose_arm(str(tmp_path / "here.toml"), None)
    rig = LockstepRig(ROBOT, servo_settings(arm, rate_hz=500.0), Emulator(ROBOT, physics="rigid"))
    chosen = use_machine(MachineChoice("bridge", None, ROBOT, arm.named_signals))
    with chosen, rci.use(partial(link_factory, rig, SAMPLE_US)):
        rp = arcl_open(ARCL_STREAM, str(tmp_path / "run.arcl"))
        pressure = named_iod(rp, "pressure")  # 2 (volts - 0.5)

        def pushed(trans, _):
            trans.t_p.z = 10.0 * iod_value(pressure)

        rig.board.panel.analog[6] = 500_000
        move(rp, at(450, 100, 250, 90.0, new_trans("PUSHED", FNDEF, pushed)), MOV_CONFIG, "run", MOV_TIME, 2000, 0)
        arcl_wait(rp)
        begun = ami_treal()

        def more() -> bool:
            rig.board.panel.analog[6] = min(1_500_000, rig.board.panel.analog[6] + 20_000)
            return ami_treal() > end

        end = begun + 2200.0
        arcl_wait(rp, more)
        arcl_close(rp)
        assert not rig.rows()["fault"].any()
    path = cartesian_table(read_stream(tmp_path / "run.arcl"))
    moved = [path[f"{axis}_mm"][-1] - np.interp(begun / 1e3, path["t_s"], path[f"{axis}_mm"]) for axis in "xyz"]
    assert np.allclose(moved, [20.0, 0.0, 0.0], atol=0.2)  # 2 bar along the tool, which points along x


def test_a_fault_of_the_servo_is_told_to_the_handler_and_raised_in_the_program() -> None:
    with arms() as (rig,):
        rp, told = arcl_open(0), []
        arcl_errproc(lambda event, robot, error: told.append((event, robot is rp, type(error))))
        move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 4000, 0)
        arcl_wait(rp, lambda: ami_treal() > 1000.0)
        rig.mailbox.request_stop()
        with pytest.raises(ServoFault):
            arcl_wait(rp)
        assert told == [(EVENT_FAULT, True, ServoFault)]
        with pytest.raises(ServoFault):
            move(rp, joint_pos(rp, "away", AWAY), 0)


def test_an_arm_that_somebody_else_commands_or_another_robot_is_refused() -> None:
    rig = LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0))
    with rci.use(lambda hello: link_factory(rig, SAMPLE_US, hello)):
        rp = arcl_open(0)
        with pytest.raises(LinkBusy):
            arcl_open(0)
        arcl_close(rp)
        with pytest.raises(LinkError):
            arcl_open(ARCL_ROBOT, "stanford", 0)
        with pytest.raises(MotionError, match="1 to 100 ms"):
            arcl_open(ARCL_PERIOD, 200, 0)
        arcl_close(arcl_open(ARCL_PERIOD, 20, 0))
