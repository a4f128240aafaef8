"""Every section of a project file checked by itself and against the others, before anything it names is read."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.problem.rig import CommonRig
from softcal.calibration.problem.uncertain import RESERVED
from softcal.declare import Declared
from softcal.errors import Fault, ProjectFileError, unknown, unknown_keys
from softcal.experiments.prepare import PlannedStep
from softcal.limits import LIMITS, RESERVED_OF_TESTS, folded, name_fault
from softcal.materials.catalogue import LAWS
from softcal.materials.infill import PrintInfill
from softcal.project.bench_names import experiments_named
from softcal.project.bench_plan import check_headers, plan_bench
from softcal.project.bench_schema import ExperimentSection
from softcal.project.calibration_schema import CalibrationSection, ParameterSection, SweepSection, UncertainSection
from softcal.project.candidate_schema import CandidateSection
from softcal.project.document import Document, Findings, KeyPath
from softcal.project.files import InputFiles
from softcal.project.law_schema import OwnLawSection, register_laws
from softcal.project.mesh_schema import MeshFile
from softcal.project.robot_schema import BodySection, RobotSection, check_part_names, part_names
from softcal.project.search import Wanted, build_search, check_kinds, check_owners, wanted_by
from softcal.project.section import entries, validated
from softcal.project.sensor_schema import check_sensors
from softcal.project.uncertain import build_uncertain
from softcal.twin.time_settings import Settling, TimeSettings

S = TypeVar("S")

SECTIONS = (
    "softcal",
    "name",
    "laws",
    "robot",
    "rig",
    "experiments",
    "parameters",
    "uncertain",
    "calibration",
    "candidates",
    "sweep",
    "dynamics",
    "engines",
    "print",
)
FORMAT = 1


@dataclass(frozen=True)
class Sections:
    """The sections of a project file, without faults; steps: the preparation of each experiment's data."""

    laws: Mapping[str, OwnLawSection]
    robot: RobotSection
    rig: CommonRig
    experiments: Mapping[str, ExperimentSection]
    steps: Mapping[str, tuple[PlannedStep, ...]]
    parameters: Mapping[str, ParameterSection]
    uncertain: Mapping[str, UncertainSection]
    calibration: CalibrationSection
    candidates: Mapping[str, CandidateSection]
    dynamics: TimeSettings
    engines: Mapping[str, Declared]
    sweep: SweepSection | None
    print_infill: PrintInfill | None


def read_sections(document: Document, files: InputFiles) -> Sections:
    """Every section of a document, with names resolved as far as the sections alone allow.

    Raises
    ------
    ProjectFileError
        With every fault of the sections, and every file that is named and is not there.
    """
    findings = Findings(document)
    others, meant = unknown_keys(document.data, SECTIONS)
    findings.faults += [unknown("unknown key", document.where((key,)), key, SECTIONS) for key in others]
    for key, allowed in (("softcal", f"softcal: {FORMAT}"), ("name", "a name for people"), ("robot", "the robot")):
        if document.data.get(key) is None and key not in meant:
            findings.add((), "a key is missing", got=f"no '{key}'", allowed=allowed)
    version = document.data.get("softcal", FORMAT)
    if version is not None and (version != FORMAT or isinstance(version, bool)):
        findings.add(("softcal",), "the format is not known", got=repr(version)[:60], allowed=str(FORMAT))
    if not isinstance(document.data.get("name") or "", str):
        findings.add(("name",), "this is of the wrong kind", got=repr(document.data["name"])[:60], allowed="text")
    laws = entries(OwnLawSection, "laws", document, findings)
    register_laws(laws, findings)
    if document.mapping("laws").keys() - LAWS.keys():
        findings.raise_if_any()  # without its law a body has faults that are none
    robot = _section(RobotSection, "robot", document, findings)
    rig = _section(CommonRig, "rig", document, findings, {})
    experiments = entries(ExperimentSection, "experiments", document, findings)
    _check_names(document, experiments, findings)
    parameters = entries(ParameterSection, "parameters", document, findings)
    uncertain = entries(UncertainSection, "uncertain", document, findings)
    calibration = _section(CalibrationSection, "calibration", document, findings, {})
    candidates = entries(CandidateSection, "candidates", document, findings)
    dynamics = _section(TimeSettings, "dynamics", document, findings, {})
    if dynamics is not None:
        if dynamics.hold is None and not dynamics.settle:  # then the motion continues until the robot is at rest
            dynamics = replace(dynamics, settle=Settling())
        after = dynamics.settle.longest if dynamics.settle else dynamics.hold or 0.0
        with findings.at(("dynamics",)):
            LIMITS["time steps"].check(1 + (dynamics.ramp + after) / dynamics.time_step)
    engines: dict[str, Declared] = {}
    stated = document.data.get("engines") or {}
    if not isinstance(stated, dict):
        findings.add(("engines",), "this is of the wrong kind", got=repr(stated)[:60], allowed="a mapping of names")
    elif stated:
        from softcal.export.engine import ENGINES

        kinds = {name: engine.settings for name, engine in ENGINES.items() if engine.settings is not None}
        for name, section in stated.items():
            if name not in kinds:
                findings.faults.append(unknown("unknown key", document.where(("engines", name)), name, kinds))
                continue
            own = validated(kinds[name], {} if section is None else section, ("engines", name), findings)
            if own is not None:
                engines[name] = own
    swept = _section(SweepSection, "sweep", document, findings)
    print_infill = _section(PrintInfill, "print", document, findings)
    if robot is not None:
        check_part_names(robot, findings)
    bodies = document.mapping("robot").get("bodies")
    for name, given in bodies.items() if isinstance(bodies, dict) else ():
        # The faults of a body are among the findings already.
        body = validated(BodySection, given, (), Findings(document))
        if body is not None and isinstance(body.mesh, MeshFile) and files.mesh(name) is None:
            with findings.at(("robot", "bodies", name, "mesh")):
                files.find(body.mesh.file, "mesh file", LIMITS["bytes of a mesh file"])
    # The parts of an unknown section of the robot have no names, and references to them would be faults that are none.
    unread = document.mapping("robot").keys() - RobotSection.model_fields.keys()
    parts = None if unread else part_names(document)
    sensors = document.mapping("robot").get("sensors")
    if parts is not None and isinstance(sensors, dict):
        check_sensors(sensors, parts, findings)
    plans = {
        name: plan_bench(name, experiment, rig or CommonRig(), parts, files, findings)
        for name, experiment in experiments.items()
    }
    set_ups = {name: experiment.set_up for name, experiment in experiments.items()}
    for name, set_up in set_ups.items():
        if set_ups.get(set_up, set_up) != set_up:
            findings.add(("experiments", name, "set_up"), "an experiment has the name of the set-up", got=f"'{set_up}'")
    wanted = {**wanted_by("parameters", parameters), **wanted_by("uncertain", uncertain)}
    check_owners(wanted, parts, findings)
    build_search(parameters, None, {key: {} for key in experiments}, set_ups, (), findings)
    build_uncertain(uncertain, None, {}, {}, None, findings)
    tied = [name for name, section in parameters.items() if section.of]
    _check_calibration(calibration, rig or CommonRig(), experiments, tied, findings)
    if swept is not None:
        tests = document.mapping("experiments")
        for i, judge in enumerate(swept.experiments):
            if not set(experiments_named([judge], tests)) <= set(tests):
                findings.unknown(("sweep", "experiments", i), "experiment", judge, tests)
    if findings.faults:  # else names and columns are checked, and reported, with the robot and the tables
        axes: Wanted = {("sweep", "over", name): [name] for name in (swept.over if swept else ()) if name not in tied}
        check_owners(axes, parts, findings)
        check_kinds({**wanted, **axes}, parts, findings)
        for name, experiment in experiments.items():
            check_headers(name, experiment, files, findings)
    findings.raise_if_any()
    if robot is None or rig is None or calibration is None or dynamics is None:
        raise ProjectFileError(Fault("the project is incomplete", document.name))
    return Sections(
        laws=laws,
        robot=robot,
        rig=rig,
        experiments=experiments,
        steps=plans,
        parameters=parameters,
        uncertain=uncertain,
        calibration=calibration,
        candidates=candidates,
        dynamics=dynamics,
        engines=engines,
        sweep=swept,
        print_infill=print_infill,
    )


