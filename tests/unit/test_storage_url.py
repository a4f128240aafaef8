"""Storages of shared studies: refused in a sentence before anything is made, and never with a password in it."""

from __future__ import annotations

import re
import socket
from pathlib import Path

import pytest
from database_folder import PASSWORD
from project_case import write_project

from softcal.calibration import storage_url
from softcal.calibration.result_reading import load_result
from softcal.calibration.storage_url import StorageUrl
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
        ("postgresql+pg8000://u:s3@cret@h:port/d", r"postgresql\+pg8000://\*\*\*@…"),
        ("postgresql+pg8000://u:s3cret", r"postgresql\+pg8000://…"),
        ("journal:", "names no file"),
        ("journal:.", "names no file"),
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
    with pytest.raises(StorageError, match=r"a database: the shared study cannot be reached; got .*(version|schema)"):
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
