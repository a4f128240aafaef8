"""Markers measured and simulated over the robot's shapes: back from the bench's frame, and drawn from two sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softcal.calibration.results.result import Distance, ExperimentFit
from softcal.geometry.primitives import box_mesh
from softcal.geometry.surface import boundary_triangles
from softcal.report.figures.places import draw_places, markers_of
from softcal.report.outline import outline, two_views
from softcal.report.twin_view import EquilibriumShapes
from softcal.twin.response import Snapshot
from softcal.twin.robot import Body, Robot

OWN = {"a": (0.1, 0.0, 0.03), "b": (0.1, 0.02, 0.0), "c": (0.0, 0.0, 0.0)}
OFF = {"a": (1e-3, 0.0, 0.0), "b": (0.0, -2e-3, 0.0), "c": (0.0, 0.0, 0.0)}


def fit(places=OWN, frame=(0.0, 0.0, 0.0), at=(0.0, 0.0, 0.0), missing=()) -> ExperimentFit:
    """Two equal states of markers in a turned and moved frame, measured a bit beside where they are."""
    turn = Rotation.from_rotvec(frame)

    def channels(values):
        return {
            f"{m}.{axis}": np.full(2, value) for m, x in values.items() for axis, value in zip("xyz", x, strict=True)
        }

    seen = {m: turn.apply(np.array(x) + OFF[m]) + at for m, x in places.items()}
    measured = channels(seen)
    for marker in missing:
        measured[f"{marker}.y"] = np.array([np.nan, measured[f"{marker}.y"][1]])
    return ExperimentFit(
        rmse={},
        rmse_detrended={},
        measured=measured,
        simulated=channels({m: turn.apply(x) + at for m, x in places.items()}),
        units={},
        response=channels(places),
        distances={m: Distance(0.0, 0.0, 0.0, 2) for m in places},
    )


@pytest.mark.parametrize("frame", [(0.0, 0.0, 0.0), (0.3, -1.2, 2.0)])
def test_markers_come_back_from_the_frame_of_the_bench(frame):
    found = markers_of(fit(frame=frame, at=(0.5, -0.1, 0.2)))
    assert found is not None
    np.testing.assert_allclose(found.simulated, np.repeat(list(OWN.values()), 2, axis=0), atol=1e-12)
    np.testing.assert_allclose(found.measured - found.simulated, np.repeat(list(OFF.values()), 2, axis=0), atol=1e-12)


def test_a_state_in_which_a_marker_was_not_seen_is_left_out():
    found = markers_of(fit(frame=(0.1, 0.2, 0.3), missing=("b",)))
    assert found is not None
    assert len(found.measured) == 5


def test_markers_on_a_line_do_not_tell_a_frame():
    line = {"a": (0.0, 0.0, 0.0), "b": (0.0, 0.0, 0.1), "c": (0.0, 0.0, 0.3)}
    assert markers_of(fit(line, frame=(0.1, 0.0, 0.0))) is None
    assert markers_of(fit(line)) is not None
    assert markers_of(replace(fit(), distances={})) is None


def test_the_first_view_is_the_wide_one_and_up_is_up():
    points = np.array([[0.0, 0.0, 0.0], [0.03, 0.2, -0.1]])
    wide, narrow = two_views(points, np.array([0.0, 0.0, 1.0]))
    assert (wide.right_name, wide.up_name) == ("y", "z")
    assert narrow.right_name == "x"
    np.testing.assert_allclose(wide.flat(points)[1], [200.0, -100.0])
    slanted, turned = two_views(points, np.array([0.0, 0.6, 0.8]))
    assert slanted.up_name == "up"
    assert abs(slanted.right @ slanted.up) < 1e-12
    assert abs(slanted.right @ turned.right) < 1e-12


def test_the_outline_of_a_box_is_its_rectangle():
    mesh = box_mesh((0.1, 0.03, 0.03), (3, 2, 2))
    turn = Rotation.from_rotvec([0.02, 0.015, 0.0]).as_matrix()  # no side is seen edge-on
    flat = (mesh.points @ turn.T)[:, :2]
    found = outline(flat, boundary_triangles(mesh.tets))
    ends = np.sort(np.concatenate([found[:, 0], found[:, 1]]))
    nodes, counts = np.unique(ends, return_counts=True)
    assert set(counts.tolist()) == {2}  # a closed line
    hull = flat[nodes]
    np.testing.assert_allclose(np.ptp(hull, axis=0), np.ptp(flat, axis=0), atol=1e-12)


def test_shapes_and_markers_are_drawn_for_each_experiment_and_both_sides():
    mesh = box_mesh((0.1, 0.03, 0.03), (4, 1, 1))
    robot = Robot((Body("beam", mesh, mesh.node_sets["x0"], {"youngs_modulus": 1e6, "poissons_ratio": 0.4}),),
                  gravity=np.array([0.0, 0.0, -9.81]))  # fmt: skip
    rest = Snapshot("rest", {"beam": mesh.points}, {}, {}, {})
    sagging = mesh.points - np.column_stack([np.zeros((mesh.n_points, 2)), mesh.points[:, 0] ** 2])
    settled = EquilibriumShapes(robot, rest, {"load": replace(rest, points={"beam": sagging})}, {"beam": mesh.tets})
    one = markers_of(fit())
    assert one is not None
    figure = draw_places("All jointly", settled, {"load": one})
    side, end = figure.axes
    assert (side.get_xlabel(), end.get_xlabel(), side.get_ylabel()) == ("x [mm]", "y [mm]", "z [mm]")
    circles = [line for line in side.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(circles[0].get_xydata()[0], [101.0, 30.0])
    assert [text.get_text() for text in figure.legends[0].texts] == ["load", "undeformed", "measured", "simulated"]
    figure.draw_without_rendering()
    scales = [
        (axes.transData.transform([[1.0, 1.0]]) - axes.transData.transform([[0.0, 0.0]]))[0] for axes in (side, end)
    ]
    np.testing.assert_allclose(scales, scales[0][0])  # one millimetre is one millimetre, everywhere
    side.set_yticks([-10.0], ["−300"])  # ticks as wide as those of a manipulator that hangs
    figure.draw_without_rendering()
    assert side.yaxis.label.get_window_extent().x0 > 0.0
