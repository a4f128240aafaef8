"""Whatever a YAML file does to its reader, it is refused in a sentence, at once, and without much memory."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from softcal.errors import InputError
from softcal.plugins.markers.camera_file import read_camera
from softcal.project.base_file import read_base
from softcal.project.project import load
from softcal.project.yaml_file import read_document

READERS = {"project": load, "camera": read_camera, "base": lambda path: read_base(str(path))}


def bomb(levels: int, width: int) -> str:
    lines = ["a0: &a0 [x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * width)}]" for n in range(1, levels)]
    return "\n".join(lines)


# What is in the file, and a piece of what is said.
FILES: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "an empty file"),
    "blanks": (b"  \n\n", "an empty file"),
    "a remark": (b"# nothing\n", "an empty file"),
    "null": (b"~\n", "holds no keys"),
    "a number": (b"5\n", "holds no keys"),
    "text": (b"hello\n", "holds no keys"),
    "a list": (b"- a\n- b\n", "holds no keys"),
    "an open bracket": (b"robot: {", "not YAML"),
    "an open quote": (b'name: "a\n', "not YAML"),
    "a tabulator": (b"robot:\n\tbodies: 5\n", "not YAML"),
    "an unknown alias": (b"robot: *nowhere\n", "not YAML"),
    "two documents": (b"a: 1\n---\nb: 2\n", "not YAML"),
    "a wrong escape": (b'name: "\\q"\n', "not YAML"),
    "an escape beyond Unicode": (b'name: "\\UFFFFFFFF"\n', "not YAML"),
    "half of a pair": (b'name: "\\ud800"\n', ""),
    "a version of the future": (b"%YAML 9.9\n---\na: 1\n", ""),
    "a control character": (b"name: a\x07b\n", "not YAML"),
    "a NUL": (b"name: a\x00b\n", "not YAML"),
    "Latin-1": ("name: Gr\xfc\xdfe\n".encode("latin-1"), "not UTF-8"),
    "UTF-16": ("name: a\n".encode("utf-16"), "not UTF-8"),
    "a program": (b"\x7fELF\x02\x01\x01\x00\x00", ""),
    "an alias bomb": (bomb(40, 9).encode(), "values in a YAML file"),
    "a wide alias bomb": (bomb(6, 200).encode(), "values in a YAML file"),
    "a value in itself": (b"robot: &a [*a]\n", "holds itself"),
    "a mapping in itself": (b"robot: &a {b: *a}\n", "holds itself"),
    "a merge of itself": (b"robot: &a {<<: *a}\n", "holds itself"),
    "a deep list": (b"robot: " + b"[" * 100_000, "levels of a YAML file"),
    "a deep list that is closed": (b"robot: " + b"[" * 500 + b"]" * 500, "levels of a YAML file"),
    "a deep mapping": (b"".join(b" " * n + b"a:\n" for n in range(500)), "levels of a YAML file"),
    "a deep mapping in flow": (b"a: " + b"{a: " * 5_000, "levels of a YAML file"),
    "two megabytes": (b"# " + b"x" * 2_000_000, "too large"),
    "many values": (b"a: [" + b"1," * 45_000 + b"1]\n", "values in a YAML file"),
    "a long key": (b"? " + b"k" * 5_000 + b"\n: 1\n", "this cannot be a key"),
    "a list as a key": (b"? [a, b]\n: 1\n", "this cannot be a key"),
    "a mapping as a key": (b"? {a: b}\n: 1\n", "this cannot be a key"),
    "an empty key": (b'"": 1\n', "this cannot be a key"),
    "a key with a line feed": (b'"a\\nb": 1\n', "this cannot be a key"),
    "a key twice": (b"softcal: 1\nsoftcal: 1\n", "line 2: softcal: the key appears twice".replace("line ", ":")),
    "a merge of a number": (b"robot: {<<: 5}\n", "this cannot be merged"),
    "a merge of numbers": (b"robot: {<<: [5]}\n", "this cannot be merged"),
    "no integer": (b"softcal: !!int abc\n", "does not match its tag"),
    "no float": (b"softcal: !!float abc\n", "does not match its tag"),
    "no bool": (b"softcal: !!bool abc\n", "does not match its tag"),
    "a tag of Python's": (b"softcal: !!python/object/apply:os.system [true]\n", "the tag is not known"),
    "a tag of nobody's": (b"softcal: !foo 1\n", "the tag is not known"),
    "a set": (b"softcal: !!set {a}\n", "the tag is not known"),
    "an ordered mapping": (b"softcal: !!omap [a: 1]\n", "the tag is not known"),
    "bytes": (b"softcal: !!binary aGVsbG8=\n", "the tag is not known"),
    "5,000 digits": (b"softcal: " + b"9" * 5_000 + b"\n", ""),
    "5,000 octal digits": (b"softcal: 0o" + b"7" * 5_000 + b"\n", ""),
    "a float beyond all": (b"softcal: 1e999999\n", ""),
    "not a number": (b"softcal: .nan\n", ""),
    "a date": (b"softcal: 2024-02-30\n", ""),
    "true": (b"softcal: true\n", ""),
}


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("case", FILES)
def test_a_file_that_is_refused(tmp_path: Path, case: str, kind: str):
    data, piece = FILES[case]
    path = tmp_path / "file.yaml"
    path.write_bytes(data)
    begun = time.monotonic()
    with pytest.raises(InputError) as error:
        READERS[kind](path)
    assert time.monotonic() - begun < 20
    assert piece in str(error.value), str(error.value)
    assert "file.yaml" in str(error.value)
    assert max(len(str(fault)) for fault in error.value.faults) < 600


@pytest.mark.parametrize("kind", READERS)
@pytest.mark.parametrize("case", ["nowhere", "folder", "long", "device", "pipe", "NUL", "closed"])
def test_a_path_that_is_no_file(tmp_path: Path, case: str, kind: str):
    path = tmp_path / {"long": "a" * 300, "NUL": "a\0b"}.get(case, case)
    path = path.with_name(path.name + ".yaml")
    if case == "folder":
        path.mkdir()
    elif case == "device":
        path.symlink_to("/dev/zero")
    elif case == "pipe":
        os.mkfifo(path)
    elif case == "closed":
        path.symlink_to(path)
    # A public function refuses a path that no system can have before it reads it.
    impossible = {"long": "this path is too long", "NUL": "a zero byte is no text"} if kind == "project" else {}
    with pytest.raises(InputError, match=impossible.get(case, "file cannot be read")):
        READERS[kind](path)


def test_what_is_right_is_read(tmp_path: Path):
    path = tmp_path / "file.yaml"
    text = (
        "\ufeffa: &a {x: 1, y: 0x10}\nb: {<<: *a, y: 1_000}\nc: {<<: [*a, {z: .5}]}\nd: &a 2\ne: *a\nf: [yes, ~, '1']\n"
    )
    path.write_text(text, encoding="utf-8")
    data = read_document(path).data
    assert data["a"] == {"x": 1, "y": 16}
    assert data["b"] == {"x": 1, "y": 1000}
    assert data["c"] == {"x": 1, "y": 16, "z": 0.5}
    assert (data["d"], data["e"], data["f"]) == (2, 2, ["yes", None, "1"])
