"""The triangles of an .stl file, validated before Gmsh reads it, since Gmsh ignores corners with invalid numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, MeshError

_HEADER, _TRIANGLE = 80, 50
_FURTHEST = 1e9  # a coordinate, in the file's own unit
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"vertex[ \t]+(\S+)[ \t]+(\S+)[ \t]+(\S+)", re.IGNORECASE)
_NUMBER = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE)
# Gmsh mistakes a binary file for text if its header is empty, as some CAD programs write it.
_NAMED = b"binary STL".ljust(_HEADER)


def checked_stl(path: Path) -> tuple[Floats, bytes]:
    """The triangles of an .stl file (n, 3, 3) in its own unit, normals outwards; its bytes as Gmsh reads them reliably.

    Raises
    ------
    MeshError
        If the file is no STL, is truncated, has no triangles, has an invalid corner, or encloses no volume.
    """
    data = path.read_bytes()
    expected = _HEADER + 4 + _TRIANGLE * int.from_bytes(data[_HEADER : _HEADER + 4], "little")
    head = data[:4000].lower()
    binary = len(data) == expected or not (head.startswith(b"solid") and (b"facet" in head or b"endsolid" in head))
    if binary:
        start = _HEADER + 4
        count = int.from_bytes(data[_HEADER:start], "little")
        if len(data) < start + _TRIANGLE * count:
            raise MeshError(
                Fault(
                    "the file is no STL, or it is cut off",
                    str(path),
                    f"{len(data)} bytes, which say that they hold {count} triangles",
                    f"{start + _TRIANGLE * count} bytes for so many",
                )
            )
        corners = np.frombuffer(data, RECORD, count, start)["corners"].astype(np.float64)
    else:
        words: list[bytes] = [word for corner in _VERTEX.findall(data) for word in corner]
        try:
            numbers = np.array(words, dtype=np.bytes_).astype(np.float64).reshape(-1, 3)
        except ValueError as error:
            wrong = next((i for i, word in enumerate(words) if not _NUMBER.fullmatch(word)), 0)
            got = f"corner {wrong // 3 + 1}: '{words[wrong].decode(errors='replace')[:40]}'"
            what, allowed = "a coordinate of a triangle's corner is no number", "such as 1.5 or -2e-3"
            raise MeshError(Fault(what, str(path), got, allowed)) from error
        facets = len(re.findall(rb"endfacet", data, re.IGNORECASE))
        if len(numbers) != 3 * facets:
            raise MeshError(
                Fault(
                    "the file is cut off, or its triangles are incomplete",
                    str(path),
                    f"{len(numbers)} corners of {facets} triangles",
                    "three corners of each",
                )
            )
        corners = numbers.reshape(-1, 3, 3)
    if len(corners) == 0:
        raise MeshError(Fault("the file holds no triangles", str(path), allowed="a closed surface of triangles"))
    broken = np.flatnonzero(~np.isfinite(corners).all(axis=(1, 2)))
    if len(broken):
        raise MeshError(
            Fault(
                "a triangle has a corner without finite coordinates",
                str(path),
                f"triangle {broken[0] + 1}: {corners[broken[0]].tolist()}",
                attempt="export it again from the CAD program",
            )
        )
    far = float(np.abs(corners).max())
    if far > _FURTHEST:
        got, allowed = f"a coordinate of {far:.3g}", f"at most {_FURTHEST:g} in the file's own unit"
        raise MeshError(Fault("a corner is too far away", str(path), got, allowed, "export it again in millimetres"))
    size = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    a, b, c = np.swapaxes(corners - corners[0, 0], 0, 1)
    signed = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0
    volume = abs(signed)
    if not volume > 1e-9 * size**3:
        raise MeshError(
            Fault(
                "the surface encloses no volume",
                str(path),
                f"{volume:.3g} in a box of {size:.3g} (in the file's own unit)",
                "a closed surface whose triangles all face outwards",
                "repair it in the CAD program and export it again",
            )
        )
    outwards = corners if signed > 0.0 else corners[:, ::-1]
    return outwards, _NAMED + data[_HEADER:] if binary else data
