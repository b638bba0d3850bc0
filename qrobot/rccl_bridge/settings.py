"""Settings of a bridge. The limits are those of the fault table: few clients, short patience, bounded memory."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.errors import ConfigError
from qrobot.rccl_bridge.isolated_link import IsolatedLink
from qrobot.units import NS_PER_S
from qrobot.wire import DEFAULT_PORT, LONGEST_PERIOD_US, SHORTEST_PERIOD_US
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US


@dataclass(frozen=True)
class BridgeSettings:
    """Raises ConfigError when the default period cannot be served.

    Attributes:
        host, port: where to listen; port 0 takes a free one.
        period_us: sample period of clients that ask for none.
        max_clients: commander and observers together; the commander's place is kept for it.
        max_greeting: clients that have not greeted yet; of more, one that came before is sent away.
        handshake_ns: a client that has not greeted by then is sent away.
        silence_ns: a commander that sends nothing for so long is taken for dead.
        blocked_ns: a client that reads nothing for so long is sent away.
        link: an isolated network link on which it listens too, at the same port.
    """

    host: str = "127.0.0.1"
    port: int = DEFAULT_PORT
    period_us: int = DEFAULT_PERIOD_US
    max_clients: int = 8
    max_greeting: int = 16
    handshake_ns: int = 2 * NS_PER_S
    silence_ns: int = NS_PER_S
    blocked_ns: int = 10 * NS_PER_S
    link: IsolatedLink | None = None

    def __post_init__(self) -> None:
        if not SHORTEST_PERIOD_US <= self.period_us <= LONGEST_PERIOD_US:
            raise ConfigError(
                f"bridge period {self.period_us} µs: {SHORTEST_PERIOD_US} to {LONGEST_PERIOD_US} are possible"
            )
