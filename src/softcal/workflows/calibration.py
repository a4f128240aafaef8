"""A project's calibrations: each experiment by itself, all jointly, or both, kept in one run folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from softcal.analysis.validation import with_split
from softcal.calibration.problem.experiment import PULLEY_FRICTION
from softcal.calibration.problem.loss import LOSSES, Loss
from softcal.calibration.problem.option import options_of
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.digits import ESTIMATE, estimate_cells
from softcal.calibration.results.result import CalibrationResult, SearchResult, result_html
from softcal.calibration.results.result_plots import ResultPlots
from softcal.calibration.run import calibrate as calibrate_problem
from softcal.calibration.run import require_joinable
from softcal.calibration.search.hold_out import fitted_part
from softcal.calibration.search.interrupts import stoppable
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.search.search import Progress
from softcal.calibration.search.shared_search import Sharing
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import CalibrationError, Fault, InputError, ParameterError, unknown
from softcal.executors.each import Workers
from softcal.html_text import paragraph, summary
from softcal.limits import JOINT
from softcal.project.bench_names import experiments_named
from softcal.project.calibration_schema import CalibrationSection
from softcal.project.project import Project, ProjectSource, project_of
from softcal.project.section import changed
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.workflows.engines import SOFTCAL, engine_for, engine_identity, left_out_sentence
from softcal.workflows.run import Outcome
from softcal.workflows.run_folder import begin_run, calibration_folder, finish_run, reopen_run

# Called after every trial, and at every stage after them: the label of the calibration, and how far it is.
Observer = Callable[[str, Progress], None]


@displayed
@dataclass(frozen=True)
class Calibrations(Outcome, ResultPlots):
    """Results by label (an experiment's name, or "joint"), and the folder that keeps them."""

    results: Mapping[str, CalibrationResult]

    def _repr_html_(self) -> str:
        kept = [f"Kept in {self.folder}."] if self.folder is not None else []
        if len(self.results) == 1:
            return result_html(self.headline) + "".join(map(paragraph, kept))
        rows = [
            [label, name, *estimate_cells(estimate)]
            for label, r in self.results.items()
            for name, estimate in r.parameters.items()
        ]
        ends = [f"{label}: {result.status}" for label, result in self.results.items()]
        return summary(f"{len(self.results)} calibrations", ["calibration", "parameter", *ESTIMATE], rows, ends + kept)

    @property
    def headline(self) -> CalibrationResult:
        """The joint result where there is one, else the first."""
        return self.results[JOINT] if JOINT in self.results else next(iter(self.results.values()))


@checked_arguments
def calibrate(
    project: ProjectSource,
    *,
    out: str | Path | None = None,
    resume: bool = False,
    workers: Workers = 1,
    engine: str = SOFTCAL,
    progress: Observer | None = None,
    storage: str | None = None,
    ready: Callable[[str, CalibrationResult], None] = lambda label, result: None,
    **changes: object,
) -> Calibrations:
    """Find a project's free parameters.

    Parameters
    ----------
    project
        A project, or the path of a project file.
    out
        Run folder, new or empty; None keeps nothing on disk.
    resume
        Go on with the run in `out`.
    workers
        An executor, or a number of processes.
    engine
        What computes the twin: "softcal" or "sofa", by the project's `engines`.
    progress
        Called after every trial, and before what takes long after them, with the calibration's label and its progress.
    storage
        Where several processes share the search, each with an `out` of its own: `journal:FILE`, or the URL of a
        PostgreSQL or MySQL database. The method is tpe; the study is named after the project and the calibration.
    ready
        Called with a calibration's label and result where others are still to come.
    changes
        Any of the project's `calibration` section, in the place of what it says: `method`, `fit` ("each", "joint" or
        "both"), `trials`, `seed`, `starts`, `loss`, `hold_out` (experiments that are not fitted but predicted), `split`
        (tied parameters that get a value for each of their parts), `mesh_error` (whether the intervals of the joint
        result, or of the only one, include the error of the mesh). None leaves what it says.

    Raises
    ------
    InputError
        Where nothing is free or nothing was measured, an option makes no sense, or the folder cannot be used; for a
        project that cannot be loaded; for an engine that does not exist, is not installed, or cannot have the robot.
    CalibrationError
        Where no trial could be simulated.
    """
    project = project_of(project)
    settings, problems = plan(project, engine, **changes)
    identity = engine_identity(engine, project.engines)
    studies = {label: f"softcal/{project.name}/{label}" for label in problems}
    shared = {label: None if storage is None else Sharing(storage, study) for label, study in studies.items()}
    for label, sharing in shared.items():
        if sharing is not None:
            require_joinable(problems[label], settings.search, sharing, identity)
    folder = None if out is None else Path(out)
    if folder is not None:
        if resume:
            reopen_run(project, folder)
        else:
            begin_run(project, settings, list(problems), folder)
    elif resume:
        raise InputError(Fault("a run is resumed from its folder, which is missing", attempt="out"))
    results: dict[str, CalibrationResult] = {}
    headline = JOINT if JOINT in problems or len(problems) > 1 else next(iter(problems))
    with stoppable() as stop:
        for label, problem in problems.items():
            store = None if folder is None else calibration_folder(folder, label)
            begun = store is not None and (store / "run.json").is_file()
            try:
                results[label] = calibrate_problem(
                    problem,
                    replace(settings.search, mesh_error=settings.mesh_error and label == headline),
                    workers=workers,
                    store=store,
                    resume=resume and begun,
                    hashes=identity,
                    progress=None if progress is None else partial(progress, label),
                    sharing=shared[label],
                )
            except CalibrationError:
                if stop.by is None:
                    raise
            if stop.by is not None:
                break
            if len(results) < len(problems):
                ready(label, results[label])
    if folder is not None and results:
        finish_run(project, results, folder)
    return Calibrations(results, folder=folder, stopped_by=stop.by)


def plan(project: Project, engine: str = SOFTCAL, **changes: object) -> tuple[CalibrationSection, dict[str, Problem]]:
    """The settings of a calibration, and the problems that it solves by label; changes as those of `calibrate`.

    Raises
    ------
    InputError
        See `calibrate`.
    ParameterError
        For an option that neither the method nor the loss has.
    """
    arguments = {key: value for key, value in changes.items() if value is not None}
    fields = _fields()

    def where(name: str) -> str:
        return f"--{name.replace('_', '-')}" if name in fields else f"--option {name}={arguments[name]}"

    overrides = {name: value for name, value in arguments.items() if name in fields or name in options_of()}
    settings = changed(project.calibration, overrides, where)
    # A file may have options of other methods and losses, a caller may not.
    used = options_of({"method": OPTIMISERS[settings.method], "loss": LOSSES[settings.loss]})
    what = f"neither the method {settings.method} nor the loss {settings.loss} has this option"
    faults = [
        unknown(what, where(name), name, sorted(used), among=(*used, *fields), got="")
        for name in arguments
        if name not in fields and name not in used
    ]
    if faults:
        raise ParameterError(faults)
    hold_out = experiments_named(settings.hold_out, project.experiments)
    settings = changed(settings, {"hold_out": hold_out}, where)
    problem = replace(
        make_problem(project, settings),
        simulate=engine_for(engine, project.robot, project.engines),
        left_out=left_out_sentence(engine, project.robot),
    )
    fitted_part(problem, settings.hold_out)  # raises where nothing is left to fit
    names = [experiment.name for experiment in problem.experiments if experiment.name not in settings.hold_out]
    if len(names) == 1:
        return settings, {names[0]: problem}
    fit = settings.fit
    alone = {name: problem.only([name, *settings.hold_out]) for name in names} if fit in ("each", "both") else {}
    return settings, {**alone, **({JOINT: problem} if fit in ("joint", "both") else {})}


def require_options(given: Mapping[str, object]) -> None:
    """Check that every name is a setting of a calibration, or an option of some method or loss.

    Raises
    ------
    ParameterError
        With every name that is none.
    """
    valid = {*_fields(), *options_of()}
    faults = [
        unknown("neither a method nor a loss has this option", f"--option {name}={value}", name, sorted(valid), got="")
        for name, value in given.items()
        if name not in valid
    ]
    if faults:
        raise ParameterError(faults)


def _fields() -> set[str]:
    return {name for name in CalibrationSection.model_fields if name != "options"}


def make_problem(project: Project, settings: CalibrationSection | None = None) -> Problem:
    """The inverse problem of a project: all its experiments jointly.

    Raises
    ------
    InputError
        Where nothing is free or nothing was measured.
    ParameterError
        Where a parameter has a wrong name, value or bound.
    """
    faults: list[Fault] = []
    if not project.experiments:
        faults.append(Fault("there is no experiment to calibrate with", str(project.path), attempt="experiments: …"))
    if project.space is None:
        faults.append(
            Fault(
                "there is no free parameter",
                str(project.path),
                allowed="at least one under 'parameters' that is not fixed",
                attempt="neck.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}",
            )
        )
    if faults or project.space is None:
        raise ParameterError(faults)
    settings = settings or project.calibration
    length = next((e.rig.length for e in project.experiments.values() if e.rig.length is not None), None)
    loss = make_loss(settings, length)
    problem = Problem(
        project.robot, tuple(project.experiments.values()), project.space, loss, uncertain=project.uncertain
    )
    for tied in settings.split:
        problem = with_split(problem, tied)
    return problem


def make_loss(settings: CalibrationSection, length: float | None = None) -> Loss:
    """The loss that the settings name, with its options; length [m]: reference of distances in per cent.

    Raises
    ------
    ParameterError
        Where there is no such loss, or it needs a length and `length` is None.
    """
    loss = LOSSES.named(settings.loss)
    if loss.needs_length and length is None:
        raise ParameterError(Fault(f"the loss '{settings.loss}' needs a length", "rig.length", allowed="rig.length"))
    return loss.made(settings.options, length)


def calibrated(project: Project, result: SearchResult) -> Project:
    """The project at the values of a result: shared ones in the robot and in every rig, an experiment's own in it."""
    theta = {label: estimate.value for label, estimate in result.parameters.items()}
    tied = {label: estimate.of for label, estimate in result.parameters.items()}
    held = {name: one.own for name, one in result.held_out.items()}
    return project_at(project, theta, tied, [*result.experiments, *result.held_out], held)


def project_at(
    project: Project,
    theta: Mapping[str, float],
    tied: Mapping[str, Sequence[str]],
    experiments: Sequence[str],
    held: Mapping[str, Mapping[str, float]] | None = None,
) -> Project:
    """The project at values of parameters: shared ones in the robot and in every rig, an experiment's own in it.

    Parameters
    ----------
    project
        The project of the calibration.
    theta
        Label -> value [SI].
    tied
        Label -> names of the parameters that have its value, where the label is none itself.
    experiments
        Those that get values.
    held
        Experiment that was held out -> its own values [SI by label].

    Raises
    ------
    ParameterError
        For experiments that the project does not have.
    """
    if strangers := [name for name in experiments if name not in project.experiments]:
        got, allowed = ", ".join(strangers), ", ".join(project.experiments)
        raise ParameterError(Fault("the result is of another project", project.name, got, allowed))
    of_robot = robot_parameters(project.robot)
    shared: dict[str, float] = {}
    by_experiment: dict[str, dict[str, float]] = {}
    for label, value in theta.items():
        name, _, experiment = label.removesuffix("]").partition("[")
        values = dict.fromkeys(tied.get(label) or (name,), value)
        members = [e.name for e in project.experiments.values() if experiment in (e.name, e.set_up)]
        for target in [by_experiment.setdefault(e, {}) for e in members] if experiment else [shared]:
            target.update(values)
    for name, values in (held or {}).items():
        by_experiment.setdefault(name, {}).update({label.partition("[")[0]: value for label, value in values.items()})
    robot = with_parameters(project.robot, {name: value for name, value in shared.items() if name in of_robot})
    changed_experiments = dict(project.experiments)
    for name in experiments:
        experiment = changed_experiments[name]
        names = experiment.rig_values().keys() | of_robot.keys()
        here = {**{n: v for n, v in shared.items() if n not in of_robot}, **by_experiment.get(name, {})}
        # The pulleys' friction stays the nominal one, under which the dataset was brought to the neck's side.
        pulleys = experiment.rig.pulleys
        kept = () if pulleys is not None and pulleys.friction_memory else (PULLEY_FRICTION,)
        settings = {n: v for n, v in here.items() if n in names and n not in kept}
        changed_experiments[name] = replace(experiment, settings={**experiment.settings, **settings})
    return replace(project, robot=robot, experiments=changed_experiments)
