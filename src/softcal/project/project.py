"""load(path): a project file, its meshes and its bench data as one frozen Project, or every fault of them at once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from softcal.calibration.experiment import PULLEY_FRICTION, Experiment, rig_parameters
from softcal.calibration.friction import friction_faults
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Ints
from softcal.errors import Fault, ProjectFileError
from softcal.experiments.dataset import Dataset
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quality import MeshReport
from softcal.limits import LIMITS
from softcal.project.axes import Axis, cells_fault, doubled, parse_axis
from softcal.project.bench import Bench, build_bench
from softcal.project.bench_names import experiments_named
from softcal.project.bench_schema import ExperimentSection, RigSection
from softcal.project.calibration_schema import CalibrationSection, ParameterSection, PrintSection
from softcal.project.document import Document, Findings, suggestion
from softcal.project.dynamics_schema import DynamicsSection
from softcal.project.engines_schema import EnginesSection
from softcal.project.files import InputFiles, sha256
from softcal.project.meshes import is_generated, mesh_maker
from softcal.project.names import RESERVED_OF_TESTS, check_names
from softcal.project.robot import BuiltRobot, build_robot
from softcal.project.robot_schema import RobotSection
from softcal.project.search import build_search, held_values, names_held, rig_value, untied
from softcal.project.section import Section, validated
from softcal.project.sweep_schema import SweepSection
from softcal.project.yaml_file import read_document
from softcal.report.content import PrintInfill
from softcal.twin.parameters import ParameterInfo, robot_parameters, with_parameters
from softcal.twin.robot import Robot

S = TypeVar("S", bound=Section)

SECTIONS = (
    "softcal",
    "name",
    "robot",
    "rig",
    "experiments",
    "parameters",
    "calibration",
    "sweep",
    "dynamics",
    "engines",
    "print",
)
FORMAT = 1


@dataclass(frozen=True)
class Project:
    """Everything a project file describes; numbers in SI.

    path: of the file. experiments, records (as read), corrected (every sample after the corrections, before any were
    chosen; None where there is no such record): by experiment. space: the free parameters, None where none is free.
    tied: what has one value in common, names or patterns, by the name of that value. held: parameters given from
    outside.
    hashes: SHA-256 of the project file and of every file it names. inputs: those files by path as written.
    generated: body -> the mesh that Gmsh made of it, before it was put in place.
    warnings: what is allowed but looks wrong.
    """

    path: Path
    name: str
    robot: Robot
    experiments: Mapping[str, Experiment]
    records: Mapping[str, Dataset]
    corrected: Mapping[str, Dataset | None]
    space: SearchSpace | None
    tied: Mapping[str, tuple[str, ...]]
    calibration: CalibrationSection
    sweep: SweepSection | None
    dynamics: DynamicsSection
    engines: EnginesSection
    print_infill: PrintInfill | None
    held: Mapping[str, float]
    hashes: Mapping[str, str]
    inputs: Mapping[str, Path]
    generated: Mapping[str, TetMesh]
    qualities: Mapping[str, MeshReport]
    regions: Mapping[str, Mapping[str, Ints]]
    warnings: tuple[Fault, ...]

    @property
    def parameters(self) -> dict[str, ParameterInfo]:
        """Every parameter by dotted name, of the robot and of the rig, with its present value."""
        return {**robot_parameters(self.robot), **rig_parameters(self.experiments.values())}


def load(
    path: str | Path, *, values: Mapping[str, str | float] | None = None, copies: Mapping[str, str] | None = None
) -> Project:
    """Read and check a project file and everything it names.

    Parameters
    ----------
    path
        The project file; paths in it are relative to its folder.
    values
        Parameters to hold, by dotted name: text with a unit (`{"neck.youngs_modulus": "2.3 MPa"}`) or numbers in SI.
        They replace what the file says, and are no longer free.
    copies
        Where files lie that the project names: path as written -> path relative to the project file. For runs.

    Raises
    ------
    ProjectFileError
        With every fault of the file, its meshes and its data: file, line, key, what was found, what is allowed.
    ParameterError
        For `values` that do not fit.
    StorageError
        Where the project file cannot be read.
    """
    path = Path(path)
    document = read_document(path)
    findings = Findings(document)
    _check_keys(document, findings)
    files = InputFiles(path.parent, dict(copies or {}))
    given = dict(values or {})

    section = _section(RobotSection, "robot", document, findings)
    rig = _section(RigSection, "rig", document, findings, {}) or RigSection()
    experiments = _entries(ExperimentSection, "experiments", document, findings)
    _check_names(document, experiments, findings)
    parameters = _entries(ParameterSection, "parameters", document, findings)
    calibration = _section(CalibrationSection, "calibration", document, findings, {})
    dynamics = _section(DynamicsSection, "dynamics", document, findings, {})
    engines = _section(EnginesSection, "engines", document, findings, {})
    swept = _section(SweepSection, "sweep", document, findings)
    print_infill = _print_infill(document, findings)

    built = None
    # Meshes are not made for a file that will be refused anyway: that may take minutes.
    if section is not None and not (findings.faults and any(map(is_generated, section.bodies.values()))):
        built = build_robot(section, mesh_maker(files), findings)
    given = untied(given, parameters)
    rig = _with_held_friction(rig, given)
    benches = {
        name: build_bench(name, experiment, rig, section, files, findings, None if built is None else built.robot)
        for name, experiment in experiments.items()
    }
    whole = {name: bench for name, bench in benches.items() if bench is not None}
    all_there = built is not None and len(whole) == len(_raw(document, "experiments"))
    known = _known(built, whole) if built is not None and all_there else None
    own = {name: whole[name].experiment.rig_values() if name in whole else {} for name in experiments}
    set_ups = {name: experiment.set_up for name, experiment in experiments.items()}
    _check_set_ups(set_ups, findings)
    space = build_search(parameters, known, own, set_ups, names_held(given, known or ()), findings)
    tied = {name: tuple(section.of) for name, section in parameters.items() if section.of}
    _check_calibration(calibration, rig, experiments, tied, findings)
    _check_settings(space, {name: bench.experiment for name, bench in whole.items()}, findings)
    _check_settling(dynamics, built, findings)
    _check_sweep(swept, known, tied, experiments, findings)
    findings.raise_if_any()

    if built is None or calibration is None or known is None or section is None or dynamics is None or engines is None:
        raise ProjectFileError(Fault("the project is not whole", document.name))
    held = held_values(given, known)
    of_robot = robot_parameters(built.robot)
    robot = with_parameters(built.robot, {name: value for name, value in held.items() if name in of_robot})
    tests = {name: _with_held_rig(bench.experiment, held) for name, bench in whole.items()}
    _check_friction(robot, space, tests, findings)
    findings.raise_if_any()
    return Project(
        path=path,
        name=str(document.data["name"]),
        robot=robot,
        experiments=tests,
        records={name: bench.record for name, bench in whole.items()},
        corrected={name: bench.corrected for name, bench in whole.items()},
        space=space,
        tied=tied,
        calibration=calibration,
        sweep=swept,
        dynamics=dynamics,
        engines=engines,
        print_infill=print_infill,
        held=held,
        hashes={path.name: sha256(path), **files.hashes()},
        inputs=dict(files.used),
        generated={name: built.made[name] for name, body in section.bodies.items() if is_generated(body)},
        qualities=built.qualities,
        regions=built.regions,
        warnings=tuple(dict.fromkeys(findings.warnings)),
    )


def _check_keys(document: Document, findings: Findings) -> None:
    for key in document.data:
        if key not in SECTIONS:
            findings.add(
                (key,), "unknown key", got=f"'{key}'", allowed=", ".join(SECTIONS), attempt=suggestion(key, SECTIONS)
            )
    for key, allowed in (("softcal", f"softcal: {FORMAT}"), ("name", "a name for people"), ("robot", "the robot")):
        if document.data.get(key) is None:
            findings.add((), "a key is missing", got=f"no '{key}'", allowed=allowed)
    version = document.data.get("softcal", FORMAT)
    if version is not None and (version != FORMAT or isinstance(version, bool)):
        findings.add(("softcal",), "the format is not known", got=repr(version)[:60], allowed=str(FORMAT))
    if not isinstance(document.data.get("name") or "", str):
        findings.add(("name",), "this is of the wrong kind", got=repr(document.data["name"])[:60], allowed="text")


def _section(
    model: type[S], key: str, document: Document, findings: Findings, default: dict[str, Any] | None = None
) -> S | None:
    data = document.data.get(key)
    data = default if data is None else data
    return None if data is None else validated(model, data, (key,), findings)


def _raw(document: Document, key: str) -> Mapping[str, Any]:
    data = document.data.get(key)
    return data if isinstance(data, dict) else {}


def _entries(model: type[S], key: str, document: Document, findings: Findings) -> dict[str, S]:
    """The entries of a mapping of sections that are in order, each checked by itself."""
    data = document.data.get(key)
    if data is not None and not isinstance(data, dict):
        findings.add((key,), "this is of the wrong kind", got=repr(data)[:60], allowed="a mapping of names")
    found = {name: validated(model, entry, (key, name), findings) for name, entry in _raw(document, key).items()}
    return {name: entry for name, entry in found.items() if entry is not None}


def _known(built: BuiltRobot, benches: Mapping[str, Bench]) -> dict[str, ParameterInfo]:
    return {
        **robot_parameters(built.robot),
        **rig_parameters(bench.experiment for bench in benches.values()),
    }


def _with_held_friction(rig: RigSection, given: Mapping[str, str | float]) -> RigSection:
    """The rig with the pulleys' friction that is held: the data are prepared under it."""
    if PULLEY_FRICTION not in given or rig.pulleys is None:
        return rig
    friction = rig_value(PULLEY_FRICTION, given[PULLEY_FRICTION])
    return rig.model_copy(update={"pulleys": rig.pulleys.model_copy(update={"friction_coefficient": friction})})


