"""Who may see the page, on every route and websocket."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from softcal.plugins.watch.gate import ELSEWHERE, LARGE, REFUSED, Gate, is_loopback, new_token
from softcal.plugins.watch.packets import MOST_SESSIONS, Packets

TOKEN = new_token()
COOKIE = f"softcal-8085={TOKEN}"
PATHS = ("/", "/report", "/twin/a.glb", "/_nicegui/3/static/nicegui.js", "/_nicegui_ws/socket.io/", "/favicon.ico")


async def _inner(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"text/html")]})
    await send({"type": "http.response.body", "body": b"the page"})


def ask(
    token: str,
    path: str = "/",
    query: str = "",
    kind: str = "http",
    method: str = "GET",
    app: Any = _inner,
    **headers: str,
) -> tuple[int | str, bytes, dict[str, str]]:
    """Status (or what a websocket got), body and headers of the answer."""
    named = {"host": "127.0.0.1:8085", **headers}
    scope = {
        "type": kind, "path": path, "method": method, "query_string": query.encode(),
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in named.items()],
    }  # fmt: skip
    sent: list[Any] = []

    async def receive() -> Any:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(Gate(app, token, 8085)(scope, receive, send))
    if kind == "websocket":
        return sent[0]["type"], b"", {}
    held = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return sent[0]["status"], sent[1]["body"], held


@pytest.mark.parametrize("path", PATHS)
def test_nothing_is_shown_without_the_token(path: str):
    assert ask(TOKEN, path)[:2] == (403, REFUSED)
    assert ask(TOKEN, path, "token=")[0] == 403
    assert ask(TOKEN, path, f"token={TOKEN[:-1]}")[0] == 403
    assert ask(TOKEN, path, f"token={TOKEN}x")[0] == 403
    assert ask(TOKEN, path, "token=%ff%00")[0] == 403
    assert ask(TOKEN, path, cookie=f"softcal-8085={TOKEN[:-1]}")[0] == 403
    assert ask(TOKEN, path, cookie=f"softcal-8086={TOKEN}")[0] == 403
    assert ask(TOKEN, path, cookie='"; softcal-8085=\xe9')[0] == 403
    assert ask(TOKEN, path, f"token={TOKEN}")[:2] == (200, b"the page")
    assert ask(TOKEN, path, cookie=COOKIE)[:2] == (200, b"the page")


def test_no_websocket_without_the_token():
    assert ask(TOKEN, PATHS[4], kind="websocket")[0] == "websocket.close"
    assert ask(TOKEN, PATHS[4], kind="websocket", cookie=f"{COOKIE}x")[0] == "websocket.close"
    assert ask(TOKEN, PATHS[4], kind="websocket", cookie=COOKIE)[0] == "websocket.accept"


def test_the_address_with_the_token_sets_a_cookie_that_scripts_cannot_read():
    held = ask(TOKEN, "/", f"token={TOKEN}")[2]
    assert held["set-cookie"] == f"{COOKIE}; Path=/; HttpOnly; SameSite=Strict"
    assert "set-cookie" not in ask(TOKEN, "/", cookie=COOKIE)[2]
    assert "set-cookie" not in ask("", "/", f"token={TOKEN}")[2]


def test_a_page_of_this_machine_answers_to_its_names_alone():
    for host in ("127.0.0.1:8085", "localhost:9000", "[::1]:8085", "127.0.0.2"):
        assert ask("", host=host)[0] == 200, host
    for host in (
        "evil.example",
        "evil.example:8085",
        "127.0.0.1.evil.example",
        "10.0.0.3:8085",
        "",
        "[",
        "localhost.evil",
        "127.0.0.1/evil",
        "evil@127.0.0.1",
        "127.0.0.1?",
        "127.0.0.1:80:80",
        "127.0.0.1 ",
    ):
        assert ask("", host=host)[:2] == (403, ELSEWHERE), host
        assert ask("", host=host, kind="websocket")[0] == "websocket.close", host


def test_a_page_of_another_origin_gets_no_websocket():
    for token, cookie in (("", ""), (TOKEN, COOKIE)):
        assert (
            ask(token, PATHS[4], kind="websocket", cookie=cookie, origin="http://evil.example")[0] == "websocket.close"
        )
        assert ask(token, PATHS[4], kind="websocket", cookie=cookie, origin="null")[0] == "websocket.close"
        for origin in ("http://[", "http://", "", "127.0.0.1:8085", "http://127.0.0.1:8085/"):
            assert ask(token, cookie=cookie, origin=origin)[:2] == (403, ELSEWHERE), origin
        own = ask(token, PATHS[4], kind="websocket", cookie=cookie, origin="http://127.0.0.1:8085")
        assert own[0] == "websocket.accept"


def test_the_page_can_only_be_read():
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS"):
        assert ask("", "/", method=method)[0] == 403
    assert ask("", "/_nicegui_ws/socket.io/", method="POST")[0] == 200


def test_a_body_that_is_longer_than_the_page_s_own_is_refused():
    path = "/_nicegui_ws/socket.io/"
    for name, value in (("content-length", "1000001"), ("content-length", "-1"), ("transfer-encoding", "chunked")):
        for method in ("GET", "POST"):
            assert ask("", path, method=method, **{name: value})[:2] == (403, LARGE), (method, name, value)
    assert ask("", path, method="POST", **{"content-length": "1000000"})[0] == 200


def test_half_a_request_for_a_websocket_is_refused():
    """Engine.IO would take it for a whole one."""
    assert ask("", "/_nicegui_ws/socket.io/", upgrade="WebSocket")[0] == 403
    assert ask("", "/", upgrade="h2c")[0] == 200


def test_sessions_beyond_those_of_many_browsers_are_refused():
    pytest.importorskip("nicegui", reason="the extra `watch` is not installed")
    sessions = SimpleNamespace(sockets={})
    app = Packets(_inner, sessions)
    for kind, answers in (("http", (200, 403)), ("websocket", ("websocket.accept", "websocket.close"))):
        for count, answer in zip((MOST_SESSIONS - 1, MOST_SESSIONS), answers, strict=True):
            sessions.sockets = dict.fromkeys(map(str, range(count)))
            assert ask("", PATHS[4], kind=kind, app=app)[0] == answer
    assert ask("", PATHS[4], "sid=1", app=app)[0] == 200
    assert ask("", "/", app=app)[0] == 200


@pytest.mark.parametrize(("first", "asked"), [("http.disconnect", []), ("http.request", ["http.request", "then"])])
def test_a_browser_that_has_hung_up_is_not_answered(first: str, asked: list[str]):
    """Engine.IO's answer would be a traceback."""
    received = []
    messages = [{"type": "then"}, {"type": first}]

    async def inner(scope: Any, receive: Any, send: Any) -> None:
        received.extend([(await receive())["type"], (await receive())["type"]])

    async def receive() -> Any:
        return messages.pop()

    scope = {"type": "http", "path": PATHS[4], "method": "GET", "query_string": b"sid=1"}
    asyncio.run(Packets(inner, SimpleNamespace(sockets={}))(scope, receive, inner))  # type: ignore[arg-type]
    assert received == asked


def test_the_page_may_load_nothing_from_elsewhere():
    policy = ask("")[2]["content-security-policy"]
    assert "default-src 'none'" in policy
    sources = {word for part in policy.split(";") for word in part.split()[1:] if "frame-ancestors" not in part}
    assert sources <= {"'none'", "'self'", "'unsafe-inline'", "'unsafe-eval'", "data:", "blob:"}
    assert ask("")[2]["referrer-policy"] == "no-referrer"


def test_tokens_are_long_and_never_the_same():
    assert len(new_token()) >= 43
    assert new_token() != new_token()


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("::", False),
        ("10.1.1.1", False),
        ("lab", False),
    ],
)
def test_what_is_this_machine_alone(host: str, expected: bool):
    assert is_loopback(host) is expected
