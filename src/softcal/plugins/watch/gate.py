"""Who may see a page: this machine alone, or those who have the token; and what the page may load: itself alone."""

from __future__ import annotations

import ipaddress
import re
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

SOCKET, FILES = "/_nicegui_ws/", "/files/"
_HOST = re.compile(r"(\[[\w:.%]+\]|[\w.-]+)(:\d+)?")
REFUSED = b"This page needs the address with its token, as softcal watch printed it.\n"
ELSEWHERE = b"This page is for this machine alone.\n"
LARGE = b"This is more than the page asks for.\n"
_MOST_BYTES = 1_000_000  # of a message to the page
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src 'self' data:; connect-src 'self' data: blob:; worker-src 'self' blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors "
)
# A notebook on this machine shows the page in a frame.
_LOCAL_FRAMES = "'self' http://localhost:* http://127.0.0.1:*"


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(32)


def is_loopback(host: str) -> bool:
    """Whether an address or a name is this machine's own, which no other machine reaches."""
    if host.rstrip(".").casefold() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


class Gate:
    """ASGI application that lets requests and websockets through to `app`.

    token: what every one of them needs, in the address or in the cookie that the address sets; "" for a page of this
    machine alone, whose requests must name it (a page from elsewhere could have its own name point here). most_bytes:
    of a file that the page takes in, by `PUT` below `FILES`; 0 for a page that takes none.
    """

    def __init__(self, app: App, token: str, port: int, most_bytes: int = 0) -> None:
        self.app, self._token, self._cookie, self._most_bytes = app, token, f"softcal-{port}", most_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal:
            await refuse(scope, receive, send, refusal)
            return
        cookies: list[tuple[bytes, bytes]] = []
        if self._token and self._is_token(_asked(scope)):
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            cookies = [(b"set-cookie", cookie.encode())]

        async def with_headers(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                own = [(name, value) for name, value in message.get("headers", [])]
                present = {name.lower() for name, _ in own}
                policy = _POLICY + ("'none'" if self._token else _LOCAL_FRAMES)
                added = [
                    (b"content-security-policy", policy.encode()),
                    (b"referrer-policy", b"no-referrer"),
                    (b"x-content-type-options", b"nosniff"),
                ]
                message["headers"] = [*own, *(pair for pair in added if pair[0] not in present), *cookies]
            await send(message)

        await self.app(scope, receive, with_headers)

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> bytes:
        """Why a request is refused, or nothing."""
        is_file = scope["type"] == "http" and scope["method"] == "PUT" and scope["path"].startswith(FILES)
        if scope["type"] == "http" and scope["method"] not in ("GET", "HEAD"):
            is_packet = scope["method"] == "POST" and scope["path"].startswith(SOCKET)
            if not is_packet and not (is_file and self._most_bytes):
                return b"This page can only be read.\n"
        length, most = headers.get("content-length", "0"), self._most_bytes if is_file else _MOST_BYTES
        if "transfer-encoding" in headers or not (length.isascii() and length.isdigit() and int(length[:20]) <= most):
            return LARGE
        if scope["type"] == "http" and headers.get("upgrade", "").casefold() == "websocket":
            return b"This is no whole request for a websocket.\n"
        host = headers.get("host", "")
        origin = headers.get("origin")
        if origin is not None and origin.partition("://")[2] != host:
            return ELSEWHERE
        if not self._token:
            parts = _HOST.fullmatch(host)
            return b"" if is_loopback("" if parts is None else parts[1]) else ELSEWHERE
        try:
            kept = SimpleCookie(headers.get("cookie", "")).get(self._cookie)
        except CookieError:
            kept = None
        return b"" if self._is_token(_asked(scope)) or self._is_token("" if kept is None else kept.value) else REFUSED

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode("utf-8", "replace"), self._token.encode())


def _asked(scope: Scope) -> str:
    """The token in an address, or ""."""
    return parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]


async def refuse(scope: Scope, receive: Receive, send: Send, why: bytes) -> None:
    """Answer with a sentence, or close the websocket."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"cache-control", b"no-store")]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": why})
