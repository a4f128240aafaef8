"""A loaded state of the robot as a CalculiX deck.

The deck represents the assembled system: every point is a node; plates are rigid bodies over the points that they
carry, ties are equations between displacements, fixed points are boundary conditions, weight and loads are dead forces
on nodes, cables are springs with softcal's tensions, also those that a drive winds, and chambers a pressure on their
walls. Each step ends at an equilibrium of softcal, which CalculiX should reproduce. CalculiX has no neo-Hookean law of
SOFA's form: bodies are written with its isochoric one (`neo-hooke-isochoric` in softcal) at the same modulus and ratio,
which agrees only at small strain.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, ParameterError
from softcal.export.engine import actuator_faults, cable_faults, contact_faults, history_faults, not_exported
from softcal.materials.catalogue import LAWS
from softcal.mechanics.elements import ELEMENTS, P1, P2
from softcal.mechanics.layout import FIXED, Layout
from softcal.plugins.calculix.cables import cable_lines, dead_pulls
from softcal.plugins.calculix.chambers import forces_left_out, wall_pressures
from softcal.plugins.calculix.format import (
    CARDS,
    ISOCHORIC,
    MICRONEWTON,
    law_lines,
    listed,
    number,
    place,
    set_name,
    weighted_sum,
)
from softcal.plugins.calculix.load_path import load_path
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.actuators.drive import Drive
from softcal.twin.build import Twin, build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.response import Snapshot
from softcal.twin.robot import Body, Moment, Robot

DECK = "robot.inp"
PLACE = "the deck"
ITS_LAW = ISOCHORIC
ITS_ELEMENTS = {element.cell: element for element in (P1, P2)}
# One increment per step, smaller ones if it does not converge; residual forces below a millionth of the average force,
# corrections below a millionth of the increment, in up to a hundred iterations: CalculiX's tangent does not contain the
# stiffness of a pressure, and its residual has the pressure of the iteration before.
_STEP = (
    "*STEP, NLGEOM, INC=1000",
    "*STATIC",
    "1.0, 1.0, 1e-4, 1.0",
    "*CONTROLS, PARAMETERS=FIELD",
    "1e-6, 1e-6, , , 1e-6, , , 1e-12",
    "*CONTROLS, PARAMETERS=TIME INCREMENTATION",
    "60, 60, 60, 100, 100",
)
_OUTPUT = ("*NODE FILE", "U", "*NODE PRINT, NSET=ALL, FREQUENCY=100000", "U", "*END STEP")


@dataclass(frozen=True)
class Deck:
    """The deck's text; first: body -> number of its first node minus one; n_states: number of steps; n_nodes: of the
    robot.
    """

    text: str
    first: dict[str, int]
    n_states: int
    n_nodes: int


def in_its_law(robot: Robot) -> Robot:
    """The robot with laws and elements (C3D4, C3D10) of CalculiX, its meshes ending at the clamps, without contact."""
    return replace(robot, bodies=tuple(_in_its_law(body.as_clamped) for body in robot.bodies), contact=None)


def _in_its_law(body: Body) -> Body:
    law = LAWS.named(body.law)
    kept = body.law if body.law in CARDS else ITS_LAW

    def alike(parameters: Mapping[str, float]) -> Mapping[str, float]:
        """The law's own constants, or E and nu of its equivalent at small strain."""
        if law.names == LAWS.named(kept).names:
            return parameters
        return {"youngs_modulus": law.youngs_modulus(parameters), "poissons_ratio": law.poissons_ratio(parameters)}

    inclusions = tuple(replace(part, parameters=alike(part.parameters)) for part in body.inclusions)
    element = ITS_ELEMENTS[ELEMENTS[body.element].cell]
    return replace(
        body,
        law=kept,
        element=element.name,
        parameters=alike(body.parameters),
        inclusions=inclusions,
        build_direction=None,
        winding=None,
    )


