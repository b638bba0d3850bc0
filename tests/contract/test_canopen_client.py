"""Another's client on our node: the package canopen, with nothing but the EDS file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import canopen
import pytest
from canopen.objectdictionary.eds import import_eds

from qrobot.hwif.canbus.frames import RPDO, TPDO
from qrobot.hwif.canbus.objects import ENTRIES
from qrobot.hwif.registers import DAC_ZERO, REGISTERS, Access
from tests.support.bus import BenchEndpoint
from tests.support.can_transport import can_transport
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.virtual_clock import VirtualClock

EDS = str(Path(__file__).parents[2] / "config/can/qrobot_board.eds")


class Desk:
    def __init__(self, network: canopen.Network, end: BenchEndpoint, clock: VirtualClock) -> None:
        self.network, self.end, self.clock = network, end, clock
        self.node = network.add_node(1, EDS)
        self.node.sdo.RESPONSE_TIMEOUT = PATIENCE_S


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    end = BenchEndpoint()
    with can_transport(end) as transport:
        network = canopen.Network(transport.interface())
        network.connect()
        desk = Desk(network, end, transport.clock)
        desk.node.nmt.state = "OPERATIONAL"
        yield desk
        network.disconnect()


def test_the_eds_file_has_every_object_with_its_type_and_access() -> None:
    dictionary = import_eds(EDS, 1)
    for entry in ENTRIES:
        variable = dictionary[entry.index] if entry.sub is None else dictionary[entry.index][entry.sub]
        assert (variable.data_type, variable.access_type) == (entry.kind, entry.access), hex(entry.index)
    information = dictionary.device_information
    assert (information.nr_of_RXPDO, information.nr_of_TXPDO) == (len(RPDO), len(TPDO))


def test_every_register_that_can_be_read_is_read_by_its_name(desk: Desk) -> None:
    desk.end.turn(3, 1234.0)
    readable = [row for row in REGISTERS if row.access is Access.READ]
    words = {row.name: [desk.node.sdo[row.name][sub + 1].raw for sub in range(row.count)] for row in readable}
    assert words["ENC_COUNT"] == [0, 0, 0, 1234, 0, 0]
    assert words["STATUS"] == [desk.node.sdo[0x6100][1].raw]


def test_a_converter_takes_volts_and_a_counter_a_load(desk: Desk) -> None:
    desk.node.sdo[0x6411][3].raw = 3277  # 1 V
    assert desk.end.bench.board.dac[2] == DAC_ZERO - 204
    desk.node.sdo["ENC_LOAD"]["ENC_LOAD 6"].raw = 500
    assert desk.node.sdo["ENC_COUNT"]["ENC_COUNT 6"].raw == 500


def test_reading_what_can_only_be_written_is_refused(desk: Desk) -> None:
    with pytest.raises(canopen.SdoAbortedError, match="write only"):
        _ = desk.node.sdo["DAC"][1].raw


def test_process_data_follow_the_mapping_that_the_node_tells(desk: Desk) -> None:
    desk.node.rpdo.read()
    desk.node.tpdo.read()
    desk.end.turn(0, 42.0)
    desk.node.rpdo[2]["DAC.DAC 1"].raw = 0x900
    desk.node.rpdo[2].transmit()
    desk.network.sync.transmit()
    wait_until(lambda: desk.node.tpdo[2]["ENC_COUNT.ENC_COUNT 1"].raw == 42)
    assert desk.end.bench.board.dac[0] == 0x900
    assert desk.node.tpdo[1]["STATUS.STATUS"].raw == desk.node.sdo["STATUS"][1].raw


def test_the_heartbeat_is_heard(desk: Desk) -> None:
    heard: list[int] = []
    desk.node.nmt.add_heartbeat_callback(heard.append)
    desk.node.sdo["producer heartbeat time, ms"].raw = 10

    def beats() -> bool:
        desk.clock.pass_ms(10)
        return bool(heard)

    wait_until(beats, "a heartbeat is heard")
    assert desk.node.nmt.state == "OPERATIONAL"
    desk.node.sdo["producer heartbeat time, ms"].raw = 0
