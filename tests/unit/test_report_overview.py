"""The overview chart with few and with many tests: its legend is beside the curves, and no two tests look alike."""

from __future__ import annotations

from dataclasses import replace

import pytest
from matplotlib.figure import Figure
from report_example import bench_experiment, example_content, fit_of, tpe_result

from softcal.report.figures.force_displacement import draw_record
from softcal.report.figures.overview import draw_overview, overview_curves
from softcal.report.figures.trajectory import TrajectoryPanels, draw_trajectory, trajectory_panels


def overview(n: int) -> Figure:
    """Of n tests with names like a bench's, four depths at several speeds."""
    depths = [0.020, 0.030, 0.035, 0.040]
    tests = [
        bench_experiment(
            f"{1e3 * depths[i % 4]:.0f} mm, {2 + 3 * (i // 4)} mm/s", depths[i % 4], (1.6 + 0.12 * i) * 1e6
        )
        for i in range(n)
    ]
    result = tpe_result(tests, 1.9e6, 0.46, n_trials=3, slack=True)
    content = replace(
        example_content(n_trials=3), experiments={t.name: t for t in tests}, results={"joint": result}, headline="joint"
    )
    ((pair, curves),) = overview_curves(content).items()
    return draw_overview(curves, pair)


@pytest.mark.parametrize("n", [1, 4, 8, 20])
def test_the_legend_is_beside_the_axes_and_whole(n: int) -> None:
    figure = overview(n)
    figure.draw_without_rendering()
    (axes,), (legend,) = figure.axes, figure.legends
    box, page = legend.get_window_extent(), figure.bbox
    assert not box.overlaps(axes.get_tightbbox())
    assert page.x0 <= box.x0 < box.x1 <= page.x1
    assert page.y0 <= box.y0 < box.y1 <= page.y1
    assert axes.get_window_extent().height > 2.2 * figure.dpi
    assert len(legend.get_texts()) == (2 if n == 1 else n)


def test_no_two_tests_look_alike() -> None:
    (axes,) = overview(18).axes
    points = [line for line in axes.lines if line.get_linestyle() == "None"]
    twins = [line for line in axes.lines if line.get_linestyle() != "None"]
    assert len({(line.get_color(), line.get_marker()) for line in points}) == 18
    assert len({(line.get_color(), line.get_linestyle()) for line in twins}) == 18


def test_a_record_of_force_shows_its_angles_too() -> None:
    measured, alone = (bench_experiment("20 mm", 0.02, 2e6, pitch=pitch).raw for pitch in (True, False))
    assert [axes.get_ylabel() for axes in draw_record(measured).axes] == ["Cable force [N]", "Pitch [deg]"]
    assert [axes.get_ylabel() for axes in draw_record(alone).axes] == ["Cable force [N]"]


def test_a_sample_without_neighbours_is_marked() -> None:
    experiment = bench_experiment("20 mm", 0.02, 2e6)
    whole = trajectory_panels(experiment, fit_of(experiment))
    for pieces, marker in ((whole.pieces, ""), (tuple(slice(k, k + 1) for k in range(50)), "D")):
        figure = draw_trajectory(TrajectoryPanels(whole.experiment, whole.abscissa, whole.panels, pieces))
        assert {line.get_marker() for line in figure.axes[1].lines[1:]} == {marker}
