"""Tendons that are knotted in the wall of a soft body or in its bore, that come from a plate, or run over grooves."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import elastic

from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.routing import bored
from softcal.twin.simulate import simulate

needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")


def block(n: int, wide: float, *, drilled: bool) -> TetMesh:
    """A cube [m] with n bricks along an edge; drilled: without those in the middle third, all along z."""
    whole = box_mesh((wide, wide, wide), (n, n, n), origin=(-0.5 * wide, -0.5 * wide, 0.0))
    aside = np.abs(whole.points[whole.tets].mean(axis=1))[:, :2]
    tets = whole.tets[~(aside < wide / 6.0).all(axis=1)] if drilled else whole.tets
    used, numbered = np.unique(tets, return_inverse=True)
    return TetMesh(whole.points[used], numbered.reshape(-1, 4))


def pulled_out(radius: float | None, n: int, wide: float, *, drilled: bool) -> float:
    """How far a cable that ends in the middle of the block is pulled out, over the block's width."""
    mesh = block(n, wide, drilled=drilled)
    body = Body("block", mesh, np.flatnonzero(mesh.points[:, 2] < 1e-9), elastic(1e5, 0.4), element="P2")
    at = np.array([0.0, 0.0, 0.5 * wide]) if drilled else np.array([0.005, -0.01, 0.515]) * wide
    cable = Cable("front", (ViaPoint(at, "block", radius), ViaPoint(at + [0.0, 0.0, 1.5 * wide])))
    tension = Command("tension", np.array([500.0 * wide**2]))
    response = simulate(Robot((body,), cables=(cable,)), Protocol({"front": tension}))
    assert response.succeeded, response.status
    return float(response.channels["front.shortening"][0]) / wide


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wide", "drilled", "meshes"),
    [(0.004, False, (4, 6, 9)), pytest.param(0.012, True, (3, 6, 9), marks=pytest.mark.long)],
)
def test_a_knot_is_pulled_out_as_far_in_any_mesh_and_a_point_is_not(wide: float, drilled: bool, meshes: tuple) -> None:
    """Of the extent by default: 1 mm in the material, 5 mm in a bore of 4 mm."""
    knot, point = ([pulled_out(radius, n, wide, drilled=drilled) for n in meshes] for radius in (None, 0.0))
    assert knot[2] == pytest.approx(knot[1], rel=0.05)
    assert knot[2] - knot[1] < knot[1] - knot[0]
    assert point[2] > 1.4 * point[0]
    assert point[2] > 3.0 * knot[2]


STEP = """\
import gmsh, sys
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
for name, grooves in (("plain", ()), ("grooved", (20, 32, 44))):
    gmsh.clear()
    cuts = [(3, occ.addCylinder(3, 0, -1, 0, 0, 62, 1.0))]
    cuts += [(3, occ.addBox(0, -7, z, 7, 14, 3)) for z in grooves]
    occ.cut([(3, occ.addBox(-6, -6, 0, 12, 12, 60))], cuts)
    occ.synchronize()
    gmsh.write(sys.argv[1] + "/" + name + ".step")
"""
TALL = 0.060
E = 0.9e6


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finger of 12 x 12 x 60 mm with a bore of 2 mm beside its axis, with and without grooves over the bore."""
    folder = tmp_path_factory.mktemp("finger")
    subprocess.run([sys.executable, "-c", STEP, str(folder)], check=True, capture_output=True)
    return folder


# Where the tendon begins: part, and position [mm]. From there it runs in the bore to the foot.
BEGINS = {
    "in the wall": ("plain", ("finger", 4.5, 57.0), ("finger", 3.0, 52.0)),
    "in the bore": ("plain", ("finger", 3.0, 50.0)),
    "in the bore below the end": ("plain", ("finger", 3.0, 59.5)),
    "from the plate": ("plain", ("tip", 3.0, 60.0)),
    "over grooves": ("grooved", ("finger", 3.0, 55.0)),
}


def finger(models: Path, kind: str, size: float) -> Robot:
    model, *begins = BEGINS[kind]
    mesh = mesh_file(models / f"{model}.step", size=size, edges_around=6)
    z = mesh.points[:, 2]
    body = Body("finger", mesh, np.flatnonzero(z < 1e-9), elastic(E, 0.45), element="P2P1")
    tip = Plate("tip", {"finger": np.flatnonzero(z > TALL - 1e-9)}, np.array([0.0, 0.0, TALL]))
    points = [*begins, ("finger", 3.0, 0.5), ("", 3.0, -10.0)]
    via = [ViaPoint(1e-3 * np.array([x, 0.0, z]), on) for on, x, z in points]
    return Robot((body,), plates=(tip,), cables=(Cable("tendon", bored(via, {"finger": mesh})),))


@needs_gmsh
@pytest.mark.long
@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=() if kind == "in the wall" else pytest.mark.long) for kind in BEGINS],
)
def test_a_finger_is_solved_and_its_modulus_is_that_of_a_finer_mesh(models: Path, kind: str) -> None:
    """Pulled by 4.5 mm: by shortening, tensions are proportional to E. Straight from the plate: 34 % too high."""
    protocol = Protocol({"tendon": Command("shortening", np.array([1.5e-3, 3.0e-3, 4.5e-3]))})
    pulled, record = (simulate(finger(models, kind, size), protocol) for size in (4e-3, 2.5e-3))
    assert pulled.succeeded, pulled.status
    assert pulled.n_factorisations < 20
    mine, measured = (response.channels["tendon.tension"] for response in (pulled, record))
    assert mine @ measured / (mine @ mine) == pytest.approx(1.0, abs=0.03)
