"""A sensor on CAN: its frames are values of converter channels, until they are too old."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import pytest
from pydantic import ValidationError

from qrobot.cli.servo_settings import servo_settings
from qrobot.config import load_deployment
from qrobot.config.can_sensor import CanSensor, CanSignal
from qrobot.config.signals import NamedSignal
from qrobot.errors import ConfigError, LinkError
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.canbus.sensor import RETRY_NS, SensorBus, decode_signal, in_a_thread
from qrobot.hwif.image import IMAGE_ADC_VALUE, IMAGE_STATUS, make_image
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_F_COMMAND,
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    DISCRETE,
    DISCRETE_ADC,
    STATUS_ADC_BUSY,
)
from qrobot.units import NS_PER_MS
from tests.support.bench import Bench
from tests.support.bus import BenchEndpoint, DirectBus, Row, at_once, rows_of
from tests.support.patience import PATIENCE_MS
from tests.support.virtual_clock import VirtualClock

FORCE, TORQUE, BOARD_CHANNEL = 6, 7, 2
RESOLUTION = 16 * ADC_F_VOLT_PER_COUNT
ON_CAN = """
[[arm]]
name = "left"
robot = "puma560"
bridge = { port = 5600 }
servo = { board_timeout_ms = 10, sensor_channels = [6] }
signals = [{ name = "grip_force", analog = 6, per_volt = 20.0, zero_v = 0.5, unit = "N" }]

[arm.board]
kind = "can"
can = { channel = "can0" }
can_sensor = { channel = "can1", signals = [{ channel = 6, id = 0x123, volt_per_count = 0.001 }] }
"""


LONG_ID = 0x18FF0123


def signal(channel: int = FORCE, **keys: object) -> CanSignal:
    return CanSignal.model_validate({"channel": channel, "id": 0x123, "volt_per_count": 0.001, **keys})


class Desk:
    def __init__(self, timeout_ms: float = PATIENCE_MS, can_id: int = 0x123, **options: object) -> None:
        name = uuid.uuid4().hex
        torque = signal(TORQUE, id=can_id, first=2, big_endian=True, volt_per_count=-0.01, zero_v=1.0)
        signals = (signal(id=can_id), torque)
        self.end = BenchEndpoint(Bench(**options))  # type: ignore[arg-type]
        self.sensor = can.Bus(interface="virtual", channel=name)
        config = CanSensor(interface="virtual", channel=name, signals=signals)
        self.config = config.model_copy(update={"timeout_ms": timeout_ms})  # longer than a file may ask for
        self.clock = VirtualClock()
        self.told: list[str] = []
        self.bus = SensorBus(DirectBus(self.end), self.config, self.clock, self.told.append, at_once)
        self.image = make_image()

    def close(self) -> None:
        self.bus.close()
        self.sensor.shutdown()

    def send(self, data: bytes, can_id: int = 0x123, extended: bool = False) -> None:
        self.sensor.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=extended))

    def exchange(self, *rows: Row) -> int:
        self.bus.exchange(rows_of(rows), self.image)
        return int(self.image[IMAGE_STATUS])

    def convert(self, channel: int) -> float | None:
        """The servo's sequence; volts, or None while the conversion is not done."""
        mux = (OP_WRITE, ADC_MUX, channel << ADC_F_CHANNEL_SHIFT | ADC_F_COMMAND)
        self.exchange((OP_WRITE, DISCRETE, 0), (OP_WRITE, DISCRETE, DISCRETE_ADC), mux)
        if self.exchange() & STATUS_ADC_BUSY:
            return None
        word = int(self.image[IMAGE_ADC_VALUE])
        assert 0 <= word <= 0xFFF0
        return ((word ^ 0x8000) - 0x8000) * ADC_F_VOLT_PER_COUNT


@pytest.fixture
def desk() -> Iterator[Desk]:
    desk = Desk()
    desk.bus.connect()
    yield desk
    desk.close()


def test_values_of_a_frame_are_read_as_volts_of_their_channels(desk: Desk) -> None:
    desk.send((-2500).to_bytes(2, "little", signed=True) + (300).to_bytes(2, "big"))
    assert desk.convert(FORCE) == pytest.approx(-2.5, abs=RESOLUTION)
    assert desk.convert(TORQUE) == pytest.approx(-4.0, abs=RESOLUTION)


