"""The neck's shape and meshes, and meshing of surfaces and CAD models; needs Gmsh, but for the shape."""

import importlib.util
import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softcal.errors import InputError, MeshError
from softcal.geometry import generate
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.generate import mesh_file
from softcal.geometry.neck import Neck
from softcal.geometry.quality import check_quality, require_sound
from softcal.geometry.read import read_mesh
from softcal.geometry.regions import boundary_faces
from softcal.processes import run

SHARED = Path(__file__).parents[3] / "shared" / "data" / "sofa"
# Of the silhouette: distance below a waist and width, in outer diameters.
DIGITISED = (
    (0.007, 0.587), (0.04, 0.717), (0.073, 0.817), (0.107, 0.880), (0.14, 0.920), (0.173, 0.947), (0.207, 0.970),
    (0.273, 0.997), (0.307, 1.0),
)  # fmt: skip
needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/data/sofa is not there")


def volume_of_revolution(profile: np.ndarray) -> float:
    r, z = profile.T
    return float(np.pi / 3 * ((r[1:] ** 2 + r[1:] * r[:-1] + r[:-1] ** 2) * np.diff(z)).sum())


def test_the_default_neck_is_the_published_one():
    shape = Neck(tets=1700)
    assert shape.height == pytest.approx(0.106704, abs=1e-9)
    assert shape.collar_start == pytest.approx(0.038 * (0.617 + 4 * 0.481))
    profile = shape.profile()
    assert profile.max(axis=0) == pytest.approx([0.019, 0.106704])
    assert np.all(np.diff(profile[:, 1]) >= -1e-15)
    assert np.all(np.linalg.norm(np.diff(profile, axis=0), axis=1) > 0)


def test_the_default_dome_is_the_digitised_one():
    shape = Neck(1.0, tets=1700)
    for below, width in DIGITISED:
        assert shape.dome_radius(below) == pytest.approx(0.5 * width, abs=0.0145 if below < 0.01 else 0.011)
    # It rises from the waist, under the flat link above, by some 26 degrees.
    rise = 1e-6 / (shape.dome_radius(1e-6) - shape.dome_radius(0.0))
    assert math.degrees(math.atan(rise)) == pytest.approx(26.0, abs=1.0)


def test_a_dome_goes_through_its_points_and_never_turns_back():
    points = tuple((below / 0.3, (width - 0.587) / 0.413) for below, width in DIGITISED[1:-1])
    shape = Neck(1.0, dome=points, tets=1700)
    for (below, width), (share, _) in zip(DIGITISED[1:-1], points, strict=True):
        assert shape.dome_radius(share * shape.dome_height) == pytest.approx(0.5 * width, abs=1e-12), below
    radii = [shape.dome_radius(below) for below in np.linspace(0.0, 0.31, 400)]
    assert (radii[0], radii[-1]) == pytest.approx((0.2935, 0.5))
    assert np.all(np.diff(radii) >= 0.0)


@needs_gmsh
@pytest.mark.parametrize("sectors", [None, 8])
@pytest.mark.parametrize("dome", ["cubic", "ellipse", ((0.1, 0.4), (0.5, 0.9))], ids=["cubic", "ellipse", "points"])
def test_the_mesh_follows_the_dome(dome, sectors):
    shape = Neck(size=0.006, dome=dome, sectors=sectors)
    mesh = shape.mesh()
    below = shape.waists[1] - mesh.points[:, 2]
    r = np.linalg.norm(mesh.points[:, :2], axis=1)
    onto = np.array([shape.dome_radius(depth) for depth in below])
    surface = np.zeros(len(r), dtype=bool)
    surface[np.unique(mesh.face_sets["outer"][:, :3])] = True  # the corners: middles of a sweep's edges may lie beside
    on_dome = surface & (below > 1e-9) & (below < shape.dome_height)
    assert on_dome.sum() >= 8
    assert r[on_dome] == pytest.approx(onto[on_dome], abs=2e-6)


