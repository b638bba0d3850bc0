"""Gate of the pendant: pure ASGI in front of everything that answers, page, socket.io and telemetry alike.

Whatever a browser on this machine can be made to do by a page from elsewhere ends here. A foreign name that was pointed
at this machine (DNS rebinding) has another Host, a foreign page another Origin, and whoever does not know the token has
no cookie. The token stands once in the address; it is answered with a cookie that scripts cannot read and that other
sites' pages do not send. A browser sends it to other servers of this machine, though, which may be another account's
(RFC 6265, section 8.5): so who shows it has to be of this account, as is the end of a tunnel that its owner has dug.
That is looked up last, for it takes time that nobody without the token is to use up.
"""

from __future__ import annotations

import os
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from hashlib import sha256
from hmac import compare_digest
from typing import Any, Final, TypeAlias
from urllib.parse import parse_qs

from qrobot.pendant.door import Door
from qrobot.realtime.loopback import maybe_account_between

Scope: TypeAlias = MutableMapping[str, Any]
Receive: TypeAlias = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send: TypeAlias = Callable[[MutableMapping[str, Any]], Awaitable[None]]
AsgiApp: TypeAlias = Callable[[Scope, Receive, Send], Awaitable[None]]

OWN_NAMES: Final = ("127.0.0.1", "localhost", "[::1]")  # any port: a tunnel may end at another one
OWN_SITES: Final = ("same-origin", "none")  # of Sec-Fetch-Site; a server at another port is "same-site"
TOKEN_PARAMETER: Final = "token"
POLICY_VIOLATION: Final = 1008  # RFC 6455, section 7.4.1
# Everything comes from this server: pages cannot ask for anything elsewhere, and nobody can frame them.
CONTENT_POLICY: Final = (
    "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; frame-ancestors 'none'; base-uri 'self'; "
    "form-action 'self'"
)
ENTRY_PAGE: Final = b"""<!doctype html><meta charset="utf-8"><title>QRobot pendant</title>
<meta http-equiv="refresh" content="0; url=/"><p>The pendant opens: <a href="/">go on</a>.</p>"""
_HEADERS: Final = (
    (b"content-security-policy", CONTENT_POLICY.encode()),
    (b"referrer-policy", b"no-referrer"),
    (b"x-content-type-options", b"nosniff"),
)


def cookie_name(token: str) -> str:
    """Name of the cookie that carries `token`: browsers send cookies to every port, and each pendant keeps its own."""
    return f"qrobot_pendant_{sha256(token.encode()).hexdigest()[:12]}"


def is_of_this_account(scope: Scope) -> bool:
    """Whether a process of this account, or of root, is at the far end."""
    theirs, ours = scope.get("client"), scope.get("server")
    if theirs is None or ours is None:
        return False
    return maybe_account_between(tuple(theirs), tuple(ours)) in {0, os.geteuid()}


class Gate:
    """Lets in who is of this account, names this machine, comes from a page of this server and shows the token.

    Args:
        app: what is behind.
        token: the secret of this run.
        names: of this machine, as a browser may call it.
        admits: whether the process at the far end may come in at all.
        door: is told of whom is let in.
    """

    def __init__(
        self,
        app: AsgiApp,
        token: str,
        names: Iterable[str] = OWN_NAMES,
        admits: Callable[[Scope], bool] = is_of_this_account,
        door: Door | None = None,
    ) -> None:
        self.door = door or Door()
        self.app, self._admits = app, admits
        self._token, self._cookie = token.encode(), cookie_name(token)
        self._names = tuple(name.lower() for name in names)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or hand over; see the ASGI specification."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif (why := self._objection(scope) or self._doubt(scope)) is not None:
            await _refuse(scope, receive, send, why)
        else:
            self.door.let_in(scope)
            await self._answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._shows_token(scope):
            await self._give_cookie(send)
        else:
            await self.app(scope, receive, _with_headers(send))

    def _doubt(self, scope: Scope) -> str | None:
        """Complaint about token or account, None when they are right."""
        if not self._shows_token(scope) and not self._has_cookie(scope):
            return "no valid token: open the address that `qrobot pendant` has printed"
        if not self._admits(scope):
            return "the request comes from another account of this machine: start a pendant of your own"
        return None

    def _objection(self, scope: Scope) -> str | None:
        """Complaint about Host, Origin or Sec-Fetch-Site, None when they are right.

        A request for a picture has no Origin; that another page asks for it browsers tell by Sec-Fetch-Site.
        """
        hosts, origins = _headers(scope, b"host"), _headers(scope, b"origin")
        if len(hosts) != 1 or not self._is_own(hosts[0]):
            return "this server is not called by that name"
        if scope["type"] == "websocket" and not origins:
            return "no Origin: only pages of this server are served here"
        own = {f"{scheme}://{hosts[0]}".lower() for scheme in ("http", "https")}
        sites = () if self._shows_token(scope) else _headers(scope, b"sec-fetch-site")
        foreign = any(origin.lower() not in own for origin in origins) or any(site not in OWN_SITES for site in sites)
        if len(origins) > 1 or foreign:
            return "the request comes from a page of another server"
        return None

    def _is_own(self, host: str) -> bool:
        name, colon, port = host.lower().rpartition(":") if not host.endswith("]") else (host.lower(), "", "")
        if not colon:
            name, port = host.lower(), ""
        return name in self._names and (not port or port.isdecimal())

    def _shows_token(self, scope: Scope) -> bool:
        shown = parse_qs(scope.get("query_string", b"").decode("latin-1")).get(TOKEN_PARAMETER, [""])
        return scope["type"] == "http" and scope["path"] == "/" and self._matches(shown[0])

    def _has_cookie(self, scope: Scope) -> bool:
        """Split by hand: `http.cookies` gives up at what other servers of this machine may have left before ours."""
        pairs = (pair.strip().partition("=") for header in _headers(scope, b"cookie") for pair in header.split(";"))
        return any(name == self._cookie and self._matches(value) for name, _, value in pairs)

    def _matches(self, shown: str) -> bool:
        return compare_digest(shown.encode(), self._token)

    async def _give_cookie(self, send: Send) -> None:
        """A page that goes on by itself: a redirection that began elsewhere would not send a strict cookie."""
        cookie = f"{self._cookie}={self._token.decode()}; HttpOnly; SameSite=Strict; Path=/"
        headers = [(b"set-cookie", cookie.encode()), (b"content-type", b"text/html"), (b"cache-control", b"no-store")]
        await send({"type": "http.response.start", "status": 200, "headers": [*headers, *_HEADERS]})
        await send({"type": "http.response.body", "body": ENTRY_PAGE})


def _headers(scope: Scope, name: bytes) -> list[str]:
    """Values of a header, one for each time it was sent."""
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _with_headers(send: Send) -> Send:
    """Add what a browser has to know to each answer."""

    async def send_with_headers(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_HEADERS]
        await send(message)

    return send_with_headers


async def _refuse(scope: Scope, receive: Receive, send: Send, why: str) -> None:
    if scope["type"] == "websocket":
        await receive()  # the handshake; to close before it is accepted is answered with 403
        await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": why})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"refused: {why}\n".encode()})
