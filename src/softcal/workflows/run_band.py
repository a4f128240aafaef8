"""The 95 % band of a calibrated run, carried into what its twin does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.workflows.export import ExportRequest

if TYPE_CHECKING:
    from softcal.analysis.reach import ReachTask
    from softcal.calibration.statistics.estimator import Estimator
    from softcal.checks import Floats
    from softcal.twin.live import LiveState


@dataclass(frozen=True)
class RunBand:
    """The 95 % band of a calibration.

    steps: parameter of the robot -> its change [SI] by z (size,); empty where there is no band. told: what the band
    is, or why there is none. estimates: label, value and interval of each parameter of the robot.
    """

    told: str
    steps: Mapping[str, Floats] = field(default_factory=dict[str, "Floats"])
    found: Estimator | None = None
    estimates: Sequence[tuple[str, str, str]] = ()

    @classmethod
    def of(cls, request: ExportRequest) -> RunBand:
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
        several = " and the differences between the experiments" if len(source.problem.experiments) > 1 else ""
        words = (
            "The bands are the 95 % intervals of the calibration carried into what the twin does at a command, "
            f"with the correlations of the parameters{several}, and without the noise of a measurement."
        )
        return cls(" ".join([words, *source.notes]), steps, found, told)

    def width(self, rates: Floats) -> Floats:
        """Half the width (n,) of what has derivatives (n, n_steps) by the parameters."""
        import numpy as np

        from softcal.calibration.statistics.band import width_of

        if self.found is None:
            return np.zeros(len(rates))
        return width_of(rates @ np.array([*self.steps.values()]), self.found.within_bounds, self.found)

    def at(self, state: LiveState, task: ReachTask, wanted: Sequence[str]) -> tuple[dict[str, float], dict[str, float]]:
        """Half the widths [SI] of channels at a state's commands, and of the commands that keep the channels there.

        Of several commands that do, those of the least change count, each in proportion to its effect. The latter is
        empty where the commands cannot keep all of the channels.

        Parameters
        ----------
        state
            The state.
        task
            The tolerances, by which several channels are weighed.
        wanted
            The channels; of a stiffness there is no band.
        """
        import numpy as np

        channels = [name for name in wanted if name not in task.stiffnesses]
        if not self.steps or not channels:
            return {}, {}
        rates, by = state.by_parameters(*self.steps).of(channels), state.by_commands()
        bands = dict(zip(channels, self.width(rates).tolist(), strict=True))
        names = list(task.units)
        tolerance = np.array([task.tolerances[names.index(name)] for name in channels])[:, None]
        J = by.of(channels) / tolerance
        effect = np.abs(J).max(axis=0)
        scale = np.divide(1.0, effect, out=np.zeros_like(effect), where=effect > 0.0)
        if len(channels) < len(wanted) or np.linalg.matrix_rank(J * scale) < len(channels):
            return bands, {}
        steps = scale[:, None] * (np.linalg.pinv(J * scale) @ (rates / tolerance))
        return bands, dict(zip(by.names, self.width(steps).tolist(), strict=True))
