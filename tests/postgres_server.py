"""A PostgreSQL server in a folder of its own, on the loopback, for as long as a test needs it."""

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
from pathlib import Path
from typing import Any

import pytest

PASSWORD = "s3cret%{word"
URL = "postgresql+pg8000://softcal:s3cret%25%7Bword@127.0.0.1:{port}/postgres"


def binaries() -> Path:
    """The folder with initdb and postgres; skips the test where there is none."""
    found = shutil.which("initdb")
    folders = [Path(found).parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    for folder in reversed(folders):
        if (folder / "initdb").is_file():
            return folder
    pytest.skip("PostgreSQL is not installed")


def unprivileged() -> dict[str, int]:
    """Options of subprocess by which it does not run as root, which initdb refuses."""
    if os.geteuid() != 0:
        return {}
    user = pwd.getpwnam("nobody")
    return {"user": user.pw_uid, "group": user.pw_gid}


@contextlib.contextmanager
def postgres() -> Generator[str]:
    """A server whose user "softcal" has a password; yields the URL of its database "postgres"."""
    programs, who = binaries(), unprivileged()
    folder = Path(tempfile.mkdtemp(prefix="softcal-postgres-"))  # pytest's own folders are closed to other users
    log = folder / "log"
    (folder / "password").write_text(PASSWORD)
    log.touch()
    if who:
        for path in (folder, folder / "password", log):
            os.chown(path, who["user"], who["group"])
    with log.open("ab") as told, socket.socket() as free:
        options: dict[str, Any] = {"stdout": told, "stderr": told, "cwd": folder, **who}
        initdb = [programs / "initdb", "-D", folder / "data", "-U", "softcal", "-A", "scram-sha-256", "--no-sync"]
        made = subprocess.run([*initdb, "--pwfile", folder / "password"], check=False, **options)
        assert made.returncode == 0, log.read_text()
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        free.close()
        places = ["-c", "listen_addresses=127.0.0.1", "-c", "unix_socket_directories="]
        server = subprocess.Popen([programs / "postgres", "-D", folder / "data", "-p", str(port), *places], **options)
        try:
            while "ready to accept connections" not in log.read_text():
                assert server.poll() is None, log.read_text()
                time.sleep(0.05)
            yield URL.format(port=port)
        finally:
            server.send_signal(signal.SIGINT)  # ends those that are still connected
            server.wait(timeout=30)
            shutil.rmtree(folder, ignore_errors=True)
