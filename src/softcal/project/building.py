"""From the sections of a project to the Project: its robot built, its bench data read, names and bounds resolved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from softcal.calibration.problem.experiment import PULLEY_FRICTION, rig_parameters
from softcal.errors import Fault, ParameterError, ProjectFileError
from softcal.experiments.plausibility import copies
from softcal.materials.components import NO_DIRECTIONS
from softcal.project.axes import Axis, cells_fault, doubled, parse_axis, shown_configurations
from softcal.project.bench import build_bench
from softcal.project.bench_fit import check_test, held_rig, held_robot
from softcal.project.calibration_schema import SweepSection
from softcal.project.candidate_schema import build_candidates
from softcal.project.document import Document, Findings
from softcal.project.files import InputFiles, sha256
from softcal.project.meshes import is_generated, mesh_maker
from softcal.project.own_law import require_at_rest
from softcal.project.project import Project
from softcal.project.robot import build_robot
from softcal.project.search import build_search, held_values, names_held, rig_value, untied
from softcal.project.sections import Sections
from softcal.project.uncertain import build_uncertain
from softcal.twin.parameters import ParameterInfo, robot_parameters


def build_project(
    path: Path, document: Document, sections: Sections, files: InputFiles, values: Mapping[str, str | float]
) -> Project:
    """The project of fault-free sections, with its meshes, data, and names resolved.

    Parameters
    ----------
    path
        The project file.
    document
        The project file as plain data.
    sections
        Its sections, without faults.
    files
        Finds and records the files that the project names.
    values
        Parameters to fix -> value: text with a unit, or a number in SI.

    Raises
    ------
    ProjectFileError
        With every fault of its meshes, its data and the names that are resolved by them.
    ParameterError
        For `values` that do not fit.
    """
    findings = Findings(document)
    experiments, parameters = sections.experiments, sections.parameters
    built = build_robot(sections.robot, mesh_maker(files), findings)
    for body in built.robot.bodies if built else ():
        middle = body.mesh.points[body.mesh.tets[0]].mean(axis=0, keepdims=True)
        require_at_rest(body.law, body.parameters, body.directions(middle), findings)
    for rod in sections.robot.rods.values():
        require_at_rest(rod.law or "", rod.constants, NO_DIRECTIONS, findings)
    given = untied(values, parameters)
    rig = sections.rig
    if PULLEY_FRICTION in given and rig.pulleys is not None:  # the data are prepared under a fixed friction
        friction = rig_value(PULLEY_FRICTION, given[PULLEY_FRICTION])
        rig = replace(rig, pulleys=replace(rig.pulleys, friction_coefficient=friction))
    benches = {
        name: build_bench(
            name, experiment, rig, sections.steps[name], files, findings, None if built is None else built.robot
        )
        for name, experiment in experiments.items()
    }
    whole = {name: bench for name, bench in benches.items() if bench is not None}
    tests = {name: bench.experiment for name, bench in whole.items()}
    known: dict[str, ParameterInfo] | None = None
    if built is not None and len(whole) == len(experiments):
        known = {**robot_parameters(built.robot), **rig_parameters(tests.values())}
    own = {name: whole[name].experiment.rig_values() if name in whole else {} for name in experiments}
    set_ups = {name: experiment.set_up for name, experiment in experiments.items()}
    space = build_search(parameters, known, own, set_ups, names_held(given, known or ()), findings)
    uncertain = build_uncertain(sections.uncertain, known, own, set_ups, space, findings)
    tied = {name: tuple(section.of) for name, section in parameters.items() if section.of}
    for name, test in tests.items():
        free = space.free_in(name) if space is not None else set[str]()
        for key in free & set(test.settings):
            findings.add(("experiments", name, "settings", key), "the parameter is set and free at once", got=key)
    if sections.dynamics.settle is not None and built is not None:
        on, parts = sections.dynamics.settle.on, [x.name for x in (*built.robot.plates, *built.robot.markers)]
        if on not in ("", *parts):
            findings.unknown(("dynamics", "settle", "on"), "plate or marker", on, parts)
    _check_sweep(sections.sweep, known, tied, findings)
    datasets = {name: test.dataset for name, test in tests.items()}
    for name, earlier in copies(datasets, {name: test.compared for name, test in tests.items()}).items():
        findings.warn(
            ("experiments", name),
            f"every measured value is that of {earlier}: a copy counts as a test of its own, so that intervals are too "
            "short and tests seem to agree",
            attempt="read the file of this test, or leave the copy out",
        )
    candidates = build_candidates(sections.candidates, tests, built.robot, findings) if built and known else ()
    findings.raise_if_any()

    if built is None or known is None:
        raise ProjectFileError(Fault("the project is incomplete", document.name))
    held = held_values(given, known)
    faults_held = [
        fault
        for name, bench in whole.items()
        for fault in check_test(built.robot, bench.experiment, space.free_in(name) if space else (), held, findings)
    ]
    findings.raise_if_any()
    if faults_held:
        raise ParameterError(faults_held)
    tests = {name: held_rig(bench.experiment, held) for name, bench in whole.items()}
    bodies, robot = sections.robot.bodies, held_robot(built.robot, held)
    varied = {target for one in space.parameters for target in (one.name, *one.of)} if space else set[str]()
    varied |= {one.name for one in uncertain}
    for axis in sections.sweep.over if sections.sweep else ():
        varied |= {axis, *tied.get(axis, ())}
    # What a material omits has the value of its part in the file, and is a parameter of its own.
    changed = {*varied, *held, *(key for test in tests.values() for key in test.settings)}
    for part in robot.deformable:
        kind, section = ("bodies", bodies.get(part.name)) if part in robot.bodies else ("rods", None)
        section = section or sections.robot.rods.get(part.name)
        for name, material in section.materials.items() if section else ():
            keys = {one.name for one in part.constants} - {*material.constants}
            keys |= {"density"} if material.density is None else set()
            for key in sorted(keys):
                if f"{part.name}.{key}" in changed and f"{part.name}.{name}.{key}" not in changed:
                    findings.warn(
                        ("robot", kind, part.name, "materials", name),
                        f"{part.name}.{name}.{key} is omitted, and keeps the file's value "
                        f"where {part.name}.{key} has another",
                        attempt=f"`of: {part.name}*.{key}` for one value of both, or {key} of {name}",
                    )
    # Memory, preload and speed of friction have no effect with a coefficient that is zero and not free.
    rough: dict[str, tuple[tuple[str, ...], float]] = {
        f"{cable.name}.friction_coefficient": (("robot", "cables", cable.name), cable.friction_coefficient)
        for cable in robot.cables
        if cable.line.friction_memory
        or cable.line.friction_preload is not None
        or cable.line.friction_speed is not None
    }
    if rig.pulleys is not None and rig.pulleys.friction_memory:
        rough[PULLEY_FRICTION] = ("rig", "pulleys"), rig.pulleys.friction_coefficient
    for name, (place, mu) in rough.items():
        if mu == 0.0 and name not in varied:
            findings.warn(
                place,
                "there is no friction for a memory, a preload or a speed to act on",
                got=f"{name} 0, and not free",
                allowed="a coefficient above 0, or a free one",
                attempt="friction_coefficient: 0.1, or none of these",
            )
    return Project(
        path=path,
        name=str(document.data["name"]),
        robot=robot,
        experiments=tests,
        records={name: bench.record for name, bench in whole.items()},
        corrected={name: bench.corrected for name, bench in whole.items()},
        space=space,
        uncertain=uncertain,
        tied=tied,
        calibration=sections.calibration,
        candidates=candidates,
        sweep=sections.sweep,
        dynamics=sections.dynamics,
        engines=sections.engines,
        print_infill=sections.print_infill,
        held=held,
        changes=document.changes,
        hashes={path.name: sha256(path), **files.hashes()},
        inputs=dict(files.used),
        generated={name: built.made[name] for name, body in bodies.items() if is_generated(body)},
        qualities=built.qualities,
        regions=built.regions,
        warnings=tuple(dict.fromkeys(findings.warnings)),
    )


def _check_sweep(
    section: SweepSection | None,
    known: Mapping[str, ParameterInfo] | None,
    tied: Mapping[str, tuple[str, ...]],
    findings: Findings,
) -> None:
    if section is None or known is None:
        return
    axes: list[Axis] = []
    for name, written in section.over.items():
        with findings.at(("sweep", "over", name)):
            axes.append(parse_axis(name, [str(entry) for entry in written], known, tied))
    for fault in doubled(axes, ()):
        findings.add(("sweep", "over", fault.where), fault.what, got=fault.got)
    if axes and (fault := cells_fault(axes)):
        findings.add(("sweep", "over"), fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    for configuration, values in section.show.items():
        for name, written in values.items():
            with findings.at(("sweep", "show", configuration, name)):
                shown_configurations({configuration: {name: written}}, known, tied)
