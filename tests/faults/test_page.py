"""The page of `softcal watch`: whatever the requests and the folders, it answers or refuses, in 300 MB."""

from __future__ import annotations

import contextlib
import json
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, replace
from html import unescape
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
import pytest
from faults.case import Case, End, assert_proper, parts
from faults.hostile import HOSTILE, attacked
from watch_case import RESULT, add_trials, live_record, write_fleet, write_json, write_run

from softcal.plugins.watch.server import MOST_PAGES

pytest.importorskip("nicegui", reason="the extra `watch` is not installed")
MOST = 300_000_000  # bytes of the page's process
PATIENCE = 15.0  # [s] for an answer
JOINT = "calibrations/joint"


def run_folder(folder: Path) -> None:
    """A run with trials, a result, and a report."""
    write_run(folder)
    add_trials(folder / JOINT, [3.0, None, 2.0])
    write_json(folder / JOINT / "live.json", live_record(1, "elsewhere"))
    write_json(folder / JOINT / "result.json", RESULT)
    (folder / "report.html").write_text("<!doctype html><title>report</title>")
    (folder / "score.json").write_text("{}")


@dataclass(frozen=True)
class Page:
    """A page that is served."""

    address: str
    process: int

    @property
    def place(self) -> tuple[str, int]:
        read = urlsplit(self.address)
        return "127.0.0.1", read.port or 0

    @property
    def token(self) -> str:
        return self.address.partition("token=")[2]

    @property
    def largest(self) -> int:
        """The most memory that it has had [B]."""
        status = Path(f"/proc/{self.process}/status").read_text()
        return 1024 * int(re.search(r"VmHWM:\s+(\d+)", status)[1])  # type: ignore[index]