@needs_shared
def test_the_profile_carries_the_reference_mesh():
    shape = Neck(tets=1700, dome="ellipse")
    mesh = read_mesh(SHARED / "neck-2792.vtu")
    description = json.loads((SHARED / "neck-shortening.json").read_text())
    assert shape.outer_diameter == description["outer_diameter_m"]
    assert shape.height == pytest.approx(description["height_m"], abs=1e-12)
    outer = mesh.points[np.unique(boundary_faces(mesh))]
    r, z = np.linalg.norm(outer[:, :2], axis=1), outer[:, 2]
    line = shape.profile(400)
    start, step = line[:-1], np.diff(line, axis=0)
    along = np.clip(
        np.einsum("pij,ij->pi", np.stack([r, z], axis=1)[:, None] - start, step) / (step**2).sum(axis=1), 0, 1
    )
    foot = start + along[..., None] * step
    distance = np.linalg.norm(foot - np.stack([r, z], axis=1)[:, None], axis=2).min(axis=1)
    assert distance.max() < 1e-7
    # The clamp's and the collar's sets are those that the reference was computed with.
    assert np.any(np.isclose(z, shape.collar_start, atol=1e-9))


@pytest.mark.parametrize("diameter", [0.025, 0.040])
def test_a_scaled_neck_keeps_its_proportions(diameter):
    shape = Neck(diameter, tets=1700)
    assert shape.height / diameter == pytest.approx(2.808)
    assert shape.profile() == pytest.approx(Neck(tets=1700).profile() * diameter / 0.038)


@pytest.mark.parametrize(
    ("lengths", "wrong"),
    [
        ({"waist_diameter": 0.05, "clamp_depth": 0.0, "n_bells": 0}, ["n_bells", "clamp_depth"]),
        ({"waist_diameter": 0.05, "clamp_depth": 0.1, "sectors": 5}, ["sectors", "waist_diameter", "clamp_depth"]),
        ({"dome": ((0.2, 0.4), (0.2, 0.5))}, ["dome"]),
        ({"dome": ((0.2, 0.4), (0.4, 0.3)), "clamp_depth": 0.1}, ["dome", "clamp_depth"]),
    ],
    ids=["out-of-range", "misfits", "level-points", "turning-points"],
)
def test_all_faults_of_a_shape_are_told_at_once(lengths, wrong):
    with pytest.raises(InputError) as caught:
        Neck(tets=1700, **lengths)
    assert [fault.where for fault in caught.value.faults] == wrong


@needs_gmsh
@pytest.mark.parametrize("order", [1, 2])
def test_a_neck_mesh_has_its_sets_and_planes(order):
    shape = Neck(size=0.006, order=order)
    mesh = shape.mesh()
    report = require_sound(mesh)
    z = mesh.points[:, 2]
    exact = volume_of_revolution(shape.profile(2000))
    assert report.volume == pytest.approx(exact, rel=0.05 if order == 1 else 2e-3)
    assert mesh.order == order
    # No tet crosses the clamp's or the collar's plane.
    for height in (shape.clamp_depth, shape.collar_start):
        corner_heights = z[mesh.tets[:, :4]] - height
        assert np.all((corner_heights >= -1e-9).all(axis=1) | (corner_heights <= 1e-9).all(axis=1))
    assert z[mesh.node_sets["socket"]].max() == pytest.approx(shape.clamp_depth, abs=1e-9)
    assert z[mesh.node_sets["collar"]].min() == pytest.approx(shape.collar_start, abs=1e-9)
    assert np.all(z[mesh.node_sets["bottom"]] < 1e-9)
    assert np.all(z[mesh.node_sets["top"]] > shape.height - 1e-9)
    assert sum(len(faces) for faces in mesh.face_sets.values()) == len(boundary_faces(mesh))


