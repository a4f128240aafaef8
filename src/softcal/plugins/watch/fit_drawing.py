"""The report's figures of the fit, measured and simulated, of a twin at values that a search has found so far."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from softcal.calibration.problem.observation import observe
from softcal.calibration.results.fit import experiment_fit
from softcal.calibration.results.result import CalibrationResult, ExperimentFit
from softcal.errors import SoftcalError
from softcal.project.project import Project
from softcal.report.content import ReportContent
from softcal.report.figure import Drawing, named_figures
from softcal.twin.response import Response
from softcal.workflows.reporting import experiment_content
from softcal.workflows.simulation import simulate

FIGURES = ("loops", "trajectory", "distances")
MOST = 6  # experiments


def fits_at(
    at_values: Project, names: Sequence[str], known: Mapping[str, Response]
) -> tuple[dict[str, ExperimentFit], str]:
    """The fits of the first experiments at the project's values, and sentences on experiments without a fit.

    Parameters
    ----------
    at_values
        The project at these values.
    names
        Names of the experiments.
    known
        Experiment -> response that need not be solved again.
    """
    fits: dict[str, ExperimentFit] = {}
    told: list[str] = []
    for name in names[:MOST]:
        experiment = at_values.experiments[name]
        try:
            response = known.get(name) or simulate(at_values, experiment=name)
            if response.succeeded:
                observed = observe(experiment, experiment.rig_values(), response, slice(None))
                fits[name] = experiment_fit(experiment, observed)
            else:
                told.append(f"{name}: {response.status}")
        except SoftcalError as error:
            told.append(f"{name}: {error}")
    if len(names) > MOST:
        told.append(f"The first {MOST} of {len(names)} experiments are drawn.")
    return fits, " ".join(told)


def fit_drawings(project: Project, label: str, fits: Mapping[str, ExperimentFit]) -> Iterator[Drawing]:
    """The figures of fits.

    Parameters
    ----------
    project
        The project of the run.
    label
        Label of the calibration.
    fits
        Experiment -> fit.
    """
    if not fits:
        return
    # The figures of a fit read the fits alone.
    result = CalibrationResult(
        parameters={}, loss=0.0, loss_name="", method="", seed=0, n_solves=0, n_factorisations=0, wall_s=0.0,
        status="", experiments=fits, importance={}, trials=(), n_failed_trials=0,
    )  # fmt: skip
    content = ReportContent(project.name, {label: result}, {name: experiment_content(project, name) for name in fits})
    for figure in named_figures(FIGURES):
        yield from figure.function(content)