def calculix_deck(robot: Robot, shapes: Sequence[Snapshot], notes: Sequence[str] = ()) -> Deck:
    """The deck of a robot under the loads and efforts of its shapes, one after the other; see `load_path`.

    Parameters
    ----------
    robot
        Of `in_its_law`.
    shapes
        Shapes with the tensions [N] of the cables and the pressures [Pa] of the chambers.
    notes
        Sentences for the header.

    Raises
    ------
    ParameterError
        For features that a deck cannot represent: rods, other actuators, friction and stretch of cables.
    """
    _require(robot)
    robot = robot.as_clamped
    twin = build_twin(robot)
    layout = twin.system.layout
    last_node = layout.n_points + 2 * layout.n_moving_frames
    cables = cable_lines(twin, shapes, last_node, sum(len(mesh.tets) for mesh in twin.meshes.values()))
    lines = [
        "** Written by softcal. Units: mm, g, s, uN, Pa. Run it with: ccx -i robot",
        *(f"** {note}" for note in notes),
        *_nodes(twin),
        *cables.nodes,
    ]
    corners: list[Ints] = []
    n_tets = 0
    for body in twin.robot.bodies:
        mesh, first = twin.meshes[body.name], twin.first_point[body.name]
        for material in body.materials:
            lines.append(f"*ELEMENT, TYPE={mesh.cell.calculix}, ELSET={set_name(material.name)}")
            corners.append(first + mesh.tets[material.elements, :4])
            for tet in mesh.tets[material.elements]:
                n_tets += 1
                lines.append(f"{n_tets}, " + ", ".join(str(first + n + 1) for n in tet))
    lines += _bonds(twin)
    for body in robot.bodies:
        for material in body.materials:
            name = set_name(material.name)
            laws = law_lines(body.law, material.parameters)
            lines += [f"*MATERIAL, NAME={name}", *laws, f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"]
    lines += [*cables.springs, *cables.equations]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "ALL, 0.0"] if cables.springs else []
    dead = twin.system.loads.total(parameter_values(robot))
    moves = (layout.rider != FIXED) & (layout.rider < layout.n_moving_frames)  # forces on fixed nodes are omitted
    for k, shape in enumerate(shapes, start=1):
        temperature = ["*TEMPERATURE", f"ALL, {number(k)}"] if cables.springs else []
        force = dead + dead_pulls(twin, shape) + forces_left_out(twin, shape)
        loads = [
            f"{i + 1}, {axis + 1}, {number(force[i, axis] / MICRONEWTON)}"
            for i in np.flatnonzero(moves & np.any(force != 0.0, axis=1))
            for axis in np.flatnonzero(force[i])
        ]
        # In a static step CalculiX ramps linearly from the previous loads to these; loads not listed go to zero.
        loads = ["*CLOAD, OP=NEW", *loads] if loads else []
        pressures = list(wall_pressures(twin, shape, np.concatenate(corners)))
        loads += ["*DLOAD, OP=NEW", *pressures] if pressures else []
        lines += [f"** {shape.label}", *_STEP, *temperature, *loads, *_OUTPUT]
    return Deck("\n".join([*lines, ""]), dict(twin.first_point), len(shapes), last_node)


def _require(robot: Robot) -> None:
    if faults := deck_faults(robot):
        raise ParameterError(faults)


def deck_faults(robot: Robot) -> list[Fault]:
    """Faults of features that a deck cannot represent: rods, other actuators, friction and stretch of cables."""
    faults = [
        Fault("a rod has no solid elements to write", where=rod.name, attempt="a solid mesh") for rod in robot.rods
    ]
    faults += [*actuator_faults(robot, "CalculiX", Chamber.name, Drive.name), *cable_faults(robot, "CalculiX")]
    faults += history_faults(robot, "CalculiX")
    faults += [
        Fault("a moment cannot be exported", load.name, attempt="two forces")
        for load in robot.loads
        if isinstance(load, Moment)
    ]
    return [*faults, *contact_faults(robot, "CalculiX")]


