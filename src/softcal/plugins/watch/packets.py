"""Filter of a session's input: only packets of Engine.IO and Socket.IO that the page sends are accepted."""

from __future__ import annotations

import re
from collections.abc import Mapping, MutableMapping
from typing import Any
from urllib.parse import parse_qs

from softcal.plugins.watch.gate import SOCKET, App, Receive, Scope, Send, refuse

FOREIGN = b"This is no message of the page.\n"
MANY = b"Too many browsers have this page open.\n"
_PACKET = re.compile(r"3|40|41|40(\{.*)|42[0-9]{0,9}(\[.*)", re.DOTALL)  # a packet that closes ends its session, too
_UPGRADE = ("2probe", "5")  # by a websocket alone
_EVENTS = ("handshake", "event", "ack", "javascript_response", "log")
_NUMBER = re.compile(r"[0-9]{1,15}")
MOST_SESSIONS = 1000  # at once, of some 30 kB each
_MOST = 16  # packets of one request, as Engine.IO allows


class Packets:
    """ASGI application that lets the page's packets through to `app`, and ends the session that sends any other.

    sessions: the server of Engine.IO, whose answers to others are tracebacks, or none.
    """

    def __init__(self, app: App, sessions: Any) -> None:
        self.app, self._sessions = app, sessions

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if not scope.get("path", "").startswith(SOCKET):
            await self.app(scope, receive, send)
            return
        query = {name: values[0] for name, values in parse_qs(scope["query_string"].decode("latin-1")).items()}
        if not _is_handshake(query):
            await refuse(scope, receive, send, FOREIGN)
        elif "sid" not in query and len(self._sessions.sockets) >= MOST_SESSIONS:
            await refuse(scope, receive, send, MANY)
        elif scope["type"] == "websocket":

            async def packet() -> MutableMapping[str, Any]:
                """A message of the websocket, which disconnects at any packet that the page does not send."""
                message = await receive()
                text = message.get("text") or ""
                if message["type"] != "websocket.receive" or text in _UPGRADE or _is_packet(text):
                    return message
                return {"type": "websocket.disconnect", "code": 1008}

            await self.app(scope, packet, send)
        elif scope["method"] == "POST":
            await self._take(query.get("sid", ""), scope, receive, send)
        elif (first := await receive())["type"] != "http.disconnect":  # Engine.IO answers those that have hung up too
            messages = [first]

            async def message() -> MutableMapping[str, Any]:
                return messages.pop() if messages else await receive()

            await self.app(scope, message, send)

    async def _take(self, name: str, scope: Scope, receive: Receive, send: Send) -> None:
        """Take in the packets of a request, or end its session."""
        body, more = b"", True
        while more:
            message = await receive()
            body += message.get("body", b"")
            more = message.get("more_body", False)
        session = self._sessions.sockets.get(name)
        packets = body.decode("utf-8", "replace").split("\x1e")
        if session and not session.closed and len(packets) <= _MOST and all(map(_is_packet, packets)):

            async def again() -> MutableMapping[str, Any]:
                return {"type": "http.request", "body": body}

            await self.app(scope, again, send)
            return
        if session:
            await session.close(wait=False)
            self._sessions.sockets.pop(name, None)
        await refuse(scope, receive, send, FOREIGN)


def _is_packet(text: str) -> bool:
    """Whether a packet is a pong, or a message that connects, disconnects or is an event of the page."""
    from nicegui import json

    packet = _PACKET.fullmatch(text)
    data = packet and (packet[1] or packet[2])
    if not data:
        return packet is not None
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return False
    if isinstance(content, dict):
        return True
    name, entries = content if len(content) == 2 else ("", None)
    return name in _EVENTS and isinstance(entries, dict) and (name != "handshake" or _is_handshake(entries))


def _is_handshake(entries: Mapping[str, Any]) -> bool:
    """Whether the entries of a handshake are such that NiceGUI does not break off in the middle of it."""
    plain = all(isinstance(entry, str | int | None) for entry in entries.values())
    return plain and _NUMBER.fullmatch(str(entries.get("next_message_id", 0))) is not None
