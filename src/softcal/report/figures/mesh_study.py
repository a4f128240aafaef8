"""Chart of the mesh study: each parameter's interval from noise, and its shift by mesh refinement."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from softcal.analysis.mesh_study import MeshStudy
from softcal.calibration.results.digits import shown, value_text, with_unit
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.format import estimate_scale, parameter_label
from softcal.report.style import BLUE, FAINT, INK, MUTED, RED, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 6  # parameters in the chart, the robot's first
_MARKERS = ("s", "^", "v", "P", "X", "*")


@register_figure("mesh")
def mesh_study(content: ReportContent) -> Iterator[Drawing]:
    """What the mesh contributes to each estimate, beside its interval from noise."""
    figure = None if content.mesh_study is None else draw_mesh_study(content.mesh_study)
    if figure is not None:
        caption = (
            "Uncertainty from noise (blue: 95 % interval) and shift by the mesh (orange: to the value expected on the "
            "best of the finer meshes); open markers: the value expected on each of them."
        )
        yield Drawing(figure, caption, title="What the mesh contributes")


def drawn_parameters(study: MeshStudy) -> list[str]:
    """Labels of the parameters in the chart; parameters at a bound on every mesh are omitted."""
    rig = [label for label in study.parameters if label not in study.of_robot]
    still = {
        label
        for label, e in study.parameters.items()
        if e.interval is None and all(one.values.get(label, e.value) == e.value for one in study.finer)
    }
    return [label for label in (*study.of_robot, *rig) if label not in still][:MOST]


def draw_mesh_study(study: MeshStudy) -> Figure | None:
    """A panel per parameter, in its own unit; None if no finer mesh was simulated."""
    best, labels = study.best, drawn_parameters(study)
    if best is None or not labels:
        return None
    with house_style():
        figure = new_figure(6.5, 0.7 + 1.1 * len(labels))
        for axes, label in zip(figure.subplots(len(labels), 1, squeeze=False)[:, 0], labels, strict=True):
            estimate = study.parameters[label]
            scale = estimate_scale(estimate)
            value = estimate.value / scale.factor
            low, high = (edge / scale.factor for edge in estimate.interval or (estimate.value, estimate.value))
            axes.barh(1, high - low, left=low, height=0.5, color=BLUE, label="noise, 95 %")
            axes.plot([value], [1], marker="o", markersize=5, color=INK, linestyle="none", label="found")
            there = best.values[label] / scale.factor
            axes.barh(0, there - value, left=value, height=0.5, color=RED, alpha=0.75, label="mesh")
            for one, marker in zip([f for f in study.finer if not f.failure], _MARKERS, strict=False):
                at = one.values[label] / scale.factor
                axes.plot([at], [0], marker=marker, markersize=6, color=INK, markerfacecolor="white", linestyle="none",
                          label=one.name)  # fmt: skip
            axes.axvline(value, color=MUTED, linewidth=0.8)
            axes.set_yticks([0, 1], ["mesh", "noise"])
            axes.set_ylim(-0.6, 1.6)
            axes.use_sticky_edges = False
            axes.margins(x=0.08)
            axes.tick_params(axis="y", length=0)
            axes.grid(visible=False, axis="y")
            axes.grid(axis="x", color=FAINT, alpha=0.5)
            expected = with_unit(estimate, shown(estimate, best.values[label]))
            title = f"{parameter_label(label, study.parameters)}: {value_text(estimate)}, {expected} expected"
            axes.set_title(title, fontsize=9)
            axes.set_xlabel(f"[{scale.unit}]" if scale.unit else "")
        handles, names = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=min(len(names), 4))
        return figure
