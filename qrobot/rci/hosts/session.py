"""Sessions of eclipse-zenoh as both ends open them, and questions asked over them.

The host listens at one endpoint, the program connects to it. Neither looks for others: no multicast, no gossip.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from qrobot.errors import ConfigError, LinkLost, LinkTimeout
from qrobot.extras import missing_extra
from qrobot.rci.hosts.packets import MOST_BYTES, HostReply, HostRequest, decode_reply, encode
from qrobot.rci.hosts.settings import HostSettings, KnownHost

if TYPE_CHECKING:
    import zenoh

LEASE_MS: Final = 1000  # a link that says nothing for so long is closed


def key_of(host: str, what: str) -> str:
    """The key at which a host answers; "orders" and "exchanges" have one each, so that neither waits for the other."""
    return f"qrobot/rci/{host}/{what}"


def listening(settings: HostSettings) -> dict[str, Any]:
    """Configuration of a host."""
    entries = _common(settings) | {
        "mode": "peer",
        "listen/endpoints": [settings.endpoint],
        "connect/endpoints": [],
        "access_control": _access(settings),
    }
    if settings.tls is not None:
        entries["transport/link/tls"] = {
            "root_ca_certificate": settings.tls.authority,
            "listen_certificate": settings.tls.certificate,
            "listen_private_key": settings.tls.key,
            "enable_mtls": True,
        }
    return entries


def connecting(host: KnownHost) -> dict[str, Any]:
    """Configuration of a program that uses a host."""
    entries = _common(host) | {
        "mode": "client",
        "listen/endpoints": [],
        "connect/endpoints": [host.endpoint],
    }
    if host.tls is not None:
        entries["transport/link/tls"] = {
            "root_ca_certificate": host.tls.authority,
            "connect_certificate": host.tls.certificate,
            "connect_private_key": host.tls.key,
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
    return entries


def _common(host: KnownHost) -> dict[str, Any]:
    return {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/protocols": [host.endpoint.partition("/")[0]],
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": 2 * MOST_BYTES,
    }


def _access(settings: HostSettings) -> dict[str, Any]:
    """Programs may ask this host, those of the list where there is one; none may answer in its place, or ask others."""
    key = [key_of(settings.name, "**")]
    rule = {"permission": "allow", "key_exprs": key}
    programs = {"id": "programs"} | ({"cert_common_names": list(settings.allow)} if settings.allow else {})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            rule | {"id": "ask", "flows": ["ingress"], "messages": ["query"]},
            rule | {"id": "answer", "flows": ["egress"], "messages": ["reply", "declare_queryable"]},
        ],
        "subjects": [programs],
        "policies": [{"rules": ["ask", "answer"], "subjects": ["programs"]}],
    }


def open_session(entries: dict[str, Any], what: str) -> zenoh.Session:
    """Open a session. Raises ConfigError without the extra `hosts`, LinkLost when the endpoint cannot be had."""
    try:
        import zenoh
    except ModuleNotFoundError as error:
        raise ConfigError(missing_extra(error) or str(error)) from None
    config = zenoh.Config()
    for key, value in entries.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise LinkLost(f"{what}: {str(error).partition(' at /')[0].strip()}") from error


def ask(session: zenoh.Session, host: KnownHost, what: str, request: HostRequest, patience_s: float) -> HostReply:
    """Ask a host and wait for its answer.

    Raises:
        LinkTimeout: none comes. RemoteProtocolError: it is none. LinkLost: the session is closed.
    """
    return ask_later(session, host, what, request, patience_s)()


def ask_later(
    session: zenoh.Session, host: KnownHost, what: str, request: HostRequest, patience_s: float
) -> Callable[[], HostReply]:
    """Ask a host; gives what waits for its answer. Both raise what `ask` raises."""
    import zenoh

    try:
        replies = session.get(
            key_of(host.name, what),
            payload=encode(request),
            timeout=patience_s,
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
    except zenoh.ZError as error:
        raise LinkLost(f"host {host.name}: {error}") from error
    return partial(_answer_in, replies, host)


def _answer_in(replies: Iterable[zenoh.Reply], host: KnownHost) -> HostReply:
    import zenoh

    try:
        found = [reply.ok for reply in replies if reply.ok is not None]
    except zenoh.ZError as error:
        raise LinkLost(f"host {host.name}: {error}") from error
    if not found:
        listed = "" if host.tls is None else ", or its access list has not the certificate of this program"
        raise LinkTimeout(
            f"host {host.name} at {host.endpoint} does not answer: it has ended, its link is silent{listed}"
        )
    return decode_reply(found[0].payload.to_bytes(), f"host {host.name}")


def answer_questions(session: zenoh.Session, host: str, what: str, answer: Callable[[bytes], bytes]) -> None:
    """Let `answer` answer what is asked, as long as the session is open; it raises nothing."""
    key = key_of(host, what)

    def asked(query: zenoh.Query) -> None:
        with query:
            data = b"" if query.payload is None else query.payload.to_bytes()
            query.reply(key, answer(data), express=True)

    session.declare_queryable(key, asked, complete=True)
