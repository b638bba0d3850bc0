"""What a client makes of complaints that do not end the conversation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from qrobot.errors import LinkTimeout
from qrobot.rci import hello_for
from qrobot.rci.client import Client, ServoLoss
from qrobot.wire import ClientRole, Connection, ErrorCode, Side, State, Welcome, WireError
from tests.support.packets import resting

GONE = WireError(ErrorCode.SERVO_GONE, "the servo does not run", False)
NEW = WireError(ErrorCode.SERVO_NEW, "the servo has started anew", False)


def conversation(in_step: bool, sampled: bool) -> tuple[Client, Connection]:
    """A client that was welcomed, and has got a sample or not; and its server."""
    client, server = Client(replace(hello_for("puma560"), in_step=in_step), "the bridge"), Connection(Side.SERVER)
    server.receive_data(client.greet())
    server.next_event()
    client.take(server.send(Welcome(ClientRole.COMMANDER, "puma560", 2, 28_000)))
    if sampled:
        client.take(server.send(State(1, resting((0.1, -0.2)), in_step=in_step)))
    return client, server


def test_an_arm_in_step_with_others_does_not_wait_for_a_servo_that_has_gone() -> None:
    client, server = conversation(in_step=True, sampled=True)
    with pytest.raises(LinkTimeout, match="the bridge says: the servo does not run"):
        client.take(server.send(GONE))


@pytest.mark.parametrize(("in_step", "sampled"), [(False, True), (True, False)])
def test_an_arm_by_itself_and_one_that_has_not_begun_wait_for_the_servo(in_step: bool, sampled: bool) -> None:
    client, server = conversation(in_step, sampled)
    client.take(server.send(GONE))
    assert client.warning == "the servo does not run"
    assert not client.refusals
    assert client.servo_loss is ServoLoss.AWAY


def test_a_sample_of_a_servo_that_has_gone_is_not_taken_for_one_of_the_next() -> None:
    client, server = conversation(in_step=False, sampled=False)
    client.take(server.send(State(1, resting((0.1, -0.2)))) + server.send(GONE))
    assert client.pop_state() is None
    client.take(server.send(State(2, resting((0.1, -0.2)))))
    assert client.pop_state().seq == 2
    assert client.servo_loss is ServoLoss.AWAY


@pytest.mark.parametrize("said", [(GONE, NEW), (NEW,), (GONE, NEW, GONE)])
def test_a_servo_that_has_started_anew_stays_another_one_until_that_is_seen(said: tuple[WireError, ...]) -> None:
    client, server = conversation(in_step=False, sampled=True)
    for complaint in said:
        client.take(server.send(complaint))
    assert client.servo_loss is ServoLoss.ANOTHER
