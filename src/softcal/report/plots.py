"""The figures of the report from Python, and what a notebook shows of robots, responses and results; see
`softcal.display`.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.calibration.results.result import CalibrationResult, SearchResult
from softcal.calibration.results.result_plots import ResultPlots
from softcal.declare import checked_arguments
from softcal.display import drawn
from softcal.errors import Fault, ParameterError, unknown
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.surface import boundary
from softcal.report.content import JOINT, ExperimentContent, ReportContent
from softcal.report.figures.loss import draw_profile, draw_surface, draw_trials_over, grid_of_trials
from softcal.report.figures.parameter import draw_estimates, forest_rows
from softcal.report.figures.trajectory import (
    Abscissa,
    TrajectoryPanel,
    TrajectoryPanels,
    draw_channel,
    draw_trajectory,
    label_abscissa,
    trajectory_panels,
)
from softcal.report.format import channel_scale, ordered_parameters, parameter_label
from softcal.report.robot_view import AROUND, ROUTE, WALL, on_walls
from softcal.report.scene import Part, Projection, Surface, Tube, bending_camera, length_scale
from softcal.report.scene_twin import displacements
from softcal.report.sketch import draw_parts, draw_sketch
from softcal.report.style import DISPLACEMENT, FAINT, INK, MUTED, SERIES, as_png, figure_settings, house_style
from softcal.report.surfaces import searched_pair
from softcal.sensing.channel import channel_name
from softcal.twin.parameter_name import parameter_name
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FINE = 90.0  # [dots per inch] of pictures in a notebook
MOST = 3  # experiments whose fit is shown there
_ROD, _LINE = 0.015, 0.007  # radii over the size of the robot


@checked_arguments
def plot_trajectory(of: ResultPlots, experiment: str) -> list[Any]:
    """See `ResultPlots.plot`.

    Raises
    ------
    ParameterError
        As it says.
    """
    path = _path(of, experiment)
    if not path.panels:
        raise ParameterError(Fault("positions alone are compared", path.experiment, attempt="write_report"))
    with house_style():
        return [_lasting(axes) for axes in draw_trajectory(path, make=_new_figure).axes]


@checked_arguments
def plot_fit(of: ResultPlots, channel: str, experiment: str, ax: Any) -> Any:
    """See `ResultPlots.plot_fit`.

    Parameters
    ----------
    of
        The result.
    channel, experiment
        The channel and its experiment, or "".
    ax
        Where it is drawn, or None.

    Raises
    ------
    ParameterError
        As it says.
    """
    path = _path(of, experiment)
    panels = {panel.channel: panel for panel in path.panels}
    panel = panels.get(channel or next(iter(panels), ""))
    if panel is None:
        raise ParameterError(unknown("the fit has no such channel", path.experiment, channel, panels))
    with _drawing(ax) as axes:
        draw_channel(axes, path, panel)
        label_abscissa(axes, path.abscissa)
        axes.set_title(path.experiment)
        axes.legend()
        return axes


@checked_arguments
def plot_intervals(of: ResultPlots, parameter: str, ax: Any) -> Any:
    """See `ResultPlots.plot_intervals`.

    Parameters
    ----------
    of
        The result.
    parameter
        The parameter, or "".
    ax
        Where they are drawn, or None.
    """
    results = results_of(of)
    names = list(dict.fromkeys(parameter_name(name).base for name in ordered_parameters(results)))
    name = _known(parameter, names)
    rows = forest_rows(name, results)
    with _drawing(ax, 1.3 + 0.42 * len(rows)) as axes:
        draw_estimates(axes, parameter_label(name, names), rows)
        return axes


@checked_arguments
def plot_loss(of: ResultPlots, parameter: str, ax: Any) -> Any:
    """See `ResultPlots.plot_loss`.

    Parameters
    ----------
    of
        The result.
    parameter
        The parameter, or "".
    ax
        Where it is drawn, or None.
    """
    results = results_of(of)
    result = results[JOINT] if JOINT in results else next(iter(results.values()))
    name = _known(parameter, list(result.parameters))
    estimate, pair = result.parameters[name], searched_pair(result)
    with _drawing(ax) as axes:
        if estimate.profile:
            draw_profile(axes, name, estimate, result)
            axes.set_ylabel("Loss")
            axes.legend()
        elif pair is None or parameter:
            draw_trials_over(axes, "Loss of the trials", result, name)
        else:
            draw_surface(axes, "Loss over the parameters", result, pair, grid_of_trials(result))
        return axes


@checked_arguments
def plot_channel(response: Response, channel: str, over: str, ax: Any) -> Any:
    """See `Response.plot`.

    Parameters
    ----------
    response
        The response.
    channel, over
        The channel, and that of the horizontal axis, or "".
    ax
        Where it is drawn, or None.

    Raises
    ------
    ParameterError
        As it says.
    """
    for name in filter(None, (channel, over)):
        if name not in response.channels:
            raise ParameterError(unknown("the response has no such channel", "plot", name, response.channels))
    scale, values = channel_scale(response.units[channel]), response.channels[channel]
    kind = channel_name(channel).kind
    panel = TrajectoryPanel(channel, kind.label or kind.name, scale, None, values / scale.factor, None)
    numbers = np.arange(len(values), dtype=np.float64)
    abscissa = Abscissa(numbers, "Sample", is_count=True)
    if over:
        across = channel_scale(response.units[over])
        abscissa = Abscissa(response.channels[over] / across.factor, across.axis(channel_name(over).label))
    with _drawing(ax) as axes:
        path = TrajectoryPanels("", abscissa, (panel,), (slice(0, len(values)),))
        colour = SERIES[len(axes.lines) % len(SERIES)]
        draw_channel(axes, path, panel, channel, colour)
        label_abscissa(axes, abscissa)
        axes.legend()
        return axes


@checked_arguments
def plot_shape(of: Response | Robot, ax: Any) -> Any:
    """See `Response.plot_shape` and `Robot.plot_shape`.

    Raises
    ------
    ParameterError
        As they say.
    """
    if isinstance(of, Response) and len(of.snapshots) < 2:
        raise ParameterError(Fault("the response has no two shapes", "plot_shape", attempt="simulate(snapshots=True)"))
    with _drawing(ax) as axes:
        draw_parts(axes, *(shape_at_rest(of) if isinstance(of, Robot) else furthest_shape(of)))
        return axes


@drawn.register
def robot_picture(robot: Robot) -> Iterator[bytes]:
    """The robot at rest, with its regions, actuators and loads."""
    yield as_png(draw_sketch(*shape_at_rest(robot)), FINE)


@drawn.register
def response_picture(response: Response) -> Iterator[bytes]:
    """The shape that is furthest from the first one, coloured by displacement, over the first one in grey."""
    if len(response.snapshots) < 2:
        return
    yield as_png(draw_sketch(*furthest_shape(response)), FINE)


@drawn.register
def result_pictures(result: CalibrationResult) -> Iterator[bytes]:
    """The loss against the trials, and the first experiments, measured and simulated."""
    from softcal.report.figures.distances import distances
    from softcal.report.figures.history import draw_history, search_history
    from softcal.report.figures.trajectory import trajectory

    content = content_of(result)
    if len((losses := search_history(result.trials)).losses):
        yield as_png(draw_history("Loss of the trials", losses), FINE)
    for figure, most in ((trajectory, MOST), (distances, 1)):
        for drawing in islice(figure(content), most):
            yield as_png(drawing.figure, FINE)


def results_of(of: ResultPlots) -> Mapping[str, SearchResult]:
    """Label -> result: of one alone, or of several calibrations."""
    if not isinstance(of, SearchResult):
        return of.results  # type: ignore[attr-defined]
    return {next(iter(of.experiments)) if len(of.experiments) == 1 else JOINT: of}


def content_of(of: ResultPlots) -> ReportContent:
    """The content of a report that has only results: the measured channels are those that were compared."""
    experiments: dict[str, ExperimentContent] = {}
    for result in results_of(of).values():
        for name, fit in result.experiments.items():
            samples = Dataset(name, {channel: Channel(y, fit.units[channel]) for channel, y in fit.measured.items()})
            drive = next((one for one in fit.measured if one not in fit.simulated and one != "time"), "")
            experiments[name] = ExperimentContent(name, samples, samples, drive=drive)
    return ReportContent("", results_of(of), experiments)


Sketch = tuple[Sequence[Part], Projection, Sequence[Part]]
"""What is drawn, through which camera, and what is behind it."""


def shape_at_rest(robot: Robot) -> Sketch:
    """The robot at rest, with its regions, actuators and loads."""
    from softcal.report.check_figures import robot_scenes

    scenes, cameras = robot_scenes(robot)
    return scenes[0].parts, cameras[0], ()


def furthest_shape(response: Response) -> Sketch:
    """The shape that is furthest from the first one, over the first one in grey."""
    rest = response.snapshots[0]
    bent = max(
        response.snapshots[1:], key=lambda shape: max(float(d.max()) for d in displacements(rest, shape).values())
    )
    moved = displacements(rest, bent)
    start, end = (np.concatenate([*shape.points.values(), *shape.rods.values()]) for shape in (rest, bent))
    size, away = length_scale(start), np.linalg.norm(end - start, axis=1)
    # A response knows no direction of gravity: its longest axis is upright, with the end that moves on top.
    middle = start - start.mean(axis=0)
    up = np.linalg.eigh(middle.T @ middle)[1][:, -1]
    up = up if away @ (middle @ up) >= 0.0 else -up
    parts, behind = _parts(response, bent, moved, size), _parts(response, rest, None, size)
    routes = [path for shape in (rest, bent) for path in shape.routes.values()]
    camera = bending_camera(np.concatenate([start, end, *routes]), up, (end - start).mean(axis=0))
    return parts, camera, behind


def _path(of: ResultPlots, experiment: str) -> TrajectoryPanels:
    """An experiment's channels, of the joint result where there is one."""
    content = content_of(of)
    fits = {name: fit for result in content.results.values() for name, fit in result.experiments.items()}
    fits |= content.headline_result.experiments
    name = experiment or next(iter(fits), "")
    if name not in fits:
        raise ParameterError(unknown("the result has no such experiment", "experiment", name, fits))
    return trajectory_panels(content.experiments[name], fits[name])


