"""Storages of shared studies: refused in a sentence before anything is made, and never with a password in it."""

from __future__ import annotations

import errno
import os
import re
import socket
import sys
from pathlib import Path
from typing import Any

import pytest
from database_folder import PASSWORD
from hypothesis import given, settings
from hypothesis import strategies as st
from project_case import write_project
from sqlalchemy import make_url

from softcal.calibration.results import file_lock
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.search import shared_journal, storage_url
from softcal.calibration.search.storage_url import StorageUrl
from softcal.cli import main
from softcal.errors import StorageError


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("sqlite:///shared.db", "got sqlite:…; allowed: journal:FILE, postgresql://"),
        ("redis://user:s3cret@host", "got redis:…; allowed"),
        ("s3cret!", "got another text; allowed"),
        ("postgresql+asyncpg://u:s3cret@h/d", "no storage that processes can share"),
        ("postgresql:u:s3cret@h/d", "no storage that processes can share"),
        ("postgresql+pg8000://u:s3@cret@h:port/d", r"postgresql\+pg8000://…"),
        ("postgresql+pg8000://u:s3cret", r"postgresql\+pg8000://…"),
        *(
            (f"{url}@h/d?{option}", "has an option that is not allowed; got .*; allowed: application_name, charset")
            for url, option in (
                ("mysql+pymysql://u:s3cret", "read_default_file=/etc/s3cret"),
                ("mysql+pymysql://u:s3cret", "charset=utf8&local_infile=1"),
                ("mysql+pymysql://u:s3cret", "init_command=s3cret"),
                ("postgresql+pg8000://u:s3cret", "startup_params=s3cret"),
            )
        ),
        ("journal:", "names no file"),
        ("journal:.", r"journal:\. \(a folder\)"),
        ("journal:/dev/null", r"journal:/dev/null \(a device\)"),
        (f"journal:{'x' * 300}", "file name too long"),
        ("journal:missing/file", "the folder of the file does not exist"),
    ],
)
def test_a_storage_that_is_none_is_refused_without_its_secrets(url: str, told: str) -> None:
    with pytest.raises(StorageError, match=told) as refused:
        storage_url.storage_url(url)
    assert "s3" not in str(refused.value)
    assert "cret" not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "package"),
    [
        ("postgresql://u:s3cret@h/d", "pg8000"),
        ("postgresql+psycopg2://u:s3cret@h/d", "psycopg2-binary"),
        ("mysql://u:s3cret@h/d", "pymysql[rsa]"),
        ("mysql+mysqlconnector://u:s3cret@h/d", "mysql-connector-python"),
    ],
)
def test_a_driver_that_is_not_installed_is_named(url: str, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(storage_url.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        StorageError, match=rf"is not installed; got .* Try: pip install '{re.escape(package)}'"
    ) as refused:
        storage_url.storage_url(url)
    assert "s3cret" not in str(refused.value)


SPECIAL = st.text("?@/:#%&[]{}+ ;=\\'\"\n\té0", max_size=4)


@given(st.lists(SPECIAL, min_size=1, max_size=3), SPECIAL, SPECIAL)
@settings(max_examples=300, deadline=None)
def test_a_password_is_in_no_message_whatever_its_characters(between: list[str], before: str, behind: str) -> None:
    password = before + "".join(f"hunter{one}hunter" for one in between) + behind
    text = f"postgresql+pg8000://me:{password}@127.0.0.1:1/db"
    if "@" in password:
        with pytest.raises(StorageError, match="%-codes for special characters in the password") as refused:
            storage_url.storage_url(text)
        assert "hunter" not in str(refused.value)
        return
    place = storage_url.storage_url(text)
    assert "hunter" not in place.shown + repr(place)
    url = make_url(place.url)
    assert (url.host, url.port, url.database) == ("127.0.0.1", 1, "db")
    assert url.password is not None
    for said in (url.password, repr(url.password)):
        with pytest.raises(StorageError) as failed, place.answering():
            raise OSError(f"no user has the password {said}, not even you.")
        assert "hunter" not in str(failed.value)
        assert "no user has the password" in str(failed.value)


def test_a_password_among_the_options_is_not_shown() -> None:
    place = storage_url.storage_url("mysql+pymysql://127.0.0.1:1/d?password=s3cret&passwd=s4cret")
    assert place.shown == "mysql+pymysql://127.0.0.1:1/d"
    with pytest.raises(StorageError, match=r"got \*\*\* or \*\*\* is wrong\.$"), place.answering():
        raise OSError("s3cret or s4cret is wrong")


def test_a_password_with_a_question_mark_is_not_shown_by_calibrate(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    err = refused_by_calibrate(capsys, tmp_path, "postgresql+pg8000://me:1234?99@127.0.0.1:1/db")
    assert "Error: postgresql+pg8000://…: the shared study cannot be reached" in err
    assert "1234" not in err


def refused_by_calibrate(capsys: pytest.CaptureFixture[str], tmp_path: Path, url: str, *options: str) -> str:
    path = write_project(tmp_path / "p")
    before = sorted(path.parent.rglob("*"))
    with pytest.raises(SystemExit) as left:
        main(["calibrate", str(path), "--method", "tpe", "--out", str(tmp_path / "out"), "--storage", url, *options])
    assert left.value.code == 2
    assert not (tmp_path / "out").exists()
    assert sorted(path.parent.rglob("*")) == before
    err = capsys.readouterr().err
    assert "Traceback" not in err
    return err


def test_a_server_that_is_not_there_or_is_silent_is_told(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(storage_url, "_LONGEST", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        port = silent.getsockname()[1]
        url = f"postgresql+pg8000://u:s3cret@127.0.0.1:{port}/d"
        gone = refused_by_calibrate(capsys, tmp_path, url)
        silent.listen()
        err = refused_by_calibrate(capsys, tmp_path, url)
    shown = f"postgresql+pg8000://***@127.0.0.1:{port}/d: the shared study cannot be reached"
    assert shown in gone
    assert f"{shown}; got it does not answer within" in err
    assert "s3cret" not in gone + err


@pytest.mark.parametrize(
    ("password", "said", "shown"),
    [("p", "port p", "port ***"), ("on", "option 'on'", "option '***'"), ("s3cret", "xs3cretx", "x***x")],
)
def test_a_short_password_is_masked_where_it_is_a_word(password: str, said: str, shown: str) -> None:
    place: Any = storage_url.storage_url(f"postgresql+pg8000://u:{password}@localhost/d")
    assert place._without_secret(said) == shown


def test_a_wrong_password_or_database_is_told_and_never_shown(
    postgresql: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    wrong = postgresql.replace("s3cret", "0ther")
    err = refused_by_calibrate(capsys, tmp_path, wrong)
    assert "password authentication failed" in err
    assert "0ther" not in err
    err = refused_by_calibrate(capsys, tmp_path, postgresql.replace("/postgres", "/nowhere"))
    assert 'database "nowhere" does not exist' in err
    assert PASSWORD not in err
    assert "s3cret" not in err


@pytest.mark.slow
def test_a_wrong_password_or_database_of_mysql_is_told_and_never_shown(
    mysql: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    err = refused_by_calibrate(capsys, tmp_path, mysql.replace("s3cret", "0ther"))
    assert "got Access denied for user 'softcal'@" in err
    assert "0ther" not in err
    err = refused_by_calibrate(capsys, tmp_path, re.sub("/softcal$", "/nowhere", mysql))
    assert "got Access denied for user 'softcal'@" in err
    assert "to database 'nowhere'" in err
    assert "s3cret" not in err


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes")
def test_a_pipe_is_refused_before_it_is_opened(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "(a pipe); allowed: journal:FILE" in refused_by_calibrate(capsys, tmp_path, f"journal:{tmp_path / 'pipe'}")


@pytest.mark.parametrize(
    "held",
    [b'{"op_code": broken\n', b'{"op_code": 0', b'{"op_code":0}\n{"op_code" x\n', b'{"op_code" x\n{"op_code":0}\n'],
)
def test_a_file_that_begins_like_a_journal_and_is_none_is_left_as_it_is(
    held: bytes, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path = tmp_path / "broken.j"
    path.write_bytes(held)
    err = refused_by_calibrate(capsys, tmp_path, f"journal:{path}")
    assert f"{path}: this file is no journal of a study" in err
    assert "Try: journal:FILE of a new file, or of a study's" in err
    assert "Expecting" not in err
    assert path.read_bytes() == held


@pytest.mark.skipif(sys.platform != "linux", reason="a folder in which nobody can make a file")
def test_a_journal_that_cannot_be_made_is_refused_before_anything_is(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    err = refused_by_calibrate(capsys, tmp_path, "journal:/proc/x.j")
    assert "/proc: no file can be made and locked in this folder" in err


def test_a_file_system_without_locks_is_told_before_anything_is_made(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(file: object, *, wait: bool = False) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    for module in (file_lock, shared_journal):
        monkeypatch.setattr(module, "lock", refuse)
    new, there = tmp_path / "new.j", tmp_path / "there.j"
    there.touch()
    for path in (new, there):
        assert "No locks available" in refused_by_calibrate(capsys, tmp_path, f"journal:{path}")
    assert sorted(tmp_path.iterdir()) == [tmp_path / "p", there]
    assert there.read_bytes() == b""


def test_a_journal_in_which_another_process_writes_at_this_moment_is_waited_for_later(tmp_path: Path) -> None:
    path = tmp_path / "shared.j"
    with file_lock.hold(path):
        assert not storage_url.storage_url(f"journal:{path}").is_new()


def test_a_journal_is_not_made_where_the_run_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path, out = write_project(tmp_path / "p"), tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    journal = tmp_path / "shared.journal"
    with pytest.raises(SystemExit) as left:
        main(["calibrate", str(path), "--method", "tpe", "--out", str(out), "--storage", f"journal:{journal}"])
    assert left.value.code == 2
    assert "the folder is not empty" in capsys.readouterr().err
    assert not journal.exists()


@pytest.mark.slow
def test_calibrate_shares_a_projects_search_by_a_database(
    postgresql: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Its words, and what is typed to go on, do not show the password."""
    path = write_project(tmp_path / "p")
    command = ["calibrate", str(path), "--method", "tpe", "--trials", "4", "--no-report", "--storage", postgresql]
    for name in ("a", "b"):
        with pytest.raises(SystemExit) as left:
            main([*command, "--out", str(tmp_path / name)])
        assert not left.value.code
    results = [load_result(tmp_path / name / "calibrations" / "pull") for name in ("a", "b")]
    assert results[0].trials == results[1].trials
    assert len(results[0].trials) == 4
    held = "".join(f.read_text(errors="replace") for f in tmp_path.rglob("*") if f.is_file())
    said = capsys.readouterr()
    assert "s3cret" not in held + said.out + said.err
    err = refused_by_calibrate(capsys, tmp_path / "again", postgresql, "--seed", "7")
    assert "the shared study began with other settings: seed; got 7; allowed: 1" in err


def test_a_database_of_another_version_of_optuna_is_refused(tmp_path: Path) -> None:
    import sqlalchemy

    place = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    with place.opened():
        pass
    engine = sqlalchemy.create_engine(place.url)
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text("UPDATE alembic_version SET version_num = 'v0.9.0.a'"))
    engine.dispose()
    with pytest.raises(StorageError, match=r"a database: the shared study cannot be read; got .*(version|schema)"):
        place.opened().__enter__()


def test_a_process_that_opens_an_empty_database_as_another_does_finds_the_tables_of_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sqlalchemy

    place = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    make, late = sqlalchemy.MetaData.create_all, [True]

    def made(self: sqlalchemy.MetaData, bind: sqlalchemy.Engine, checkfirst: bool = True) -> None:
        if first := bool(late) and late.pop():
            with place.opened():  # as by another process, after this one has seen that there are no tables
                pass
        make(self, bind, checkfirst=checkfirst and not first)

    monkeypatch.setattr(sqlalchemy.MetaData, "create_all", made)
    with place.opened() as storage:
        assert storage.get_all_studies() == []


def test_what_a_database_refuses_in_the_middle_is_told(tmp_path: Path) -> None:
    import optuna
    import sqlalchemy

    place = StorageUrl("a database", url=f"sqlite:///{tmp_path / 'optuna.db'}")
    with place.opened() as storage:
        engine = sqlalchemy.create_engine(place.url)
        with engine.begin() as connection:
            connection.execute(sqlalchemy.text("DROP TABLE trials"))
        engine.dispose()
        study = optuna.create_study(storage=storage)
        with pytest.raises(StorageError, match=r"a database: .* cannot be reached; got no such table: trials"):
            with place.answering():
                study.get_trials()
