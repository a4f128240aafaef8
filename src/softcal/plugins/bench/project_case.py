"""Cases that are a project: its experiments are fitted or held out, and calibrated as any user's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import ClassVar

import numpy as np

import softcal
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.results.result import CalibrationResult
from softcal.checks import Floats
from softcal.errors import CalibrationError, Fault, InputError, StorageError
from softcal.executors.executor import Executor
from softcal.plugins.bench.case import BenchmarkCase, Progress
from softcal.plugins.bench.predictions import Predictions
from softcal.plugins.bench.record import FIT, PREDICT, CaseRecord, Split, joined, stacked
from softcal.project.bench_names import experiments_named
from softcal.project.document import Entry
from softcal.project.project import Project, load
from softcal.twin.robot import Robot
from softcal.units import format_quantity
from softcal.workflows.calibration import calibrate

PREDICTED, _PLACE = "predict.csv", "experiments.predict.files[0].path"
_PACKED = Path(__file__).parent / "examples"
# Beside the package in the source tree; a wheel has those of the cases inside.
EXAMPLES = next(
    (place for place in (_PACKED, Path(softcal.__file__).parents[2] / "examples") if place.is_dir()), _PACKED
)


class ProjectCase(BenchmarkCase):
    """A case whose folder has a `project.yaml`; the experiments that it holds out are to be predicted.

    A sample is named `EXPERIMENT:ROW`, or by the label of its row where the experiment has labels.

    Attributes
    ----------
    example
        Name of the example that is the project; "" where the case's own folder has one.
    held_out
        Experiments to be predicted, where the project itself holds none out.
    left_out
        Experiments of the samples to fit that softcal's model is not fitted to.
    """

    example: ClassVar[str] = ""
    held_out: ClassVar[tuple[str, ...]] = ()
    left_out: ClassVar[tuple[str, ...]] = ()

    @property
    def readme(self) -> Path:
        own = super().readme
        return own if own.is_file() else self.project_folder / "README.md"

    @property
    def project_folder(self) -> Path:
        """The folder of the project: the case's, or an example's.

        Raises
        ------
        StorageError
            Where softcal is installed without its examples.
        """
        if not self.example:
            return self.folder
        if not (EXAMPLES / self.example).is_dir():
            where = f"examples/{self.example}"
            told = "the files of the case are not in this installation of softcal"
            raise StorageError(Fault(told, where, attempt="softcal from its wheel, or from a checkout of its source"))
        return EXAMPLES / self.example

    def record(self, data: Path | None = None) -> CaseRecord:
        project = self._project(data)
        held = self._held(project)
        parts: list[tuple[Split, CaseRecord]] = []
        for name, experiment in project.experiments.items():
            channels = {c: np.array(experiment.dataset.values(c)) for c in experiment.compared}
            for channel, values in channels.items():
                values[~experiment.seen(channel)] = np.nan
            units = {c: experiment.dataset.channels[c].unit for c in experiment.compared}
            samples = _names(experiment)
            record = CaseRecord(samples, np.zeros(len(samples), dtype=bool), channels, units)
            parts.append((PREDICT if name in held else FIT, record))
        return joined([*(part for part in parts if part[0] == FIT), *(part for part in parts if part[0] == PREDICT)])

    def run(
        self,
        data: Path | None = None,
        *,
        workers: int | Executor = 1,
        store: Path | None = None,
        resume: bool = False,
        progress: Progress,
    ) -> Predictions:
        began = perf_counter()
        project = self._project(data)
        held = self._held(project)
        done = calibrate(
            project,
            fit="joint",
            hold_out=[*self.left_out, *held],
            out=store,
            resume=resume and store is not None and (store / "run.json").is_file(),
            workers=workers,
            progress=lambda label, state: progress(f"{self.name}: {state.done} trials {state.stage}"),
        )
        if done.stopped_by is not None:
            raise done.stopped_by
        found = done.headline
        require_predicted(found, (*self.left_out, *held))
        fits = {**found.experiments, **{name: one.fit for name, one in found.held_out.items()}}
        tables: list[tuple[tuple[str, ...], Mapping[str, Floats], Mapping[str, Floats]]] = []
        for name in [*(e for e in project.experiments if e not in held), *held]:
            experiment, fit = project.experiments[name], fits[name]
            names = _names(experiment)
            none = np.full(len(names), np.nan)  # the half-widths of the samples to predict count
            widths = {of: np.asarray(fit.bands.get(of, none) if name in held else none) for of in experiment.compared}
            tables.append((names, {of: np.asarray(fit.simulated[of]) for of in experiment.compared}, widths))
        samples = tuple(sample for names, _, _ in tables for sample in names)
        names = dict.fromkeys(name for _, table, _ in tables for name in table)
        channels = {name: stacked([table for _, table, _ in tables], name) for name in names}
        bands = {name: stacked([widths for _, _, widths in tables], name) for name in names}
        values: dict[str, str] = {}
        for name, one in found.parameters.items():
            values[name] = format_quantity(one.value, one.unit)
            if one.interval is not None:
                low, high = (format_quantity(end, one.unit, digits=3) for end in one.interval)
                values[name] += f" (95 %: {low} to {high})"
        return Predictions(
            samples,
            channels,
            {name: band for name, band in bands.items() if np.isfinite(band).any()},
            "softcal",
            len(found.trials),
            perf_counter() - began,
            values,
        )

    def robot(self) -> Robot:
        return self._project(None).robot

    def _held(self, project: Project) -> tuple[str, ...]:
        return tuple(experiments_named(self.held_out or project.calibration.hold_out, project.experiments))

    def _project(self, data: Path | None) -> Project:
        """The project, with further samples in the place of those that it predicts."""
        path = self.project_folder / "project.yaml"
        if data is None:
            return load(path)
        if not (self.project_folder / PREDICTED).is_file():
            allowed = f"a case whose samples to predict are in {PREDICTED}"
            raise InputError(Fault("the case takes no further samples", "--data", str(data), allowed))
        return load(path, changes={_PLACE: Entry(str(data.absolute()), "--data")})


def require_predicted(found: CalibrationResult, held: tuple[str, ...]) -> None:
    """Check that every experiment that was held out could be predicted.

    Raises
    ------
    CalibrationError
        For those that could not.
    """
    if missing := set(held) - found.held_out.keys():
        raise CalibrationError(f"{', '.join(sorted(missing))} cannot be predicted: {found.notes[-1].text}")


def _names(experiment: Experiment) -> tuple[str, ...]:
    """The names of an experiment's samples."""
    labels = experiment.dataset.labels
    n = experiment.dataset.n_samples
    return tuple(labels) if labels else tuple(f"{experiment.name}:{i + 1}" for i in range(n))
