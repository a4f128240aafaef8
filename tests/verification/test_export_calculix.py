"""The exported deck, run by CalculiX: cables, plates, ties and weight end where softcal's statics does."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable

from softcal.errors import ParameterError, SimulationError
from softcal.export.calculix import calculix_deck, in_its_law, run_calculix, write_calculix
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.build import build_twin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, Tie, ViaPoint
from softcal.twin.simulate import simulate

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)


def difference(robot: Robot, protocol: Protocol, folder) -> tuple[float, float]:
    """Largest difference of a node's displacement over the largest displacement, and the latter [m]."""
    response = simulate(robot, protocol, snapshots=True)
    assert response.succeeded, response.status
    shape, meshes = response.snapshots[-1], build_twin(robot).meshes
    deck = calculix_deck(robot, shape)
    theirs = run_calculix(deck, folder, timeout=60)
    largest, worst = 0.0, 0.0
    for name, x in shape.points.items():
        u = theirs[deck.first[name] :][: len(x)]
        worst = max(worst, np.linalg.norm(x - meshes[name].points - u, axis=1).max())
        largest = max(largest, np.linalg.norm(u, axis=1).max())
    return worst / largest, largest


@needs_ccx
@pytest.mark.parametrize("element", ["P1", "P2"])
@pytest.mark.parametrize("d", [0.003, 0.015], ids=["moderate", "large"])
def test_a_column_under_a_cable_is_calculix_own(element, d, tmp_path):
    robot = in_its_law(column_robot(element, parameters=elastic(1e6, 0.4)))
    error, largest = difference(robot, pulled(0.0, d), tmp_path)
    assert error < 1e-4
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
    error, largest = difference(robot, Protocol({"pull": Command("shortening", np.array([0.0, 0.0015]))}), tmp_path)
    assert error < 1e-3
    assert largest > 0.002


def test_numbers_fit_the_twenty_characters_that_calculix_reads(tmp_path):
    robot = in_its_law(column_robot("P2", parameters=elastic(1e6, 0.4)))
    shape = simulate(robot, pulled(0.0, 0.01), snapshots=True).snapshots[-1]
    deck, _ = write_calculix(robot, shape, tmp_path)
    words = [w.strip() for line in deck.read_text().splitlines() if line[:1] != "*" for w in line.split(",")]
    assert max(len(word) for word in words) <= 20


def test_what_differs_is_told(tmp_path):
    given = column_robot("P2P1", parameters=elastic(1e6, 0.45))
    robot = in_its_law(given)
    shape = simulate(robot, pulled(0.0, 0.01), snapshots=True).snapshots[-1]
    _, readme = write_calculix(robot, shape, tmp_path, given=given)
    assert "CalculiX has no law 'neo-hooke'" in readme.read_text()
    assert "P2P1 is written as C3D10" in readme.read_text()


def test_what_it_cannot_be_given_is_refused_at_once():
    robot = column_robot(
        "P2",
        cables=(replace(side_cable("front", (0.05, 0.0)), friction_coefficient=0.1),),
        parameters=elastic(1e6, 0.4),
    )
    shape = simulate(robot, pulled(0.0), snapshots=True).snapshots[-1]
    with pytest.raises(ParameterError, match="a cable with friction is not written"):
        calculix_deck(robot, shape)


def test_a_missing_calculix_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    robot = in_its_law(column_robot("P1", parameters=elastic(1e6, 0.4)))
    shape = simulate(robot, pulled(0.0, 0.001), snapshots=True).snapshots[-1]
    with pytest.raises(SimulationError, match="apt-get install calculix-ccx"):
        run_calculix(calculix_deck(robot, shape), tmp_path)


@needs_ccx
def test_a_run_that_fails_says_so(tmp_path):
    robot = in_its_law(column_robot("P1", parameters=elastic(1e6, 0.4)))
    shape = simulate(robot, pulled(0.0, 0.01), snapshots=True).snapshots[-1]
    deck = calculix_deck(robot, shape)
    broken = type(deck)(deck.text.replace("*STATIC\n", "*STATIC\n1.0, 1.0\n** "), deck.first)
    pushed = type(deck)(broken.text.replace("*NODE FILE", "*CLOAD\n200, 1, 1e9\n*NODE FILE"), deck.first)
    with pytest.raises(SimulationError, match="did not reach the full load"):
        run_calculix(pushed, tmp_path)