def served(folder: Path, *options: str) -> Generator[Page]:
    command = [sys.executable, "-m", "softcal", "watch", str(folder), "--no-browser", "--port", "0", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield Page(process.stdout.readline().split()[1], process.pid)
            process.send_signal(signal.SIGINT)
            said = process.communicate(timeout=60)[1]
        finally:
            process.kill()
    assert "Traceback" not in said, said[-3000:]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Generator[Page]:
    folder = tmp_path_factory.mktemp("page") / "run"
    run_folder(folder)
    (folder.parent / "secret.txt").write_text("hunter2")
    (folder / "figures").mkdir()
    (folder / "figures" / "outside.png").symlink_to(folder.parent / "secret.txt")
    yield from served(folder)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Generator[Page]:
    """A page that other machines could reach."""
    folder = tmp_path_factory.mktemp("guarded") / "run"
    run_folder(folder)
    yield from served(folder, "--host", "0.0.0.0")


def request(path: str = "/", method: str = "GET", host: str = "127.0.0.1", body: bytes = b"", **headers: str) -> bytes:
    """A request as it is sent; a name of a header has _ for -."""
    lines = [f"{method} {path} HTTP/1.1", f"Host: {host}", "Connection: close"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + body


def answer(page: Page, sent: bytes, repeated: bytes, times: int) -> bytes:
    """What is answered to a request, and to bytes sent so many times after it; b"" where it only hangs up."""
    got = b""
    with socket.create_connection(page.place, timeout=PATIENCE) as peer:
        try:
            peer.sendall(sent.replace(b"TOKEN", page.token.encode()))
            for _ in range(times):
                peer.sendall(repeated)
        except (BrokenPipeError, ConnectionResetError, TimeoutError):
            pass  # it does not take in what it does not want
        try:
            while len(got) < 100_000 and (more := peer.recv(65536)):
                got += more
        except ConnectionResetError:
            pass
    return got


def asked(page: Page, sent: bytes, repeated: bytes = b"", times: int = 0) -> Callable[[], object]:
    """Sends a request; ends as its answer says."""

    def run() -> None:
        got = answer(page, sent, repeated, times)
        sys.stdout.write(got[:300].decode("latin-1"))
        status = re.match(rb"HTTP/1.1 (\d)", got)
        if b"hunter2" in got:
            raise AssertionError("it gave what is outside of the folder")
        raise SystemExit({b"1": 0, b"2": 0, b"3": 0, b"4": 2}.get(status[1], 70) if status else 2)

    return run


SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
UPGRADE = {"Upgrade": "websocket", "Sec_WebSocket_Version": "13", "Sec_WebSocket_Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
WEBSOCKET = SOCKET.replace("polling", "websocket")
LARGE = b"x" * (1 << 20)
ANSWERED, REFUSED, EITHER = ("solved",), ("refused",), ("solved", "refused")
# What is sent, and sent after it so many times.
REQUESTS: Mapping[str, tuple[bytes, tuple[End, ...], bytes, int]] = {
    name: (*entry, b"", 0) if len(entry) == 2 else entry  # type: ignore[misc]
    for name, entry in {
        "the page": (request(), ANSWERED),
        "the report": (request("/report"), ANSWERED),
        "a figure outside": (request("/figures/outside.png"), REFUSED),
        **{
            f"a way out by {path}": (request(path), REFUSED)
            for path in (
                "/../secret.txt", "/%2e%2e/secret.txt", "/figures/../../secret.txt", "/figures/..%2f..%2fsecret.txt",
                "/figures/..%5c..%5csecret.txt", "/figures/%2fetc%2fpasswd", "/figures//etc/passwd", "/figures/%00",
                "/figures/..", "/figures/.", "/figures/%ff%fe", "/figures/" + "a" * 5000, "/figures/a%0d%0ab",
                "/twin/../x.glb",
                "/twin/%00.glb", "/fit/%2e%2e.png", "/_nicegui/../../secret.txt",
                "/_nicegui/3.18.0/static/../../../secret.txt",
                "/_nicegui/3.18.0/static/%2e%2e/%2e%2e/nicegui.py", "/_nicegui/3.18.0/components/x/../../nicegui.py",
                "/_nicegui/3.18.0/resources/x/..%2f..%2fx", "/_nicegui/client/x", "/docs", "/openapi.json", "/redoc",
                "/run.json", "/report/", "/report.html", "/.git/config", "/favicon.ico/../../x", "//evil.example/",
            )
        },
        **{
            f"the method {method}": (request(method=method), REFUSED)
            for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "PROPFIND", "get", "X" * 99)
        },
        **{
            f"the host {host[:30]!r}": (request(host=host), REFUSED)
            for host in (
                "evil.example", "", "127.0.0.1.evil.example", "127.0.0.1@evil.example", "[::1", "[", "\xff\xfe",
                "a" * 5000,
                "127.0.0.1:port", "0", "127.0.0.1, evil.example", "127.0.0.1/../", "localhost:80:80",
            )
        },
        **{
            f"the origin {origin[:30]!r}": (request(Origin=origin), REFUSED)
            for origin in (
                "http://evil.example", "null", "", "[", "file://", "http://127.0.0.1.evil.example", "\xff", "a" * 5000,
            )
        },
        "no host": (b"GET / HTTP/1.1\r\nConnection: close\r\n\r\n", REFUSED),
        "two hosts": (request(host="127.0.0.1\r\nHost: evil.example"), REFUSED),
        "two hosts, turned": (request(host="evil.example\r\nHost: 127.0.0.1"), REFUSED),
        "a whole address": (request("http://evil.example/"), EITHER),
        "an old version": (b"GET / HTTP/1.0\r\n\r\n", REFUSED),
        "a version that is none": (b"GET / HTTP/9.9\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", EITHER),
        "no version": (b"GET /\r\n\r\n", REFUSED),
        "noise": (np.random.default_rng(1).bytes(5000) + b"\r\n\r\n", REFUSED),
        "TLS": (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(600) + b"\r\n\r\n", REFUSED),
        "NUL": (bytes(5000) + b"\r\n\r\n", REFUSED),
        "a header of NUL": (request(X="a\0b"), REFUSED),
        "a header that is split": (request(X="a\r\n b"), EITHER),
        "a header without a colon": (request(host="127.0.0.1\r\nbroken"), REFUSED),
        "a thousand headers": (request(**{f"X{k}": "a" for k in range(1000)}), EITHER),
        "a long address": (request("/" + "a" * 60_000), REFUSED),
        "a long query": (request("/?" + "a=b&" * 15_000), EITHER),
        "a query of codes": (request("/?token=%ff%00%zz"), EITHER),
        "a cookie that is none": (request(Cookie='"; =\xe9'), EITHER),
        "a cookie of another path": (request(Cookie="softcal-1=a; Path=/; x=\x01"), EITHER),
        "ranges": (request("/report", Range="bytes=0-0," * 5000), EITHER),
        "a language of noise": (request(Accept_Language="\xff" * 5000), EITHER),
        "a header without end": (b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ", REFUSED, LARGE, 400),
        "headers without end": (b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", REFUSED, b"X: y\r\n" * 10_000, 2000),
        "a body of a page": (request(body=LARGE, Content_Length=str(len(LARGE))), EITHER),
        "a body of half a gigabyte": (request(Content_Length=str(500 << 20)), EITHER, LARGE, 500),
        "a length below zero": (request(Content_Length="-1"), REFUSED),
        "a length of letters": (request(Content_Length="many"), REFUSED),
        "two lengths": (request(Content_Length="1\r\nContent-Length: 2", body=b"ab"), REFUSED),
        "a length and pieces": (request(Content_Length="1", Transfer_Encoding="chunked", body=b"0\r\n\r\n"), EITHER),
        "pieces that are none": (request(SOCKET, "POST", Transfer_Encoding="chunked", body=b"zz\r\n\r\n"), REFUSED),
        "a socket": (request(SOCKET), ANSWERED),
        "a socket of another session": (request(SOCKET + "&sid=nobody"), REFUSED),
        "a socket of another version": (request(SOCKET.replace("EIO=4", "EIO=9")), REFUSED),
        "a socket of another kind": (request(SOCKET.replace("polling", "pigeon")), REFUSED),
        "a socket of nothing": (request("/_nicegui_ws/socket.io/"), REFUSED),
        "a message to nobody": (request(SOCKET + "&sid=nobody", "POST", body=b"40", Content_Length="2"), REFUSED),
        "a message of half a gigabyte": (
            request(SOCKET + "&sid=a", "POST", Content_Length=str(500 << 20)), REFUSED, LARGE, 500,
        ),
        "a message of half a gigabyte in pieces": (
            request(SOCKET + "&sid=a", "POST", Transfer_Encoding="chunked"),
            REFUSED,
            b"100000\r\n" + LARGE + b"\r\n",
            500,
        ),
        "a websocket of evil": (request(WEBSOCKET, Origin="http://evil.example", **UPGRADE), REFUSED),
        "a websocket without a key": (request(WEBSOCKET, Upgrade="websocket"), EITHER),
        "a websocket of nothing": (request("/", **UPGRADE), REFUSED),
    }.items()
}  # fmt: skip
TOKENS: Mapping[str, tuple[bytes, tuple[End, ...]]] = {
    "no token": (request(), REFUSED),
    "its token": (request("/?token=TOKEN"), ANSWERED),
    "its token twice": (request("/?token=x&token=TOKEN"), REFUSED),
    "its token and more": (request("/?token=TOKENx"), REFUSED),
    "its token in other letters": (request("/?token=%54OKEN"), REFUSED),
    "its token with blanks": (request("/?token=%20TOKEN"), REFUSED),
    "its token as a part of the path": (request("/token=TOKEN"), REFUSED),
    "its token as a header": (request(Authorization="Bearer TOKEN"), REFUSED),
    "its token as a cookie of another name": (request(Cookie="softcal=TOKEN"), REFUSED),
    "its token from another origin": (request("/?token=TOKEN", Origin="http://evil.example"), REFUSED),
    "its token to be changed": (request("/?token=TOKEN", "DELETE"), REFUSED),
    "a token of NUL": (request("/?token=%00"), REFUSED),
    "a token of another script": (request("/?token=%D9%A2%F0%9F%98%80"), REFUSED),
    "a long token": (request("/?token=" + "a" * 50_000), REFUSED),
    "a report without a token": (request("/report"), REFUSED),
    "a socket without a token": (request(SOCKET), REFUSED),
    "a websocket without a token": (request(WEBSOCKET, **UPGRADE), REFUSED),
    "a file of the page without a token": (request("/_nicegui/3.18.0/static/nicegui.js"), REFUSED),
}
REQUEST_CASES = [
    *(Case("page", name, (), ends) for name, (_, ends, *_) in REQUESTS.items()),
    *(Case("page with a token", name, (), ends) for name, (_, ends) in TOKENS.items()),
]


@pytest.mark.parametrize("case", parts(REQUEST_CASES))
def test_a_hostile_request(case: Case, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    with_token = case.door.endswith("token")
    page: Page = request.getfixturevalue("guarded" if with_token else "page")
    sent, _, *more = (TOKENS if with_token else REQUESTS)[case.name]
    assert_proper(replace(case, run=asked(page, sent, *more)), tmp_path)
    assert page.largest < MOST, f"the page has taken {page.largest / 1e6:.0f} MB"
    assert b"200 OK" in answer(page, globals()["request"]("/?token=TOKEN"), b"", 0), "the page does not answer any more"


# Folders of strangers
def fleet(folder: Path) -> None:
    write_fleet(folder, a="DONE", b="FAILED", c="WORK", d=None)


PLACES: Mapping[str, tuple[Callable[[Path], None], str]] = {
    **{
        f"{name.rpartition('/')[2]} of a {'search' if '/' in name else 'run'}": (run_folder, name)
        for name in (
            "run.json", "report.html", f"{JOINT}/run.json", f"{JOINT}/live.json", f"{JOINT}/result.json",
            f"{JOINT}/optuna.journal",
        )
    },
    "record of a fleet": (fleet, "fleet.json"),
    "record of a specimen": (fleet, "specimens/a.json"),
    "journal of a specimen": (fleet, "specimens/c/calibrations/joint/optuna.journal"),
}  # fmt: skip


def looked_at() -> None:
    """Reads the present folder as the page does, with the trials of each search, and its report."""
    from softcal.plugins.watch.reading import Unreadable, read_file
    from softcal.plugins.watch.run_reader import RunReader

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    reader = RunReader(Path())
    for _ in range(2):
        run = reader.read()
        for search in run.searches:
            reader.whole(search)
    try:
        read_file(Path(), "report.html")
    except Unreadable as error:
        sys.stdout.write(f"{error}\n")
    sys.stdout.write("\n".join(run.unreadable))
    if (grown := 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)) > MOST // 2:
        raise AssertionError(f"it took {grown / 1e6:.0f} MB")


FOLDER_CASES = [
    Case("folder of a page", f"{what} as {place}", looked_at, ANSWERED, attacked(files, name, put))
    for place, (files, name) in PLACES.items()
    for what, put in HOSTILE.items()
]


@pytest.mark.parametrize("case", parts(FOLDER_CASES))
def test_a_folder_of_a_stranger(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)


def connected(page: Page, said: Callable[[object], None] = lambda _: None) -> Any:
    """A browser, which is made up, that has the page open."""
    socketio = pytest.importorskip("socketio")
    client = about(page)[0]
    query = {
        "client_id": client,
        "tab_id": client,
        "document_id": "a",
        "next_message_id": 0,
        "implicit_handshake": "true",
    }
    browser = socketio.Client()
    browser.on("update", said)
    browser.connect(
        f"{page.address}?{urlencode(query)}", socketio_path="/_nicegui_ws/socket.io", transports=["polling"]
    )
    return browser


def shown(page: Page, awaited: str) -> str:
    """All that a browser is sent until it has a text, or for a minute."""
    said = list[str]()
    browser = connected(page, lambda data: said.append(str(data)))
    until = time.monotonic() + 60.0
    while awaited not in "".join(said) and time.monotonic() < until:
        time.sleep(0.2)
    browser.disconnect()
    return "".join(said)


@pytest.mark.slow
def test_a_folder_of_all_that_is_hostile_is_shown(tmp_path: Path) -> None:
    """By one page, which says of which files it cannot read."""
    for place, (files, name) in PLACES.items():
        for what in ("five gigabytes", "many braces", "a link to an endless device", "a pipe", "an archive"):
            attacked(files, name, HOSTILE[what])(tmp_path / "runs" / f"{what} as {place}")
    pages = contextlib.contextmanager(served)
    with pages(tmp_path / "runs") as page:
        said = shown(page, "run.json cannot be read")
        for name in ("fleet.json", "specimens/a.json", "run.json"):
            assert f"{name} cannot be read" in said, said[-3000:]
        assert page.largest < MOST


# Sessions of strangers
PACKETS = (
    "4", "9", "b", "bx", "b" * 100, "٤2[]", "0", "6", "44", '44{"a"', "43[1]", '4["event",{}]', '4"2[]"', "42", "42[]",
    '42{"a":1}', "42[5]", "42[[]]", '42["event"]', '42["event",5]', '42["event",{}', '42["event",{}]x',
    '42["event",{"a":NaN}]', '42["event",' + "[" * 5000, '42["event",' + "[" * 5000 + "]" * 5000 + "]",
    '42["connect",{"QUERY_STRING":"implicit_handshake=true"}]', '42["disconnect"]', '42["nobody",{}]', "41x", "3x",
    '42/other,["event",{}]', "42" + "9" * 5000 + '["event",{}]', "40/other,", "40[", "40[5]", "4" + "9" * 30 + '["a"]',
    '451-["x",{"_placeholder":true,"num":0}]', '4519999999999-["x"]',
    '42["handshake",{"client_id":"a","tab_id":[],"document_id":{},"next_message_id":0}]',
    '42["handshake",{"client_id":"a","tab_id":"a","document_id":"a","next_message_id":"a"}]',
)  # fmt: skip
BY_POLLING = ("1", "2probe", "5", "\udcff", "d=", "d=9", "3\x1e9", "\x1e".join("3" * 17), "3\x1e")


def opened(page: Page, place: str = SOCKET) -> str:
    """The place of a new session by polling, connected."""
    session = re.search(rb'"sid":"([^"]+)"', answer(page, request(place), b"", 0))
    assert session is not None
    place = f"{SOCKET}&sid={session[1].decode()}"
    assert posted(page, place, "40") == 200
    return place


def posted(page: Page, place: str, packets: str) -> int:
    """The status of the answer to packets."""
    body = packets.encode(errors="surrogateescape")
    return int(answer(page, request(place, "POST", body=body, Content_Length=str(len(body))), b"", 0).split()[1])


@pytest.mark.slow
def test_a_packet_that_is_none_of_the_page_s_ends_its_session(tmp_path: Path) -> None:
    client = pytest.importorskip("websockets.sync.client")
    closed = pytest.importorskip("websockets.exceptions").ConnectionClosed
    run_folder(tmp_path / "run")
    with contextlib.contextmanager(served)(tmp_path / "run") as page:
        for packet in (*PACKETS, *BY_POLLING):
            place = opened(page)
            assert (posted(page, place, packet), posted(page, place, "3")) == (403, 403), packet[:60]
        for packet in (*PACKETS, b"event"):
            with client.connect(f"ws://127.0.0.1:{page.place[1]}{WEBSOCKET}") as peer:
                peer.recv()
                peer.send("40")
                peer.recv()
                peer.send(packet)
                with pytest.raises(closed):
                    peer.recv(timeout=3.0)  # before the first ping
        place = opened(page)
        assert posted(page, place, '3\x1e420["event",{"client_id":"a","id":1}]\x1e42["ack",{}]') == 200
        assert posted(page, place, "3") == 200


def about(page: Page) -> tuple[str, dict[str, Any]]:
    """A new page's name, and its elements."""
    text = unescape(answer(page, request(), b"", 0).decode())
    client = re.search(r"'client_id': '([\w-]+)'", text)
    assert client is not None, text[-3000:]
    return client[1], json.JSONDecoder().raw_decode(text, text.index('{"0"'))[0]


def test_a_handshake_that_is_none_is_refused(page: Page) -> None:
    query = {"implicit_handshake": "true", "client_id": about(page)[0], "tab_id": "a", "document_id": "a"}
    for number, status in (("a", b" 403 "), ("9" * 5000, b" 403 "), ("1", b" 200 ")):
        place = f"{SOCKET}&{urlencode(query)}&next_message_id={number}"
        assert status in answer(page, request(place), b"", 0)[:20], number[:9]


@pytest.mark.slow
def test_events_that_say_what_the_page_does_not_ask(tmp_path: Path) -> None:
    run_folder(tmp_path / "run")
    with contextlib.contextmanager(served)(tmp_path / "run") as page:
        client, elements = about(page)
        query = {"implicit_handshake": "true", "client_id": client, "tab_id": "a", "document_id": "a"}
        place = opened(page, f"{SOCKET}&{urlencode(query)}")
        messages = [["log", {"client_id": client, "level": "error", "message": "Traceback"}]] + [
            ["event", {"client_id": client, "id": int(name), "listener_id": event["listener_id"], "args": args}]
            for name, element in elements.items()
            for event in element.get("events", ())
            for args in ([], ["null"], ['{"a":1}'], ["x"], [1], 5, ["null", "null"], ['"a"', '"b"'])
        ]
        assert len(messages) > 100
        for first in range(0, len(messages), 16):
            sent = "\x1e".join("42" + json.dumps(message) for message in messages[first : first + 16])
            assert posted(page, place, sent) == 200


@pytest.mark.long
def test_pages_that_no_browser_connects(tmp_path: Path) -> None:
    run_folder(tmp_path / "run")
    with contextlib.contextmanager(served)(tmp_path / "run") as page:
        for _ in range(600):
            answer(page, request(), b"", 0)
        assert b"text/plain" in answer(page, request("/nothing"), b"", 0)
        assert page.largest < MOST // 2, f"the page has taken {page.largest / 1e6:.0f} MB"


@pytest.mark.long
def test_pages_beyond_those_that_browsers_may_have_open(tmp_path: Path) -> None:
    """They are refused with a sentence, until one of the others is closed."""
    run_folder(tmp_path / "run")
    with contextlib.contextmanager(served)(tmp_path / "run") as page:
        browsers = [connected(page) for _ in range(MOST_PAGES)]
        assert b" 503 " in (said := answer(page, request(), b"", 0))[:20]
        assert b"other browsers" in said
        assert page.largest < MOST
        browsers[0].disconnect()
        until = time.monotonic() + 20.0
        while b" 503 " in answer(page, request(), b"", 0)[:20] and time.monotonic() < until:
            time.sleep(0.5)
        assert b" 200 " in answer(page, request(), b"", 0)[:20]
        for browser in browsers[1:]:
            browser.disconnect()
