"""YAML read with its lines: numbers, equal keys, aliases, what is not YAML."""

from __future__ import annotations

from pathlib import Path

import pytest

from softcal.errors import Fault, InputError, ProjectFileError, StorageError
from softcal.project.document import Document, Findings, dotted
from softcal.project.yaml_file import read_document


def read(tmp_path: Path, text: str) -> Document:
    path = tmp_path / "p.yaml"
    path.write_text(text, encoding="utf-8")
    return read_document(path)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e5", 1e5),
        ("1.0e5", 1e5),
        ("-2", -2),
        ("012", 12),
        ("0x1F", 31),
        ("1_000", 1000),
        ("no", "no"),
        ("true", True),
        ("~", None),
        ("'5'", "5"),
        (".inf", ".inf"),
        (".nan", ".nan"),
        ("2.3 MPa", "2.3 MPa"),
        ("2026-11-21", "2026-11-21"),
    ],
)
def test_scalars_are_read_by_yaml_1_2(tmp_path: Path, text: str, value: object):
    found = read(tmp_path, f"a: {text}").data["a"]
    assert found == value
    assert type(found) is type(value)


def test_lines_are_known_by_key_path(tmp_path: Path):
    document = read(tmp_path, "a:\n  b: 1\n  c:\n    - x\n    - {d: 2}\n")
    assert document.where(("a", "c", 1, "d")) == "p.yaml:5: a.c[1].d"
    assert document.where(("a", "missing", "deeper")) == "p.yaml:1: a.missing.deeper"
    assert document.where(()) == "p.yaml:1"


def test_every_equal_key_is_a_fault(tmp_path: Path):
    document = read(tmp_path, "a: 1\nb: {c: 1, c: 2}\na: 3\n")
    assert [fault.where for fault in document.faults] == ["p.yaml:2: b.c", "p.yaml:3: a"]
    assert "line 1" in document.faults[1].got
    assert document.data["a"] == 1


def test_a_second_merge_is_a_fault(tmp_path: Path):
    document = read(tmp_path, "a: &x {k: 1}\nb: &y {k: 2}\nc:\n  <<: *x\n  <<: *y\n")
    (fault,) = document.faults
    assert (fault.where, fault.what, fault.allowed) == ("p.yaml:5: c", "the key appears twice", "<<: [*a, *b]")


def test_aliases_and_merge_keys(tmp_path: Path):
    document = read(tmp_path, "a: &x {k: 1, l: 2}\nb: *x\nc: {<<: *x, l: 3}\n")
    assert document.data["b"] == {"k": 1, "l": 2}
    assert document.data["c"] == {"k": 1, "l": 3}
    assert not document.faults


def test_what_is_not_yaml_is_told_with_its_line(tmp_path: Path):
    with pytest.raises(ProjectFileError, match=r"p\.yaml:3: this is not YAML"):
        read(tmp_path, "a: 1\nb: {c: 1\n")


@pytest.mark.parametrize("text", ["", "# nothing\n", "- a\n", "7\n"])
def test_a_file_without_keys(tmp_path: Path, text: str):
    with pytest.raises(ProjectFileError, match="holds no keys"):
        read(tmp_path, text)


def test_a_file_that_cannot_be_read(tmp_path: Path):
    with pytest.raises(StorageError, match="no such file"):
        read_document(tmp_path / "none.yaml")
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9\n")
    with pytest.raises(StorageError, match="not UTF-8 at 6"):
        read_document(tmp_path / "latin.yaml")


def test_findings_collect_and_sort_by_line(tmp_path: Path):
    findings = Findings(read(tmp_path, "a: 1\nb: 2\n"))
    findings.add(("b",), "second")
    with findings.at(("a",)):
        raise InputError([Fault("first", where="data.csv, line 3"), Fault("also first", where="a")])
    findings.unknown(("b",), "cable", "frnt", ["front", "left"])
    with pytest.raises(ProjectFileError) as error:
        findings.raise_if_any()
    told = [str(fault) for fault in error.value.faults]
    assert told[0] == "p.yaml:1: a: data.csv, line 3: first."
    assert told[1] == "p.yaml:1: a: also first."
    assert told[2] == "p.yaml:2: b: second."
    assert "allowed: front, left. Try: 'front'." in told[3]


def test_nothing_found_raises_nothing(tmp_path: Path):
    Findings(read(tmp_path, "a: 1\n")).raise_if_any()


def test_dotted():
    assert dotted(("robot", "cables", "front", "via", 1, "at")) == "robot.cables.front.via[1].at"