def test_a_value_in_the_place_of_a_potentiometer_is_refused_with_its_joint(tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(ON_CAN.replace("signals = [{ channel = 6", "signals = [{ channel = 2"))
    with pytest.raises(ConfigError, match=r"board\.can_sensor: channel 2 carries the potentiometer of joint 3"):
        servo_settings(load_deployment(path).arm[0])
    path.write_text(path.read_text() + "pots = false\n")
    assert not servo_settings(load_deployment(path).arm[0]).pots


def test_a_value_on_can_has_a_name_for_programs(desk: Desk, tmp_path: Path) -> None:
    path = tmp_path / "here.toml"
    path.write_text(ON_CAN)
    (arm,) = load_deployment(path).arm
    (named,) = arm.named_signals
    assert arm.board.can_sensor is not None
    assert named.analog in {each.channel for each in arm.board.can_sensor.signals}
    desk.send((1500).to_bytes(2, "little") + bytes(2))
    volts = desk.convert(named.analog)
    assert volts is not None
    assert (volts - named.zero_v) * named.per_volt == pytest.approx(20.0, abs=20 * RESOLUTION)


def test_the_newest_of_several_frames_counts(desk: Desk) -> None:
    for count in (1000, 2000, 3000):
        desk.send(count.to_bytes(2, "little") + bytes(2))
    desk.send(bytes(4), can_id=0x124)
    assert desk.convert(FORCE) == pytest.approx(3.0, abs=RESOLUTION)


@pytest.mark.parametrize(
    ("own", "other"), [((0x7FF, False), (0x7FF, True)), ((LONG_ID, True), (LONG_ID & 0x7FF, False))]
)
def test_a_frame_of_29_bits_is_another_one_than_that_of_11_bits_with_its_number(
    own: tuple[int, bool], other: tuple[int, bool]
) -> None:
    desk = Desk(can_id=own[0])
    desk.bus.connect()
    for count, (can_id, extended) in ((1000, own), (2000, other)):
        desk.send(count.to_bytes(2, "little") + bytes(2), can_id, extended)
    assert desk.convert(FORCE) == pytest.approx(1.0, abs=RESOLUTION)
    desk.close()


def test_the_boards_own_channels_are_converted_by_the_board(desk: Desk) -> None:
    desk.send(bytes(4))
    desk.convert(FORCE)
    assert all(offset != ADC_MUX for _, offset, _ in desk.end.applied)
    assert desk.convert(BOARD_CHANNEL) is not None
    assert (OP_WRITE, ADC_MUX, BOARD_CHANNEL << ADC_F_CHANNEL_SHIFT | ADC_F_COMMAND) in desk.end.applied


def test_a_sensor_that_is_silent_or_was_never_heard_has_no_value() -> None:
    desk = Desk(timeout_ms=20.0)
    desk.bus.connect()
    assert desk.convert(FORCE) is None
    desk.send(bytes(4))
    desk.exchange()
    desk.clock.pass_ms(20.1)
    assert desk.convert(FORCE) is None
    desk.close()


class Adapter:
    """The interface of the sensor, which somebody pulls and plugs in.

    Attributes:
        pulled: it neither receives, nor opens, nor closes.
        opened: times it was opened. open_now: how many of these are open.
    """

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.pulled, self.opened, self.open_now = False, 0, 0
        self._open = open_interface
        patch.setattr("qrobot.hwif.canbus.link.open_interface", self.open_or_say_why_not)

    def open_or_say_why_not(self, *where: object) -> can.BusABC:
        try:
            return self.open(*where)
        except can.CanError as error:
            raise LinkError(f"CAN interface does not open: {error}") from error

    def open(self, *where: object) -> can.BusABC:
        self.must_be_there()
        self.opened, self.open_now = self.opened + 1, self.open_now + 1
        bus = self._open(*where)  # type: ignore[arg-type]
        receive, shut_down = bus.recv, bus.shutdown

        def checked_receive(timeout: float | None = None) -> can.Message | None:
            self.must_be_there()
            return receive(timeout)

        def checked_shut_down() -> None:
            shut_down()
            self.open_now -= 1
            self.must_be_there()

        bus.recv, bus.shutdown = checked_receive, checked_shut_down  # type: ignore[method-assign]
        return bus

    def must_be_there(self) -> None:
        if self.pulled:
            raise can.CanOperationError("no such device")


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch) -> Adapter:
    return Adapter(monkeypatch)


def test_a_sensor_whose_interface_fails_has_no_value_until_it_opens_again_and_the_board_goes_on(
    adapter: Adapter,
) -> None:
    desk = Desk()
    desk.bus.connect()
    desk.send(bytes(4))
    assert desk.convert(FORCE) == 0.0
    adapter.pulled = True
    for _ in range(3):
        assert desk.convert(FORCE) is None
        assert desk.convert(BOARD_CHANNEL) is not None
    desk.clock.pass_ms(RETRY_NS / NS_PER_MS)
    assert desk.convert(FORCE) is None
    adapter.pulled = False
    desk.exchange()
    assert adapter.opened == 1  # it is looked for now and then
    desk.clock.pass_ms(RETRY_NS / NS_PER_MS)
    desk.exchange()
    desk.send(bytes(4))
    assert desk.convert(FORCE) == 0.0
    assert (adapter.opened, desk.bus.losses) == (2, 1)
    assert [line.partition(": ")[2] for line in desk.told] == [
        "the interface fails: no such device",
        "the interface is open",
    ]
    desk.close()