def _with_held_rig(experiment: Experiment, held: Mapping[str, float]) -> Experiment:
    """The experiment with the rig values that are held."""
    own = {name: held[name] for name in experiment.rig_values() if name in held}
    return replace(experiment, settings={**experiment.settings, **own})


def _check_calibration(
    section: CalibrationSection | None,
    rig: RigSection,
    experiments: Mapping[str, object],
    tied: Mapping[str, object],
    findings: Findings,
) -> None:
    if section is None:
        return
    if section.loss == "distance" and rig.length is None:
        findings.add(
            ("calibration", "loss"),
            "the loss 'distance' is told in per cent of a length",
            got="no rig.length",
            allowed="rig: {length: 425 mm}",
        )
    for i, name in enumerate(section.hold_out):
        if name not in experiments:
            findings.unknown(("calibration", "hold_out", i), "experiment", name, experiments)
    for i, name in enumerate(section.split):
        if name not in tied:
            findings.unknown(("calibration", "split", i), "tied parameter", name, tied)


def _check_settling(section: DynamicsSection | None, built: BuiltRobot | None, findings: Findings) -> None:
    """What is watched for rest must be there."""
    if section is None or section.settle is None or built is None:
        return
    watched = [part.name for part in (*built.robot.plates, *built.robot.markers)]
    if section.settle.on not in ("", *watched):
        findings.unknown(("dynamics", "settle", "on"), "plate or marker", section.settle.on, watched)


