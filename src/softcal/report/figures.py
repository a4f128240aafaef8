"""The pictures of a report: selection, captions, and the calls that draw them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from softcal.analysis.record import RecordFit
from softcal.calibration.result import ExperimentFit
from softcal.experiments.dataset import Dataset
from softcal.experiments.steps.branches import PULLEY_STEP
from softcal.experiments.steps.noise import NOISE_STEPS
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.format import (
    file_stem,
    joined,
    number,
    ordered_parameters,
    parameter_label,
    parameter_name,
    result_label,
)
from softcal.report.style import encode

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Section = Literal[
    "overview", "twin", "bench", "fit", "record", "search", "history", "parameters", "plausible", "compared", "mesh"
]


@dataclass(frozen=True)
class Picture:
    """One picture: file stem, section of the page, caption, and bytes as PNG and SVG.

    shown: the format embedded in the page, SVG for charts and PNG for rendered scenes. note: an emphasised remark on
    how it was drawn, or "".
    """

    name: str
    section: Section
    caption: str
    png: bytes
    svg: bytes
    shown: Literal["png", "svg"] = "svg"
    note: str = ""


def report_pictures(content: ReportContent) -> list[Picture]:
    """Draw all pictures for which the content has data."""
    return [
        *_overview(content),
        *_compared(content),
        *_twin(content),
        *_bench(content),
        *_places(content),
        *_fits(content),
        *_records(content),
        *_searches(content),
        *_estimates(content),
        *_mesh(content),
    ]


def _picture(figure: Figure, name: str, section: Section, caption: str) -> Picture:
    return Picture(name, section, caption, *encode(figure))


def _overview(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_bench import draw_overview

    result = content.headline_result
    if _has_curves(content):
        caption = f"Measured cable force (points) and the calibrated twin (lines): {result_label(content.headline)}."
        yield _picture(draw_overview(content, result), "overview", "overview", caption)


def _has_curves(content: ReportContent) -> bool:
    from softcal.report.chart_bench import overview_curves

    result = content.headline_result
    return any(overview_curves(content.experiments[name], result) for name in result.experiments)


def _compared(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_comparison import draw_comparison
    from softcal.report.chart_configurations import draw_configurations
    from softcal.report.chart_surface import draw_curves, draw_surfaces
    from softcal.report.comparison import comparison
    from softcal.report.surfaces import error_curves, error_surfaces, swept_pair

    result, compared = content.headline_result, content.compared
    nominal = {} if compared is None or compared.nominal is None else compared.nominal.parameters
    pair, surfaces = swept_pair(result), error_surfaces(result)
    if pair is not None and surfaces:
        others = [name for name in result.parameters if name not in pair]
        held = f", {joined(parameter_label(n) for n in others)} as in the best cell" if others else ""
        caption = (
            f"Error in every cell of the sweep, section by section{held}; dark is better, each panel has its own "
            "scale; star: best cell; empty: not simulated."
        )
        figure = draw_surfaces(result, pair, surfaces, nominal)
        yield _picture(figure, "error-surfaces", "compared", caption)
    if curves := error_curves(result):
        caption = "Error over the sweep, section by section; star: best value."
        yield _picture(draw_curves(result, curves), "error-curves", "compared", caption)
    found = comparison(content)
    if found is not None:
        caption = (
            f"Distance of every marker from its measured position, nominal and {found.tuned_name}, in every state."
        )
        yield _picture(draw_comparison(found), "nominal-and-tuned", "compared", caption)
    if compared is not None and len(compared.configurations) > 1:
        drawn = draw_configurations(compared)
        caption = (
            f"{compared.state}: the twin at selected values, with the root mean square distance of its markers (blue) "
            "from their measured positions (red). Colour: displacement from rest, one scale for all."
        )
        section: Section = "compared" if _has_curves(content) else "overview"
        yield Picture("configurations", section, caption, *encode(drawn.figure), "png", drawn.note)


def _twin(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_twin import draw_twin

    if content.twin is None:
        return
    drawn = draw_twin(content.twin)
    robot = content.twin.robot
    states = "at rest and at its largest pitch" if robot.cables else "undeformed and in equilibrium"
    drawn_as = ["colour is the displacement"]
    drawn_as += ["fixed regions are grey"] if any(len(body.fixed) for body in robot.bodies) else []
    drawn_as += ["the tubes are cables"] if robot.cables else []
    drawn_as += ["the discs are rigid plates"] if robot.plates else []
    caption = f"The calibrated twin {states}, to one scale: {joined(drawn_as)}."
    yield Picture("twin", "twin", caption, *encode(drawn.figure), "png", drawn.note)


def _bench(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_bench import draw_force_displacement, draw_record, has_force_displacement

    for name, experiment in content.experiments.items():
        if _is_of_states(experiment):
            continue
        drawable = has_force_displacement(experiment.prepared) or has_force_displacement(experiment.raw)
        figure = draw_force_displacement(experiment) if drawable else draw_record(experiment.raw)
        caption = _bench_caption(experiment) if drawable else _record_caption(experiment)
        yield _picture(figure, f"force-displacement-{file_stem(name)}", "bench", caption)


def _is_of_states(experiment: ExperimentContent) -> bool:
    """Whether the rows are states with positions, for which a chart over the samples is of no use."""
    return any(name.rpartition(".")[2] in ("x", "y", "z") and "." in name for name in experiment.raw.channels)


def _bench_caption(experiment: ExperimentContent) -> str:
    drawn = experiment.corrected or experiment.raw
    later = steps_between(experiment.prepared, len(drawn.provenance))
    caption = f"{experiment.name}: the record in light tones, the samples used for the fit in blue."
    if drawn.cycle is None and later:
        caption += f" Between the two {'lie' if len(later) > 1 else 'lies'}: {joined(later)}."
    return caption


def steps_between(data: Dataset, after: int) -> list[str]:
    """Steps after the first `after` that changed samples, each once; stating noise changes none."""
    return list(dict.fromkeys(step.name for step in data.provenance[after:] if step.name not in NOISE_STEPS))


def _record_caption(experiment: ExperimentContent) -> str:
    later = steps_between(experiment.prepared, len(experiment.raw.provenance))
    return f"{experiment.name}: the record" + (f"; the fit uses it after {joined(later)}." if later else ".")


def _places(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_places import draw_places, markers_of

    if content.equilibria is None:
        return
    fits = content.headline_result.experiments
    found = {name: markers_of(fits[name]) for name in content.equilibria.shapes if name in fits}
    markers = {name: one for name, one in found.items() if one is not None}
    if not markers:
        return
    caption = (
        f"{result_label(content.headline)}: measured and simulated marker positions in the robot's frame, with the "
        "shapes of the calibrated twin."
    )
    left = len(fits) - len(content.equilibria.shapes)
    caption += f" {left} further experiments are omitted." if left > 0 else ""
    figure = draw_places(result_label(content.headline), content.equilibria, markers)
    yield _picture(figure, "places", "fit", caption)


def _fits(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_bench import draw_trajectory
    from softcal.report.chart_positions import draw_distances
    from softcal.report.positions import places
    from softcal.report.series import trajectory_panels

    for label, result in content.results.items():
        found = places(result)
        if found:
            caption = (
                f"{result_label(label)}: distance of every marker from its measured position; bars are means over "
            )
            caption += "the states, lines go to the largest" + (
                "; pale: held out of the fit and predicted." if any(place.held_out for place in found) else "."
            )
            yield _picture(draw_distances(result_label(label), found), f"distances-{file_stem(label)}", "fit", caption)
        for name, fit in result.experiments.items():
            path = trajectory_panels(content.experiments[name], fit)
            if not path.panels:
                continue
            alone = file_stem(label) == file_stem(name)
            who = name if alone else f"{name}, {result_label(label).lower() if label == 'joint' else label}"
            caption = f"{who}: measured and simulated; the residual is simulated minus measured."
            silent = [panel.label.lower() for panel in path.panels if panel.measured is None]
            if silent:
                caption += f" The {joined(silent)} was not measured; only the simulated one is shown."
            if path.abscissa.note:
                caption += f" {path.abscissa.note}"
            stem = f"trajectory-{file_stem(name)}" + ("" if alone else f"-by-{file_stem(label)}")
            yield _picture(draw_trajectory(path), stem, "fit", caption)


def _records(content: ReportContent) -> Iterator[Picture]:
    # Each experiment once: from the headline's calibration if it includes it, else from the first that does.
    drawn: set[str] = set()
    for label in dict.fromkeys([content.headline, *content.records]):
        fresh = {n: found for n, found in content.records.get(label, {}).items() if n not in drawn}
        drawn.update(fresh)
        for name, found in fresh.items():
            if found.fit is not None:
                yield _record(content, label, name, found, found.fit)


def _record(content: ReportContent, label: str, name: str, found: RecordFit, fit: ExperimentFit) -> Picture:
    from softcal.report.chart_bench import draw_trajectory
    from softcal.report.series import trajectory_panels

    path = trajectory_panels(replace(content.experiments[name], prepared=found.record, drive="time"), fit)
    caption = (
        f"{name}: the whole record and the twin ({result_label(label)}), driven by {joined(found.drives)} as measured. "
        "The twin was fitted to part of these samples, or to averages of them. It is elastic: the hysteresis loop "
        "remains in the residual."
    )
    if any(step.name == PULLEY_STEP for step in found.record.provenance) and "tension" in fit.measured:
        caption += " Pulley friction is subtracted from every sample as on the fitted branch."
    if found.every > 1:
        caption += f" One sample in {found.every} is compared."
    return Picture(f"record-{file_stem(name)}", "record", caption, *encode(draw_trajectory(path, 9.0)), "png")


def _searches(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_search import draw_history, draw_loss_map, draw_loss_profile
    from softcal.report.series import grid_of_trials, search_history

    searched = {label: result for label, result in content.results.items() if not result.is_sweep}
    for label, result in searched.items():
        title, stem = result_label(label), file_stem(label)
        grid = content.landscapes.get(label) or grid_of_trials(result)
        figure = draw_loss_map(title, result, grid) or draw_loss_profile(title, result)
        if figure is not None:
            what = "on a grid" if grid else "at the trials"
            others = len(result.parameters) - 2
            seen = f", seen along {others} further parameter{'s' * (others > 1)}" if others > 0 and not grid else ""
            caption = f"{title}: the loss {what}{seen}; star: the optimum; dashed: the bounds of the search."
            yield _picture(figure, f"loss-{stem}", "search", caption)
    for label, result in searched.items():
        history = search_history(result.trials)
        if len(history.losses):
            caption = (
                f"{result_label(label)}: {len(history.losses)} trials, the best loss {number(result.loss)}; "
                f"{len(history.failed) or 'none'} could not be simulated."
            )
            figure = draw_history(result_label(label), history)
            yield _picture(figure, f"history-{file_stem(label)}", "history", caption)


def _estimates(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_parameters import draw_forest, draw_plausible_modulus, forest_caption

    for name in dict.fromkeys(parameter_name(name).base for name in ordered_parameters(content.results)):
        caption = forest_caption(name, content.results)
        yield _picture(draw_forest(name, content.results), f"parameter-{file_stem(name)}", "parameters", caption)
    if content.print_infill is not None:
        figure = draw_plausible_modulus(content.print_infill, content.results)
        if figure is not None:
            low, high = (number(bound / 1e6) for bound in content.print_infill.effective_modulus)
            caption = (
                f"A print of {100 * content.print_infill.infill:.3g} % infill is expected between "
                f"{low} and {high} MPa (green); solid material lies further right (grey)."
            )
            yield _picture(figure, "plausible-modulus", "plausible", caption)


def _mesh(content: ReportContent) -> Iterator[Picture]:
    from softcal.report.chart_mesh import draw_mesh_study

    figure = None if content.mesh_study is None else draw_mesh_study(content.mesh_study)
    if figure is not None:
        caption = (
            "Uncertainty from noise (blue: 95 % interval) and shift by the mesh (orange: to the value expected on the "
            "best of the finer meshes); open markers: the value expected on each of them."
        )
        yield _picture(figure, "mesh-study", "mesh", caption)
