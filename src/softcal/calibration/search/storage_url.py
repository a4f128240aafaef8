"""Storage of a shared study: the URL of a journal file or a database, opened by Optuna, or refused in a sentence.

A password is never shown, whatever is wrong with it or the URL.
"""

from __future__ import annotations

import contextlib
import importlib.util
import re
import threading
import time
import traceback
from collections.abc import Generator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.bounded_work import memory_limit
from softcal.calibration.results.trial_journal import BROKEN
from softcal.calibration.search.shared_journal import ANOTHER, NO_JOURNAL, is_new_journal, open_journal
from softcal.errors import Fault, SoftcalError, StorageError
from softcal.regular_file import NOTHING, not_a_file

if TYPE_CHECKING:
    import optuna

_JOURNAL = "journal"
_MEMORY = 2.5e8  # [B] beyond what there is before it is connected
_LONGEST, _TABLES = 10.0, 60.0  # [s] that a server may take to answer, and after that, to make or read its tables
_TRIES, _PAUSE = 5, 0.2  # of tables that another process is making; [s] between two
# Database -> its drivers in Python -> the module, and what pip installs.
_DRIVERS: dict[str, dict[str, tuple[str, str]]] = {
    "postgresql": {
        "psycopg2": ("psycopg2", "psycopg2-binary"),
        "psycopg": ("psycopg", "psycopg[binary]"),
        "pg8000": ("pg8000", "pg8000"),
    },
    "mysql": {
        "mysqldb": ("MySQLdb", "mysqlclient"),
        "pymysql": ("pymysql", "pymysql[rsa]"),  # with what the passwords of MySQL 8 need
        "mysqlconnector": ("mysql", "mysql-connector-python"),
    },
}
_WITHOUT = {"postgresql": "pg8000", "mysql": "pymysql"}  # those in pure Python, advised where there is none
_SHORT = 4  # characters of a password below which it may be a part of other words
_SECRET = ("password", "passwd")  # options of a URL
# Those that a URL may have: others of the drivers read files, send files to the server, or run statements.
_OPTIONS = {
    *("user", *_SECRET, "host", "port", "unix_socket", "charset", "application_name"),
    *("connect_timeout", "connection_timeout", "sslmode", "sslrootcert", "sslcert", "sslkey", "ssl", "ssl_ca"),
    *("ssl_cert", "ssl_key", "ssl_check_hostname", "ssl_verify_cert", "ssl_verify_identity", "ssl_disabled"),
}
_ALLOWED = (
    "journal:FILE, postgresql://USER:PASSWORD@HOST/DATABASE, mysql://USER:PASSWORD@HOST/DATABASE, each database also "
    "with a driver, as in postgresql+pg8000://…"
)


# Who asks, as SQLAlchemy reads it: a password ends at the first @ behind it, whatever is in it.
_UP_TO_HOST = re.compile(r"//([^:/]*(:[^@]*)?@)?")
_CERTAIN = re.compile(r"//(?P<user>[^@/?]*@)?(?P<place>([\w.-]*|\[[0-9a-fA-F:]*\])(:\d+)?(/[\w.-]*)?)(\?[^@]*)?")


class UnansweredError(StorageError):
    """A database that did not answer a request, such as during a restart; a later request may succeed."""


