"""An .stl that is no closed surface of finite triangles is refused and not filled, as text and as binary."""

from __future__ import annotations

import importlib.util
import itertools
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softcal.errors import MeshError
from softcal.geometry.stl import checked_stl

CORNERS = np.array(list(itertools.product([0.0, 20.0], repeat=3)))
FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1)]
FACES += [(2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
CUBE = CORNERS[np.array(FACES)]


def moved(value: float, *, everywhere: bool) -> np.ndarray:
    """The cube with a coordinate of one corner changed, of one triangle or of all that share it."""
    triangles = CUBE.copy()
    if everywhere:
        triangles[(triangles == CORNERS[7]).all(axis=-1)] = [value, 20.0, 20.0]
    else:
        triangles[3, 1, 0] = value
    return triangles


def as_text(triangles: np.ndarray) -> bytes:
    lines = ["solid cube"]
    for corners in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {float(x)!r} {float(y)!r} {float(z)!r}" for x, y, z in corners]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid cube", ""]).encode()


def as_binary(triangles: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in triangles.astype(np.float32)]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


SURFACES: dict[str, tuple[np.ndarray, str]] = {
    "NaN at a corner of a triangle": (moved(np.nan, everywhere=False), "triangle 4"),
    "NaN at a corner of the cube": (moved(np.nan, everywhere=True), "corner without finite coordinates"),
    "infinity at a corner": (moved(np.inf, everywhere=True), "corner without finite coordinates"),
    "a corner beyond all": (moved(1e30, everywhere=True), "a corner is too far away"),
    "no triangles": (CUBE[:0], "holds no triangles"),
    "one triangle": (CUBE[:1], "encloses no volume"),
    "a flat cube": (CUBE * [1.0, 1.0, 0.0], "encloses no volume"),
    "a point": (CUBE * 0.0, "encloses no volume"),
    "a flat cube far away": (CUBE * [1.0, 1.0, 0.0] + 1000.0, "encloses no volume"),
    "there and back": (np.concatenate([CUBE, CUBE[:, ::-1]]), "encloses no volume"),
}


@pytest.mark.parametrize("write", [as_text, as_binary])
@pytest.mark.parametrize("case", SURFACES)
def test_a_surface_that_is_refused(tmp_path: Path, case: str, write: Callable[[np.ndarray], bytes]):
    triangles, piece = SURFACES[case]
    path = tmp_path / "part.stl"
    path.write_bytes(write(triangles))
    with pytest.raises(MeshError, match=piece) as error:
        checked_stl(path)
    assert str(error.value).startswith(str(path))


BYTES = {
    "text": (b"hello\n", "no STL"),
    "zeros": (bytes(84), "holds no triangles"),
    "a cut": (as_binary(CUBE)[:-7], "cut off"),
    "a count beyond all": (bytes(80) + struct.pack("<I", 10**9) + bytes(600), "cut off"),
    "a cut text": (as_text(CUBE)[:-60], "cut off"),
    "text for a number": (as_text(CUBE).replace(b"vertex 0.0 0.0 20.0", b"vertex a b c", 1), "no number"),
    "two corners": (as_text(CUBE).replace(b"vertex 0.0 0.0 20.0\n", b"", 1), "incomplete"),
}


@pytest.mark.parametrize("case", BYTES)
def test_bytes_that_are_no_surface(tmp_path: Path, case: str):
    data, piece = BYTES[case]
    path = tmp_path / "part.stl"
    path.write_bytes(data)
    with pytest.raises(MeshError, match=piece):
        checked_stl(path)


def test_a_cube_is_let_through(tmp_path: Path):
    path = tmp_path / "part.stl"
    path.write_bytes(as_text(CUBE))
    triangles, data = checked_stl(path)
    assert data == as_text(CUBE)
    assert triangles == pytest.approx(np.array(CUBE))
    path.write_bytes(as_binary(CUBE))
    # Gmsh takes a binary file of few triangles for text where its header is empty.
    again, data = checked_stl(path)
    assert data[80:] == as_binary(CUBE)[80:]
    assert data[:10] == b"binary STL"
    assert again == pytest.approx(triangles)


@pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")
def test_a_binary_cube_with_an_empty_header_is_filled(tmp_path: Path):
    from softcal.geometry.generate import mesh_file

    path = tmp_path / "part.stl"
    path.write_bytes(as_binary(CUBE))
    mesh = mesh_file(path, size=0.01)
    assert np.ptp(mesh.points, axis=0) == pytest.approx([0.02, 0.02, 0.02], rel=1e-6)