def test_a_board_is_found_although_the_interface_of_its_sensor_does_not_open(adapter: Adapter) -> None:
    desk = Desk()
    adapter.pulled = True
    for _ in range(3):  # the board, too, may have to be looked for
        desk.bus.connect()
        assert desk.convert(BOARD_CHANNEL) is not None
        assert desk.convert(FORCE) is None
        desk.bus.close()
    [told] = desk.told
    assert told.startswith("no sensor at CAN virtual:")
    adapter.pulled = False
    desk.bus.connect()
    desk.send(bytes(4))
    assert desk.convert(FORCE) == 0.0
    assert desk.bus.losses == 0
    desk.close()


def test_neither_a_board_that_is_found_nor_an_exchange_waits_for_an_interface_that_opens_slowly(
    adapter: Adapter,
) -> None:
    desk, begun = Desk(), list[Callable[[], None]]()
    desk.bus = SensorBus(DirectBus(desk.end), desk.config, desk.clock, aside=begun.append)
    for _ in range(2):  # the board is found, lost, and found again
        desk.bus.connect()
        for _ in range(3):
            desk.clock.pass_ms(RETRY_NS / NS_PER_MS)
            assert desk.convert(BOARD_CHANNEL) is not None
            assert desk.convert(FORCE) is None
        desk.bus.close()
    desk.bus.connect()
    [opens] = begun
    opens()
    desk.send(bytes(4))
    assert desk.convert(FORCE) == 0.0
    assert (adapter.opened, adapter.open_now) == (1, 1)
    desk.close()
    assert adapter.open_now == 0


def test_an_interface_that_is_open_when_its_board_has_been_let_go_of_is_let_go_of_too(adapter: Adapter) -> None:
    desk, begun = Desk(), list[Callable[[], None]]()
    desk.bus = SensorBus(DirectBus(desk.end), desk.config, desk.clock, aside=begun.append)
    desk.bus.connect()
    desk.bus.close()
    begun.pop()()
    assert (adapter.opened, adapter.open_now) == (1, 0)
    desk.bus.connect()
    begun.pop()()
    desk.send(bytes(4))
    assert desk.convert(FORCE) == 0.0
    desk.close()


def test_what_is_done_aside_is_not_waited_for() -> None:
    may, done = threading.Event(), threading.Event()
    in_a_thread(lambda: done.set() if may.wait() else None)
    assert not done.is_set()
    may.set()
    assert done.wait()


def test_a_frame_that_is_too_short_is_counted_and_is_no_value(desk: Desk) -> None:
    desk.send(bytes(3))  # enough for the first signal
    assert desk.convert(FORCE) == 0.0
    assert desk.convert(TORQUE) is None
    assert desk.bus.malformed == 1


def test_a_board_of_revision_e_is_refused() -> None:
    desk = Desk(revision_f=False)
    with pytest.raises(LinkError, match="revision F"):
        desk.bus.connect()
    desk.close()


@pytest.mark.parametrize(("count", "volts"), [(32767, 10.0), (-32768, -10.0), (0, 0.0)])
def test_values_are_clipped_at_ten_volts(count: int, volts: float) -> None:
    word = decode_signal(signal(), count.to_bytes(2, "little", signed=True))
    assert ((word ^ 0x8000) - 0x8000) * ADC_F_VOLT_PER_COUNT == pytest.approx(volts, abs=RESOLUTION)


@pytest.mark.parametrize(("first", "size"), [(7, 2), (5, 4)])
def test_a_signal_beyond_the_end_of_a_frame_is_refused(first: int, size: int) -> None:
    with pytest.raises(ValidationError, match="a frame has bytes 0 to 7"):
        signal(first=first, size=size)


def test_a_signal_that_would_read_the_same_whatever_comes_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"volt_per_count\n.*0 is no scale"):
        signal(volt_per_count=0.0)
    with pytest.raises(ValidationError, match=r"per_volt\n.*0 is no scale"):
        NamedSignal(name="grip", analog=6, per_volt=0.0)


def test_two_signals_cannot_share_a_channel() -> None:
    with pytest.raises(ValidationError, match="the same channel"):
        CanSensor(signals=(signal(), signal()))
