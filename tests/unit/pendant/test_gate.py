"""Who comes through the gate in front of the pendant."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import sys
from typing import Any

import pytest
import uvicorn

from qrobot.cli.pendant import entry_file
from qrobot.pendant.door import Door
from qrobot.pendant.gate import Gate, cookie_name, is_of_this_account
from qrobot.pendant.server import server_config, tell_in_one_line
from tests.support.accounts import as_other_account, needs_root

TOKEN, HOST = "right", "127.0.0.1:8560"
OWN = f"http://{HOST}"
COOKIE = cookie_name(TOKEN)
IN = f"other=1; {COOKIE}={TOKEN}"
FOREIGN = "http://evil.example"


async def _inside(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def knock(kind: str, path: str, query: str = "", ours: bool = True, **headers: str | list[str]) -> list[dict[str, Any]]:
    """What the gate answers to a request, of a process of this account or not."""
    sent: list[dict[str, Any]] = []

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(dict(message))

    pairs = [(name.encode(), each.encode()) for name, value in headers.items()
             for each in ([value] if isinstance(value, str) else value)]  # fmt: skip
    scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": pairs}
    asyncio.run(Gate(_inside, TOKEN, admits=lambda _: ours)(scope, receive, send))
    return sent


def came_in(answer: list[dict[str, Any]]) -> bool:
    first = answer[0]
    return first["type"] == "websocket.accept" or first.get("status") == 204


PAGES = [("http", "/"), ("http", "/_nicegui_ws/socket.io/")]
PLACES = [*PAGES, ("websocket", "/_nicegui_ws/socket.io/"), ("websocket", "/live")]


@pytest.mark.parametrize(
    ("site", "comes_in"), [("same-origin", True), ("none", True), ("same-site", False), ("", False)]
)
def test_what_a_page_of_another_port_asks_for_as_a_picture_is_refused(site: str, comes_in: bool) -> None:
    """Such a request has no Origin, and the cookie comes along: to a browser another port is the same site."""
    headers = {"host": HOST, "cookie": IN, "sec-fetch-site": site}
    assert came_in(knock("http", "/ask/scope/keep", **headers)) is comes_in
    assert "set-cookie" in str(knock("http", "/", f"token={TOKEN}", **headers))  # who has the address may come in


@pytest.mark.parametrize(("kind", "path"), PLACES)
def test_a_page_of_this_server_comes_in_and_no_other(kind: str, path: str) -> None:
    assert came_in(knock(kind, path, host=HOST, origin=OWN, cookie=IN))
    assert came_in(knock(kind, path, host="localhost:9000", origin="http://localhost:9000", cookie=IN))  # a tunnel
    refused: list[dict[str, Any]] = [
        {"host": HOST, "origin": OWN},
        {"host": HOST, "origin": OWN, "cookie": f"{COOKIE}=wrong"},
        {"host": HOST, "origin": FOREIGN, "cookie": IN},
        {"host": HOST, "origin": "null", "cookie": IN},
        {"host": HOST, "origin": [OWN, FOREIGN], "cookie": IN},
        {"host": HOST, "origin": "http://127.0.0.1:80", "cookie": IN},  # another server of this machine
        {"host": "evil.example:8560", "origin": "http://evil.example:8560", "cookie": IN},  # DNS rebinding
        {"host": "127.0.0.1.evil.example", "cookie": IN, "origin": OWN},
        {"host": [HOST, "evil.example"], "origin": OWN, "cookie": IN},
        {"origin": OWN, "cookie": IN},
        {"host": HOST, "origin": OWN, "cookie": IN, "sec-fetch-site": "cross-site"},
        {"host": HOST, "origin": OWN, "cookie": IN, "sec-fetch-site": ["same-origin", "same-site"]},
    ]
    for headers in refused:
        answer = knock(kind, path, **headers)
        assert answer[0].get("status", 403) == 403, headers
        assert answer[0]["type"] in ("http.response.start", "websocket.close"), headers


@pytest.mark.parametrize(("kind", "path"), PLACES)
def test_another_account_does_not_come_in_whatever_it_shows(kind: str, path: str) -> None:
    """Browsers send a cookie to every port of this machine; whoever serves one may show it here."""
    answer = knock(kind, path, host=HOST, origin=OWN, cookie=IN, ours=False)
    assert not came_in(answer)
    assert b"another account" in str(answer).encode()
    assert not came_in(knock("http", "/", query=f"token={TOKEN}", host=HOST, ours=False))


def test_nobody_without_the_token_makes_the_gate_look_up_whose_a_connection_is() -> None:
    looked = []

    async def knock_with(cookie: str) -> None:
        headers = [(b"host", HOST.encode()), (b"cookie", cookie.encode())]
        scope = {"type": "http", "path": "/", "query_string": b"", "headers": headers}

        def admits(_scope: object) -> bool:
            looked.append(cookie)
            return True

        await Gate(_inside, TOKEN, admits=admits)(scope, _nothing, _unheard)

    for cookie in ("", f"{COOKIE}=wrong", IN):
        asyncio.run(knock_with(cookie))
    assert looked == [IN]


async def _nothing() -> dict[str, Any]:
    return {}


async def _unheard(_message: object) -> None:
    pass


def test_a_connection_of_this_account_is_known_by_its_ends() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as browser:
        near, _ = server.accept()
        with near:
            scope = {"client": list(browser.getsockname()), "server": list(browser.getpeername())}
            assert is_of_this_account(scope)
            assert not is_of_this_account(scope | {"client": None})
            assert not is_of_this_account(scope | {"client": ["127.0.0.1", 1]})  # whoever it is: it is not there


def test_no_header_says_who_is_at_the_far_end() -> None:
    """uvicorn would take the word of a proxy on this machine for it, and everybody on this machine is one."""
    ends = asyncio.run(_ends_of_a_request(b"X-Forwarded-For: 127.0.0.1:1"))
    assert ends["client"] == ends["told"]


async def _ends_of_a_request(header: bytes) -> dict[str, Any]:
    """What the app behind the pendant's server is told of a request's far end, and what that is."""
    seen: dict[str, Any] = {}

    async def app(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            seen["client"] = tuple(scope["client"])
            await _inside(scope, receive, send)

    config = server_config(app, Door())
    config.lifespan = "off"
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        serving = asyncio.create_task(server.serve([listener]))
        reader, writer = await asyncio.open_connection(*listener.getsockname())
        seen["told"] = writer.get_extra_info("sockname")
        writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n" + header + b"\r\n\r\n")
        await reader.read()
        writer.close()
        server.should_exit = True
        await serving
    return seen


@needs_root
def test_a_connection_of_another_account_is_known_by_its_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 0)  # the server's account, in the child too
    with socket.create_server(("127.0.0.1", 0)) as server:

        def visit() -> bool:
            with socket.create_connection(server.getsockname()) as browser:
                near, _ = server.accept()
                with near:
                    return is_of_this_account({"client": browser.getsockname(), "server": browser.getpeername()})

        assert as_other_account(visit) == "False"


@pytest.mark.parametrize("other", ['x={"a":1}', "a=b c", "version=1", "alone", r"b=\q", "="])
def test_a_cookie_that_another_server_of_this_machine_has_left_locks_nobody_out(other: str) -> None:
    assert came_in(knock("http", "/", host=HOST, cookie=f"{other}; {IN}"))
    assert not came_in(knock("http", "/", host=HOST, cookie=f"{other}; {COOKIE}=wrong"))


def test_a_socket_without_an_origin_is_no_page() -> None:
    assert not came_in(knock("websocket", "/live", host=HOST, cookie=IN))
    assert came_in(knock("http", "/", host=HOST, cookie=IN))


def test_the_token_of_the_address_becomes_a_cookie_that_only_this_site_sends_and_no_script_reads() -> None:
    start, body = knock("http", "/", query=f"token={TOKEN}", host=HOST)
    headers = dict(start["headers"])
    assert start["status"] == 200
    assert headers[b"set-cookie"] == f"{COOKIE}={TOKEN}; HttpOnly; SameSite=Strict; Path=/".encode()
    assert TOKEN.encode() not in body["body"]
    for query in ("token=wrong", "token=", ""):
        assert knock("http", "/", query=query, host=HOST)[0]["status"] == 403
    assert knock("http", "/", query=f"token={TOKEN}", host="evil.example")[0]["status"] == 403


def test_pages_may_ask_for_nothing_elsewhere_and_stand_in_no_frame() -> None:
    start = knock("http", "/", host=HOST, cookie=IN)[0]
    policy = dict(start["headers"])[b"content-security-policy"].decode()
    assert "default-src 'self'" in policy
    assert "frame-ancestors 'none'" in policy


@pytest.mark.parametrize(
    ("error", "told"),
    [(RuntimeError("No response returned."), None), (RuntimeError("no room"), "pendant: RuntimeError: no room")],
)
def test_an_error_of_the_server_is_told_in_one_line_and_a_page_closed_early_is_none(
    error: Exception, told: str | None
) -> None:
    try:
        raise error
    except RuntimeError:
        record = logging.LogRecord(
            "uvicorn.error", logging.ERROR, "", 0, "Exception in ASGI application\n", (), sys.exc_info()
        )
    assert (logging.Formatter().format(record) if tell_in_one_line(record) else None) == told


def test_two_pendants_of_one_machine_keep_a_cookie_each() -> None:
    assert cookie_name("one") != cookie_name("two")
    assert "one" not in cookie_name("one")


def test_the_address_reaches_a_browser_by_a_file_that_nobody_else_can_read() -> None:
    with entry_file("http://127.0.0.1:1/?token=secret&x=1") as page:
        assert page.parent.stat().st_mode & 0o077 == 0
        assert "url=http://127.0.0.1:1/?token=secret&amp;x=1" in page.read_text()
    assert not page.parent.exists()
