"""The whole record beside the twin that is driven through it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from softcal.experiments.steps.branches import PULLEY_STEP
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, register_figure
from softcal.report.figures.trajectory import draw_trajectory, trajectory_panels
from softcal.report.format import joined, result_label


@register_figure("record")
def record(content: ReportContent) -> Iterator[Drawing]:
    """The twin driven through every sample of each corrected record, loading and unloading."""
    # Each experiment once: from the headline's calibration if it includes it, else from the first that does.
    drawn: set[str] = set()
    for label in dict.fromkeys([content.headline, *content.records]):
        fresh = {name: whole for name, whole in content.records.get(label, {}).items() if name not in drawn}
        drawn.update(fresh)
        for name, whole in fresh.items():
            if whole.fit is None:
                continue
            driven = replace(content.experiments[name], prepared=whole.record, drive="time")
            caption = (
                f"{name}: the whole record and the twin ({result_label(label)}), driven by {joined(whole.drives)} as "
                "measured. The twin was fitted to part of these samples, or to averages of them."
            )
            if not whole.remembers:
                caption += " It is elastic: the hysteresis loop remains in the residual."
            if any(step.name == PULLEY_STEP for step in whole.record.provenance) and "tension" in whole.fit.measured:
                caption += " Pulley friction is subtracted from every sample as on the fitted branch."
            if whole.every > 1:
                caption += f" One sample in {whole.every} is compared."
            yield Drawing(
                draw_trajectory(trajectory_panels(driven, whole.fit), 9.0),
                caption,
                of=name,
                shown="png",
                title=f"The whole record of {name}",
            )
