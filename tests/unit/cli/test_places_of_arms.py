"""Wherever a deployment file may have the bridge of an arm, programs that are told its address find it."""

from __future__ import annotations

import pytest

from qrobot.cli.arms import place_of_arm
from qrobot.cli.run import bridge_links
from qrobot.config.bridge import BridgeChoice
from qrobot.config.deployment import load_deployment
from qrobot.rci import TcpLink, bridge_address, hello_for
from qrobot.rci.tcp import BRIDGE_VARIABLE, LOCALHOST, ONLY_VARIABLE, address_text, check_reachable

PORT = 5677  # where nobody listens


@pytest.mark.parametrize("host", [LOCALHOST, "127.3.2.1", "localhost", "::1"])
def test_a_program_finds_an_arm_at_every_address_that_its_deployment_file_may_have(
    host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = load_deployment("emulator").arm[0].model_copy(update={"bridge": BridgeChoice(host=host, port=PORT)})
    place, address = place_of_arm(arm), (LOCALHOST if host == "localhost" else host, PORT)
    assert (bridge_address(place), address_text(place)) == (address, place)
    monkeypatch.setenv(BRIDGE_VARIABLE, "")
    monkeypatch.setenv(ONLY_VARIABLE, place)
    link = bridge_links(arm)(hello_for(arm.robot))
    assert isinstance(link, TcpLink)
    assert link.address == (host, PORT)
    assert bridge_address() == address  # for what looks for a bridge by itself
    check_reachable(link.address)
