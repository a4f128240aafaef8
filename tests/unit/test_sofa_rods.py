"""Rods in the exported SOFA scene, against a recorder of its calls and softcal's own elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import elastic, tensed
from sofa_case import recorded, scene_modules, use_fake

from softcal.geometry.centreline import Centreline, helix, straight
from softcal.geometry.section import RectangularBar, RoundBar
from softcal.mechanics.rod import build_rod
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.rods import SEGMENTS, finer, linear_rod, node_volumes, rod_parameters
from softcal.plugins.sofa.scene import ASSUMED_DENSITY, scene_parameters
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Cable, Disc, Marker, Plate, PointLoad, Robot, Rod, ViaPoint

N = 6  # elements of the spring
UNTURNED = [0.0, 0.0, 0.0, 1.0]


def coil(elements: int = N) -> Centreline:
    return helix((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), diameter=0.03, pitch=0.02, turns=0.5, at=elements)


def hung(density: float = 900.0) -> Robot:
    """A head on a helical wire of rectangular section from a foot that stands still, and a cable."""
    foot = Plate("foot", {}, np.zeros(3), fixed=True)
    head = Plate(
        "head", {}, np.array([0.0, 0.0, 0.01]), mass=0.02,
        disc=Disc(0.05, 0.002, centre=np.array([0.0, 0.0, 0.011])),
        centre_of_mass=np.array([0.0, 0.0, 0.011]),
    )  # fmt: skip
    wire = Rod(
        "wire", coil(), RectangularBar(0.003, 0.005), elastic(1e9, 0.4),
        clamped={"foot": np.array([0]), "head": np.array([N - 1, N])}, density=density,
    )  # fmt: skip
    cable = Cable("pull", (ViaPoint((0.02, 0.0, 0.01), "head"), ViaPoint((0.02, 0.0, -0.05))))
    load = PointLoad("push", "head", (0.0, 0.0, 0.01), (0.1, 0.0, 0.0))
    marker = Marker("tip", "head", (0.02, 0.0, 0.01))
    return Robot(
        plates=(foot, head), rods=(wire,), cables=(cable,), loads=(load,), markers=(marker,), gravity=(0.0, 0.0, -9.81)
    )


def test_rod_has_every_component_and_number(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    robot = hung()
    root, parameters = recorded(robot, tensed(0.1, cable="pull"), tmp_path)
    assert "Sofa.Component.SolidMechanics.FEM.Elastic" in root.robot.own("RequiredPlugin").pluginName.value
    assert parameters["bodies"] == {}
    by_name = {node.name: node for node in root.all()}
    line = finer(robot.rods[0], SEGMENTS).centreline
    n = SEGMENTS * N
    on_head = list(range(n - SEGMENTS, n + 1))  # what lies between two nodes on a plate is on it too

    free = by_name["wire_free"]
    assert [part.kind for part in free.objects] == ["MechanicalObject", "FixedProjectiveConstraint"]
    assert free.own("MechanicalObject").template.value == "Rigid3"
    expected = [[*at, *UNTURNED] for at in line.nodes[: n - SEGMENTS].tolist()]
    assert free.own("MechanicalObject").position.value == expected
    assert free.own("FixedProjectiveConstraint").indices.value == [0]  # what is clamped to a plate that stands still

    riders = by_name["wire_on_head"]
    assert riders.parents == [by_name["head"]]
    assert [part.kind for part in riders.objects] == ["MechanicalObject", "RigidMapping"]
    assert riders.own("RigidMapping").given == {"template": "Rigid3,Rigid3", "globalToLocalCoords": True}
    assert riders.own("MechanicalObject").position.value == [[*at, *UNTURNED] for at in line.nodes[on_head].tolist()]

    wire = by_name["wire"]
    assert wire.parents == [free, riders]
    mapping = wire.own("SubsetMultiMapping")
    assert mapping.template.value == "Rigid3,Rigid3"
    assert mapping.input.value == ["@/robot/wire_free/dofs", "@/robot/head/wire_on_head/dofs"]
    assert mapping.output.value == "@/robot/wire_free/wire/dofs"
    pairs = np.array(mapping.indexPairs.value).reshape(-1, 2)
    there = [list(range(n - SEGMENTS)), on_head]
    assert [there[parent][k] for parent, k in pairs] == list(range(n + 1))
    assert wire.own("MechanicalObject").position.value == [[*at, *UNTURNED] for at in line.nodes.tolist()]

    edges = wire.own("EdgeSetTopologyContainer").edges.value
    assert edges == [edge for k in range(n) for edge in ([k, k + 1], [k + 1, k])]
    beams = wire.own("BeamFEMForceField")
    assert beams.topology.value == "@topology"
    assert (beams.youngModulus.value, beams.poissonRatio.value) == (0.5e9, 0.4)
    assert wire.objects[-1].name == "stiffness"

    masses = [node for node in wire.children if node.name.startswith("wire_mass")]
    total, seen = 0.0, []
    for node in masses:
        assert [part.kind for part in node.objects] == ["MechanicalObject", "SubsetMapping", "UniformMass"]
        indices = node.own("SubsetMapping").indices.value
        assert node.own("MechanicalObject").position.value == [[*at, *UNTURNED] for at in line.nodes[indices].tolist()]
        mass, volume, *inertia = node.own("UniformMass").vertexMass.value
        assert volume == 1.0
        section = robot.rods[0].section.constants
        np.testing.assert_allclose(inertia, ((section.I1 + section.I2) / section.area * np.eye(3)).ravel())
        total += mass * len(indices)
        seen += indices
    assert sorted(seen) == list(range(n + 1))
    assert len(masses) == 2  # the ends carry half
    assert total == pytest.approx(900.0 * section.area * line.stations[-1], rel=1e-12)

    assert by_name["push"].own("RigidMapping")
    assert not [part for node in root.all() for part in node.objects if part.name == "wire_weightless"]


def test_rod_on_no_moving_plate_is_one_node(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    rod = Rod("rod", straight((0, 0, 0), (0.1, 0, 0), 4), RoundBar(0.004), elastic(1e9, 0.4), fixed=[0, 1])
    robot = Robot(rods=(rod,), gravity=(0.0, 0.0, -9.81))
    root, _ = recorded(robot, Protocol({}), tmp_path)
    (node,) = root.children[0].children
    assert node.name == "rod"
    assert node.own("FixedProjectiveConstraint").indices.value == list(range(SEGMENTS + 1))
    assert not node.own("SubsetMultiMapping")
    # No density in the project: mass to move with, and a force that takes its weight off.
    (weightless,) = [part for part in node.objects if part.name == "rod_weightless"]
    forces = np.array(weightless.forces.value)
    assert forces.shape == (4 * SEGMENTS + 1, 6)
    np.testing.assert_allclose(
        forces.sum(axis=0), [0, 0, ASSUMED_DENSITY * 9.81 * rod.section.constants.area * 0.1, 0, 0, 0]
    )
    masses = [child.own("UniformMass").vertexMass.value[0] for child in node.children]
    assert masses[0] == pytest.approx(2.0 * masses[1])


def test_stiffness_is_that_of_softcals_elements(tmp_path, monkeypatch):
    """Of every beam at rest, from either end, under the modulus and the ratio that parameters.json says now."""
    use_fake(monkeypatch)
    robot = hung()
    _, parameters = recorded(robot, tensed(0.1, cable="pull"), tmp_path)
    rod = finer(robot.rods[0], SEGMENTS)
    nodes = np.array(rod.centreline.nodes)
    term = build_rod("wire", rod.section, rod.centreline, np.arange(len(nodes)), nodes)
    axes = np.tile(np.eye(3), (len(nodes), 1, 1))
    edited = {**parameters["rods"]["wire"], "youngs_modulus": 3e8, "poissons_ratio": 0.1}
    exact = term.assemble(nodes, axes, elastic(3e8, 0.1)).tangent
    with scene_modules(tmp_path) as modules:
        found = np.array(modules.rods.stiffnesses(edited))
        words = np.array(modules.rods.numbers(modules.rods.beams_data(edited))).reshape(len(exact), 2, 13 + 144)
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    matrices = words[:, :, 13:].reshape(len(exact), 2, 12, 12)
    np.testing.assert_array_equal(matrices[:, 0], 0.5 * found)
    np.testing.assert_array_equal(matrices[:, 1], 0.5 * np.roll(found, (6, 6), axis=(1, 2)))
    np.testing.assert_allclose(words[:, 0, 3], np.linalg.norm(np.diff(nodes, axis=0), axis=1))


def test_stiffness_that_sofa_does_not_take_is_an_error(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    root, parameters = recorded(hung(), tensed(0.1, cable="pull"), tmp_path)
    rod = parameters["rods"]["wire"]
    (beams,) = root.find("BeamFEMForceField")
    with scene_modules(tmp_path) as modules:
        modules.rods.Stiffness(beams, "wire", rod, name="stiffness").init()
        given = beams.beamsData.value
        assert given == modules.rods.beams_data(rod)
        for wrong in ("", given.rpartition("[")[0], given.replace("[", "[1", 1)):
            beams.beamsData.value = wrong
            with pytest.raises(RuntimeError, match="stiffness of beams: wire"):
                modules.rods.require_stiffness(beams, "wire", rod)


def test_finer_rod_is_the_helix_with_more_elements():
    rod = hung().rods[0]
    cut = finer(rod, 3)
    line = coil(3 * N)
    for key in ("nodes", "triads", "lengths"):
        np.testing.assert_allclose(getattr(cut.centreline, key), getattr(line, key), rtol=0, atol=1e-14)
    assert cut.clamped["head"].tolist() == list(range(3 * N - 3, 3 * N + 1))
    assert cut.clamped["foot"].tolist() == [0]
    assert finer(replace(rod, clamped={}, fixed=[4, 0, 2, 3]), 2).fixed.tolist() == [0, 4, 5, 6, 7, 8]
    assert node_volumes(cut).sum() == pytest.approx(rod.section.constants.area * line.stations[-1])


def test_nodes_on_plates_that_stand_still_are_fixed():
    rod = hung().rods[0]
    still = linear_rod(rod, ("foot",))
    assert still.fixed.tolist() == [0]
    assert set(still.clamped) == {"head"}
    assert linear_robot(hung()).robot.rods[0].fixed.tolist() == [0]
    assert linear_rod(rod, ()).clamped.keys() == rod.clamped.keys()


def test_parameters_and_readme_of_a_robot_of_rods(tmp_path):
    robot = hung()
    write_sofa(robot, tensed(0.1, cable="pull"), tmp_path, "hung")
    readme = (tmp_path / "README.md").read_text()
    assert "beams for each element of a rod" in readme
    assert "`hung/robot.py`, `parts.py`, `rods.py`" in readme
    assert (tmp_path / "hung" / "rods.py").is_file()
    rod = scene_parameters(linear_robot(robot), tensed(0.1, cable="pull"))["rods"]["wire"]
    assert rod["segments"] == SEGMENTS
    assert rod["plates"] == {"head": list(range(SEGMENTS * (N - 1), SEGMENTS * N + 1))}


@pytest.mark.parametrize("line", [straight((0, 0, 0), (0.03, 0.05, 0.1), 5), coil(N)])
def test_elements_that_are_alike_share_one_flexibility(line):
    rod = Rod("rod", line, RoundBar(0.004), elastic(1e9, 0.4), fixed=[0])
    written = rod_parameters(rod, 1000.0)
    assert len(written["flexibilities"]) == 1
    assert written["kinds"] == [0] * (len(written["nodes"]) - 1)


def test_elements_of_two_lengths_have_two_flexibilities(tmp_path, monkeypatch):
    """The stiffness of every one of them is its own nevertheless."""
    use_fake(monkeypatch)
    line = straight((0, 0, 0), (0.03, 0.05, 0.1), [0.0, 0.1, 0.2, 0.6, 1.0])
    robot = Robot(rods=(Rod("rod", line, RoundBar(0.004), elastic(1e9, 0.4), fixed=[0]),))
    _, parameters = recorded(robot, Protocol({}), tmp_path)
    written = parameters["rods"]["rod"]
    assert written["kinds"] == [0] * 2 * SEGMENTS + [1] * 2 * SEGMENTS
    rod = finer(robot.rods[0], SEGMENTS)
    nodes = np.array(rod.centreline.nodes)
    term = build_rod("rod", rod.section, rod.centreline, np.arange(len(nodes)), nodes)
    exact = term.assemble(nodes, np.tile(np.eye(3), (len(nodes), 1, 1)), elastic(1e9, 0.4)).tangent
    with scene_modules(tmp_path) as modules:
        found = np.array(modules.rods.stiffnesses(written))
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
