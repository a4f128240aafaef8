"""A folder of its own for a database server that a test starts, on the loopback, as a user without rights."""

from __future__ import annotations

import contextlib
import os
import pwd
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

PASSWORD = "s3cret%{word"
IN_URL = "s3cret%25%7Bword"


@dataclass(frozen=True)
class DatabaseFolder:
    """Where a server has its data and its log.

    Attributes
    ----------
    path
        The folder.
    port
        A port of the loopback that is free.
    """

    path: Path
    port: int

    @property
    def log(self) -> Path:
        """What the server says."""
        return self.path / "log"

    def write(self, name: str, text: str) -> Path:
        """A file that the server can read."""
        path = self.path / name
        path.write_text(text)
        _give(path)
        return path

    def run(self, *command: str | Path) -> None:
        """Run a program to its end, as the server's user."""
        with self.log.open("ab") as told:
            made = subprocess.run(command, check=False, stdout=told, stderr=told, cwd=self.path, **_unprivileged())
        assert made.returncode == 0, self.log.read_text()

    @contextlib.contextmanager
    def served(self, *command: str | Path, ready: str, stop: signal.Signals) -> Generator[subprocess.Popen[bytes]]:
        """Run a server from when it says that it is ready. stop: the signal that ends it and its connections."""
        said = len(self.log.read_text())
        with self.log.open("ab") as told:
            server = subprocess.Popen(command, stdout=told, stderr=told, cwd=self.path, **_unprivileged())
        try:
            while ready not in self.log.read_text()[said:]:
                assert server.poll() is None, self.log.read_text()
                time.sleep(0.05)
            yield server
        finally:
            server.send_signal(stop)
            server.wait(timeout=60)


@contextlib.contextmanager
def database_folder() -> Generator[DatabaseFolder]:
    """A folder that is removed at the end."""
    path = Path(tempfile.mkdtemp(prefix="softcal-database-"))  # pytest's own folders are closed to other users
    _give(path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    folder = DatabaseFolder(path, port)
    folder.write("log", "")
    try:
        yield folder
    finally:
        shutil.rmtree(path, ignore_errors=True)


def _unprivileged() -> dict[str, int]:
    """Options of subprocess by which a server does not run as root, which it refuses."""
    if os.geteuid() != 0:
        return {}
    user = pwd.getpwnam("nobody")
    return {"user": user.pw_uid, "group": user.pw_gid}


def _give(path: Path) -> None:
    if who := _unprivileged():
        os.chown(path, who["user"], who["group"])
