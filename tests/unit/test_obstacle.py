"""Obstacles: their distances, the deepest points of triangles, and files of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import softcal
from softcal.geometry.obstacle import BoxObstacle, HalfSpace, Obstacle, SphereObstacle
from softcal.project.obstacles import read_obstacles

EACH = {
    "half-space": HalfSpace((0.01, 0.0, -0.02), (1.0, 2.0, 2.0)),
    "sphere": SphereObstacle((0.01, -0.02, 0.03), 0.02),
    "box": BoxObstacle((-0.02, -0.01, 0.0), (0.01, 0.03, 0.04)),
}


@pytest.mark.parametrize("obstacle", EACH.values(), ids=EACH)
def test_the_distance_is_that_to_its_surface_and_has_its_gradient(obstacle: Obstacle) -> None:
    random, h = np.random.default_rng(0), 1e-7
    points = random.uniform(-0.06, 0.06, (200, 3))
    d, n = obstacle.distances(points)
    assert (d < 0.0).any()
    assert (d > 0.0).any()
    assert np.linalg.norm(n, axis=1) == pytest.approx(np.ones(200))
    ahead, behind = (np.array([obstacle.distances(points + s * axis)[0] for axis in np.eye(3)]) for s in (h, -h))
    assert ((ahead - behind) / (2.0 * h)).T == pytest.approx(n, abs=1e-5)
    on_it = obstacle.distances(points - d[:, None] * n)[0]
    assert on_it == pytest.approx(np.zeros(200), abs=1e-12), "along the gradient the surface is as far as the distance"


@pytest.mark.parametrize("obstacle", EACH.values(), ids=EACH)
def test_the_deepest_point_of_a_triangle_is_deeper_than_all_others(obstacle: Obstacle) -> None:
    random = np.random.default_rng(1)
    corners = random.uniform(-0.05, 0.05, (40, 3, 3))
    corners[:10, 2] = corners[:10, 1]  # segments, as of rods
    shares = obstacle.deepest(corners)
    assert shares.sum(axis=1) == pytest.approx(np.ones(40))
    assert shares.min() >= 0.0
    own = obstacle.distances(np.einsum("nk,nkj->nj", shares, corners))[0]
    others = random.dirichlet(np.full(3, 0.5), 20_000)
    for triangle, depth in zip(corners, own.tolist(), strict=True):
        assert depth <= obstacle.distances(others @ triangle)[0].min() + 1e-8


@pytest.mark.parametrize("obstacle", EACH.values(), ids=EACH)
def test_its_drawing_is_its_surface(obstacle: Obstacle) -> None:
    points, triangles = obstacle.drawn(np.zeros(3), 0.1)
    assert obstacle.distances(points)[0] == pytest.approx(np.zeros(len(points)), abs=1e-12)
    assert set(triangles.ravel().tolist()) <= set(range(len(points)))
    if not isinstance(obstacle, HalfSpace):  # closed: the volume that its triangles enclose is its own
        a, b, c = (points[triangles[:, k]] for k in range(3))
        volume = 4.0 / 3.0 * np.pi * 0.02**3 if isinstance(obstacle, SphereObstacle) else 0.03 * 0.04 * 0.04
        assert abs(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0 == pytest.approx(volume, rel=0.05)


FILE = """\
obstacles:
  table: {half_space: {point: [0 mm, 0 mm, -10 mm], normal: [0, 0, 2]}}
  ball: {sphere: {centre: [2 cm, 0 mm, 150 mm], radius: 10 mm}}
  wall: {box: {lower: [-1 cm, -1 cm, 0 mm], upper: [1 cm, 1 cm, 5 mm]}}
"""


def test_a_file_has_obstacles_with_units(tmp_path: Path) -> None:
    path = tmp_path / "around.yaml"
    path.write_text(FILE)
    found = read_obstacles(path)
    assert list(found) == ["table", "ball", "wall"]
    table, ball, wall = found.values()
    point = np.array([[0.02, 0.0, 0.13]])
    assert [float(one.distances(point)[0][0]) for one in (table, ball, wall)] == pytest.approx(
        [0.14, 0.01, np.hypot(0.01, 0.125)]
    )


FAULTS = {
    "no unit": ("ball: {sphere: {centre: [1, 0 mm, 0 mm], radius: 10 mm}}", "the unit is missing"),
    "another unit": ("ball: {sphere: {centre: [0 mm, 0 mm, 0 mm], radius: 10 N}}", "the unit does not fit"),
    "NaN": ("ball: {sphere: {centre: [.nan mm, 0 mm, 0 mm], radius: 10 mm}}", "this is not a quantity"),
    "no radius": ("ball: {sphere: {centre: [0 mm, 0 mm, 0 mm]}}", "'radius' must be given"),
    "a negative radius": ("ball: {sphere: {centre: [0 mm, 0 mm, 0 mm], radius: -1 mm}}", "the size is out of range"),
    "another shape": ("ball: {cone: {}}", "unknown key"),
    "no shape": ("ball: {}", "an obstacle has one shape"),
    "two shapes": (
        "ball: {sphere: {centre: [0 mm, 0 mm, 0 mm], radius: 1 mm}, box: {lower: [0 mm, 0 mm, 0 mm], "
        "upper: [1 mm, 1 mm, 1 mm]}}", "an obstacle has one shape"),
    "inside out": ("wall: {box: {lower: [2 mm, 0 mm, 0 mm], upper: [1 mm, 1 mm, 1 mm]}}", "turned inside out"),
    "no direction": ("table: {half_space: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 0]}}", "direction"),
    "no name": ("a b: {sphere: {centre: [0 mm, 0 mm, 0 mm], radius: 1 mm}}", "this cannot be a name"),
    "none": ("{}", "there are no obstacles"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_file_of_obstacles_that_is_none_is_refused(name: str, tmp_path: Path) -> None:
    text, told = FAULTS[name]
    path = tmp_path / "around.yaml"
    path.write_text(f"obstacles:\n  {text}\n")
    with pytest.raises(softcal.InputError, match=told) as refused:
        read_obstacles(path)
    assert "around.yaml" in str(refused.value)


def test_an_obstacle_of_python_is_checked_as_that_of_a_file() -> None:
    for made in (
        lambda: SphereObstacle((0.0, 0.0, np.nan), 0.01),
        lambda: SphereObstacle((0.0, 0.0, 0.0), 0.0),
        lambda: HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        lambda: BoxObstacle((0.0, 0.0, 0.0), (0.0, 1.0, 1.0)),
    ):
        with pytest.raises(softcal.InputError):
            made()
