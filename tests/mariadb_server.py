"""A MariaDB server in a folder of its own, on the loopback, for as long as a test needs it."""

from __future__ import annotations

import contextlib
import shutil
import signal
from collections.abc import Generator

import pytest
from database_folder import IN_URL, PASSWORD, database_folder

URL = f"mysql+pymysql://softcal:{IN_URL}@127.0.0.1:{{port}}/softcal"


@contextlib.contextmanager
def mariadb() -> Generator[str]:
    """A server whose user "softcal" has a password; yields the URL of its database "softcal"."""
    path = "/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin"  # a user's own path may be without sbin
    install, server = shutil.which("mariadb-install-db", path=path), shutil.which("mariadbd", path=path)
    if install is None or server is None:
        pytest.skip("MariaDB is not installed")
    with database_folder() as folder:
        data = f"--datadir={folder.path / 'data'}"
        folder.run(install, "--no-defaults", data, "--auth-root-authentication-method=normal", "--skip-test-db")
        begin = folder.write(
            "begin.sql",
            "CREATE DATABASE softcal;\n"
            f"CREATE USER softcal@'%' IDENTIFIED BY '{PASSWORD}';\n"
            "GRANT ALL ON softcal.* TO softcal@'%';\n",
        )
        places = [f"--socket={folder.path / 'socket'}", f"--pid-file={folder.path / 'pid'}", f"--init-file={begin}"]
        command = [server, "--no-defaults", data, "--bind-address=127.0.0.1", f"--port={folder.port}", *places]
        with folder.served(*command, ready="ready for connections", stop=signal.SIGTERM):
            yield URL.format(port=folder.port)
