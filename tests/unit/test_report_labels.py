"""No text of a chart covers another one, whatever the names of experiments, states and markers."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_case import estimates

from softcal.calibration.results.result import Distance, ExperimentFit
from softcal.plugins.fleet.figures import draw_specimens
from softcal.plugins.fleet.statement import fleet_statement
from softcal.report.comparison import NominalComparison
from softcal.report.figures.distances import draw_distances
from softcal.report.figures.nominal_and_tuned import draw_comparison
from softcal.report.positions import Place
from softcal.report.style import encode, house_style, new_figure, overlapping, plain_log_ticks

NAMES = [f"cable{i}_pulled_by_2_kgf_on_monday" for i in range(1, 7)]


def fit(n_markers: int) -> ExperimentFit:
    distances = {
        f"marker{k}": Distance(0.001 + 1e-3 * k, 0.002 + 1e-3 * k, 0.0015 + 1e-3 * k, 3) for k in range(n_markers)
    }
    return ExperimentFit({}, {}, {}, {}, {}, distances=distances, length=0.4)


@pytest.mark.parametrize("names", [["a", "b"], NAMES])
def test_the_names_of_experiments_are_apart(names) -> None:
    figure = draw_distances("joint", [Place(name, fit(4), held_out=k == 1) for k, name in enumerate(names)])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    labels = axes.get_xticklabels()
    assert not overlapping(labels)
    assert {label.get_rotation() for label in labels} == ({0.0} if len(names) == 2 else {90.0})


def test_markers_beyond_the_colours_are_hatched() -> None:
    figure = draw_distances("joint", [Place("rest", fit(9), held_out=False)])
    looks = [(bar.get_facecolor(), bar.get_hatch()) for bar in figure.axes[0].patches]
    assert len(set(looks)) == 9


@pytest.mark.parametrize("n_states", [2, 4])
@pytest.mark.parametrize("names", [["a", "b", "c"], NAMES])
def test_numbers_and_names_of_a_comparison_are_apart(names, n_states: int) -> None:
    rng = np.random.default_rng(1)
    experiments = tuple(name for name in names for _ in range(n_states))
    states = tuple(f"{0.5 * (k % n_states)} kgf" for k in range(len(experiments)))
    nominal = rng.uniform(0.011, 0.099, (2, len(experiments)))
    figure = draw_comparison(
        NominalComparison(("marker1", "marker2"), experiments, states, nominal, 0.9 * nominal, "%", "calibrated")
    )
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert not overlapping([text for text in axes.texts if text.get_visible()])
        assert not overlapping(axes.get_xticklabels())


@pytest.mark.parametrize(("low", "high"), [(2.0, 3.0), (1.0, 20.0), (0.1, 4e5)])
def test_logarithmic_ticks_are_plain_numbers(low: float, high: float) -> None:
    with house_style():
        figure = new_figure()
        axes = figure.subplots()
        axes.set_yscale("log")
        axes.set_ylim(low, high)
        plain_log_ticks(axes.yaxis, low, high)
        figure.draw_without_rendering()
    shown = [float(label.get_text()) for label in axes.get_yticklabels()]
    assert sum(low <= value <= high for value in shown) >= 2


@pytest.mark.parametrize("name", ["$ x_{ $ A", "5$ a_ $2"])
def test_dollars_in_names_are_dollars(name: str) -> None:
    """Matplotlib would read what is between two as mathematics."""
    factors = [{"price": name if k % 2 else "B"} for k in range(12)]
    values = [10.0 + 3.0 * (k % 2) + 0.1 * k for k in range(12)]
    specimens = estimates(values, [0.05] * 12, factors=factors)
    found = fleet_statement(specimens, ["price"])
    figure = draw_specimens(found.populations[0], specimens, found)
    (legend,) = figure.legends
    assert f"price {name}" in [text.get_text() for text in legend.get_texts()]
    assert not any(text.get_parse_math() for text in legend.get_texts())
    assert encode(figure)[0]
