"""For a browser: the twin as a page; see `softcal.report.twin_page` and `softcal.export.shape_modes`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.units import format_quantity
from softcal.workflows.export import ExportOption, ExportRequest, register_export

if TYPE_CHECKING:
    from softcal.calibration.statistics.estimator import Estimator
    from softcal.checks import Floats
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
    band, told = _Band.of(request), list[str]()
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


@dataclass(frozen=True)
class _Band:
    """The 95 % band of a calibration.

    steps: parameter of the robot -> its change [SI] by z (size,); empty where there is no band. told: what the band
    is, or why there is none. estimates: label, value and interval of each parameter of the robot.
    """

    told: str
    steps: Mapping[str, Floats] = field(default_factory=dict[str, "Floats"])
    found: Estimator | None = None
    estimates: Sequence[tuple[str, str, str]] = ()

    @classmethod
    def of(cls, request: ExportRequest) -> _Band:
        import numpy as np

        from softcal.calibration.results.digits import estimate_cells
        from softcal.twin.parameters import parameter_values
        from softcal.workflows.run import SweepRun
        from softcal.workflows.run_folder import load_run
        from softcal.workflows.study_source import run_source

        if request.run is None:
            return cls("There are no bands: the values are those of a project file, not of a calibrated run.")
        run, values = Path(request.run), parameter_values(request.project.robot)
        if run.is_dir() and isinstance(load_run(run), SweepRun):
            return cls("There are no bands: a sweep has no intervals.")
        source = run_source(run)
        free, known = source.problem.space.parameters, {} if source.result is None else source.result.parameters
        of_robot = [(p, target) for p in free for target in p.targets if target in values]
        others = [target for p, target in of_robot if not isclose(values[target], source.theta[p.label])]
        if others:
            return cls(f"There are no bands: {others[0]} does not have the calibrated value.")
        labels = dict.fromkeys(p.label for p, _ in of_robot)
        told = [(label, (cells := estimate_cells(known[label]))[0], cells[1]) for label in labels]
        unknown = [f"{label} has no interval" for label in labels if known[label].interval is None]
        if unknown or not labels:
            why = next(iter(unknown), "no parameter of the robot was calibrated")
            return cls(f"There are no bands: {why}.", estimates=told)
        request.stage("Simulating the experiments, for the bands")
        found, slopes = source.estimator()
        steps = {target: np.where([p is one for one in free], slopes, 0.0) for p, target in of_robot}
        words = (
            "The bands are the 95 % intervals of the calibration carried into what the twin does at a given tension, "
            "with the correlations of the parameters and the differences between the experiments, and without the "
            "noise of a measurement."
        )
        return cls(" ".join([words, *source.notes]), steps, found, told)

    def width(self, rates: Floats) -> Floats:
        """Half the width (n,) of what has derivatives (n, n_steps) by the parameters."""
        import numpy as np

        from softcal.calibration.statistics.band import width_of

        if self.found is None:
            return np.zeros(len(rates))
        return width_of(rates @ np.array([*self.steps.values()]), self.found.within_bounds, self.found)
