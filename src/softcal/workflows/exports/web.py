"""For a browser: the twin as a page; see `softcal.report.twin_page` and `softcal.export.shape_modes`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from softcal.units import format_quantity
from softcal.workflows.export import ExportOption, ExportRequest, register_export
from softcal.workflows.run_band import RunBand

if TYPE_CHECKING:
    from softcal.export.tension_grid import Reach

PAGE = "twin.html"
SAMPLES = {1: 33, 2: 9, 3: 7}  # number of cables -> nodes along each


@register_export(
    PAGE,
    hint="open {out}/" + PAGE + " in a browser",
    samples=ExportOption(int, "Nodes along each cable; by default 33, 9 or 7.", "N"),
)
def web(request: ExportRequest, folder: Path, samples: int | None = None) -> list[Path]:
    """For a browser: the twin in 3-D with a slider for each of up to three cables, as one page without a network.

    Parameters
    ----------
    request
        The project, its cases, the run for the 95 % bands, and observers.
    folder
        Of the page.
    samples
        Nodes along each cable; by default 33, 9 or 7.
    """
    import numpy as np

    from softcal.export.shape_modes import hermite, shape_modes
    from softcal.export.tension_grid import tension_grid
    from softcal.report.twin_page import drawn, twin_page
    from softcal.report.twin_view import TwinView

    robot, reaches = request.project.robot, _reaches(request)
    band, told = RunBand.of(request), list[str]()
    request.stage("Simulating the nodes of the model, and points between them")
    fit = tension_grid(
        robot,
        reaches,
        samples or SAMPLES.get(len(reaches), 2),
        tell=told.append,
        parameters=list(band.steps),
        shapes=True,
    )
    for sentence in told:
        request.warn(sentence)
    # Seen from where the first cable, which is pulled at first, bends it to the right.
    bent = fit.nodes[-(len(fit.nodes) // len(fit.model["axes"][0]))]
    seen = drawn(TwinView(robot, fit.nodes[0], bent, fit.tets), [*fit.nodes, *fit.between])
    modes = shape_modes(fit.model, seen.points[: len(fit.nodes)], fit.points, seen.points[len(fit.nodes) :])
    widths = [band.width(rates) for rates in fit.rates.values()]
    data = {
        "model": fit.model,
        "shapes": modes.data,
        "parts": seen.parts,
        "view": seen.view,
        "markers": [marker.name for marker in robot.markers],
        "measures": list(fit.rates),
        "bands": hermite(fit.model, np.stack(widths, axis=1), monotonic=True) if band.steps else None,
    }
    largest = {"m": 0.0, "rad": 0.0}
    for name, error in fit.error.items():
        if not name.startswith("d "):
            largest[error.unit] = max(largest[error.unit], error.largest)
    apart, lengths, angles = (
        format_quantity(value, unit, digits=2)
        for value, unit in ((modes.error, "m"), (largest["m"], "m"), (largest["rad"], "rad"))
    )
    statements = [
        "Each slider pulls a cable, by its tension or by its shortening; the others keep their tensions. "
        f"{fit.model['others']} Statics only: no dynamics, no hysteresis.",
        f"The largest difference of a drawn point from the twin: {apart}, at the {len(fit.nodes)} nodes of the model "
        f"and {fit.model['error']['measured at']}; of the lengths in the table {lengths}, of the angles {angles}.",
        band.told,
    ]
    request.note("\n".join(statements))
    page = folder / PAGE
    page.write_text(twin_page(request.project.name, data, [*statements, *told], band.estimates), encoding="utf-8")
    return [page]


def _reaches(request: ExportRequest) -> dict[str, Reach]:
    """The largest command of each cable in the cases, of the kind of its first one."""
    from softcal.export.tension_grid import Reach

    found: dict[str, Reach] = {}
    for case in request.cases().values():
        for cable, command in case.protocol.commands.items():
            unit, most = "m" if command.control == "shortening" else "N", float(max(command.values))
            if most > 0.0 and found.get(cable, Reach(0.0, unit)).unit == unit:
                found[cable] = Reach(max(most, found.get(cable, Reach(0.0, unit)).value), unit)
    return found