def _check_sweep(
    section: SweepSection | None,
    known: Mapping[str, ParameterInfo] | None,
    tied: Mapping[str, tuple[str, ...]],
    experiments: Mapping[str, object],
    findings: Findings,
) -> None:
    if section is None or known is None:
        return
    axes: list[Axis] = []
    for name, written in section.over.items():
        with findings.at(("sweep", "over", name)):
            axes.append(parse_axis(name, written, known, tied))
    for fault in doubled(axes, ()):
        findings.add(("sweep", "over", fault.where), fault.what, got=fault.got)
    if axes and (fault := cells_fault(axes)):
        findings.add(("sweep", "over"), fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    for i, wanted in enumerate(section.experiments):
        if not set(experiments_named([wanted], experiments)) <= set(experiments):
            findings.unknown(("sweep", "experiments", i), "experiment", wanted, experiments)


def _check_names(document: Document, experiments: Mapping[str, ExperimentSection], findings: Findings) -> None:
    """Experiments, set-ups and tied parameters give files, columns and labels their names."""
    tests = _raw(document, "experiments")
    check_names({name: ("experiments", name) for name in tests}, findings, RESERVED_OF_TESTS)
    check_names(
        {one.set_up: ("experiments", name, "set_up") for name, one in experiments.items() if one.set_up},
        findings,
        RESERVED_OF_TESTS,
    )
    tied = [name for name, given in _raw(document, "parameters").items() if isinstance(given, dict) and given.get("of")]
    check_names({name: ("parameters", name) for name in tied}, findings)
    if fault := LIMITS["experiments"].fault(len(tests)):
        findings.add(("experiments",), fault.what, got=fault.got, allowed=fault.allowed)


def _check_set_ups(set_ups: Mapping[str, str], findings: Findings) -> None:
    """A set-up cannot have the name of an experiment outside it: results are called by both."""
    for name, set_up in set_ups.items():
        if set_ups.get(set_up, set_up) != set_up:
            findings.add(("experiments", name, "set_up"), "an experiment has the name of the set-up", got=f"'{set_up}'")


def _check_settings(space: SearchSpace | None, experiments: Mapping[str, Experiment], findings: Findings) -> None:
    """A parameter that an experiment sets cannot be free in it."""
    for name, experiment in experiments.items():
        free = space.free_in(name) if space is not None else set[str]()
        for key in free & set(experiment.settings):
            findings.add(("experiments", name, "settings", key), "the parameter is set and free at once", got=key)


def _check_friction(
    robot: Robot, space: SearchSpace | None, experiments: Mapping[str, Experiment], findings: Findings
) -> None:
    for name, experiment in experiments.items():
        for fault in friction_faults(robot, experiment, space.free_in(name) if space is not None else ()):
            findings.faults.append(replace(fault, where=findings.document.where(("experiments", name))))


def _print_infill(document: Document, findings: Findings) -> PrintInfill | None:
    section = _section(PrintSection, "print", document, findings)
    if section is None:
        return None
    with findings.at(("print",)):
        return PrintInfill(section.bulk_youngs_modulus, section.infill, section.exponent)
    return None