@needs_gmsh
def test_quadratic_tets_follow_the_curved_surface():
    mesh = Neck(size=0.008).mesh()
    faces = mesh.face_sets["outer"]
    middles = np.unique(faces[:, 3:])
    skirt = middles[(mesh.points[middles, 2] > 1e-6) & (mesh.points[middles, 2] < 0.3 * 0.038)]
    assert len(skirt) > 10
    assert np.linalg.norm(mesh.points[skirt, :2], axis=1) == pytest.approx(0.019, rel=1e-6)
    # Every middle node lies nearer to the middle of its own edge than to that of any other edge of its tet.
    corners = mesh.points[mesh.tets[:, :4]]
    straight = np.stack([corners[:, list(edge)].mean(axis=1) for edge in TET_EDGES], axis=1)
    away = np.linalg.norm(mesh.points[mesh.tets[:, 4:]][:, :, None] - straight[:, None], axis=3)
    assert np.all(np.argmin(away, axis=2) == np.arange(6))


@needs_gmsh
@pytest.mark.parametrize(
    ("count", "order", "refinement"), [(2400, 1, 1.0), (9700, 1, 1.0), (1500, 2, 1.0), (3000, 2, 3.0)]
)
def test_a_target_count_is_met(count, order, refinement):
    mesh = Neck(tets=count, order=order, waist_refinement=refinement).mesh()
    assert mesh.n_tets == pytest.approx(count, rel=0.05)
    require_sound(mesh)


@needs_gmsh
@pytest.mark.parametrize(("count", "sectors"), [(2000, 6), (3000, 8)])
def test_a_swept_neck_meets_its_count_and_is_its_own_mirror_image(count, sectors):
    shape = Neck(tets=count, waist_refinement=12, sectors=sectors)
    mesh = shape.mesh()
    report = require_sound(mesh)
    assert mesh.n_tets == pytest.approx(count, rel=0.05)
    assert report.volume == pytest.approx(volume_of_revolution(shape.profile(2000)), rel=4e-3)
    assert mesh.points[mesh.node_sets["socket"], 2].max() == pytest.approx(shape.clamp_depth, abs=1e-9)
    assert mesh.points[mesh.node_sets["collar"], 2].min() == pytest.approx(shape.collar_start, abs=1e-9)
    places = np.round(mesh.points, 9) + 0.0
    twin = {tuple(place): i for i, place in enumerate(places)}
    mirror = np.array([twin[x, -y + 0.0, z] for x, y, z in places])
    cells = {frozenset(tet) for tet in mesh.tets.tolist()}
    assert cells == {frozenset(tet) for tet in mirror[mesh.tets].tolist()}


@needs_gmsh
def test_a_swept_neck_can_be_linear():
    mesh = Neck(size=0.008, order=1, sectors=8).mesh()
    assert mesh.order == 1
    assert require_sound(mesh).n_parts == 1
    assert len(mesh.face_sets["top"]) > 0


@needs_gmsh
def test_refined_waists_have_smaller_tets():
    shape = Neck(size=0.006, order=1)
    even = shape.mesh()
    graded = replace(shape, waist_refinement=3.0).mesh()

    def edge_at_waists(mesh):
        tets = mesh.points[mesh.tets]
        centre = tets.mean(axis=1)
        r = np.linalg.norm(centre[:, :2], axis=1)
        near = np.zeros(len(tets), dtype=bool)
        for height in shape.waists:
            near |= np.hypot(r - 0.5 * shape.waist_diameter, centre[:, 2] - height) < 0.0015
        return np.median([np.linalg.norm(tets[near, a] - tets[near, b], axis=1) for a, b in TET_EDGES])

    assert edge_at_waists(graded) < 0.5 * edge_at_waists(even)
    assert graded.n_tets < 6 * even.n_tets


@needs_gmsh
@pytest.mark.parametrize(
    "shape",
    [
        Neck(n_bells=1, size=0.007),
        Neck(n_bells=2, collar_diameter=0.03, size=0.007),
        Neck(n_bells=2, collar_diameter=0.01, size=0.007),
        Neck(n_bells=2, clamp_depth=0.005, size=0.007),
        Neck(n_bells=2, clamp_depth=0.038 * (0.617 - 0.3), size=0.007),
        Neck(n_bells=2, dome_height=0.481 * 0.038, size=0.007),
        Neck(n_bells=2, dome_height=0.0076, size=0.007),
        Neck(n_bells=2, dome_height=0.004, size=0.005),
        Neck(n_bells=2, size=0.007, dome="ellipse"),
    ],
    ids=[
        "one-bell",
        "wide-collar",
        "thin-collar",
        "clamped-skirt",
        "clamped-rim",
        "no-skirt",
        "round",
        "flat",
        "ellipse",
    ],
)
def test_every_length_can_be_changed(shape):
    mesh = shape.mesh()
    assert require_sound(mesh).volume == pytest.approx(volume_of_revolution(shape.profile(1000)), rel=5e-3)
    assert mesh.points[:, 2].max() == pytest.approx(shape.height)