@dataclass(frozen=True)
class StorageUrl:
    """The place of a shared study.

    Attributes
    ----------
    shown
        The place without passwords, for printing.
    file
        File of a journal, or None.
    url
        URL of a database with its driver, or "".
    """

    shown: str
    file: Path | None = None
    url: str = field(default="", repr=False)

    def is_new(self) -> bool:
        """Whether the storage is a journal that does not exist yet; nothing is created or changed.

        Raises
        ------
        StorageError
            Where the journal cannot be created, or an existing file cannot be used as one.
        """
        if self.file is None:
            return False
        with self.answering():
            return is_new_journal(self.file)

    @contextlib.contextmanager
    def opened(self) -> Generator[optuna.storages.BaseStorage]:
        """Optuna's storage at this place, closed at the end; an empty database gets its tables.

        Raises
        ------
        StorageError
            Where it does not answer within ten seconds, refuses, or is of another version of Optuna; where its tables
            are not there a minute later.
        """
        import optuna

        optuna.logging.set_verbosity(optuna.logging.ERROR)  # it warns with the statements of SQL that failed
        storage = self._open()
        try:
            yield storage
        finally:
            from optuna.storages import RDBStorage

            if isinstance(storage, RDBStorage):
                storage.remove_session()
                storage.engine.dispose()

    def _open(self) -> optuna.storages.BaseStorage:
        if self.file is not None:
            with self.answering():
                return open_journal(self.file)
        opened: list[optuna.storages.BaseStorage] = []
        failed: list[BaseException] = []
        answered, joined = threading.Event(), threading.Event()

        def connect() -> None:
            try:
                import sqlalchemy

                engine = sqlalchemy.create_engine(self.url, poolclass=sqlalchemy.NullPool)
                engine.connect().close()
                joined.set()
                answered.set()
                opened.append(_database(self.url))
            except MemoryError:
                failed.append(self._silent(f"its answer takes more than {_MEMORY / 1e6:.0f} MB"))
            except BaseException as error:  # noqa: BLE001 (raised again below)
                failed.append(error)
            finally:
                answered.set()

        # No driver has a limit for every way in which a server can be silent, or for what it says.
        thread = threading.Thread(target=connect, daemon=True)
        with memory_limit(_MEMORY):
            thread.start()
            if not answered.wait(_LONGEST):
                raise self._silent(f"it does not answer within {_LONGEST:.0f} s")
            thread.join(_TABLES)
        if not opened and not failed:
            raise self._silent(f"its tables are not there after {_TABLES:.0f} s")
        with self.answering(joined=joined.is_set()):
            if failed:
                raise failed[0]
        return opened[0]

    @contextlib.contextmanager
    def answering(self, *, joined: bool = True) -> Generator[None]:
        """Turn what is raised where the storage fails into a sentence; joined: whether it has answered before.

        Raises
        ------
        StorageError
            In the place of errors of the operating system, the database and Optuna.
        """
        import optuna
        import sqlalchemy.exc

        try:
            yield
        except SoftcalError:
            raise
        except Exception as error:  # whatever a driver raises
            known = isinstance(error, (OSError, sqlalchemy.exc.SQLAlchemyError, optuna.exceptions.OptunaError))
            *_, (frame, _) = traceback.walk_tb(error.__traceback__)
            is_ours = str(frame.f_globals.get("__name__", "")).startswith("softcal.")
            if (isinstance(error, BROKEN) or not known) and is_ours:  # a mistake of softcal's own
                raise
            if isinstance(error, BROKEN) and self.file is not None:
                raise StorageError(Fault(f"{NO_JOURNAL}, or it is damaged", str(self.file), attempt=ANOTHER)) from None
            # The message of the driver, without the statement and the pages that SQLAlchemy adds.
            origin = error.__cause__ if error.__cause__ is not None else error
            origin = getattr(origin, "orig", None) or origin
            # pg8000 has it by field, pymysql after its number.
            said = [a.get("M", "") if isinstance(a, dict) else a for a in getattr(origin, "args", ())]
            reason = next((a for a in said if isinstance(a, str) and a), str(origin)).strip()
            got = (self._without_secret(reason).splitlines() or [""])[0].rstrip(".") or type(error).__name__
            if isinstance(error, BROKEN) and joined:  # by a record in it
                what = "the shared study cannot be read"
                raise StorageError(Fault(what, self.shown, got, attempt="another database")) from None
            kind = UnansweredError if self.url and known else StorageError
            raise kind(Fault("the shared study cannot be reached", self.shown, got)) from None

    def _silent(self, got: str) -> StorageError:
        attempt = "the address, its port, and whether the server runs"
        return StorageError(Fault("the shared study cannot be reached", self.shown, got, attempt=attempt))

    def _without_secret(self, text: str) -> str:
        import sqlalchemy

        if not self.url:
            return text
        url = sqlalchemy.make_url(self.url)
        secrets = {str(secret) for secret in (url.password, *(url.query.get(name) for name in _SECRET)) if secret}
        for secret in secrets | {repr(secret)[1:-1] for secret in secrets}:
            # A short one is a part of other words too.
            whole = re.escape(secret) if len(secret) >= _SHORT else rf"(?<!\w){re.escape(secret)}(?!\w)"
            text = re.sub(whole, "***", text)
        return text


