"""For a browser: the twin as a page; see `softcal.report.twin_page` and `softcal.export.shape_modes`."""

from __future__ import annotations

from pathlib import Path

from softcal.units import format_quantity
from softcal.workflows.export import ExportRequest, register_export
from softcal.workflows.exports.reduced import REACH, SAMPLES, reduced_fit

PAGE = "twin.html"
TESTED = 40  # random states at which its error is measured


@register_export(PAGE, pulled=False, hint="open {out}/" + PAGE + " in a browser", reach=REACH, samples=SAMPLES)
def web(request: ExportRequest, folder: Path, reach: str | None = None, samples: int | None = None) -> list[Path]:
    """For a browser: the twin in 3-D with a slider for each actuator, bands and a chart, as one page without a network.

    Parameters
    ----------
    request
        The project, the run for the 95 % bands, and observers.
    folder
        Folder of the page.
    reach, samples
        See `softcal export reduced`.
    """
    import numpy as np

    from softcal.export.reduced import Input, Sampled, evaluator_of
    from softcal.export.shape_modes import shape_modes
    from softcal.report.twin_page import drawn, shown_channels, shown_unit, twin_page
    from softcal.report.twin_view import TwinView

    robot = request.project.robot
    fit, band = reduced_fit(request, reach, samples, shapes=True, tested=TESTED)
    inputs, sampled, tested = [Input(**one) for one in fit.model["inputs"]], fit.sampled, fit.tested
    default = np.array([(one.default - one.least) / (one.most - one.least) for one in inputs])
    rest = Sampled.at(robot, inputs, default[None], shapes=True).snapshots[0]
    # Seen from where the first input bends it to the right.
    first = np.array([1.0 if default[0] <= 0.5 else 0.0, *default[1:]])
    bent = sampled.snapshots[np.abs(sampled.places - (2.0 * first - 1.0)).sum(axis=1).argmin()]
    seen = drawn(TwinView(robot, rest, bent, sampled.tets), [*sampled.snapshots, *tested.snapshots])
    n = len(sampled.points)
    directions, powers = np.array(fit.model["directions"]), np.array(fit.model["powers"])
    modes = shape_modes(seen.rest, seen.points[:n], lambda values: sampled.fitted(directions, powers, values))
    apart = max(
        modes.distance(directions, one.places, points)
        for one, points in ((sampled, seen.points[:n]), (tested, seen.points[n:]))
    )
    read = evaluator_of(fit.model)
    values = [read.read(dict(zip(read.inputs, at.tolist())), read.channels)[0] for at in sampled.points]
    shown = shown_channels(dict(zip(read.channels, np.transpose(values))))
    parts, commands = {part.name: part for part in robot.commandable}, [one for one in inputs if one.control]
    channels = {one.name: [f"{one.name}.{kind.name}" for kind in parts[one.name].channels[::-1]] for one in commands}
    units = {one.derivative: shown_unit(np.array([one.least, one.most]), one.unit) for one in inputs}
    data = {
        "model": {key: value for key, value in fit.model.items() if key not in ("parameters", "error", "rows")},
        "shapes": modes.data,
        "parts": seen.parts,
        "view": seen.view,
        "inputs": [channels.get(one.name, [one.name]) for one in inputs],
        "efforts": [one.derivative for one in commands or inputs],
        **shown,
        "units": {**shown["units"], **units},
    }
    largest: dict[str, float] = {}
    for name, error in fit.error.items():
        if not name.startswith(("d ", "band of ")):
            largest[error.unit] = max(largest.get(error.unit, 0.0), error.largest)
    errors = ", ".join(format_quantity(value, unit, digits=2) for unit, value in largest.items())
    statements = [
        f"Each slider sets one input; the others keep theirs. {fit.model['others']}"
        "Statics only: no dynamics, no hysteresis.",
        f"The largest difference of a drawn point from the twin: {format_quantity(apart, 'm', digits=2)}, at the {n} "
        f"equilibria of the model and {fit.model['error']['measured at']}; of what is in the table {errors}.",
        band.told,
    ]
    request.note("\n".join(statements))
    named = [", ".join(dict.fromkeys(parts[one.name].channels[k].name for one in commands)) for k in (1, 0)]
    page = folder / PAGE
    html = twin_page(request.project.name, data, named if commands else (), statements, band.estimates)
    page.write_text(html, encoding="utf-8")
    return [page]
