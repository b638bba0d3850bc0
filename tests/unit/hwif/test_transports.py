"""Transports by name: tables of a deployment file, servers of a command line, and what is said when they are wrong."""

from __future__ import annotations

import os
import re
import socket
from pathlib import Path

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.cli.board import board, run_gateway
from qrobot.cli.servo_settings import servo_settings
from qrobot.config import Deployment, load_deployment, load_robot
from qrobot.config.deployment import DeployedArm
from qrobot.errors import ConfigError, LinkError
from qrobot.hwif.canbus.client import CanBus
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.canbus.multicast import LocalMulticast
from qrobot.hwif.canbus.sensor import SensorBus
from qrobot.hwif.transports import open_transport, servers
from qrobot.model.transmission import DAC_ZERO, dac_code
from tests.support.bus import BenchEndpoint
from tests.support.deployment import LEFT

GUIDE = Path(__file__).parents[3] / "docs/how-to/use-can.md"
CAN = (
    LEFT
    + """kind = "can"
can = { interface = "virtual", channel = "x", node_id = 7, period_ms = 4 }
"""
)


def load(tmp_path: Path, text: str) -> Deployment:
    path = tmp_path / "here.toml"
    path.write_text(text)
    return load_deployment(path)


def test_a_board_on_can_is_reached_by_a_bus_at_its_own_pace(tmp_path: Path) -> None:
    [arm] = load(tmp_path, CAN).arm
    bus, period_ns, *_ = open_transport(arm.board)
    assert isinstance(bus, CanBus)
    assert (bus.name, period_ns) == ("CAN virtual:x, node 7", 4_000_000)


DRIVES = (
    CAN.split("[arm.board]", maxsplit=1)[0]
    + """
[arm.board]
kind = "drives"
[arm.board.drives]
interface = "virtual"
channel = "x"
nodes = [1, 2, 3, 4, 5, 6]
torque_permille = [-900, -900, -900, 900, -900, -900]
increments_per_count = [131.072, 131.072, 131.072, -131.072, 131.072, 131.072]
counts_at_zero = [0, 0, 0, 8000, 0, 0]
"""
)


SENSOR = """
[arm.board.can_sensor]
interface = "virtual"
channel = "y"
signals = [{ channel = 6, id = 0x1B0, volt_per_count = 0.001 }]
"""


def test_a_sensor_on_can_stands_before_the_transport_to_a_board(tmp_path: Path) -> None:
    [arm] = load(tmp_path, CAN + SENSOR).arm
    bus = open_transport(arm.board).bus
    assert isinstance(bus, SensorBus)
    assert bus.name == "CAN virtual:x, node 7 with a sensor on CAN virtual:y"


def test_the_servo_is_told_how_often_the_interface_of_a_sensor_has_failed(tmp_path: Path) -> None:
    [arm] = load(tmp_path, CAN + SENSOR).arm
    bus, _, losses, _ = open_transport(arm.board)
    assert isinstance(bus, SensorBus)
    bus.losses = 3
    assert losses() == 3


def test_a_sensor_on_can_needs_a_gateway(tmp_path: Path) -> None:
    emulated = CAN.split("[arm.board]", maxsplit=1)[0] + SENSOR
    with pytest.raises(ConfigError, match="needs a board behind a gateway, and kind = 'emulator' has none"):
        load(tmp_path, emulated)


def test_drives_are_reached_by_a_bus_too(tmp_path: Path) -> None:
    [arm] = load(tmp_path, DRIVES).arm
    bus, period_ns, *_ = open_transport(arm.board)
    assert isinstance(bus, DrivesBus)
    assert (bus.name, period_ns) == ("CAN virtual:x, 6 drives", 2_000_000)


@pytest.mark.parametrize(("timeout_ms", "patience_s"), [(50, 0.010), (4, 0.004)])
def test_drives_are_waited_for_no_longer_than_the_servo_waits(
    tmp_path: Path, timeout_ms: float, patience_s: float
) -> None:
    [arm] = load(tmp_path, f"{DRIVES}timeout_ms = {timeout_ms}\n").arm
    bus = open_transport(arm.board, patience_ms=arm.servo.board_timeout_ms).bus
    assert isinstance(bus, DrivesBus)
    assert bus.link.timeout_s == patience_s


