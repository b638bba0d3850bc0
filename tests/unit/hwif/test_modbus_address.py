"""Addresses of Modbus servers on the command line."""

from __future__ import annotations

import pytest

from qrobot.errors import ConfigError
from qrobot.hwif.modbus.device import WATCHDOG_MS
from qrobot.hwif.modbus.server import check_address, split_address


def test_an_address_has_a_host_a_port_and_perhaps_a_patience() -> None:
    assert split_address("127.0.0.1:1502") == ("127.0.0.1", 1502, WATCHDOG_MS, ())
    assert split_address("board.lab:502@0") == ("board.lab", 502, 0.0, ())


def test_an_address_of_ipv6_stands_in_brackets_and_is_judged_as_any_other() -> None:
    assert check_address("[::1]:1502@0") == ("::1", 1502, 0.0, ())
    assert check_address("[fd00::7]:1502+fd00::/64") == ("fd00::7", 1502, WATCHDOG_MS, ("fd00::/64",))
    with pytest.raises(ConfigError, match="server at :: could be reached by every machine"):
        check_address("[::]:1502")


@pytest.mark.parametrize("address", ["", "[]:1502", "1502", ":1502", "here:", "here:x", "here:70000", "here:1502@soon"])
def test_what_is_no_address_is_told_with_an_example(address: str) -> None:
    with pytest.raises(ConfigError, match=r"give HOST:PORT.*127\.0\.0\.1:1502"):
        split_address(address)
