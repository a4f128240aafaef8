"""Plots from Python: the numbers of the result with their units, in the axes that are given or in new ones."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.text import Text
from numpy.testing import assert_allclose
from project_case import write_project

import softcal

MM, N, DEG, MPA = 1e-3, 1.0, np.pi / 180, 1e6
E = "bar.youngs_modulus"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """A project, its run, a search by trials, and a response with shapes."""
    home = tmp_path_factory.mktemp("project")
    project = softcal.load(write_project(home))
    found = softcal.calibrate(project, starts=1, out=home / "run")
    searched = softcal.calibrate(project, method="tpe", trials=12)
    return SimpleNamespace(
        project=project,
        found=found,
        run=softcal.load_run(home / "run"),
        searched=searched,
        response=softcal.simulate(project, snapshots=True),
    )


@pytest.fixture(autouse=True)
def closed() -> Generator[None]:
    with plt.rc_context({"backend": "Agg"}):
        yield
        plt.close("all")


PLOTS: dict[str, Callable[..., Axes]] = {
    "fit": lambda done, **to: done.found.plot_fit(**to),
    "fit of a run": lambda done, **to: done.run.plot_fit("pitch", "pull", **to),
    "intervals": lambda done, **to: done.found.headline.plot_intervals(**to),
    "loss by derivatives": lambda done, **to: done.found.plot_loss(**to),
    "loss over two": lambda done, **to: done.searched.plot_loss(**to),
    "loss over one": lambda done, **to: done.searched.plot_loss(E, **to),
    "channel": lambda done, **to: done.response.plot("front.tension", "front.shortening", **to),
    "shape": lambda done, **to: done.response.plot_shape(**to),
    "robot": lambda done, **to: done.project.robot.plot_shape(**to),
}


@pytest.mark.parametrize("name", PLOTS)
def test_axes_in_are_axes_out_and_nothing_is_shown_or_saved(
    name: str, done: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: pytest.fail("it was shown"))
    figure, mine = plt.subplots()
    mine.set_facecolor("pink")
    assert PLOTS[name](done, ax=mine) is mine
    assert mine.has_data()
    assert plt.get_fignums() == [figure.number]
    own = PLOTS[name](done)
    assert own.figure.number == figure.number + 1, "a new figure, which a notebook shows"
    assert own.has_data()
    assert list(tmp_path.iterdir()) == []


def line(axes: Axes, label: str) -> tuple[np.ndarray, np.ndarray]:
    (found,) = (one for one in axes.lines if one.get_label() == label)
    x, y = found.get_data()
    return np.asarray(x), np.asarray(y)


def test_a_fit_has_the_numbers_of_the_result(done: SimpleNamespace) -> None:
    fit = done.found.headline.experiments["pull"]
    axes = done.found.plot_fit("pitch")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Cable shortening [mm]", "Pitch [deg]")
    for label, values in (("measured", fit.measured), ("simulated", fit.simulated)):
        x, y = line(axes, label)
        assert_allclose(x * MM, fit.measured["shortening"])
        assert_allclose(y * DEG, values["pitch"])
    panels = done.found.plot()
    assert [one.get_ylabel() for one in panels] == ["Cable force [N]", "Residual [N]", "Pitch [deg]", "Residual [deg]"]
    residual = panels[3].lines[-1].get_ydata()
    assert_allclose(np.asarray(residual) * DEG, fit.simulated["pitch"] - fit.measured["pitch"], atol=1e-12)
    assert panels[0].figure.number == plt.get_fignums()[-1]


def test_intervals_and_loss_have_the_numbers_of_the_result(done: SimpleNamespace) -> None:
    estimate = done.found.headline.parameters[E]
    axes = done.found.plot_intervals(E)
    assert axes.get_xlabel() == "E [MPa]"
    assert_allclose(np.asarray(axes.lines[0].get_xdata()) * MPA, estimate.interval)
    assert_allclose(np.asarray(axes.lines[1].get_xdata()) * MPA, estimate.value)
    axes = done.found.plot_loss(E)
    x, loss = line(axes, "loss, by derivatives")
    assert_allclose(np.column_stack([x * MPA, loss]), estimate.profile)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("E [MPa]", "Loss")
    axes = done.searched.plot_loss(E)
    x, loss = (np.asarray(side) for side in axes.lines[0].get_data())
    trials = sorted((one.theta[E], one.loss) for one in done.searched.headline.trials)
    assert_allclose(np.column_stack([x * MPA, loss]), trials)
    both = done.searched.plot_loss()
    assert (both.get_xlabel(), both.get_ylabel()) == ("E [MPa]", "slack (front, pull) [mm]")
    assert len(both.collections[0].get_offsets()) == len(trials)


def test_a_channel_is_drawn_beside_what_is_there(done: SimpleNamespace) -> None:
    channels = done.response.channels
    axes = done.response.plot("front.tension", "front.shortening")
    x, y = line(axes, "front.tension")
    assert_allclose(x * MM, channels["front.shortening"])
    assert_allclose(y * N, channels["front.tension"])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("front.shortening [mm]", "Cable force [N]")
    done.response.plot("plate.x", ax=(other := done.response.plot("plate.z")))
    assert [one.get_label() for one in other.lines] == ["plate.z", "plate.x"]
    assert len({one.get_color() for one in other.lines}) == 2
    assert other.get_xlabel() == "Sample"


@pytest.mark.parametrize(("columns", "width"), [("one column", 89), ("two columns", 183)])
def test_in_the_style_of_a_paper_figures_are_as_wide_as_a_column(
    done: SimpleNamespace, columns: str, width: float
) -> None:
    with softcal.paper_style(columns):
        drawn = [PLOTS[name](done).figure for name in PLOTS] + [done.found.plot()[0].figure, plt.figure()]
    for figure in drawn:
        assert figure.get_figwidth() * 25.4 == pytest.approx(width)
        figure.draw_without_rendering()
        sizes = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text()]
        assert min(sizes, default=7.0) >= 7.0
        assert max(sizes, default=7.0) <= 10.0
    assert done.found.plot_fit().figure.get_figwidth() == 5.2


@pytest.mark.parametrize(
    ("slip", "words"),
    [
        (lambda done: done.found.plot_fit(ax=3), "ax: this is drawn in axes of Matplotlib; got 3"),
        (
            lambda done: done.response.plot_shape(ax=plt.figure().add_subplot(projection="3d")),
            "ax: this is drawn in axes of Matplotlib",
        ),
        (lambda done: done.found.plot_fit(3), "channel: this is of the wrong kind; got 3; allowed: text"),
        (lambda done: done.response.plot(["tension"]), "channel: this is of the wrong kind"),
        (lambda done: done.found.plot_fit("roll"), "pull: the fit has no such channel; got 'roll'; allowed: tension"),
        (lambda done: done.found.plot("push"), "the result has no such experiment; got 'push'; allowed: pull"),
        (lambda done: done.found.plot_loss("E"), f"the result has no such parameter; got 'E'; allowed: {E}"),
        (lambda done: done.found.plot_intervals("E"), "the result has no such parameter; got 'E'"),
        (lambda done: done.response.plot("tension"), "the response has no such channel; got 'tension'"),
        (lambda done: softcal.simulate(done.project).plot_shape(), "no two shapes. Try: simulate"),
        (lambda done: softcal.paper_style("A4").__enter__(), "there is no such style; got 'A4'; allowed: one column"),
    ],
)
def test_what_cannot_be_drawn_is_told(slip: Callable[[SimpleNamespace], object], words: str, done: SimpleNamespace):
    before = plt.get_fignums()
    with pytest.raises(softcal.InputError, match=words.replace("(", r"\(")):
        slip(done)
    assert len(plt.get_fignums()) <= len(before) + 1