@pytest.mark.parametrize("mode", ["torque", "position"])
def test_the_mode_of_the_drives_is_known_to_the_servo(tmp_path: Path, mode: str) -> None:
    table = DRIVES.replace("torque_permille", "#") if mode == "position" else DRIVES
    [arm] = load(tmp_path, f"{table}absolute = true\nmode = '{mode}'\n").arm
    assert servo_settings(arm).position_drives == (mode == "position")


@pytest.mark.parametrize("mode", ["torque", "position"])
@pytest.mark.parametrize(
    "sensor",
    [
        SENSOR.replace("channel = 6", "channel = 2"),
        '[[arm.board.io]]\nhost = "127.0.0.1"\nanalog = [{ address = 0, channel = 2, volt_per_count = 0.001 }]\n',
    ],
    ids=["can_sensor", "io"],
)
def test_separate_drives_have_no_potentiometers_and_every_channel_free(tmp_path: Path, mode: str, sensor: str) -> None:
    table = DRIVES.replace("torque_permille", "#") if mode == "position" else DRIVES
    [arm] = load(tmp_path, f"{table}absolute = true\nmode = '{mode}'\n{sensor}").arm
    assert not servo_settings(arm).pots


def test_an_arm_with_a_joint_that_has_no_drive_is_refused(tmp_path: Path) -> None:
    table = re.sub(r"(, -?[0-9.]+)\]", "]", DRIVES)  # the sixth number of each list
    [arm] = load(tmp_path, table).arm
    with pytest.raises(ConfigError, match=r"drives\.nodes of .* names 5 drives, puma560 has 6 joints"):
        servo_settings(arm)


@pytest.mark.parametrize("mode", ["torque", "position"])
def test_an_arm_with_a_drive_that_has_no_joint_is_refused_by_servo_and_gateway(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    puma = load_robot("puma560")
    joints = puma.joints.model_copy(update={"names": puma.joints.names[:5], "kinds": puma.joints.kinds[:5]})
    five = puma.model_copy(update={"name": "five", "joints": joints})
    monkeypatch.setattr("qrobot.cli.servo_settings.robot_of_arm", lambda _arm: five)
    table = DRIVES.replace("torque_permille", "#") if mode == "position" else DRIVES
    [arm] = load(tmp_path, f"{table}absolute = true\nmode = '{mode}'\n").arm
    for begin in (servo_settings, run_gateway):
        with pytest.raises(ConfigError, match=r"drives\.nodes of left names 6 drives, five has 5 joints"):
            begin(arm)


@pytest.mark.parametrize("robot", ["puma560", "stanford"])
@pytest.mark.parametrize("turned", [1, -1])
def test_drives_that_would_turn_their_motors_the_wrong_way_round_are_refused(
    tmp_path: Path, robot: str, turned: int
) -> None:
    transmission = load_robot(robot).transmission
    increments = turned * np.array([100.0, 100.0, 100.0, -100.0, 100.0, 100.0])
    # dac_code(tau) = 0x800 + tau dac_per_Nm, TorqueSetpoints: torque = (0x800 - word) permille / 0x800. Torque that
    # lets the joint's counts rise lets the position rise by the sign of increments_per_count.
    right = np.array(
        [
            float(np.sign(each)) * 900
            for each in (DAC_ZERO - np.array([dac_code(1.0, dac) for dac in transmission.dac_per_Nm]))
            * transmission.rad_per_count
            * increments
        ]
    )

    def arm_of(torque: Floats) -> DeployedArm:
        table = re.sub(r"torque_permille = .*", f"torque_permille = {torque.tolist()}", DRIVES)
        table = re.sub(r"increments_per_count = .*", f"increments_per_count = {increments.tolist()}", table)
        return load(tmp_path, table.replace("puma560", robot)).arm[0]

    assert not servo_settings(arm_of(right)).emulated
    wrong = right * [1, 1, -1, 1, -1, 1]
    with pytest.raises(ConfigError, match=r"torque_permille of left has the wrong sign for joint 3, 5") as refused:
        servo_settings(arm_of(wrong))
    assert f"[{', '.join(f'{each:g}' for each in right)}]" in str(refused.value)
    with pytest.raises(ConfigError, match="would run away"):
        run_gateway(arm_of(wrong))


@pytest.mark.parametrize("example", [0, 1])
def test_the_drives_of_the_guide_turn_their_motors_the_right_way_round(tmp_path: Path, example: int) -> None:
    guide = GUIDE.read_text()
    table = [each for each in re.findall(r"```toml\n(.*?)```", guide, re.S) if "[arm.board.drives]" in each][example]
    head, key, _ = DRIVES.partition("[arm.board.drives]")
    [arm] = load(tmp_path, head + key + table.partition(key)[2]).arm
    assert servo_settings(arm).position_drives == bool(example)


def test_a_law_is_refused_where_nobody_obeys_it(tmp_path: Path) -> None:
    table = DRIVES.replace("torque_permille", "#").replace("servo = {", "servo = { law = 'pid',")
    with pytest.raises(ConfigError, match=r"servo\.law means nothing to drives in position mode"):
        load(tmp_path, f"{table}absolute = true\nmode = 'position'\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[1, 2, 3, 4, 5, 6]", "[1, 2, 3, 4, 5, 5]", "same node number"),
        ("[1, 2, 3, 4, 5, 6]", "[1, 2, 3, 4, 5]", "torque_permille needs 5 numbers"),
        ("-900,", "0,", "must not be 0"),
        ("nodes", "mode = 'position'\nnodes", "torque_permille has no meaning in position mode"),
        ("torque_permille", "mode = 'position'\n#", "position mode needs absolute = true"),
        ("nodes", "mode = 'velocity'\nnodes", "'torque' or 'position'"),
        ('kind = "drives"', "kind = 'drives'\ncalibration_table = 'puma560'", "no potentiometers and no index pulses"),
    ],
)
def test_drives_need_a_number_for_each_that_means_something(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, DRIVES.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('kind = "can"', 'kind = "emulator"', "a table 'can' needs kind = 'can', not 'emulator'"),
        ("can = {", "scene = {}\n# {", "kind = 'can' needs a table"),
        ("node_id = 7", "node_id = 96", "node_id"),
        ("board_timeout_ms = 10", "board_timeout_ms = 7", "asked every 4 ms: at least 8"),
    ],
)
def test_a_transport_that_does_not_fit_its_board_or_its_servo_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CAN
    with pytest.raises(ConfigError, match=message):
        load(tmp_path, CAN.replace(old, new))


