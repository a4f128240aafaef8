"""A real browser without a window, and servers of the page in processes of their own."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# WebGL without a graphics card.
DRAWN_BY_SOFTWARE = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
PATIENCE = 120_000  # [ms]; a loaded machine needs its time


@dataclass
class Server:
    """A page's server; `address` as it printed it."""

    process: subprocess.Popen[str]
    address: str

    @property
    def port(self) -> int:
        return int(re.search(r":(\d+)/", self.address).group(1))  # type: ignore[union-attr]

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


@dataclass
class Seen:
    """A page with what its browser complained of, and what it asked for."""

    page: Any
    complaints: list[str] = field(default_factory=list[str])
    requests: list[str] = field(default_factory=list[str])

    def fact(self, name: str) -> str:
        return self.page.locator(f'[data-fact="{name}"]').inner_text()

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE / 1000
        while not condition():
            assert time.monotonic() < end, f"{what}; the page: {self.page.inner_text('body')[:2000]}"
            self.page.wait_for_timeout(100)


@pytest.fixture
def serve() -> Generator[Callable[..., Server]]:
    """Start a server of a folder's page; all end with the test."""
    running: list[Server] = []

    def start(folder: Path, *options: str, name: str = "watch") -> Server:
        command = [sys.executable, "-m", "softcal", name, str(folder), "--no-browser", *options]
        environment = {key: value for key, value in os.environ.items() if "PYTEST" not in key}
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
        )
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("Page: "), line + process.stdout.read()
        server = Server(process, line.removeprefix("Page: ").split(" ")[0])
        running.append(server)
        return server

    yield start
    for server in running:
        with contextlib.suppress(ProcessLookupError):
            server.process.send_signal(signal.SIGINT)
        try:
            server.process.wait(20)
        except subprocess.TimeoutExpired:
            server.kill()
        server.process.stdout.close()  # type: ignore[union-attr]


# Of a module, not of the session: while it is there, asyncio.run cannot be used in the tests' own process.
@pytest.fixture(scope="module")
def browser() -> Generator[Any]:
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    pytest.importorskip("nicegui", reason="the extra `watch` is not installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as running:
        found = running.chromium.launch(executable_path=CHROMIUM, args=DRAWN_BY_SOFTWARE)
        yield found
        found.close()


@pytest.fixture
def look(browser: Any) -> Generator[Callable[..., Seen]]:
    """Open an address in a browser of its own, without anything of an earlier one."""
    contexts: list[Any] = []

    def open_page(address: str, width: int = 1300, height: int = 1000) -> Seen:
        context = browser.new_context(viewport={"width": width, "height": height})
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        seen = Seen(page)
        page.on("console", lambda m: seen.complaints.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: seen.complaints.append(str(error)))
        page.on("request", lambda request: seen.requests.append(request.url))
        page.on("websocket", lambda socket: seen.requests.append(socket.url))
        page.goto(address)
        return seen

    yield open_page
    for context in contexts:
        context.close()
