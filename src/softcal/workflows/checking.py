"""Check of a project before calibration: a summary table, warnings, pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from softcal.calibration.problem.experiment import rig_parameters
from softcal.calibration.problem.scope import ScopedParameter
from softcal.calibration.results.fit import missing_rows
from softcal.checks import Ints
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.experiments.driven import driven_whole
from softcal.geometry.cell import CELLS
from softcal.geometry.quality import SAME_PLACE
from softcal.html_text import summary
from softcal.materials.catalogue import LAWS
from softcal.mechanics.chamber import ChamberTerm
from softcal.project.project import Project, ProjectSource, project_of
from softcal.sensing.channel import TIME
from softcal.twin.build import twin_of
from softcal.twin.channels import channels_of
from softcal.twin.material import Material
from softcal.twin.parameters import robot_parameters
from softcal.twin.response import Response
from softcal.twin.robot import Body, Robot, Rod
from softcal.units import AS_WRITTEN, format_place, format_quantity, format_range, plain
from softcal.workflows.checked_cables import beyond_limits, cable_rows, off_course
from softcal.workflows.output import require_writable
from softcal.workflows.start_states import BlockObserver, start_states

# The measured stiffness is implausible beyond this factor of the twin's stiffness at the bounds of its moduli.
STIFFNESS_MARGIN = 2.0
# Points whose largest coordinate is a smaller or larger part of the robot's are suspect, but at the origin.
SMALL, LARGE = 1e-3, 100.0


@displayed
@dataclass(frozen=True)
class CheckReport:
    """Result of a check: rows of (part, description), warnings as sentences, paths of the pictures if drawn."""

    rows: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    pictures: tuple[Path, ...] = ()
    notes: tuple[str, ...] = field(default_factory=tuple)

    def _repr_html_(self) -> str:
        remarks = [*(f"Warning: {warning}" for warning in self.warnings), *(f"Note: {note}" for note in self.notes)]
        return summary("The project", ["part", ""], self.rows, remarks)


@checked_arguments
def check(
    project: ProjectSource,
    out_dir: str | Path | None = None,
    *,
    solve: bool = True,
    progress: Callable[[str], None] = lambda stage: None,
    ready: BlockObserver = lambda rows, warnings: None,
) -> CheckReport:
    """Check a project: build the twin, solve it at rest and at the end of each experiment at the start values,
    compare it with the data, draw the pictures.

    Parameters
    ----------
    project
        A project, or the path of a project file.
    out_dir
        Folder for `robot.png`, `states.png` and `data-<experiment>.png`; older ones there are replaced.
        None draws nothing.
    solve
        Whether states are solved, drawn and compared with the data.
    progress, ready
        Called with the name of each stage; with rows and warnings as soon as they are known.

    Raises
    ------
    InputError
        Where the project cannot be loaded, or the twin cannot be built.
    StorageError
        Where the folder cannot be written.
    """
    project = project_of(project)
    bodies = tuple(_body_rows(project))
    ready(bodies, ())
    progress("Building the twin")
    twin_of(project.robot)
    if out_dir is not None:
        require_writable(Path(out_dir))
    warnings = [str(fault) for fault in project.warnings]
    if project.experiments and project.space is None:
        warnings.append("no parameter is free: there is nothing to calibrate")
    warnings += [*_beyond_bounds(project), *off_course(project.robot)]
    warnings += [*_off_scale(project.robot), *_unstable_at_rest(project), *beyond_limits(project)]
    if project.experiments and project.space is not None:
        from softcal.workflows.calibration import plan

        try:
            plan(project)
        except InputError as error:
            warnings += [f"calibrate would refuse this project: {fault}" for fault in error.faults]
    others = (*_part_rows(project), *_bench_rows(project), *_search_rows(project))
    ready(others, warnings)
    rows = (*bodies, *others)
    states = start_states(project, progress, ready) if solve else None
    if states is not None:
        against = (_against_twin(project, name, response) for name, response in states.responses.items())
        ready((), stiffness := [sentence for sentence in against if sentence])
        rows, warnings = (*rows, *states.rows), [*warnings, *states.warnings, *stiffness]
    if out_dir is None:
        return CheckReport(rows, tuple(warnings))
    from softcal.report.check_figures import draw_check, start_scenes

    progress("Drawing")
    # With the cycles if they were searched, so that the picture shows them.
    records = {name: project.corrected[name] or project.records[name] for name in project.experiments}
    shown = None if states is None else start_scenes(project.robot, states.undeformed, states.shapes, states.tets)
    drawn = draw_check(project.robot, records, out_dir, shown)
    pictures = [drawn.robot, *([drawn.states] if drawn.states else []), *drawn.datasets.values()]
    return CheckReport(rows, tuple(warnings), tuple(pictures), drawn.notes)


def _off_scale(robot: Robot) -> list[str]:
    """The points whose coordinates are far smaller or larger than the robot, as where m was written for mm."""
    parts = [*(body.mesh.points for body in robot.bodies), *(rod.centreline.nodes for rod in robot.rods)]
    size = float(np.abs(np.concatenate(parts)).max())
    points = {plate.name: plate.reference for plate in robot.plates}
    placed = {part.name: getattr(part, "at", None) for part in (*robot.markers, *robot.loads)}
    points |= {name: at for name, at in placed.items() if at is not None}
    points |= {f"{one.name}, via point {i}": via.at for one in robot.cables for i, via in enumerate(one.via_points, 1)}
    return [
        f"{name}: the point {format_place(at)} is {'near the origin' if far < size else 'far away'} for a robot that "
        f"reaches to {format_quantity(size, 'm')}: m written for mm, or mm for m?"
        for name, at in points.items()
        if not (SAME_PLACE * size >= (far := float(np.abs(at).max())) or SMALL * size <= far <= LARGE * size)
    ]


def _unstable_at_rest(project: Project) -> list[str]:
    """The materials of bodies whose start values give no resistance to a small shear or stretch."""
    sentences: list[str] = []
    for body in project.robot.bodies:
        law = LAWS.named(body.law)
        for name, material in ((body.name, body), *((f"{body.name}.{one.name}", one) for one in body.inclusions)):
            mu, E = law.shear_modulus(material.parameters), law.youngs_modulus(material.parameters)
            if not (mu > 0.0 and E > 0.0):
                moduli = f"shear modulus {format_quantity(mu, 'Pa')}, Young's modulus {format_quantity(E, 'Pa')}"
                sentences.append(f"{name}: with these constants {body.law} is unstable at rest ({moduli})")
    return sentences


def _body_rows(project: Project) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for body in project.robot.bodies:
        quality = project.qualities[body.name]
        size = " × ".join(f"{1e3 * (b - a):.4g}" for a, b in zip(quality.lower, quality.upper, strict=True))
        kind = CELLS[quality.order].name
        rows += [
            (
                f"body {body.name}",
                f"{quality.n_tets} {kind} tets, {quality.n_points} nodes, {size} mm, {1e6 * quality.volume:.4g} cm³",
            ),
            (
                "  mesh quality",
                f"least dihedral angle {math.degrees(quality.min_dihedral):.3g} deg, "
                f"mean ratio: minimum {quality.min_quality:.2g}, median {quality.median_quality:.2g}",
            ),
            *_material_rows(body, f"{body.law}, {body.element}, ", "tets"),
        ]
        regions = {**{"fixed": body.fixed}, **project.regions[body.name]}
        rows.append(("  regions", ", ".join(f"{name} {len(nodes)} nodes" for name, nodes in regions.items())))
        rows += [("  shape", f"parameters {', '.join(body.shape.values)}")] if body.shape is not None else []
        if body.clamp is not None and body.zone is not None:
            reach = format_quantity(body.zone.depths.upper, "m", digits=3)
            depth = format_quantity(body.clamp.depth, "m")
            rows.append(("  clamp", f"{depth} deeper than the fixed nodes; as a parameter up to {reach} either way"))
    for rod in project.robot.rods:
        line, places = rod.centreline, [f"{plate} at {_arcs(rod, nodes)}" for plate, nodes in rod.clamped.items()]
        places += [f"fixed at {_arcs(rod, rod.fixed)}"] if len(rod.fixed) else []
        rows += [
            (
                f"rod {rod.name}",
                f"{format_quantity(float(line.stations[-1]), 'm')} long, {len(line.lengths)} elements, "
                f"{format_quantity(rod.section.constants.outer_diameter, 'm')} thick, attached: {', '.join(places)}",
            ),
            *_material_rows(rod, f"{rod.law} at small strain, as rods use it at any: " * bool(rod.law), "elements"),
        ]
    return rows


def _material_rows(part: Body | Rod, law: str, elements: str) -> list[tuple[str, str]]:
    """law: what it begins with; elements: what they are called."""
    rows = [("  material", f"{law}{_constants(part, part.materials[0])}")]
    rows += [
        (f"  material of {one.name}", f"{len(one.elements)} {elements}, {_constants(part, one)}")
        for one in part.inclusions
    ]
    return [*rows, *([("  history", ", ".join(part.history))] if part.history else [])]


def _constants(part: Body | Rod, material: Material) -> str:
    shown: list[str] = []
    for constant in part.constants:
        value, unit = material.parameters[constant.name], constant.quantity.unit
        shown.append(f"{constant.label} {plain(value, AS_WRITTEN) if unit == '1' else format_quantity(value, unit)}")
    return ", ".join([*shown, *([f"{material.density:.4g} kg/m³"] if material.density else [])])


def _part_rows(project: Project) -> list[tuple[str, str]]:
    robot = project.robot
    rows: list[tuple[str, str]] = []
    for plate in robot.plates:
        carriers = [f"{len(nodes)} nodes of {body}" for body, nodes in plate.nodes.items()]
        carriers += [rod.name for rod in robot.rods if plate.name in rod.clamped]
        holes = f"{len(plate.holes)} hole{'s' * (len(plate.holes) > 1)}, " if plate.holes else ""
        mass = "fixed" if plate.fixed else f"mass {format_quantity(plate.mass, 'kg')}"
        rows.append((f"plate {plate.name}", f"on {', '.join(carriers) or 'nothing'}, {holes}{mass}"))
    rows += cable_rows(robot)
    volumes = {term.name: term.rest_volume for term in twin_of(robot).system.of(ChamberTerm)}
    for part in robot.actuators:
        values = [
            f"{key.replace('_', ' ')} {format_quantity(value, part.actuator.quantities[key].unit)}"
            for key, value in part.values.items()
        ]
        size = [f"{format_quantity(volumes[part.name], 'm^3')} at rest"] if part.name in volumes else []
        parts = (*part.actuator.surfaces, *part.actuator.driven)
        of = [f"of {' and '.join(parts)}"] if parts else []
        rows.append((f"{part.actuator.name} {part.name}", ", ".join([*of, *size, *values])))
    rows += [(f"tie {tie.name}", f"{len(tie.nodes)} nodes of {tie.body} on {tie.on}") for tie in robot.ties]
    rows += [(f"marker {marker.name}", f"on {marker.on}") for marker in robot.markers]
    for one in robot.sensors:
        rows.append((f"sensor {one.name}", f"{one.sensor.name}: {', '.join(map(str, channels_of([one])))}"))
    if np.any(robot.gravity):
        rows.append(("gravity", "(" + ", ".join(f"{g:.4g}" for g in robot.gravity) + ") m/s²"))
    rows += [(f"load {load.name}", f"on {load.on}") for load in robot.loads]
    return rows + [("contact", term.in_words()) for term in twin_of(robot).system.contacts]


def _arcs(rod: Rod, nodes: Ints) -> str:
    return " and ".join(format_quantity(float(rod.centreline.stations[n]), "m") for n in nodes)


def _bench_rows(project: Project) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for name, experiment in project.experiments.items():
        data, units = experiment.dataset, {**robot_parameters(project.robot), **rig_parameters([experiment])}
        names = [experiment.twin_channel(channel) for channel in experiment.drives]
        none = f"no {project.robot.actuator_word} is driven"
        driven = " and ".join(f"{one.carrier} by {one.kind.name}" for one in names) or none
        for key, value in experiment.settings.items():
            driven += f", {key} = {format_quantity(value, units[key].unit)}"
        # Positions are shown by the name of their marker or plate.
        compared = dict.fromkeys(experiment.point_of(channel) or channel for channel in experiment.compared)
        data_row = f"{data.n_samples} of {project.records[name].n_samples} samples"
        for key, c in data.channels.items():
            of = experiment.twin_channel(key)
            if not (of.kind == TIME or of.is_deviation or of.point or key in data.incomplete):
                least, most = (format_quantity(float(end), c.unit) for end in (c.values.min(), c.values.max()))
                data_row += f", {key} {least} to {most}"
        rows += [(f"experiment {name}", f"{driven}, compared: {', '.join(compared)}"), ("  data", data_row)]
        if unseen := missing_rows(experiment):
            of_all = f"of {data.n_samples} samples"
            rows.append(("  not measured", ", ".join(f"{one} in {len(at)} {of_all}" for one, at in unseen.items())))
        rows += [("  clocks", step.outcome) for step in data.provenance if step.name == "synchronise"]
        cycle = (project.corrected[name] or data).cycle
        if cycle is not None:
            rows.append(("  cycles", f"{len(np.unique(cycle[cycle >= 0]))} found"))
    return rows


def _search_rows(project: Project) -> list[tuple[str, str]]:
    if project.space is None:
        return []
    rows: dict[str, str] = {}
    for parameter in project.space.parameters:
        bounds = format_range(parameter.lower, parameter.upper, parameter.unit)
        rows[f"free {parameter.name}"] = f"{bounds}, {parameter.scale}{_scope(parameter)}"
    for one in project.uncertain:
        sd = format_quantity(one.sd, one.unit, digits=AS_WRITTEN)
        rows[f"uncertain {one.name}"] = f"standard deviation {sd}{_scope(one)}"
    settings = project.calibration
    if settings.hold_out:
        rows["held out"] = ", ".join(settings.hold_out)
    if settings.split:
        rows["untied"] = ", ".join(settings.split)
    rows["calibration"] = f"{settings.method}, loss {settings.loss}, fit {settings.fit}, seed {settings.seed}"
    return list(rows.items())


def _scope(parameter: ScopedParameter) -> str:
    """Whether a parameter has one value, in words after it."""
    per = ", one for each experiment" if parameter.per_experiment else ""
    per = ", one for each set-up" if parameter.per_set_up else per
    return per + (f", one value for {', '.join(parameter.of)}" if parameter.of else "")


def _beyond_bounds(project: Project) -> list[str]:
    """Faults of free parameters whose value in the project is outside their bounds and cannot be a start."""
    faults: list[Fault] = []
    known = project.parameters
    for p in project.space.parameters if project.space else ():
        values = [known[target].value for target in p.targets if target in known]
        if p.start is None and any(not p.lower <= value <= p.upper for value in values):
            got = ", ".join(dict.fromkeys(format_quantity(value, p.unit, digits=AS_WRITTEN) for value in values))
            allowed = format_range(p.lower, p.upper, p.unit)
            what = "the project's value is outside the bounds of the search"
            faults.append(Fault(what, p.label, got, allowed, attempt="a start, or other bounds"))
    return [str(fault) for fault in faults]


def _against_twin(project: Project, name: str, response: Response) -> str:
    """A warning if no modulus within the bounds can reproduce the measured stiffness, as with kN taken for N."""
    experiment = project.experiments[name]
    data = experiment.dataset
    of = driven_whole(data)
    if of is None or data.n_samples < 3 or not response.succeeded:
        return ""
    measured = _slope(*(data.values(channel) for channel in of.names))
    simulated = _slope(*(response.channels[str(experiment.twin_channel(channel))] for channel in of.names))
    if not simulated > 0:
        return ""
    # Factors by which the free moduli can soften and stiffen the twin.
    known = project.parameters
    factors = [
        (p.lower / known[target].value, p.upper / known[target].value)
        for p in (project.space.parameters if project.space else ())
        for target in p.targets
        if target.endswith("youngs_modulus")
    ]
    low, high = min((low for low, _ in factors), default=1 / 3), max((high for _, high in factors), default=3.0)
    ratio = measured / simulated
    if low / STIFFNESS_MARGIN <= ratio <= high * STIFFNESS_MARGIN:
        return ""
    return str(
        Fault(
            f"{name}: the measured stiffness is implausible compared with the twin's",
            got=f"{of.slope_in_words(measured)}, {ratio:.3g} times the twin's {of.slope_in_words(simulated)}",
            allowed=f"{low / STIFFNESS_MARGIN:.3g} to {high * STIFFNESS_MARGIN:.3g} times, by the bounds of the moduli",
            attempt=f"check the units ({' or '.join(kind.mistake for kind in of.kinds)}), and the size of the mesh",
        )
    )


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    spread = float(np.ptp(x))
    return float(np.polyfit(x, y, 1)[0]) if spread > 0 else 0.0
