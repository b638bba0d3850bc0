"""May this client come in, and as what? Each rule is one function; the first that objects decides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from hmac import compare_digest
from typing import Final

from qrobot.realtime.loopback import is_loopback
from qrobot.wire import LONGEST_PERIOD_US, SHORTEST_PERIOD_US, ClientRole, ErrorCode, Hello


@dataclass(frozen=True)
class HandshakeRequest:
    """A greeting: the HELLO, the address it came from, the robot that is here, and the token that lets one in.

    `peers` are the hosts of an isolated link by which it came; None for the loopback interface, where an empty token
    lets everybody in.
    """

    hello: Hello
    host: str
    robot_name: str
    token: bytes = b""
    peers: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Refusal:
    """Reason and error code of a refused greeting."""

    code: ErrorCode
    text: str


def judge_robot(visitor: HandshakeRequest) -> Refusal | None:
    """A commander has to name this robot; an observer may name none."""
    asked, here = visitor.hello.robot, visitor.robot_name
    if asked == here or (not asked and visitor.hello.role is ClientRole.OBSERVER):
        return None
    return Refusal(ErrorCode.WRONG_ROBOT, f"this is {here!r}, not {asked!r}")


def judge_period(visitor: HandshakeRequest) -> Refusal | None:
    """Sample periods run from 1 to 100 ms; 0 takes the bridge's."""
    period_us = visitor.hello.period_us
    if period_us == 0 or SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        return None
    allowed = f"{SHORTEST_PERIOD_US} to {LONGEST_PERIOD_US}"
    return Refusal(ErrorCode.BAD_PERIOD, f"sample period {period_us} µs: {allowed} are possible, 0 takes the server's")


def judge_authentication(visitor: HandshakeRequest) -> Refusal | None:
    """A client comes by loopback, where nobody listens in, or from a peer of a link, and shows the token for that."""
    if visitor.peers is None and not is_loopback(visitor.host):
        where = "come through a tunnel to its loopback interface"
        return Refusal(ErrorCode.AUTHENTICATION, f"{visitor.host} is not this machine; {where}")
    if visitor.peers is not None and visitor.host not in visitor.peers:
        known = f"is no peer of this link; {', '.join(visitor.peers)} may come"
        return Refusal(ErrorCode.AUTHENTICATION, f"{visitor.host} {known}")
    if not compare_digest(visitor.hello.auth, visitor.token) and (visitor.token or visitor.peers is not None):
        shown = "another bridge's token" if visitor.hello.auth else "no token"
        remedy = _REMEDY if visitor.peers is None else _LINK_REMEDY
        return Refusal(ErrorCode.AUTHENTICATION, f"this program has shown {shown}; {remedy}")
    return None


_LINK_REMEDY: Final = "give it the token of the link, from its file, in QROBOT_TOKEN"
_REMEDY: Final = (
    "run it under the account that serves the arm or in its group qrobot, with the same QROBOT_RUNTIME_DIR, "
    "or give it the bridge's token in QROBOT_TOKEN"
)
RULES: Final[tuple[Callable[[HandshakeRequest], Refusal | None], ...]] = (
    judge_authentication,
    judge_robot,
    judge_period,
)


def judge(visitor: HandshakeRequest) -> Refusal | None:
    """First objection, or None."""
    return next((refusal for rule in RULES if (refusal := rule(visitor)) is not None), None)
