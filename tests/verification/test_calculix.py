"""CalculiX on the same quadratic mesh with the same law: the isochoric neo-Hookean solid, C3D10 and our P2.

CalculiX (Debian package calculix-ccx) is a peer of these tests alone; they are skipped where it is not installed.
"""

import shutil
import subprocess

import numpy as np
import pytest
from mechanics_cases import constants, elastic

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.materials.catalogue import LAWS
from softcal.plugins.calculix.format import CARDS, law_lines
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Body, Robot, SurfaceLoad
from softcal.twin.simulate import simulate

CCX = shutil.which("ccx")
pytestmark = pytest.mark.skipif(CCX is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx")

E, NU = 1.0, 0.45
LENGTHS = (40.0, 8.0, 6.0)


def calculix_displacements(mesh: TetMesh, law: list[str], forces: np.ndarray, fixed: np.ndarray, folder) -> np.ndarray:
    """Nodal displacements (n_points, 3) by CalculiX, NLGEOM, dead nodal forces."""
    nodes = [f"{i + 1}, " + ", ".join(f"{v:.15g}" for v in at) for i, at in enumerate(mesh.points)]
    elements = [f"{i + 1}, " + ", ".join(str(n + 1) for n in tet) for i, tet in enumerate(mesh.tets)]
    loads = [f"{i + 1}, {k + 1}, {f:.15g}" for i, row in enumerate(forces) for k, f in enumerate(row) if f != 0.0]
    deck = [
        "*NODE, NSET=ALL", *nodes,
        "*ELEMENT, TYPE=C3D10, ELSET=BAR", *elements,
        "*NSET, NSET=FIX", *[f"{n + 1}," for n in fixed],
        "*BOUNDARY", "FIX, 1, 3",
        "*MATERIAL, NAME=RUBBER",
        *law,
        "*SOLID SECTION, ELSET=BAR, MATERIAL=RUBBER",
        "*STEP, NLGEOM, INC=200",
        "*STATIC", "0.1, 1.0, 1e-5, 0.25",
        "*CONTROLS, PARAMETERS=FIELD", "1e-7, 1e-7, , , 1e-7",
        "*CLOAD", *loads,
        "*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U",
        "*END STEP", "",
    ]  # fmt: skip
    (folder / "bar.inp").write_text("\n".join(deck))
    done = subprocess.run([str(CCX), "-i", "bar"], cwd=folder, capture_output=True, text=True, timeout=120, check=False)
    text = (folder / "bar.dat").read_text() if (folder / "bar.dat").exists() else ""
    assert "for set ALL and time  0.1000000E+01" in text, done.stdout[-2000:]
    rows = text.split("for set ALL and time  0.1000000E+01")[1].split("\n")[1:]
    table = np.array([[float(v) for v in row.split()] for row in rows if row.strip()])
    out = np.zeros((mesh.n_points, 3))
    out[table[:, 0].astype(int) - 1] = table[:, 1:4]
    return out


def bent(law: str, parameters: dict[str, float], traction: float) -> tuple[Robot, np.ndarray, np.ndarray]:
    """A bar under a shear traction at its end: the robot, the nodal forces, our displacements."""
    mesh = box_mesh(LENGTHS, (8, 2, 2), order=2)
    body = Body("bar", mesh, fixed=mesh.node_sets["x0"], parameters=parameters, law=law, element="P2")
    shear = SurfaceLoad("shear", "bar", mesh.face_sets["x1"], traction * np.array([0.2, 0.3, 1.0]))
    robot = Robot((body,), loads=(shear,))
    response = simulate(robot, Protocol({}), snapshots=True)
    assert response.succeeded, response.status
    forces = build_twin(robot).system.loads.total(parameter_values(robot))[: mesh.n_points]
    return robot, forces, response.snapshots[-1].points["bar"] - mesh.points


@pytest.mark.parametrize(("traction", "at_least"), [(1.2e-3, 0.15), (6e-3, 0.6)], ids=["moderate", "large"])
def test_bent_bar_is_calculix_own(traction, at_least, tmp_path):
    robot, forces, ours = bent("neo-hooke-isochoric", elastic(E, NU), traction)
    (body,) = robot.bodies
    mu, kappa = E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))
    law = ["*HYPERELASTIC, NEO HOOKE", f"{mu / 2:.15g}, {2 / kappa:.15g}"]
    theirs = calculix_displacements(body.mesh, law, forces, body.fixed, tmp_path)
    largest = np.linalg.norm(theirs, axis=1).max()
    assert largest > at_least * LENGTHS[0]
    assert np.linalg.norm(ours - theirs, axis=1).max() < 1e-4 * largest


@pytest.mark.parametrize("name", [name for name in CARDS if name != "neo-hooke-isochoric"])
def test_every_law_of_calculix_is_ours(name, tmp_path):
    parameters = constants(LAWS[name], E, NU)
    robot, forces, ours = bent(name, parameters, 4e-3)
    (body,) = robot.bodies
    theirs = calculix_displacements(body.mesh, law_lines(name, parameters), forces, body.fixed, tmp_path)
    largest = np.linalg.norm(theirs, axis=1).max()
    assert largest > 0.4 * LENGTHS[0]
    assert np.linalg.norm(ours - theirs, axis=1).max() < 1e-4 * largest
