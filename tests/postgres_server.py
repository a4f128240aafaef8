"""A PostgreSQL server in a folder of its own, on the loopback, for as long as a test needs it."""

from __future__ import annotations

import contextlib
import shutil
import signal
from collections.abc import Generator
from pathlib import Path

import pytest
from database_folder import IN_URL, PASSWORD, DatabaseFolder, database_folder

URL = f"postgresql+pg8000://softcal:{IN_URL}@127.0.0.1:{{port}}/postgres"


def _programs() -> Path:
    """The folder with initdb and postgres; skips the test where there is none."""
    found = shutil.which("initdb")
    folders = [Path(found).parent] if found else sorted(Path("/usr/lib/postgresql").glob("*/bin"))
    for folder in reversed(folders):
        if (folder / "initdb").is_file():
            return folder
    pytest.skip("PostgreSQL is not installed")


@contextlib.contextmanager
def postgres() -> Generator[str]:
    """A server whose user "softcal" has a password; yields the URL of its database "postgres"."""
    with postgres_folder() as folder, postgres_served(folder) as url:
        yield url


@contextlib.contextmanager
def postgres_folder() -> Generator[DatabaseFolder]:
    """The data of a server that does not run yet."""
    programs = _programs()
    with database_folder() as folder:
        password = folder.write("password", PASSWORD)
        initdb = [programs / "initdb", "-D", folder.path / "data", "-U", "softcal", "-A", "scram-sha-256", "--no-sync"]
        folder.run(*initdb, "--pwfile", password)
        yield folder


@contextlib.contextmanager
def postgres_served(folder: DatabaseFolder) -> Generator[str]:
    """Run the server of a folder; yields the URL of its database."""
    places = ["-c", "listen_addresses=127.0.0.1", "-c", "unix_socket_directories="]
    command = [_programs() / "postgres", "-D", folder.path / "data", "-p", str(folder.port), *places]
    with folder.served(*command, ready="ready to accept connections", stop=signal.SIGINT):
        yield URL.format(port=folder.port)
