"""A bellows: a wall of one thickness around an axis, with folds, closed by a cap; structured, without Gmsh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import Primitive
from softcal.geometry.quadratic import of_order
from softcal.geometry.quality import require_sound
from softcal.geometry.regions import Cavity, Plane
from softcal.geometry.surface import boundary_faces
from softcal.geometry.sweep import sweep
from softcal.limits import LIMITS
from softcal.quantities import Size

FINE = 400  # points of a fold, between which its length is measured
NEWTON = 5  # iterations from the nearest of these points, which leave rounding errors
ROUNDING = 9  # decimals [m]: nodes of two parts of the section that are nearer than this are one


@dataclass(frozen=True)
class Bellows(Primitive):
    """A bellows about z, open at z = 0, where it has a root, and closed by a flat cap on top.

    The middle of its wall is a wave, r = mean - a cos(2 pi z / pitch), with the wall at right angles to it.

    Attributes
    ----------
    outer_diameter, root_diameter : Outer diameters of the wall at the crests of its folds, and between these [m]
    pitch : Length of a fold along the axis [m]
    wall : Thickness of the wall [m]
    cap : Thickness of the cap [m]
    folds : Number of folds along the axis
    layers, rings : Numbers of elements along a fold, and across the wall and the cap
    sectors : Number of elements around the axis, even
    order : 2 for quadratic tets, 1 for linear ones
    """

    outer_diameter: Size
    root_diameter: Size
    pitch: Size
    wall: Size
    cap: Size
    folds: Annotated[int, LIMITS["bells"]] = 3
    layers: Annotated[int, LIMITS["layers of elements"]] = 8
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    sectors: Annotated[int, LIMITS["sectors"]] = 12
    order: Literal[1, 2] = 2

    lengths: ClassVar[tuple[str, ...]] = ("outer_diameter", "root_diameter", "pitch", "wall", "cap")

    def __post_init__(self) -> None:
        super().__post_init__()
        faults: list[Fault] = []
        if self.sectors % 2:
            faults.append(
                Fault("a bellows is swept in pairs of sectors", "sectors", str(self.sectors), "an even number")
            )
        if not 2.0 * self.wall < self.root_diameter < self.outer_diameter:
            got, allowed = f"{self.root_diameter:g} m", "between 2 x wall and outer_diameter"
            faults.append(Fault("a diameter of the bellows does not fit", "root_diameter", got, allowed))
        sharpest = 1.0 / ((2.0 * math.pi / self.pitch) ** 2 * max(self.amplitude, 1e-12))
        if 0.5 * self.wall >= sharpest:
            got, allowed = f"{self.wall:g} m", f"< {2.0 * sharpest:.3g} m, twice the least radius of its middle"
            faults.append(Fault("the wall is too thick for its folds", "wall", got, allowed))
        if faults:
            raise MeshError(faults)

    @property
    def amplitude(self) -> float:
        """Of the wave [m]."""
        return 0.25 * (self.outer_diameter - self.root_diameter)

    @property
    def height(self) -> float:
        """Of the cap's outer side [m]."""
        return self.folds * self.pitch + self.cap

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        """Those of the cap, and the outermost."""
        root = 0.5 * self.root_diameter
        return (0.0, root - self.wall, root, 0.5 * self.outer_diameter), (0.0, self.folds * self.pitch, self.height)

    def shares(self, places: Floats) -> Floats:
        """As `Primitive.shares`, in the cap; in the wall the shares of its thickness and of its length, this less 1."""
        from scipy.spatial import KDTree

        shares = super().shares(places)
        in_wall = places[:, 1] < self.folds * self.pitch - 10.0**-ROUNDING
        fine, lengths = self._fold
        points = np.linspace(0.0, self.folds * self.pitch, self.folds * FINE + 1)
        _, nearest = KDTree(np.column_stack([self._middle(points)[0], points])).query(places[in_wall])
        z = points[nearest]
        for _ in range(NEWTON):
            r, slope, bend = self._middle(z)
            dr, dz = places[in_wall].T - [r, z]
            z = np.clip(z + (dz + dr * slope) / (1.0 + slope**2 - dr * bend), 0.0, points[-1])
        r, slope, _ = self._middle(z)
        dr, dz = places[in_wall].T - [r, z]
        folds = np.minimum(np.floor(z / self.pitch), self.folds - 1)
        along = (folds + np.interp(z - folds * self.pitch, fine, lengths) / lengths[-1]) / self.folds
        shares[in_wall] = np.column_stack([(dr - dz * slope) / np.hypot(1.0, slope) / self.wall, along - 1.0])
        return shares

    def places(self, shares: Floats) -> Floats:
        places = super().places(shares)
        in_wall = shares[:, 1] <= 0.0
        places[in_wall] = self._in_wall(shares[in_wall, 0], shares[in_wall, 1] + 1.0)
        return places

    def mesh(self) -> TetMesh:
        """The mesh [m], with node and face sets "foot", at z = 0, "top" and "cavity", the wall of the chamber.

        Raises
        ------
        MeshError
            For too many tets.
        """
        n_tets = 6 * self.sectors * self.rings * (self.folds * self.layers + 2 * self.rings)
        if fault := LIMITS["tets"].fault(n_tets, "bellows"):
            raise MeshError(fault)
        # Nodes (r, z) [m] of quadratic elements: of the wall, along it and from inside to outside; of the cap, over the
        # wall and over the opening between.
        along, across = np.meshgrid(
            np.linspace(0.0, 1.0, 2 * self.layers * self.folds + 1), np.linspace(-0.5, 0.5, 2 * self.rings + 1)
        )
        heights = self.folds * self.pitch + self.cap * np.linspace(0.0, 1.0, 2 * self.rings + 1)
        outer = 0.5 * self.root_diameter
        inner = outer - self.wall
        n = max(1, round(inner / self.cap))
        over = np.linspace(inner, outer, 2 * self.rings + 1), np.linspace(0.0, inner, 2 * n + 1)
        cap = [np.stack(np.meshgrid(r, heights), axis=-1) for r in over]
        patches = [self._in_wall(across.T, along.T), *cap]
        section, number = np.unique(
            np.round(np.concatenate([patch.reshape(-1, 2) for patch in patches]), ROUNDING), axis=0, return_inverse=True
        )
        first = np.cumsum([0, *(patch[..., 0].size for patch in patches)])
        triangles = [number.ravel()[k + _triangles(patch.shape[:2])] for k, patch in zip(first, patches, strict=False)]
        mesh = sweep(section, np.concatenate(triangles), sectors=self.sectors)
        require_sound(mesh, "bellows")
        faces, z = boundary_faces(mesh), mesh.points[:, 2]
        face_sets = {
            "foot": faces[(z[faces] < 1e-9).all(axis=1)],
            "top": faces[(z[faces] > self.height - 1e-9).all(axis=1)],
            "cavity": Cavity((0.0, 0.0, self.height - self.cap), (Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),)).faces(
                mesh
            ),
        }
        node_sets: dict[str, Ints] = {name: np.unique(rows) for name, rows in face_sets.items()}
        return of_order(TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets), self.order)

    def _in_wall(self, across: Floats, along: Floats) -> Floats:
        """Places (..., 2) [m] by shares of the wall's thickness, from its middle, and of its length."""
        fine, lengths = self._fold
        folds = np.minimum(np.floor(along * self.folds), self.folds - 1)
        z = folds * self.pitch + np.interp((along * self.folds - folds) * lengths[-1], lengths, fine)
        r, slope, _ = self._middle(z)
        offset = self.wall * across / np.hypot(1.0, slope)
        return np.stack([r + offset, z - offset * slope], axis=-1)

    def _middle(self, z: Floats) -> tuple[Floats, Floats, Floats]:
        """Radius of the wall's middle [m] at heights [m], and its derivatives by the height [-], [1/m]."""
        wave = 2.0 * math.pi / self.pitch
        r = 0.25 * (self.outer_diameter + self.root_diameter) - 0.5 * self.wall - self.amplitude * np.cos(wave * z)
        return r, self.amplitude * wave * np.sin(wave * z), self.amplitude * wave**2 * np.cos(wave * z)

    @property
    def _fold(self) -> tuple[Floats, Floats]:
        """Heights in a fold [m], and the length of the wall's middle up to them [m]."""
        fine = np.linspace(0.0, self.pitch, FINE + 1)
        return fine, np.append(0.0, np.cumsum(np.hypot(np.diff(fine), np.diff(self._middle(fine)[0]))))


def _triangles(shape: tuple[int, int]) -> Ints:
    """Two quadratic triangles (k, 6) of each element of a grid with a node between any two corners."""
    node = np.arange(shape[0] * shape[1]).reshape(shape)
    c = [node[i : shape[0] - 2 + i : 2, j : shape[1] - 2 + j : 2].ravel() for i in range(3) for j in range(3)]
    return np.concatenate(
        [np.stack([c[k] for k in which], axis=1) for which in ((0, 2, 8, 1, 5, 4), (0, 8, 6, 4, 7, 3))]
    )
