"""The exported deck, run by CalculiX: cables, plates, ties and weight end where softcal's statics does."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed

from softcal.errors import ParameterError, SimulationError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.plugins.calculix.deck import calculix_deck, in_its_law, write_calculix
from softcal.plugins.calculix.load_path import load_path
from softcal.plugins.calculix.run import run_calculix
from softcal.twin.build import build_twin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, Tie, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows.study_source import load_calibrated

NECK = Path(__file__).resolve().parents[2] / "examples" / "neck" / "project.yaml"

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)


def differences(robot: Robot, protocol: Protocol, folder, timeout: float = 60.0) -> tuple[np.ndarray, float]:
    """At every state of the deck the largest difference of a node's displacement over the largest displacement, and
    the latter at the last [m].
    """
    response = simulate(robot, protocol, snapshots=True)
    assert response.succeeded, response.status
    shapes, meshes = load_path(robot, response.snapshots[-1]).shapes, build_twin(robot).meshes
    deck = calculix_deck(robot, shapes)
    errors, largest = [], 0.0
    for shape, theirs in zip(shapes, run_calculix(deck, folder, timeout=timeout), strict=True):
        ours = np.vstack([x - meshes[name].points for name, x in shape.points.items()])
        u = np.vstack([theirs[deck.first[name] :][: len(x)] for name, x in shape.points.items()])
        largest = float(np.linalg.norm(u, axis=1).max())
        errors.append(float(np.linalg.norm(ours - u, axis=1).max()) / largest)
    return np.array(errors), largest


@needs_ccx
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("d", [0.003, 0.015], ids=["moderate", "large"])
def test_a_column_under_a_cable_is_calculix_own(element, d, tmp_path):
    robot = in_its_law(column_robot(element, parameters=elastic(1e6, 0.4)))
    errors, largest = differences(robot, pulled(0.0, d), tmp_path)
    assert errors.max() < 1e-5
    assert largest > 0.3 * d


@needs_ccx
def test_tied_bodies_and_weight_are_calculix_own(tmp_path):
    """Two bars with other meshes bonded by equations, hanging sideways, with a heavy plate and a cable between them."""
    material = elastic(1e6, 0.4)
    low = box_mesh((0.02, 0.02, 0.05), (1, 1, 3), order=2)
    high = box_mesh((0.02, 0.02, 0.05), (2, 2, 3), order=2)
    high = TetMesh(high.points + [0.0, 0.0, 0.05], high.tets)
    law = "neo-hooke-isochoric"
    top = np.flatnonzero(np.isclose(high.points[:, 2], 0.1))
    robot = Robot(
        bodies=(
            Body("low", low, np.flatnonzero(low.points[:, 2] < 1e-9), material, law, "P2", 1000.0),
            Body("high", high, [], material, law, "P2", 1000.0),
        ),
        ties=(Tie("seam", "high", np.flatnonzero(np.isclose(high.points[:, 2], 0.05)), "low"),),
        plates=(Plate("cap", {"high": top}, np.array([0.01, 0.01, 0.1]), mass=0.05),),
        cables=(
            Cable(
                "pull",
                (
                    ViaPoint(np.array([0.02, 0.01, 0.0])),
                    ViaPoint(np.array([0.018, 0.01, 0.05]), "low"),
                    ViaPoint(np.array([0.02, 0.01, 0.1]), "cap"),
                ),
                pulled_end="first",
            ),
        ),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
    errors, largest = differences(robot, Protocol({"pull": Command("shortening", np.array([0.0, 0.0015]))}), tmp_path)
    assert errors.max() < 1e-4
    assert len(errors) > 1  # under its weight alone, and pulled
    assert largest > 0.002


@needs_ccx
def test_two_cables_that_bend_and_twist(tmp_path):
    skew = Cable("skew", (ViaPoint(np.array([0.05, 0.0, 0.1]), "plate"), ViaPoint(np.array([0.0, 0.05, 0.0]))))
    cables = [skew, side_cable("left", (0.0, 0.05))]
    robot = in_its_law(column_robot("P2", parameters=elastic(1e6, 0.4), divisions=(1, 1, 3), cables=cables))
    commands = {"skew": Command("shortening", np.array([0.02])), "left": Command("tension", np.array([1.5]))}
    errors, _ = differences(robot, Protocol(commands), tmp_path)
    assert errors.max() < 2e-5


def beam_with_cable_inside(heights: np.ndarray) -> Robot:
    """A slender clamped bar without plates; Euler's load is 0.8 N, so that no dead force can stand for its cable."""
    mesh = box_mesh((0.02, 0.02, 0.2), (1, 1, 8), origin=(-0.01, -0.01, 0.0), order=2)
    law = "neo-hooke-isochoric"
    body = Body("beam", mesh, mesh.node_sets["z0"], elastic(1e6, 0.4), law, "P2")
    inside = tuple(ViaPoint(np.array([0.008, 0.001, z]), "beam") for z in heights)
    return Robot((body,), cables=(Cable("in", (ViaPoint(np.array([0.008, 0.0, 0.0])), *inside), pulled_end="first"),))


@pytest.mark.slow
@needs_ccx
def test_a_cable_inside_a_slender_beam_pulled_until_it_curls(tmp_path):
    robot = beam_with_cable_inside(np.linspace(0.02, 0.19, 8))
    errors, largest = differences(robot, pulled(0.05, cable="in"), tmp_path)
    assert errors.max() < 1e-5
    assert largest > 0.25  # of 0.2 m of beam


