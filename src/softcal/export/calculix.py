"""A loaded state of the robot as a CalculiX deck, and what CalculiX makes of it.

The deck is the system as it stands: every point is a node; plates are rigid bodies over the points that ride on them,
ties are equations between displacements, fixed points are boundaries, and every force at the state (weight, loads, and
the cables' pull along their converged directions) is a dead force on a node. So CalculiX ends where softcal does, if
both are right. It has no neo-Hooke law of SOFA's form: bodies are written with its own, isochoric one
(`neo-hooke-isochoric` in softcal) at the same modulus and ratio, which is the same at small strain alone.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, ParameterError, SimulationError
from softcal.materials.catalogue import LAWS
from softcal.mechanics.layout import FIXED, Layout
from softcal.twin.build import Twin, build_twin
from softcal.twin.parameters import robot_parameters
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot

DECK = "robot.inp"
ITS_LAW = "neo-hooke-isochoric"
TIMEOUT = 1800.0  # [s]
FIRST_INCREMENT, SMALLEST_INCREMENT, LARGEST_INCREMENT = 0.05, 1e-6, 0.2


@dataclass(frozen=True)
class Deck:
    """The deck's text; first: body -> its first node less one."""

    text: str
    first: dict[str, int]


def in_its_law(robot: Robot) -> Robot:
    """The robot with the law that CalculiX has, and displacement elements alone (C3D4, C3D10)."""
    return replace(
        robot,
        bodies=tuple(
            replace(body, law=ITS_LAW, element="P2" if body.element == "P2P1" else body.element)
            for body in robot.bodies
        ),
    )


def calculix_deck(robot: Robot, shape: Snapshot) -> Deck:
    """The deck of a robot under the loads and cable tensions of one of its shapes.

    Raises
    ------
    ParameterError
        For what CalculiX cannot be given: rods, contact, friction along cables.
    """
    faults = [
        Fault("a rod has no solid elements to write", where=rod.name, attempt="a solid mesh") for rod in robot.rods
    ]
    faults += [
        Fault(
            "a cable with friction is not written", where=cable.name, got=f"{cable.friction_coefficient:g}", allowed="0"
        )
        for cable in robot.cables
        if cable.friction_coefficient > 0.0
    ]
    if robot.contact is not None:
        faults.append(Fault("contact is not written", where="contact", attempt="a project without contact"))
    if faults:
        raise ParameterError(faults)
    twin = build_twin(robot)
    lines = [
        "** Written by softcal. Units: m, kg, s, N, Pa. Run it with: ccx -i robot",
        *_nodes(twin.system.layout),
        *_elements(twin),
        *_bonds(twin),
        *_materials(robot),
        "*STEP, NLGEOM, INC=10000",
        "*STATIC",
        f"{FIRST_INCREMENT}, 1.0, {SMALLEST_INCREMENT}, {LARGEST_INCREMENT}",
        "*CONTROLS, PARAMETERS=FIELD",
        "1e-6, 1e-6, , , 1e-6",
        *_forces(twin, shape),
        "*NODE FILE",
        "U",
        "*NODE PRINT, NSET=ALL, FREQUENCY=100000",
        "U",
        "*END STEP",
        "",
    ]
    return Deck("\n".join(lines), dict(twin.first_point))


def write_calculix(robot: Robot, shape: Snapshot, folder: Path, *, given: Robot | None = None) -> list[Path]:
    """Write the deck and what to know about it into an existing folder.

    given: the robot as it was before `in_its_law`, so that it can be told what became of it.

    Raises
    ------
    ParameterError
        For what CalculiX cannot be given; see `calculix_deck`.
    """
    deck = calculix_deck(robot, shape)
    notes = _notes(given or robot)
    path, readme = folder / DECK, folder / "README.txt"
    path.write_text(deck.text, encoding="utf-8")
    pulls = ", ".join(f"{name} {tension:.6g} N" for name, tension in shape.tensions.items())
    readme.write_text(
        f"State: {shape.label}{f'; cables: {pulls}' if pulls else ''}.\n"
        "Run: ccx -i robot\nLook at it: cgx robot.frd\n" + "".join(f"{note}\n" for note in notes),
        encoding="utf-8",
    )
    return [path, readme]