def _known(parameter: str, names: list[str]) -> str:
    """The parameter, by default the first."""
    if (name := parameter or next(iter(names), "")) not in names:
        raise ParameterError(unknown("the result has no such parameter", "parameter", parameter, names))
    return name


@contextmanager
def _drawing(ax: Axes | None, height: float = 3.6) -> Generator[Axes]:
    """The axes of the argument, in their own style, or axes of a new figure in softcal's style."""
    from matplotlib.axes import Axes

    if ax is None:
        with house_style():
            yield _lasting(_new_figure(5.2, height).add_subplot())
    elif isinstance(ax, Axes) and ax.name == "rectilinear":  # pyright: ignore[reportUnnecessaryIsInstance] (a user's)
        yield ax
    else:
        raise ParameterError(Fault("this is drawn in axes of Matplotlib", "ax", repr(ax)[:60], "plane axes, or None"))


def _new_figure(width: float, height: float) -> Figure:
    """A figure that notebooks and `matplotlib.pyplot.show` show."""
    from matplotlib import pyplot as plt

    return plt.figure(**figure_settings(width, height))


def _lasting(axes: Axes) -> Axes:
    """The axes, whose ticks, which are made as they are drawn, keep the style of now."""
    import matplotlib as mpl

    size, grid = mpl.rcParams["font.size"], mpl.rcParams["grid.color"]
    axes.tick_params(labelsize=size, color=MUTED, labelcolor=INK, grid_color=grid, grid_linewidth=0.7)
    return axes