def write_calculix(robot: Robot, shape: Snapshot, folder: Path, *, given: Robot | None = None) -> list[Path]:
    """Write the deck and a README into an existing folder.

    Parameters
    ----------
    robot, shape
        The robot of `in_its_law`, and its shape under load.
    folder
        The folder.
    given
        The robot before `in_its_law`, to document the changes.

    Raises
    ------
    ParameterError
        See `calculix_deck`.
    """
    _require(robot)
    source = given or robot
    notes = [*not_exported(source, PLACE)]
    for body in source.bodies:
        if body.law not in CARDS:
            notes.append(
                f"{body.name}: CalculiX has no law '{body.law}'; written with its isochoric neo-Hookean one at the "
                "same modulus and ratio, which agrees at small strain."
            )
        element = ELEMENTS[body.element]
        if element is not ITS_ELEMENTS[element.cell]:
            notes.append(
                f"{body.name}: {element.name} is written as {element.cell.calculix}, which stiffens as Poisson's ratio "
                "nears 0.5."
            )
    deck = calculix_deck(robot, load_path(robot, shape).shapes, notes)
    path, readme = folder / DECK, folder / "README.txt"
    path.write_text(deck.text, encoding="utf-8")
    units = {part.name: part.channels[1].unit for part in robot.actuated}
    pulls = ", ".join(f"{name} {effort:.6g} {units[name]}" for name, effort in shape.efforts.items())
    readme.write_text(
        f"State: {shape.label}{f'; {pulls}' if pulls else ''}.\n"
        f"Steps: {deck.n_states}. Each ends at an equilibrium of softcal on the load path, the last at this state.\n"
        "Run: ccx -i robot\nLook at it: cgx robot.frd\n" + "".join(f"{note}\n" for note in notes),
        encoding="utf-8",
    )
    return [path, readme]


def _nodes(twin: Twin) -> Iterator[str]:
    layout = twin.system.layout
    yield "*NODE, NSET=ALL"
    for i, at in enumerate(layout.X):
        yield f"{i + 1}, {place(at)}"
    # The moving frames' reference nodes are at the centroids of their plates' nodes: CalculiX's tangent lacks the
    # second-order terms of rigid bodies; this choice gives the best convergence.
    held: list[set[int]] = [set() for _ in range(layout.n_moving_frames)]
    for name, mesh in twin.meshes.items():
        nodes = mesh.tets + twin.first_point[name]
        riders = layout.rider[nodes]
        for k in range(len(held)):
            bends = (riders == k).any(axis=1) & (riders != k).any(axis=1)
            held[k].update(nodes[bends][riders[bends] == k].tolist())
    for k, own in enumerate(held):
        pivot = layout.X[sorted(own)].mean(axis=0) if own else layout.references[k]
        reference, turn = _frame_nodes(layout, k)
        yield f"{reference}, {place(pivot)}"
        yield f"{turn}, {place(pivot)}"


def _frame_nodes(layout: Layout, k: int) -> tuple[int, int]:
    """Numbers of a moving frame's reference node and rotation node."""
    first = layout.n_points + 1 + 2 * k
    return first, first + 1


def _bonds(twin: Twin) -> Iterator[str]:
    layout = twin.system.layout
    still = np.flatnonzero((layout.rider == FIXED) | (layout.rider >= layout.n_moving_frames))
    if len(still):
        yield "*BOUNDARY"
        for n in still:
            yield f"{n + 1}, 1, 3"
    for name, k in twin.frame.items():
        riders = np.flatnonzero(layout.rider == k)
        if k >= layout.n_moving_frames or len(riders) == 0:
            continue
        yield f"*NSET, NSET={set_name(name)}"
        yield from listed(riders + 1)
        reference, turn = _frame_nodes(layout, k)
        yield f"*RIGID BODY, NSET={set_name(name)}, REF NODE={reference}, ROT NODE={turn}"
    ties = layout.ties
    for point in np.unique(ties.point):
        own = ties.point == point
        terms = zip(ties.master[own].tolist(), ties.weight[own].tolist(), strict=True)
        yield from weighted_sum(int(point) + 1, [(m + 1, w) for m, w in terms if w != 0.0])