def run_calculix(deck: Deck, folder: Path, *, timeout: float = TIMEOUT) -> Floats:
    """Displacements of all nodes (n, 3) [m] as CalculiX finds them; the folder keeps its files.

    Raises
    ------
    SimulationError
        Where ccx is not installed, does not converge, or takes longer than `timeout` [s].
    """
    ccx = shutil.which("ccx")
    if ccx is None:
        raise SimulationError(
            "CalculiX was not found: there is no ccx on the PATH. Debian: apt-get install calculix-ccx."
        )
    (folder / DECK).write_text(deck.text, encoding="utf-8")
    stem = DECK.removesuffix(".inp")
    try:
        done = subprocess.run(
            [ccx, "-i", stem], cwd=folder, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired as error:
        raise SimulationError(f"CalculiX did not end within {timeout:g} s.") from error
    printed = folder / f"{stem}.dat"
    tables = printed.read_text().split("for set ALL and time") if printed.exists() else []
    ends = [table for table in tables if table.lstrip().startswith("0.1000000E+01")]
    if not ends:
        said = [line.strip() for line in done.stdout.splitlines() if "*ERROR" in line or "divergence" in line]
        why = f" ({said[-1]})" if said else ""
        raise SimulationError(f"CalculiX did not reach the full load{why}; see {printed.name} and its other files.")
    rows = np.array([[float(v) for v in row.split()] for row in ends[-1].split("\n")[1:] if row.strip()])
    out = np.zeros((int(rows[:, 0].max()), 3))
    out[rows[:, 0].astype(int) - 1] = rows[:, 1:4]
    return out


def _nodes(layout: Layout) -> Iterator[str]:
    yield "*NODE, NSET=ALL"
    for i, at in enumerate(layout.X):
        yield f"{i + 1}, " + ", ".join(_number(v) for v in at)
    for k in range(layout.n_moving_frames):
        reference, turn = _frame_nodes(layout, k)
        at = ", ".join(_number(v) for v in layout.references[k])
        yield f"{reference}, {at}"
        yield f"{turn}, {at}"


def _frame_nodes(layout: Layout, k: int) -> tuple[int, int]:
    """The reference node of a moving frame, and the one whose displacements are its rotation."""
    first = layout.n_points + 1 + 2 * k
    return first, first + 1


def _elements(twin: Twin) -> Iterator[str]:
    number = 0
    for body in twin.robot.bodies:
        mesh, first = twin.meshes[body.name], twin.first_point[body.name]
        yield f"*ELEMENT, TYPE={'C3D4' if mesh.order == 1 else 'C3D10'}, ELSET={_set(body.name)}"
        for tet in mesh.tets:
            number += 1
            yield f"{number}, " + ", ".join(str(first + n + 1) for n in tet)


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
        yield f"*NSET, NSET={_set(name)}"
        yield from _listed(riders + 1)
        reference, turn = _frame_nodes(layout, k)
        yield f"*RIGID BODY, NSET={_set(name)}, REF NODE={reference}, ROT NODE={turn}"
    ties = layout.ties
    for point in np.unique(ties.point):
        own = ties.point == point
        terms = [(m, w) for m, w in zip(ties.master[own], ties.weight[own], strict=True) if w != 0.0]
        for axis in (1, 2, 3):
            yield "*EQUATION"
            yield str(1 + len(terms))
            written = [f"{point + 1}, {axis}, 1.0", *(f"{m + 1}, {axis}, {_number(-w)}" for m, w in terms)]
            for i in range(0, len(written), 4):
                yield ", ".join(written[i : i + 4])


def _materials(robot: Robot) -> Iterator[str]:
    for body in robot.bodies:
        law = LAWS[ITS_LAW]
        mu, kappa = law.shear_modulus(body.parameters), law.bulk_modulus(body.parameters)
        yield f"*MATERIAL, NAME={_set(body.name)}"
        yield "*HYPERELASTIC, NEO HOOKE"
        yield f"{_number(mu / 2)}, {_number(2 / kappa)}"
        yield f"*SOLID SECTION, ELSET={_set(body.name)}, MATERIAL={_set(body.name)}"


def _forces(twin: Twin, shape: Snapshot) -> Iterator[str]:
    """Every force at the shape, as it is there: on free nodes and riders; what acts on fixed ones is left out."""
    layout, cables = twin.system.layout, twin.system.cables
    theta = {name: info.value for name, info in robot_parameters(twin.robot).items()}
    force = twin.system.loads.total(theta)
    x = positions(twin, shape)
    tension = np.array([shape.tensions.get(name, 0.0) for name in cables.names])
    if cables.n_cables:
        force -= cables.segment_gradient(x, tension[cables.cable], 3 * layout.n_points).reshape(-1, 3)
    moves = (layout.rider != FIXED) & (layout.rider < layout.n_moving_frames)
    rows = [
        f"{i + 1}, {axis + 1}, {_number(force[i, axis])}"
        for i in np.flatnonzero(moves & np.any(force != 0.0, axis=1))
        for axis in np.flatnonzero(force[i])
    ]
    if rows:
        yield "*CLOAD"
        yield from rows


def positions(twin: Twin, shape: Snapshot) -> Floats:
    """Positions of all points of the twin (n_points, 3) [m] in a shape of its robot."""
    layout = twin.system.layout
    x, position, rotation = layout.X.copy(), layout.references.copy(), np.tile(np.eye(3), (layout.n_frames, 1, 1))
    for name, points in shape.points.items():
        x[twin.first_point[name] :][: len(points)] = points
    for name, (at, turn) in shape.plates.items():
        position[twin.frame[name]], rotation[twin.frame[name]] = at, turn
    layout.links.place(x, position, rotation)
    return x


def _notes(robot: Robot) -> tuple[str, ...]:
    notes: list[str] = []
    for body in robot.bodies:
        if body.law != ITS_LAW:
            notes.append(
                f"{body.name}: CalculiX has no law '{body.law}'; written with its isochoric neo-Hookean one at the "
                "same modulus and ratio, which is the same at small strain."
            )
        if body.element == "P2P1":
            notes.append(f"{body.name}: P2P1 is written as C3D10, which stiffens as Poisson's ratio nears 0.5.")
    return tuple(notes)


def _number(value: float) -> str:
    """At most the twenty characters that CalculiX reads of a number: the rest, an exponent maybe, it would drop."""
    return f"{value:.12e}"


def _set(name: str) -> str:
    return name.upper()


def _listed(numbers: Ints) -> Iterator[str]:
    for i in range(0, len(numbers), 12):
        yield ", ".join(str(n) for n in numbers[i : i + 12]) + ","
