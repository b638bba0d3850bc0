"""Deployment files: defaults, two arms, and what must not collide."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.cli.servo_settings import overrun_of, servo_settings
from qrobot.config import Deployment, load_deployment, load_robot
from qrobot.errors import ConfigError
from qrobot.servo.settings import COUNTED_ONLY, Overrun

ONE = '[[arm]]\nname = "left"\nrobot = "puma560"\nbridge = { port = 5600 }\n'


def load(tmp_path: Path, text: str) -> Deployment:
    path = tmp_path / "here.toml"
    path.write_text(text)
    return load_deployment(path)


@pytest.mark.parametrize("name", ["emulator", "pressing", "two_arms"])
def test_packaged_deployments_load_and_name_packaged_robots(name: str) -> None:
    for arm in load_deployment(name).arm:
        assert load_robot(arm.robot).poses[arm.board.start_pose].size


def test_defaults_are_those_of_the_papers(tmp_path: Path) -> None:
    [arm] = load(tmp_path, ONE).arm
    assert (arm.servo.rate_hz, arm.bridge.period_ms, arm.bridge.host) == (1000, 28.0, "127.0.0.1")
    assert arm.servo.guardian_patience_ms == 5.0
    assert (arm.board.kind, arm.board.plant, arm.board.calibrated) == ("emulator", "nominal", True)


def test_two_arms_have_names_and_ports_of_their_own() -> None:
    left, right = load_deployment("two_arms").arm
    assert left.name != right.name
    assert left.bridge.port != right.bridge.port


@pytest.mark.parametrize(
    ("second", "says"),
    [(ONE.replace("5600", "5601"), "same name"), (ONE.replace("left", "right"), "same bridge.port")],
)
def test_arms_may_not_collide(tmp_path: Path, second: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        load(tmp_path, ONE + second)


def both(one: str, other: str) -> str:
    """Two arms on such boards."""
    second, servo = ONE.replace("left", "right").replace("5600", "5601"), "servo = { board_timeout_ms = 10 }\n"
    return f"{ONE}{servo}board = {{ {one} }}\n{second}{servo}board = {{ {other} }}\n"


def drives(*nodes: int) -> str:
    told = {"nodes": list(nodes), "torque_permille": [-1.0] * len(nodes), "increments_per_count": [1.0] * len(nodes)}
    keys = ", ".join(f"{key} = {value}" for key, value in (told | {"counts_at_zero": [0] * len(nodes)}).items())
    return f"kind = 'drives', drives = {{ {keys} }}"


@pytest.mark.parametrize(
    ("board", "apart", "says"),
    [
        ("kind = 'port', port = {}", "kind = 'port', port = { base = 0x340 }", "port 0x300"),
        ("kind = 'port', port = { base = 0x33e }", "kind = 'port', port = { base = 0x380 }", "port 0x33e"),
        ("kind = 'can', can = {}", "kind = 'can', can = { channel = 'can1' }", r"CAN bus can0 \(socketcan\)"),
        ("kind = 'can', can = {}", "kind = 'can', can = { interface = 'virtual' }", r"CAN bus can0 \(socketcan\)"),
        ("kind = 'modbus', modbus = {}", "kind = 'modbus', modbus = { port = 503 }", "device 1 at 127.0.0.1:502"),
        ("kind = 'modbus', modbus = {}", "kind = 'modbus', modbus = { device_id = 2 }", "device 1 at"),
        (drives(1, 2), drives(1, 2).replace("nodes", "channel = 'can1', nodes"), "CAN bus can0"),
    ],
)
def test_nor_may_two_arms_have_one_board(tmp_path: Path, board: str, apart: str, says: str) -> None:
    assert len(load(tmp_path, both(board, apart)).arm) == 2
    with pytest.raises(ConfigError, match=f"left and right have one board or bus: {says}"):
        load(tmp_path, both(board, board))


GROUP = "interface = 'udp_multicast', channel = '239.74.163.2'"


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("kind = 'can', can = { node_id = 1 }", "kind = 'can', can = { node_id = 2 }"),
        ("kind = 'can', can = { node_id = 5 }", drives(1, 2)),
        (drives(1, 2), drives(3, 4)),
        (f"kind = 'can', can = {{ {GROUP} }}", f"kind = 'can', can = {{ node_id = 2, {GROUP[:-1]}/43113' }}"),
        ("kind = 'port', port = {}", "kind = 'port', port = { base = 0x33e }"),
    ],
)
def test_two_arms_may_not_be_on_one_bus_whose_sync_feeds_both_and_cards_may_not_overlap(
    tmp_path: Path, one: str, other: str
) -> None:
    with pytest.raises(ConfigError, match="left and right have one board or bus"):
        load(tmp_path, both(one, other))


COIL = "outputs = [{ address = 5, output = 1 }]"
WORD = "outputs = [{ address = 5, output = 1, kind = 'register' }]"
VOLTS = "analog_outputs = [{ address = 5, output = 1, volt_per_count = 0.001 }]"
HAND = "gripper = { address = 4, open = [1, 2], close = [3], relax = [0] }"


def module(gives: str, place: str = "host = 'cabinet'") -> str:
    return f"{{ {place}, {gives} }}"


@pytest.mark.parametrize(
    ("one", "other", "what"),
    [(COIL, COIL, "coil"), (WORD, VOLTS, "register"), (VOLTS, VOLTS, "register"), (WORD, HAND, "register"),
     (HAND, VOLTS, "register")],
)  # fmt: skip
def test_what_a_module_of_one_arm_writes_no_other_arm_and_no_other_module_writes(
    tmp_path: Path, one: str, other: str, what: str
) -> None:
    says = f"{what} 5 of device 1 at cabinet:502"
    here, there = module(one), module(other, "host = 'Cabinet'")
    with pytest.raises(ConfigError, match=f"left and right both write {says}"):
        load(tmp_path, both(f"io = [{here}]", f"io = [{there}]"))
    second = there.replace("output = 1", "output = 2")
    with pytest.raises(ConfigError, match=rf"arm\.0\.board: .*two modules write {says}"):
        load(tmp_path, f"{ONE}board = {{ io = [{here}, {second}] }}")
    for place in ("host = 'cell'", "host = 'cabinet', port = 503", "host = 'cabinet', device_id = 2"):
        apart = module(other, place)
        assert len(load(tmp_path, both(f"io = [{here}]", f"io = [{apart}]")).arm) == 2


def test_two_arms_may_share_a_module_of_which_each_has_outputs_of_its_own(tmp_path: Path) -> None:
    reads = "inputs = [{ address = 5, input = 1 }]"
    one, other = module(f"{COIL}, {reads}"), module(f"{WORD.replace('address = 5', 'address = 6')}, {VOLTS}, {reads}")
    assert len(load(tmp_path, both(f"io = [{one}]", f"io = [{other}]")).arm) == 2


@pytest.mark.parametrize(
    "gives",
    ["inputs = [{ address = 0, input = 1 }]", "analog = [{ address = 0, channel = 6, volt_per_count = 0.001 }]"],
)
def test_inputs_of_a_module_are_asked_for_before_they_are_too_old(tmp_path: Path, gives: str) -> None:
    """Its outputs, which nobody asks for, may be looked at as seldom as the file says."""
    rare, least = "host = 'cabinet', period_ms = 500", "timeout_ms = 1000"
    load(tmp_path, f"{ONE}board = {{ io = [{module(gives, f'{rare}, {least}')}] }}")
    load(tmp_path, f"{ONE}board = {{ io = [{module(COIL, rare)}] }}")
    for given in ("timeout_ms = 999", "timeout_ms = 100"):
        with pytest.raises(ConfigError, match=r"board\.io\.0: .*asked for every 500 ms: at least 1000"):
            load(tmp_path, f"{ONE}board = {{ io = [{module(gives, f'{rare}, {given}')}] }}")


@pytest.mark.parametrize(
    ("extra", "says"),
    [
        ("servo = { rate_hz = 50 }", r"arm\.0\.servo\.rate_hz: .*greater than or equal to 100"),
        ("servo = { rate = 1000 }", r"arm\.0\.servo\.rate: unknown key; did you mean 'rate_hz'"),
        ("servo = { require_realtime = 1 }", r"arm\.0\.servo\.require_realtime: .*valid boolean"),
        (
            "servo = { rate_hz = 399, guardian_timeout_ms = 5 }",
            r"arm\.0\.servo: servo\.guardian_timeout_ms 5 is too short .* 399 Hz: at least 5\.01",
        ),
        (
            "servo = { rate_hz = 100, guardian_timeout_ms = 19 }",
            r"arm\.0\.servo: servo\.guardian_timeout_ms 19 is too short .*: at least 20",
        ),
        ("servo = { guardian_timeout_ms = nan }", r"arm\.0\.servo\.guardian_timeout_ms: .*finite"),
        ('signals = [{ name = "p", analog = 6 }]', r"arm\.0: .*channel 6 is not in servo\.sensor_channels"),
        ('signals = [{ name = "p", outputs = [2, 2] }]', r"arm\.0: .*'p': the arm has no output 2"),
        (
            'signals = [{ name = "p", inputs = [3, 2] }]',
            r"arm\.0\.signals\.0: .*line comes first, as in \[2, 3\]",
        ),
        ('signals = [{ name = "p", inputs = [3, 6] }]', r"arm\.0\.signals\.0\.inputs\.1: .*less than 6"),
        ('signals = [{ name = "p" }]', r"arm\.0\.signals\.0: .*one of inputs, outputs, analog, .* is needed, not 0"),
        ('signals = [{ name = "p", inputs = [1, 1], unit = "V" }]', r"arm\.0\.signals\.0: .*unit are for analog"),
        (
            'signals = [{ name = "p", inputs = [1, 1] }]\nboard = { outputs = [{ output = 1, name = "p", bit = 4 }] }',
            r"arm\.0: .*two signals or outputs have the same name 'p'",
        ),
        ('board = { plant = "perfect" }', r"arm\.0\.board\.plant: .*'nominal' or 'mismatched'"),
        ('board = { kind = "modbus" }', r"arm\.0\.board: .*needs a table \[arm\.board\.modbus\]"),
        ("board = { modbus = {} }", r"arm\.0\.board: .*'modbus' needs kind = 'modbus'"),
        ('board = { kind = "modbus", modbus = { port = 0 } }', r"board\.modbus\.port: .*greater than or equal to 1"),
        ('colour = "red"', r"arm\.0\.colour: unknown key; known: name, robot"),
    ],
)
def test_mistakes_carry_their_path(tmp_path: Path, extra: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        load(tmp_path, ONE + extra)


LINK = '{ interface = "eth1", address = "10.7.0.1", peers = ["10.7.0.2"], token_file = "link.token" }'


@pytest.mark.parametrize(
    ("bridge", "says"),
    [
        ('host = "0.0.0.0"', r"arm\.0\.bridge\.host: .*beyond the loopback interface.*tunnel or a link"),
        ('host = "robot-pc"', r"arm\.0\.bridge\.host: "),
        (
            f"link = {LINK.replace('10.7.0.1', '0.0.0.0')}",
            r"bridge\.link\.address: .*0\.0\.0\.0 is no address of one mach",
        ),
        (
            f"link = {LINK.replace('10.7.0.2', '127.0.0.1')}",
            r"bridge\.link\.peers: .*127\.0\.0\.1 is no address of one",
        ),
        (f"link = {LINK.replace('10.7.0.2', 'sun')}", r"bridge\.link\.peers: .*'sun'"),
        (f"link = {LINK.replace('eth1', 'eth/1')}", r"bridge\.link\.interface: "),
        ("link = {}", r"bridge\.link\.token_file: missing"),
    ],
)
def test_a_bridge_listens_on_the_loopback_interface_and_a_link_alone(tmp_path: Path, bridge: str, says: str) -> None:
    one = ONE.replace("{ port", "{ %s, port")
    assert load(tmp_path, one % f"link = {LINK}").arm[0].bridge.link.token_file == str(tmp_path / "link.token")
    with pytest.raises(ConfigError, match=says):
        load(tmp_path, one % bridge)


@pytest.mark.parametrize("name", ["Left", "a/b", "", "../x", "x" * 33])
def test_an_arm_name_is_fit_for_a_file_name(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"arm\.0\.name: .*(small letters, digits and underscores|at most 32 char)"):
        load(tmp_path, ONE.replace("left", name))


def test_a_deployment_without_arms_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="arm: missing"):
        load(tmp_path, "")


def test_late_cycles_of_an_emulated_arm_are_counted_unless_its_file_sets_a_limit(tmp_path: Path) -> None:
    [lenient] = load(tmp_path, ONE).arm
    assert overrun_of(lenient) == COUNTED_ONLY
    [strict] = load(tmp_path, ONE + "[arm.servo.overrun]\nwindow_s = 2.0\n").arm
    assert overrun_of(strict) == Overrun(misses_in_a_row=3, late_share=0.01, window_s=2.0)


def test_the_servo_knows_whether_its_board_is_emulated(tmp_path: Path) -> None:
    [emulated] = load(tmp_path, ONE).arm
    assert servo_settings(emulated).emulated
    counted = "servo = { board_timeout_ms = 5, overrun = { misses_in_a_row = 0, late_share = 1.0 } }\n"
    [real] = load(tmp_path, f'{ONE}{counted}board = {{ kind = "modbus", modbus = {{}} }}\n').arm
    assert servo_settings(real).overrun == COUNTED_ONLY
    assert not servo_settings(real).emulated


def test_files_are_sought_from_the_folder_of_the_deployment_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cell").mkdir()
    text = ONE.replace('"puma560"', '"arms/mine.toml"') + 'board = { calibration_table = "tables/mine.txt" }\n'
    text += '[arm.servo]\nlaw = "../laws.py:mine"\nmodel = "/else/where.toml"\n'
    (tmp_path / "cell" / "here.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    [arm] = load_deployment("cell/here.toml").arm
    here = tmp_path / "cell"
    assert (arm.robot, arm.board.calibration_table) == (f"{here}/arms/mine.toml", f"{here}/tables/mine.txt")
    assert (arm.servo.law, arm.servo.model) == (f"{here}/../laws.py:mine", "/else/where.toml")


def test_packaged_names_and_the_folder_of_logs_are_left_alone(tmp_path: Path) -> None:
    table = 'board = { calibration_table = "puma560" }\nlog = { directory = "out" }\n'
    [arm] = load(tmp_path, ONE + table).arm
    assert (arm.robot, arm.board.calibration_table, arm.log.directory) == ("puma560", "puma560", "out")
    assert (arm.servo.law, arm.servo.model) == ("qrobot", None)


def test_values_nested_without_end_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"here\.toml: its values are nested too deeply"):
        load(tmp_path, "a = " + "[" * 5000 + "]" * 5000)