@needs_gmsh
def test_the_same_input_gives_the_same_mesh():
    one, other = (Neck(size=0.009, order=1).mesh() for _ in range(2))
    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.tets, other.tets)


@needs_gmsh
def test_a_target_that_cannot_be_met_is_told():
    with pytest.raises(MeshError, match=r"no mesh of about 10 tets was found; got [0-9]+ tets at best"):
        Neck(n_bells=1, tets=10, order=1).mesh()


@pytest.mark.parametrize(
    ("target", "told"),
    [
        ({}, "got neither size nor tets"),
        ({"size": 0.01, "tets": 100}, "got size and tets"),
        ({"size": -1.0}, "size: the size is out of range; got -1 m"),
        ({"tets": 0}, "too few tets; got 0"),
        ({"size": 0.01, "waist_refinement": 0.5}, "got 0.5; allowed: 1 to 1000"),
        ({"size": 0.01, "sectors": 2}, "too few sectors; got 2; allowed: 4"),
        ({"size": 0.01, "sectors": 5}, "got 5 sectors; allowed: an even number"),
    ],
    ids=["none", "both", "size", "tets", "refinement", "few-sectors", "odd-sectors"],
)
def test_a_wrong_target_is_refused(target, told):
    with pytest.raises(InputError, match=told):
        Neck(**target).mesh()


def tetrahedron_stl(path: Path, *, faces: int = 4, height: float = 30) -> Path:
    corners = ((0, 0, 0), (30, 0, 0), (0, 30, 0), (0, 0, height))
    lines = ["solid t"]
    for face in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))[:faces]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {} {} {}".format(*corners[i]) for i in face]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid t"]))
    return path


@needs_gmsh
@pytest.mark.parametrize("order", [1, 2])
def test_a_closed_surface_is_filled(tmp_path, order):
    mesh = mesh_file(tetrahedron_stl(tmp_path / "t.stl"), tets=3000, order=order)
    assert mesh.n_tets == pytest.approx(3000, rel=0.05)
    assert require_sound(mesh).volume == pytest.approx(0.03**3 / 6, rel=1e-6)
    assert len(mesh.face_sets["surface"]) == len(boundary_faces(mesh))
    in_centimetres = mesh_file(tmp_path / "t.stl", size=0.05, unit="cm")
    assert check_quality(in_centimetres).volume == pytest.approx(0.3**3 / 6, rel=1e-6)


@pytest.mark.slow
@needs_gmsh
@pytest.mark.parametrize(
    ("size", "most"),
    [(5e-3, 2600), (4e-3, 3400), (3.75e-3, 3450), (3.25e-3, 7100)],
    ids=["as generated", "another algorithm", "with nodes moved", "with more nodes"],
)
def test_a_mesh_with_slivers_is_made_again_by_other_recipes(size, most, repository):
    report = check_quality(mesh_file(repository / "examples/finger/finger.stl", size=size))
    assert not report.slivers
    assert report.n_tets < most


@needs_gmsh
def test_slivers_in_a_sharp_edge_remain(tmp_path):
    """No recipe helps: the mesh is that of the first one, which has the fewest tets."""
    path = tetrahedron_stl(tmp_path / "wedge.stl", height=1.0)
    mesh = mesh_file(path, size=0.004)
    assert check_quality(mesh).slivers
    assert mesh.n_tets < 250