@needs_ccx
@pytest.mark.parametrize("z", [0.07, 0.095], ids=["free", "beside the plate"])
def test_a_via_point_in_an_element_beside_a_plate(z, tmp_path):
    via = (*(ViaPoint(np.array([0.013, 0.001, at]), "neck") for at in (z, 0.05)), ViaPoint(np.array([0.013, 0.0, 0.0])))
    robot = column_robot("P2", parameters=elastic(1e6, 0.4), divisions=(1, 1, 4), cables=[Cable("inside", via)])
    errors, _ = differences(in_its_law(robot), tensed(6.0, cable="inside"), tmp_path)
    assert errors.max() < 1e-4


def neck(element: str) -> Robot:
    robot = in_its_law(load_calibrated(NECK).robot)
    robot = replace(robot, contact=None)  # which CalculiX does not get
    return replace(robot, bodies=tuple(replace(body, element=element) for body in robot.bodies))


@needs_ccx
@pytest.mark.parametrize(
    ("element", "d"),
    [("P1", 0.04), pytest.param("P2", 0.04, marks=pytest.mark.long)],
    ids=["P1 at 40 mm", "P2 at 40 mm"],
)
def test_the_neck_bent_far_is_calculix_own(element, d, tmp_path):
    """The neck of the example, whose plate has turned by 43 degrees at 40 mm."""
    errors, largest = differences(neck(element), pulled(d), tmp_path, timeout=600.0)
    assert errors.max() < 1e-5
    assert largest > 0.9 * d


@needs_ccx
def test_calculix_goes_evenly_from_step_to_step(tmp_path):
    """What the deck's steps rely on, told by one tet under small loads: new ones, and springs by temperature."""
    step = "*STEP, NLGEOM\n*STATIC, DIRECT\n0.5, 1.0\n*TEMPERATURE\nALL, {}\n{}*NODE PRINT, NSET=ALL\nU\n*END STEP\n"
    pushes = [(1.0, "*CLOAD, OP=NEW\n4, 1, 1e-3\n"), (1.0, "*CLOAD, OP=NEW\n4, 2, 1e-3\n"), (3.0, "")]
    (tmp_path / "tet.inp").write_text(
        "*NODE, NSET=ALL\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n5, 0, 0, 2\n"
        "*ELEMENT, TYPE=C3D4, ELSET=E\n1, 1, 2, 3, 4\n*BOUNDARY\n1, 1, 3\n2, 1, 3\n3, 1, 3\n5, 1, 3\n"
        "*MATERIAL, NAME=M\n*ELASTIC\n1e6, 0\n*SOLID SECTION, ELSET=E, MATERIAL=M\n"
        "*ELEMENT, TYPE=SPRINGA, ELSET=S\n2, 4, 5\n*SPRING, ELSET=S, NONLINEAR\n"
        + "".join(f"{1e-3 * T}, {stretch}, {T}\n" for T in (0, 1, 3) for stretch in (-1, 1))
        + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nALL, 0\n"
        + "".join(step.format(*push) for push in pushes)
    )
    subprocess.run(["ccx", "-i", "tet"], cwd=tmp_path, capture_output=True, timeout=60, check=True)
    rows = [line.split() for line in (tmp_path / "tet.dat").read_text().splitlines() if line.split()[:1] == ["4"]]
    u = np.array([[float(v) for v in row[1:]] for row in rows])
    x, z = u[1, 0], u[1, 2]
    expected = [[0.5, 0, 0.5], [1, 0, 1], [0.5, 0.5, 1], [0, 1, 1], [0, 1, 2], [0, 1, 3]]
    np.testing.assert_allclose(u, np.array(expected) * [x, x, z], atol=1e-4 * x)


def test_numbers_fit_the_twenty_characters_that_calculix_reads(tmp_path):
    robot = in_its_law(column_robot("P2", parameters=elastic(1e6, 0.4)))
    shape = simulate(robot, pulled(0.0, 0.01), snapshots=True).snapshots[-1]
    deck, _ = write_calculix(robot, shape, tmp_path)
    words = [w.strip() for line in deck.read_text().splitlines() if line[:1] != "*" for w in line.split(",")]
    assert max(len(word) for word in words) <= 20


def test_what_differs_is_told(tmp_path):
    given = column_robot("P2P1", parameters=elastic(1e6, 0.45))
    robot = in_its_law(given)
    shape = simulate(robot, pulled(0.0, 0.02), snapshots=True).snapshots[-1]
    deck, readme = write_calculix(robot, shape, tmp_path, given=given)
    assert deck.read_text().count("*STEP,") == 2
    assert "Steps: 2." in readme.read_text()
    assert "CalculiX has no law 'neo-hooke'" in readme.read_text()
    assert "P2P1 is written as C3D10" in readme.read_text()


def test_what_it_cannot_be_given_is_refused_at_once():
    robot = column_robot(
        "P2",
        cables=(replace(side_cable("front", (0.05, 0.0)), friction_coefficient=0.1),),
        parameters=elastic(1e6, 0.4),
    )
    shape = simulate(robot, pulled(0.0), snapshots=True).snapshots[-1]
    with pytest.raises(ParameterError, match="a cable in CalculiX has no friction"):
        calculix_deck(robot, [shape])


@needs_ccx
def test_a_deck_that_does_not_converge_says_how_far_it_came(tmp_path):
    robot = in_its_law(column_robot("P1", parameters=elastic(1e6, 0.4)))
    shape = simulate(robot, pulled(0.0, 0.01), snapshots=True).snapshots[-1]
    deck = calculix_deck(robot, [shape, replace(shape, efforts={"front": 1e6})])
    with pytest.raises(SimulationError, match=r"did not reach the full load \(ERROR: .*\); it reached 1 of 2 states"):
        run_calculix(deck, tmp_path)
