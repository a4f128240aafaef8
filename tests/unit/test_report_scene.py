"""Scenes: surfaces, plates, cameras, and the sentence where there is no renderer."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text
from report_example import column_mesh, example_content, neck_robot, twin_view

from softcal.geometry.cell import TET_EDGES
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.surface import border, boundary, boundary_triangles
from softcal.report import check_figures
from softcal.report.check_figures import draw_check, region_colours, robot_scenes
from softcal.report.figure import FIGURES
from softcal.report.figures import twin
from softcal.report.robot_view import material_colours
from softcal.report.scene import (
    Arrow,
    FlatDisc,
    Label,
    Surface,
    Tube,
    Wire,
    alike,
    extent_points,
)
from softcal.report.scene_figure import draw_side_by_side
from softcal.report.scene_render import Rendering, panel_size, render_scenes
from softcal.report.scene_twin import twin_parts, twin_scenes
from softcal.report.scene_worker import from_behind
from softcal.report.style import DPI, MUTED, encode, new_figure
from softcal.twin.facing import plate_normal, plate_radius
from softcal.twin.material import Material
from softcal.twin.robot import ViaPoint

UNIT = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def blank(n: int) -> Rendering:
    """Pictures of nothing."""
    return Rendering((np.zeros((4, 4, 4), dtype=np.uint8),) * n)


def enclosed(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def test_the_surface_is_closed_and_points_outwards() -> None:
    mesh = column_mesh()
    edges = mesh.points[mesh.tets[:, 1:]] - mesh.points[mesh.tets[:, :1]]
    volume = np.linalg.det(edges).sum() / 6
    assert enclosed(mesh.points, boundary_triangles(mesh.tets)) == pytest.approx(volume, rel=1e-9)


def test_a_quadratic_face_gives_four_triangles() -> None:
    points = np.concatenate([UNIT, [UNIT[list(pair)].mean(axis=0) for pair in TET_EDGES]])
    triangles = boundary_triangles(np.arange(10)[None])
    assert triangles.shape == (16, 3)
    assert enclosed(points, triangles) == pytest.approx(1 / 6)


def test_quadratic_faces_are_drawn_curved() -> None:
    points = np.concatenate([UNIT, [UNIT[list(pair)].mean(axis=0) for pair in TET_EDGES]])
    tets = np.arange(10)[None]
    fine = fine_surface(boundary(tets))
    assert fine.triangles.shape == (64, 3)
    assert fine.edges.shape == (6, 5), "every edge once"
    assert len(np.unique(fine.triangles)) == len(fine.nodes) == 34, "every point once"
    assert enclosed(fine.at(points), fine.triangles) == pytest.approx(1 / 6)
    x, y, z = points.T
    curved = np.stack([x + 0.3 * y * z, y - 0.2 * x**2, z + 0.1 * x * y], axis=1)  # quadratic, as the element is
    x, y, z = fine.at(points).T
    exact = np.stack([x + 0.3 * y * z, y - 0.2 * x**2, z + 0.1 * x * y], axis=1)
    np.testing.assert_allclose(fine.at(curved), exact, atol=1e-12)
    for most, n in ((64, 64), (63, 16), (15, 4), (1, 4)):
        coarse = fine_surface(boundary(tets), most)
        assert coarse.triangles.shape == (n, 3)
        assert enclosed(coarse.at(points), coarse.triangles) == pytest.approx(1 / 6)
    linear = fine_surface(boundary(tets[:, :4]))
    assert (linear.triangles.shape, linear.edges.shape) == ((4, 3), (6, 2))


def test_the_plate_covers_its_cables_and_faces_away_from_the_base() -> None:
    robot = neck_robot(column_mesh())
    np.testing.assert_allclose(plate_normal(robot, robot.plates[0]), [0, 0, 1], atol=0.05)
    assert plate_radius(robot, robot.plates[0]) == pytest.approx(1.08 * 0.05, rel=0.02)


def test_the_camera_holds_everything_and_bends_to_the_right() -> None:
    found = twin_scenes(twin_view(column_mesh()))
    camera = found.camera
    frame = np.stack([camera.right, camera.up, camera.back])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(camera.right, camera.up), camera.back, atol=1e-12)
    left, right, bottom, top = camera.window
    x, y, _ = camera.project(extent_points(found.scenes)).T
    assert left < x.min()
    assert x.max() < right
    assert bottom < y.min()
    assert y.max() < top
    plate = camera.project(np.array([[0, 0, 0.1], [0.04, 0, 0.09]]))
    assert plate[1, 0] > plate[0, 0]


def test_the_largest_displacement_tops_the_colours() -> None:
    view = twin_view(column_mesh(), 0.7)
    moved = np.linalg.norm(view.bent.points["neck"] - view.rest.points["neck"], axis=1)
    assert twin_scenes(view).largest == pytest.approx(moved.max())


def test_two_views_get_windows_of_one_size() -> None:
    _, cameras = robot_scenes(neck_robot(column_mesh()))
    windows = np.array([camera.window for camera in alike(cameras)])
    np.testing.assert_allclose(np.ptp(windows[:, :2], axis=1), np.ptp(windows[0, :2]))
    np.testing.assert_allclose(np.ptp(windows[:, 2:], axis=1), np.ptp(windows[0, 2:]))


def test_regions_are_told_apart() -> None:
    robot = neck_robot(column_mesh())
    colours = region_colours(robot, robot.bodies[0], boundary(robot.bodies[0].mesh.tets), "white")
    assert len(np.unique(colours, axis=0)) == 3


def test_materials_have_colours_of_their_own_and_a_legend(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = twin_view(column_mesh())
    (body,), tets = view.robot.bodies, view.tets["neck"]
    middle = body.mesh.points[tets].mean(axis=1)
    core = Material("core", np.flatnonzero(np.abs(middle[:, 2] - 0.05) < 0.01), {"youngs_modulus": 4e6})
    robot = replace(view.robot, bodies=(replace(body, inclusions=(core,)),))
    colours = material_colours(robot)
    assert list(colours) == ["neck", "neck.core"]
    (checked, _), _ = robot_scenes(robot)
    rest, bent = twin_scenes(replace(view, robot=robot)).scenes
    for scene in (checked, rest):
        outer, inner = [p for p in scene.parts if isinstance(p, Surface) and p.colour is not MUTED]
        assert outer.opacity < inner.opacity == 1.0, "what is inside is seen"
        shade = inner.colour if isinstance(inner.colour, str) else to_hex(np.unique(inner.colour, axis=0)[0])
        assert shade == colours["neck.core"]
        volume = np.linalg.det(np.diff(body.mesh.points[tets[core.elements]], axis=1)).sum() / 6
        assert enclosed(inner.points, inner.triangles) == pytest.approx(volume, rel=1e-9)
    assert all(part.opacity == 1.0 for part in bent.parts if isinstance(part, Surface))
    monkeypatch.setattr(check_figures, "render_scenes", lambda scenes, _: blank(len(scenes)))
    monkeypatch.setattr(twin, "render_scenes", lambda scenes, _: blank(len(scenes)))
    figures = [twin.draw_twin(replace(view, robot=robot)).figure]
    monkeypatch.setattr(check_figures, "as_png", lambda figure: figures.append(figure) or b"")
    draw_check(robot, {}, tmp_path)
    for figure in figures:
        (legend,) = figure.legends
        assert {"neck", "neck.core"} <= {text.get_text() for text in legend.get_texts()}


def test_a_plate_of_no_shape_is_the_outline_of_what_it_holds_and_leads_to_its_cables() -> None:
    view = twin_view(column_mesh())
    for scene in twin_scenes(view).scenes:
        (wire,) = [part for part in scene.parts if isinstance(part, Wire)]
        snapshot = view.rest if scene.title == view.rest.label else view.bent
        ends = [path[-1] for cable, path in snapshot.routes.items()]
        ring, *arms = wire.paths
        assert np.array_equal(ring[0], ring[-1])
        np.testing.assert_allclose([arm[-1] for arm in arms], ends, atol=1e-9)
        held = snapshot.points["neck"][view.robot.plates[0].nodes["neck"]]
        assert np.linalg.norm(ring[:, None] - held, axis=2).min(axis=1).max() < 1e-9
        (label,) = [label for label in scene.labels if label.text == "plate"]
        assert {*map(tuple, label.at)} == {*map(tuple, ring)}, "its name points to it"
    assert not [part for scene in robot_scenes(view.robot)[0] for part in scene.parts if isinstance(part, FlatDisc)]


def test_the_border_of_two_squares_is_two_loops() -> None:
    square = np.array([[0, 1, 2, 8, 9, 10], [0, 2, 3, 10, 11, 12]])
    loops = border(np.concatenate([square, square + 20]))
    assert [sorted(loop.tolist()) for loop in loops] == [
        sorted([*range(4), 0, 8, 9, 11, 12]),
        sorted([*range(20, 24), 20, 28, 29, 31, 32]),
    ]
    for loop in loops:
        assert loop[0] == loop[-1]
    assert border(square[:0]) == []


def test_loads_and_gravity_become_arrows_of_their_direction() -> None:
    scenes, _ = robot_scenes(neck_robot(column_mesh()))
    arrows = [part for part in scenes[0].parts if isinstance(part, Arrow)]
    assert len(arrows) == 2
    for arrow in arrows:
        assert (arrow.tip - arrow.tail)[2] < 0


def test_the_renderer_draws_or_says_why_not() -> None:
    found = twin_scenes(twin_view(column_mesh()))
    rendering = render_scenes(found.scenes, (found.camera, found.camera))
    if rendering.pictures:
        first, second = rendering.pictures
        assert first.shape == second.shape
        shown = DPI * np.array(panel_size(found.camera)[::-1])
        np.testing.assert_allclose(first.shape[:2], shown, atol=1.0, err_msg="as many pixels as are shown")
        assert first.shape[2] == 4
        assert 0.02 < (first[:, :, 3] > 0).mean() < 0.9
        assert (first != second).any()
    else:
        assert "the 3-D renderer" in rendering.note


def test_a_tube_that_is_seen_through_has_its_own_colour() -> None:
    view = twin_scenes(twin_view(column_mesh()))
    path = view.scenes[0].parts[0].extent[[0, -1]]
    tube = Tube(path, np.linspace(0.2, 0.1, 2) * np.ptp(path), colour="#808080", opacity=0.5)
    rendering = render_scenes((replace(view.scenes[0], parts=(tube,), labels=()),), (view.camera,))
    if rendering.note:
        pytest.skip(rendering.note)
    pixels = rendering.pictures[0].reshape(-1, 4).astype(float)
    drawn = pixels[pixels[:, 3] > 0, :3]
    assert len(drawn) > 100
    assert np.ptp(drawn, axis=1).max() < 10, "grey"


def test_a_figure_is_drawn_once_for_each_file(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = new_figure()
    axes = figure.add_subplot()
    figure.set_layout_engine("none")
    drawn: list[str] = []
    draw = axes.draw
    monkeypatch.setattr(axes, "draw", lambda renderer: drawn.append(type(renderer).__name__) or draw(renderer))
    encode(figure)
    assert len(drawn) == 2


def test_where_the_renderer_dies_a_sentence_stands_for_its_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    (drawn,) = FIGURES["twin"].function(replace(example_content(n_trials=3), twin=twin_view(column_mesh())))
    assert drawn.note.startswith("The pictures are missing, since the 3-D renderer (PyVista/VTK) does not work")
    assert "libegl1" in drawn.note
    assert all("no picture" in axes.texts[0].get_text() for axes in drawn.figure.axes[:2])
    assert encode(drawn.figure)[0].startswith(b"\x89PNG")


def test_labels_do_not_overlap() -> None:
    found = twin_scenes(twin_view(column_mesh()))
    crowded = tuple(Label(f"cable {k}", np.array([[0.05, 0.0, 0.1 + 1e-4 * k]])) for k in range(4))
    scenes = tuple(replace(scene, labels=scene.labels + crowded) for scene in found.scenes)
    cameras = (found.camera, found.camera)
    figure = draw_side_by_side(scenes, cameras, blank(2), largest=found.largest).figure
    figure.draw_without_rendering()
    for axes in figure.axes[:2]:
        assert axes._left_title.get_window_extent().y1 < figure.bbox.y1
        boxes = [Text.get_window_extent(text) for text in axes.texts]  # without the lines to the parts
        assert len(boxes) >= 8
        clashes = [(a, b) for i, a in enumerate(boxes) for b in boxes[i + 1 :] if a.overlaps(b)]
        assert not clashes


@pytest.mark.parametrize("many", [6, 60])
def test_names_near_the_foot_stay_in_the_picture_and_of_many_as_many_as_fit(many: int) -> None:
    scenes, cameras = robot_scenes(neck_robot(column_mesh(0.6)))
    foot = tuple(Label(f"cable {k}", np.array([[0.05, 0.0, 1e-4 * k]])) for k in range(many))
    figure = draw_side_by_side((replace(scenes[0], labels=foot),), cameras[:1], blank(1)).figure
    figure.draw_without_rendering()
    (axes,) = figure.axes
    boxes = [Text.get_window_extent(text) for text in axes.texts if text.get_text().startswith("cable")]
    room = axes.get_window_extent()
    assert all(room.y0 <= box.y0 < box.y1 <= room.y1 for box in boxes)
    assert not [(a, b) for i, a in enumerate(boxes) for b in boxes[i + 1 :] if a.overlaps(b)]
    assert len(boxes) == many if many == 6 else 12 < len(boxes) < many
    assert room.height <= 2 * room.width + 1


def test_a_body_with_cables_inside_is_seen_through() -> None:
    robot = neck_robot(column_mesh())
    inner = replace(robot.cables[0], via_points=(ViaPoint(np.array([0, 0, 0.05]), "neck"), *robot.cables[0].via_points))
    for cables, through in (((robot.cables[0],), False), ((inner,), True)):
        (scene, _), _ = robot_scenes(replace(robot, cables=cables))
        (body,) = [part for part in scene.parts if isinstance(part, Surface) and part.edges is not None]
        assert (body.opacity < 1) is through


def test_a_surface_to_see_through_is_drawn_from_behind() -> None:
    (scene, _), (camera, _) = robot_scenes(neck_robot(column_mesh()))
    (body,) = [part for part in scene.parts if isinstance(part, Surface) and part.edges is not None]
    tints = np.arange(len(body.triangles))[:, None] / len(body.triangles) * np.ones(3)
    mesh = replace(body, colour=tints).mesh()
    drawn = from_behind(mesh, camera)
    depth = (drawn.points[drawn.regular_faces].mean(axis=1) @ camera.back).round(12)
    assert np.all(np.diff(depth) >= 0)
    kept = {(*face, *tint) for face, tint in zip(mesh.regular_faces.tolist(), mesh["colour"].tolist(), strict=True)}
    assert {(*f, *t) for f, t in zip(drawn.regular_faces.tolist(), drawn["colour"].tolist(), strict=True)} == kept


@pytest.mark.parametrize("height", [0.04, 0.1067, 0.3])
def test_the_colours_legend_is_whole_on_a_narrow_picture(height: float) -> None:
    robot = neck_robot(column_mesh(height))
    scenes, cameras = robot_scenes(robot)
    names = ["body", "fixed", "plate (nodes, via points)", "cable", "via point in space", "via point on a body", "load"]
    figure = draw_side_by_side(scenes, cameras, blank(2), colours=dict.fromkeys(names, "#808080")).figure
    figure.draw_without_rendering()
    (legend,) = figure.legends
    box, page = legend.get_window_extent(), figure.bbox
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert page.y0 <= box.y0 < box.y1 <= min(axes.get_window_extent().y0 for axes in figure.axes)


def test_what_is_fixed_is_grey_and_nothing_is_drawn_beneath_it() -> None:
    """No part of the picture reaches beyond the robot's own, and the clamped faces have a colour of their own."""
    view = twin_view(column_mesh())
    robot = view.robot
    shades = {name: np.zeros(len(points)) for name, points in view.rest.points.items()}
    parts, _ = twin_parts(view, view.rest, shades, 1.0)
    low = min(float(part.points[:, 2].min()) for part in parts if isinstance(part, Surface))
    assert low == pytest.approx(robot.bodies[0].mesh.points[:, 2].min(), abs=1e-12)
    grey = [part for part in parts if isinstance(part, Surface) and isinstance(part.colour, str)]
    assert [part.colour for part in grey] == [MUTED]
    assert grey[0].points[grey[0].triangles][..., 2].max() <= 0.014
    free = replace(robot, bodies=tuple(replace(body, fixed=np.array([], dtype=int)) for body in robot.bodies))
    parts, _ = twin_parts(replace(view, robot=free), view.rest, shades, 1.0)
    assert not [part for part in parts if isinstance(part, Surface) and isinstance(part.colour, str)]