@needs_gmsh
@pytest.mark.parametrize("unit", ["MM", "M"])
def test_a_step_model_is_meshed_in_its_own_unit(tmp_path, unit):
    # Gmsh may only live in processes of its own, here as in the product.
    length = {"MM": 20.0, "M": 0.02}[unit]
    script = (
        "import gmsh, sys; gmsh.initialize(); gmsh.option.setNumber('General.Terminal', 0);"
        f"gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, {length}, {length / 4});"
        f"gmsh.model.occ.addBox({-length}, {-length}, {length}, {2 * length}, {2 * length}, {length / 2});"
        "gmsh.model.occ.synchronize(); gmsh.write(sys.argv[1]); gmsh.finalize()"
    )
    path = tmp_path / "part.step"
    subprocess.run([sys.executable, "-c", script, str(path)], check=True)
    if unit == "M":
        path.write_text(path.read_text().replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    mesh = mesh_file(path, size=0.004, order=2)
    # Two solids that touch are one body.
    assert require_sound(mesh).volume == pytest.approx(math.pi * 0.005**2 * 0.02 + 0.04**2 * 0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "content", "options", "told"),
    [
        ("part.obj", "x", {}, r"got '\.obj'; allowed: \.stl, \.step, \.stp"),
        ("none.stl", None, {}, "does not exist"),
        ("empty.stl", "", {}, "the file is empty"),
        ("part.step", "x", {"unit": "m"}, "carries its own unit"),
        pytest.param("text.stl", "hello", {}, "holds no triangles|no STL", marks=needs_gmsh),
        pytest.param("text.step", "hello", {}, "could not mesh|holds no solid", marks=needs_gmsh),
    ],
    ids=["suffix", "missing", "empty", "unit", "text-stl", "text-step"],
)
def test_files_that_cannot_be_meshed_are_told(tmp_path, capfd, name, content, options, told):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(MeshError, match=told) as caught:
        mesh_file(path, size=0.01, **options)
    assert str(path) in str(caught.value)
    assert capfd.readouterr() == ("", "")


@needs_gmsh
def test_a_size_in_the_wrong_unit_is_told(tmp_path):
    with pytest.raises(MeshError, match=r"the target size is too small; got a size that gives about 3\.8e\+13 tets"):
        mesh_file(tetrahedron_stl(tmp_path / "t.stl"), size=0.001, unit="m")


@needs_gmsh
def test_an_open_surface_is_told(tmp_path):
    with pytest.raises(MeshError, match="the surface is not closed; got 3 free edges"):
        mesh_file(tetrahedron_stl(tmp_path / "t.stl", faces=3), size=0.01)


def fake_worker(monkeypatch, script: str) -> None:
    def replaced(module, *arguments, **options):
        return run([sys.executable, "-c", script, *arguments], **options)

    monkeypatch.setattr(generate, "run_module", replaced)


@pytest.mark.parametrize(
    ("script", "told"),
    [
        ("import os; os.kill(os.getpid(), 11)", "Gmsh crashed; got signal 11: no message"),
        ("import sys; sys.stderr.write('lost\\n'); sys.exit(3)", "Gmsh crashed; got exit code 3: lost"),
        ("print('half a js')", "Gmsh crashed; got exit code 0: half a js"),
        ("import time; time.sleep(60)", "took too long and was stopped; got more than 0.7 s"),
    ],
    ids=["signal", "exit", "no-mesh", "hang"],
)
def test_a_worker_that_dies_or_hangs_is_told(monkeypatch, script, told):
    fake_worker(monkeypatch, script)
    with pytest.raises(MeshError, match=told):
        Neck(size=0.01).mesh(timeout=0.7)


@pytest.mark.parametrize(
    ("gmsh", "told"),
    [
        (None, r"Gmsh is not installed.*Try: pip install 'softcal\[mesh\]'"),
        ("raise OSError('libGLU.so.1: cannot open shared object file')", "Try: apt-get install libglu1-mesa"),
        ("raise OSError('libodd.so.2: cannot open shared object file')", "the package that holds libodd.so"),
    ],
    ids=["absent", "libGLU", "other"],
)
def test_what_to_install_is_told(tmp_path, monkeypatch, gmsh, told):
    (tmp_path / "gmsh.py").write_text(gmsh or "raise ImportError('No module named gmsh')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(MeshError, match=told):
        Neck(size=0.01).mesh()