def storage_url(text: str) -> StorageUrl:
    """The place that a text names: `journal:FILE`, or the URL of a PostgreSQL or MySQL database.

    Raises
    ------
    StorageError
        Where it names none, its driver is not installed, or the folder of its file does not exist.
    """
    what, where = "this is no storage that processes can share", "--storage"
    scheme, _, rest = text.partition(":")
    if scheme == _JOURNAL:
        file = Path(rest)
        if not rest.strip():
            raise StorageError(Fault(what, where, f"{text}, which names no file", _ALLOWED))
        if (found := not_a_file(file)) and found != NOTHING:
            raise StorageError(Fault(what, where, f"{text} ({found})", _ALLOWED))
        if not file.absolute().parent.is_dir():
            raise StorageError(Fault("the folder of the file does not exist", where, text, "an existing folder"))
        return StorageUrl(text, file)
    database, _, driver = scheme.partition("+")
    known = _DRIVERS.get(database, {})
    if not known or (driver and driver not in known) or not rest.startswith("//"):
        shown = f"{scheme}:…" if re.fullmatch(r"[a-z0-9+]{1,40}", scheme) else "another text"
        raise StorageError(Fault(what, where, shown, _ALLOWED))
    read = _CERTAIN.fullmatch(rest)
    shown = f"{scheme}://{'…' if read is None else '***@' * bool(read['user']) + read['place']}"
    installed = [name for name, (module, _) in known.items() if importlib.util.find_spec(module) is not None]
    if (driver and driver not in installed) or not installed:
        package = known[driver or _WITHOUT[database]][1]
        fault = Fault(f"the driver of {database} is not installed", where, shown, attempt=f"pip install '{package}'")
        raise StorageError(fault)
    import sqlalchemy
    import sqlalchemy.exc

    try:
        if "@" in _UP_TO_HOST.sub("", rest, count=1):
            raise ValueError("the rest of a password would be taken for the host, the database or an option")
        url = sqlalchemy.make_url(text).set(drivername=f"{database}+{driver or installed[0]}")
        if set(url.query) - _OPTIONS:
            options = ", ".join(sorted(_OPTIONS))
            raise StorageError(
                Fault("the URL of the database has an option that is not allowed", where, shown, options)
            )
        return StorageUrl(shown, url=url.render_as_string(hide_password=False))
    except (ValueError, sqlalchemy.exc.ArgumentError):
        attempt = "%-codes for special characters in the password, such as %40 for @"
        raise StorageError(Fault("the URL of the database cannot be read", where, shown, _ALLOWED, attempt)) from None


def _database(url: str) -> optuna.storages.BaseStorage:
    import sqlalchemy.exc
    from optuna.storages import RDBStorage

    # Optuna fills in a template, for which a brace would be a field. A connection is tried before it is used: servers
    # and the networks between close those that were not used for a while.
    escaped = url.replace("{", "{{").replace("}", "}}")
    for left in reversed(range(_TRIES)):
        try:
            storage = RDBStorage(escaped, engine_kwargs={"pool_pre_ping": True})
            storage.remove_session()
            return storage
        except Exception as error:
            # A server that was reached refuses a statement, such as to make a table that another process just made; the
            # error is Optuna's own, or SQLAlchemy's.
            told = [e for e in (error, error.__cause__) if isinstance(e, sqlalchemy.exc.DBAPIError)]
            if left == 0 or all(one.statement is None for one in told):
                raise
            time.sleep(_PAUSE)
    raise AssertionError
