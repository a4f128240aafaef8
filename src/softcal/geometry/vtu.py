"""The mesh of a .vtu file: text or binary, compressed or not, with its arrays in place or appended.

meshio's own reader interchanges arrays that are appended raw where the place of one is the new place of another, wraps
numbers of text that its type does not hold, and takes the last of several arrays of a name.
"""

from __future__ import annotations

import base64
import lzma
import re
import zlib
from collections.abc import Callable, Mapping
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from softcal.checks import Ints
from softcal.geometry.deck import DeckError, numbers_in

_KINDS = {
    "Float32": "f4", "Float64": "f8", "Int8": "i1", "Int16": "i2", "Int32": "i4", "Int64": "i8",
    "UInt8": "u1", "UInt16": "u2", "UInt32": "u4", "UInt64": "u8",
}  # fmt: skip
_COMPRESSORS: Mapping[str, Callable[[bytes], bytes]] = {
    "vtkZLibDataCompressor": zlib.decompress,
    "vtkLZMADataCompressor": lzma.decompress,
    "": bytes,
}


def read_vtu(path: Path) -> Any:
    """A mesh of meshio.

    Raises
    ------
    DeckError
        For what is wrong, or not followed.
    ValueError, LookupError
        For what does not follow the format.
    """
    meshio: Any = import_module("meshio")
    raw = path.read_bytes()
    mark = re.search(rb"<AppendedData[^>]*>\s*_", raw)
    begin, end = (mark.end(), raw.rindex(b"</AppendedData>")) if mark else (len(raw), len(raw))
    root, appended = ET.fromstring(raw[:begin] + raw[end:]), raw[begin:end]
    order = ">" if root.get("byte_order") == "BigEndian" else "<"

    def numbers_of(array: ET.Element) -> Any:
        """The numbers of an array, in rows where it has several components."""
        kind, text = np.dtype(order + _KINDS[array.attrib["type"]]), array.text or ""
        if (form := array.get("format", "ascii")) == "ascii":
            written = numbers_in(text, np.float64 if kind.kind == "f" else np.int64)
            numbers = written.astype(kind)
            if kind.kind != "f" and (written != numbers).any():
                raise DeckError(f"numbers from {written.min()} to {written.max()} in an array of {array.get('type')}")
        else:
            packed, is_text = "".join(text.split()).encode(), True
            if form == "appended":
                is_text = root.findall("AppendedData")[0].get("encoding") == "base64"
                if not 0 <= (at := int(array.attrib["offset"])) < len(appended):
                    raise DeckError(f"an array at byte {at} of {len(appended)}")
                packed = appended[at:]
            header = np.dtype(order + _KINDS[root.get("header_type", "UInt32")])
            numbers = np.frombuffer(_unpacked(packed, header, root.get("compressor", ""), is_text=is_text), kind)
        width = int(array.get("NumberOfComponents") or 1)
        return numbers.reshape(-1, width) if width > 1 else numbers

    if root.get("type") != "UnstructuredGrid":
        raise DeckError(f"a file of type '{root.get('type', '')[:60]}' in place of UnstructuredGrid")
    pieces = root.findall("UnstructuredGrid/Piece")
    if len(pieces) != 1:
        raise DeckError(f"{len(pieces)} pieces in place of one: merge them, such as by ParaView's filter Clean to Grid")
    if (version := root.get("version", "1.0")) not in ("0.1", "1.0"):
        raise DeckError(f"version {version[:20]} of the format; 0.1 and 1.0 are read")
    found: dict[str, dict[str, Any]] = {}
    for part in pieces[0]:
        arrays: dict[str, Any] = {}
        for array in part.iter("DataArray"):
            if (name := array.get("Name", "")) in arrays:
                raise DeckError(f"two arrays '{name[:60]}'")
            arrays[name] = numbers_of(array)
        if part.tag in found:
            raise DeckError(f"two sections {part.tag[:60]}")
        found[part.tag] = arrays
    [points], cells = found["Points"].values(), found["Cells"]
    n_points, n_cells = (int(pieces[0].attrib[key]) for key in ("NumberOfPoints", "NumberOfCells"))
    if len(points) != n_points or {len(cells["offsets"]), len(cells["types"])} != {n_cells}:
        raise DeckError(f"{len(points)} points and {len(cells['types'])} cells in place of {n_points} and {n_cells}")
    blocks, data = vtk_cells(cells["connectivity"], cells["offsets"], cells["types"], found.get("CellData", {}))
    return meshio.Mesh(points, blocks, point_data=found.get("PointData"), cell_data=data)


def vtk_cells(connectivity: Ints, offsets: Ints, types: Ints, data: Mapping[str, Any]) -> Any:
    """meshio's blocks of cells and their data from the arrays of VTK.

    Parameters
    ----------
    connectivity, offsets, types
        The nodes of all cells in order, where those of each cell end, and VTK's number of its kind.
    data
        Name -> a number for each cell.

    Raises
    ------
    DeckError
        Where a cell begins and ends elsewhere than its type says, of which meshio takes the nodes before the end.
    """
    common: Any = import_module("meshio._vtk_common")
    kinds, row = np.unique(types, return_inverse=True)
    names = [common.vtk_to_meshio_type.get(int(kind), "") for kind in kinds]
    sizes = np.diff(offsets.astype(np.int64), prepend=0)
    # Of a kind without a number of nodes, such as polygons, any number is right.
    wanted = np.array([common.num_nodes_per_cell.get(name, -bool(name)) for name in names])[row]
    if len(bad := np.flatnonzero((sizes != wanted) & (wanted >= 0))):
        raise DeckError(f"cell {bad[0]} of type {types[bad[0]]} with {sizes[bad[0]]} nodes")
    if len(offsets) and offsets[-1] != len(connectivity):
        raise DeckError(f"{len(connectivity)} nodes of cells that end at {offsets[-1]}")
    return common.vtk_cells_from_data(connectivity, offsets, types, data)


def _unpacked(data: bytes, header: np.dtype[Any], compressor: str, is_text: bool) -> bytes:
    """The bytes of an array from those that begin with its header: how many, or how many in each compressed block."""
    if compressor not in _COMPRESSORS:
        raise DeckError(f"compressor {compressor[:40]}; {', '.join(filter(None, _COMPRESSORS))} are read")

    def taken(at: int, count: int) -> bytes:
        found = base64.b64decode(data[at : at + _length(count)], validate=True) if is_text else data[at : at + count]
        if len(found) < count:
            raise DeckError("an array that ends too early")
        return found[:count]

    size = header.itemsize
    [count] = np.frombuffer(taken(0, size), header).tolist()
    sizes = [count]
    if compressor:
        size *= 3 + count
        sizes = np.frombuffer(taken(0, size), header).tolist()[3:]
    # As text, the header stands alone, or the numbers follow within it.
    alone = _length(size) if is_text else size
    if is_text and not compressor and data[alone - 1 : alone] != b"=":
        return taken(0, size + count)[size:]
    held = taken(alone, sum(sizes))
    ends = np.cumsum([0, *sizes]).tolist()
    return b"".join(_COMPRESSORS[compressor](held[at:end]) for at, end in pairwise(ends))


def _length(count: int) -> int:
    """Number of letters for a number of bytes in base 64."""
    return 4 * -(-count // 3)
