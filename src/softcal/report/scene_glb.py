"""Scenes as binary glTF 2.0 (GLB), which viewers of three-dimensional pictures read: triangles with their colours."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.checks import Floats
from softcal.geometry.ring import across
from softcal.report.scene import Part, length_scale

if TYPE_CHECKING:
    from pyvista import PolyData

_FLOAT, _UNSIGNED = 5126, 5125  # glTF's numbers of component types
_VERTICES, _INDICES = 34962, 34963
_TRIANGLES, _LINES = 4, 1


def scene_glb(parts: Sequence[Part], outlines: Sequence[Part], up: Floats, towards: Floats) -> bytes:
    """Parts, and the edges of others as lines, as one GLB file.

    The file's origin is in the middle of all parts, and they are 10 long.

    Parameters
    ----------
    parts
        Drawn with their colours.
    outlines
        Parts of which only the edges are drawn.
    up
        The z axis of the file (3,) [-].
    towards
        Its x axis (3,) [-], as far as it is across z.
    """
    extent = np.concatenate([part.extent for part in (*parts, *outlines)])
    middle, size = 0.5 * (extent.min(axis=0) + extent.max(axis=0)), length_scale(extent) or 1.0
    z = up / np.linalg.norm(up)
    x = towards - (towards @ z) * z
    x = across(z) if np.linalg.norm(x) < 1e-9 else x / np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z])
    file = _Glb(lambda points: (points - middle) @ axes.T * (10.0 / size))
    for part in parts:
        file.add_surface(part)
    for part in outlines:
        file.add_edges(part.mesh())
    return file.written()


class _Glb:
    """A glTF document with its binary buffer."""

    def __init__(self, place: Callable[[Floats], Floats]) -> None:
        self._place = place
        self._data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._primitives: list[dict[str, Any]] = []

    def add_surface(self, part: Part) -> None:
        """The triangles of a part."""
        mesh: PolyData = part.mesh().triangulate()
        if mesh.n_points == 0 or mesh.n_cells == 0:
            return
        from matplotlib.colors import to_rgb

        faces = np.asarray(mesh.regular_faces)
        points = self._place(np.asarray(mesh.points, dtype=np.float64))
        by_face = "colour" in mesh.cell_data
        # RGB from 0 to 1 of every point, or of every triangle where the part's colours are those of its faces.
        if isinstance(part.colour, str):
            shades = np.tile(np.array(to_rgb(part.colour)), (mesh.n_points, 1))
        else:
            data = mesh.cell_data if by_face else mesh.point_data
            shades = np.asarray(data["colour"], dtype=np.float64)[:, :3] / 255.0
        if by_face or not part.smooth:  # with facets: each triangle has its own corners
            points, shades = (
                points[faces.ravel()],
                shades[faces.ravel()] if not by_face else np.repeat(shades, 3, axis=0),
            )
            faces = np.arange(len(points)).reshape(-1, 3)
        # Unit normals of the points, the mean of those of their triangles.
        area = np.cross(points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]])
        normals = np.zeros_like(points)
        for corner in range(3):
            np.add.at(normals, faces[:, corner], area)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 0.0, normals / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
        # Colours as they are named (sRGB), as the intensities that glTF has.
        shades = np.where(shades <= 0.04045, shades / 12.92, ((shades + 0.055) / 1.055) ** 2.4)
        attributes = {
            "POSITION": self._floats(points, bounds=True),
            "NORMAL": self._floats(normals),
            "COLOR_0": self._floats(shades),
        }
        self._primitive(attributes, faces, _TRIANGLES, part.opacity)

    def add_edges(self, mesh: PolyData) -> None:
        """The edges of a shape where its faces meet at an angle, grey."""
        edges = mesh.triangulate().extract_feature_edges(30.0, boundary_edges=True, manifold_edges=False)
        if edges.n_cells == 0:
            return
        lines = np.asarray(edges.lines).reshape(-1, 3)[:, 1:]
        points = self._place(np.asarray(edges.points, dtype=np.float64))
        grey = np.full((len(points), 3), 0.25)
        attributes = {"POSITION": self._floats(points, bounds=True), "COLOR_0": self._floats(grey)}
        self._primitive(attributes, lines, _LINES, 1.0)

    def written(self) -> bytes:
        """The file."""
        about = {
            "asset": {"version": "2.0", "generator": "softcal"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": self._primitives}],
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": len(self._data)}],
        }
        text = json.dumps(about, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        whole = 12 + 8 + len(text) + 8 + len(self._data)
        head = struct.pack("<III", 0x46546C67, 2, whole) + struct.pack("<II", len(text), 0x4E4F534A)
        return head + text + struct.pack("<II", len(self._data), 0x004E4942) + bytes(self._data)

    def _primitive(self, attributes: dict[str, int], indices: Any, mode: int, opacity: float) -> None:
        flat = np.ascontiguousarray(indices, dtype="<u4").ravel()
        material: dict[str, Any] = {
            "pbrMetallicRoughness": {
                "metallicFactor": 0.0,
                "roughnessFactor": 0.9,
                "baseColorFactor": [1, 1, 1, opacity],
            },
            "doubleSided": True,
        }
        if opacity < 1.0:
            material["alphaMode"] = "BLEND"
        self._materials.append(material)
        self._primitives.append(
            {
                "attributes": attributes,
                "indices": self._accessor(flat.tobytes(), len(flat), _UNSIGNED, "SCALAR", _INDICES),
                "material": len(self._materials) - 1,
                "mode": mode,
            }
        )

    def _floats(self, values: Floats, *, bounds: bool = False) -> int:
        held = np.ascontiguousarray(values, dtype="<f4")
        number = self._accessor(held.tobytes(), len(held), _FLOAT, "VEC3", _VERTICES)
        if bounds:
            self._accessors[number] |= {"min": held.min(axis=0).tolist(), "max": held.max(axis=0).tolist()}
        return number

    def _accessor(self, data: bytes, count: int, component: int, kind: str, target: int) -> int:
        self._views.append({"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data), "target": target})
        self._data += data
        self._accessors.append(
            {"bufferView": len(self._views) - 1, "componentType": component, "count": count, "type": kind}
        )
        return len(self._accessors) - 1