def _parts(response: Response, shape: Snapshot, moved: dict[str, np.ndarray] | None, size: float) -> list[Part]:
    """Bodies, rods and actuators of a shape; moved [m]: displacements that colour it, grey and without actuators if
    None.
    """
    from matplotlib import colormaps

    largest = max((float(d.max()) for d in (moved or {}).values()), default=0.0) or 1.0
    shades = {name: colormaps[DISPLACEMENT](d / largest)[:, :3] for name, d in (moved or {}).items()}
    parts: list[Part] = []
    for name, tets in response.tets.items():
        faces, colours = boundary(tets), shades.get(name)
        fine, is_wall = fine_surface(faces), on_walls(faces, name, response.walls)
        at, is_inside = fine.at(shape.points[name]), fine.by_triangle(is_wall & (moved is not None))
        look, opacity = FAINT if colours is None else fine.at(colours), AROUND if is_inside.any() else 1.0
        parts.append(Surface(at, fine.triangles[~is_inside], colour=look, opacity=opacity))
        if is_inside.any():
            parts.append(Surface(at, fine.triangles[is_inside], colour=WALL))
    parts += [Tube(nodes, _ROD * size, colour=shades.get(name, FAINT)) for name, nodes in shape.rods.items()]
    routes = {} if moved is None else shape.routes
    return parts + [Tube(path, _LINE * size, colour=ROUTE) for path in routes.values()]