def test_an_emulated_board_is_behind_no_transport() -> None:
    [arm] = load_deployment("emulator").arm
    with pytest.raises(ConfigError, match="behind no transport"):
        open_transport(arm.board)


def test_options_of_an_emulated_board_are_refused_for_another(tmp_path: Path) -> None:
    load(tmp_path, CAN)
    with pytest.raises(ConfigError, match=r"--plant, --serve: only for an emulated board"):
        board(str(tmp_path / "here.toml"), plant="nominal", serve=("can=virtual:x",))


@pytest.mark.parametrize("text", ["can", "can=", "carrier-pigeon=coop", "=virtual:x"])
def test_a_server_needs_a_transport_and_an_address(text: str) -> None:
    with pytest.raises(ConfigError, match="give TRANSPORT=ADDRESS"), servers((text,), BenchEndpoint(), print):
        pass


@pytest.mark.parametrize("text", ["vcan0", "socketcan:", "virtual:x@y", "virtual:x@200"])
def test_an_address_that_is_none_is_refused(text: str) -> None:
    with (
        pytest.raises(ConfigError, match=r"INTERFACE:CHANNEL|1 to 95"),
        servers((f"can={text}",), BenchEndpoint(), print),
    ):
        pass


@pytest.mark.parametrize(("interface", "channel"), [("no-such", "x"), ("socketcan", "no-such-device")])
def test_an_interface_that_does_not_open_is_named(interface: str, channel: str) -> None:
    with pytest.raises(LinkError, match=f"{interface}:{channel} does not open"):
        open_interface(interface, channel)


def test_multicast_takes_multicast_groups_alone_and_stays_on_this_machine() -> None:
    with pytest.raises(ConfigError, match="no multicast group"):
        LocalMulticast("192.168.1.1")
    with open_interface("udp_multicast", "239.74.163.2/43997") as bus:
        assert isinstance(bus, LocalMulticast)
        with socket.socket(fileno=os.dup(bus.fileno())) as shared:
            assert shared.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 0
            chosen = shared.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
        assert socket.inet_ntoa(chosen) == "127.0.0.1"