def _section(
    model: type[S], key: str, document: Document, findings: Findings, default: dict[str, Any] | None = None
) -> S | None:
    data = document.data.get(key)
    data = default if data is None else data
    return None if data is None else validated(model, data, (key,), findings)


def _check_calibration(
    section: CalibrationSection | None,
    rig: CommonRig,
    experiments: Collection[str],
    tied: Collection[str],
    findings: Findings,
) -> None:
    if section is None:
        return
    if LOSSES[section.loss].needs_length and rig.length is None:
        findings.add(
            ("calibration", "loss"),
            f"the loss '{section.loss}' needs a length",
            got="no rig.length",
            allowed="rig: {length: 425 mm}",
        )
    for i, name in enumerate(section.hold_out):
        if name not in experiments:
            findings.unknown(("calibration", "hold_out", i), "experiment", name, experiments)
    if experiments and set(experiments) <= set(section.hold_out):
        got = ", ".join(section.hold_out)
        findings.add(
            ("calibration", "hold_out"), "no experiment is left to fit", got=got, allowed="all but one at most"
        )
    for i, name in enumerate(section.split):
        if name not in tied:
            findings.unknown(("calibration", "split", i), "tied parameter", name, tied)


def _check_names(document: Document, experiments: Mapping[str, ExperimentSection], findings: Findings) -> None:
    """Check the names of experiments, set-ups and tied parameters, which become names of files, columns and labels."""
    tests = document.mapping("experiments")
    candidates = document.mapping("candidates")
    names = {name: ("experiments", name) for name in tests} | {name: ("candidates", name) for name in candidates}
    _check_allowed(names, findings, RESERVED_OF_TESTS)
    for name in set(tests) & set(candidates):
        findings.add(("candidates", name), "an experiment has the name of the candidate", got=f"'{name}'")
    _check_allowed(
        {one.set_up: ("experiments", name, "set_up") for name, one in experiments.items() if one.set_up},
        findings,
        RESERVED_OF_TESTS,
    )
    for section, reserved in (("parameters", ()), ("uncertain", RESERVED)):
        given = document.mapping(section)
        tied = [name for name, one in given.items() if isinstance(one, dict) and one.get("of")]
        _check_allowed({name: (section, name) for name in tied}, findings, reserved)
    if fault := LIMITS["experiments"].fault(len(tests)):
        findings.add(("experiments",), fault.what, got=fault.got, allowed=fault.allowed)


def _check_allowed(names: Mapping[str, KeyPath], findings: Findings, reserved: Iterable[str] = ()) -> None:
    """Record names that are not allowed, and names that differ only in capitals, which a file system may not
    distinguish.

    Parameters
    ----------
    names
        Key path by name.
    findings
        Collects the faults and warnings.
    reserved
        Names that softcal uses for its own files and columns.
    """
    seen: dict[str, str] = {}
    for name, path in names.items():
        if (fault := name_fault(name, reserved)) is not None:
            findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        elif (other := seen.setdefault(folded(name), name)) != name:
            findings.add(path, "two names differ only in capitals", got=f"'{other}' and '{name}'")
