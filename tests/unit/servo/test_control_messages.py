"""Requests of the control interface: what is none is refused by our own error."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import RemoteProtocolError
from qrobot.servo.operator.messages import ChangeGains, ChangeLaw, decode_request, encode


def refused(line: bytes) -> bool:
    """The line is no request, and is told so by our own error."""
    try:
        decode_request(line)
    except RemoteProtocolError:
        return True
    return False


@given(st.binary(max_size=300))
def test_garbage_is_refused(data: bytes) -> None:
    assert refused(b"?" + data)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x)
)


@given(JSON)
def test_json_that_is_no_request_is_refused(value: Any) -> None:
    for document in (value, {"command": value}, {"command": "law", "name": [value]}, {"command": "stop", "x": value}):
        assert refused(json.dumps(document).encode())


@given(st.lists(st.floats(0, 1e6), max_size=32), st.booleans(), st.text(min_size=1, max_size=50))
def test_requests_survive_the_wire(numbers: list[float], force: bool, name: str) -> None:
    for request in (ChangeGains(kp=tuple(numbers), force=force), ChangeLaw(name=name)):
        assert decode_request(encode(request)) == request
