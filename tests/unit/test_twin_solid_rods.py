"""Rods made solid: what holds them, what they are made of, what cannot be made solid."""

from dataclasses import replace

import numpy as np
import pytest

from softcal.errors import MeshError
from softcal.geometry.centreline import straight
from softcal.geometry.section import CrossSection, RectangularBar, RoundBar
from softcal.twin.manipulator import Cables, Manipulator, Springs, manipulator
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import Plate, Robot, Rod
from softcal.twin.solid_rods import solid_body, with_solid_rods

SPRINGS = Springs(youngs_modulus=1e9, poissons_ratio=0.4, density=900.0)
SHAPE = Manipulator(springs=SPRINGS)
ONE_END = Cables(ends={"S1": 0.0})
ROUND = RoundBar(0.01)


def rod(*, section: CrossSection = ROUND, n: int = 8, at: int = 8, fixed: tuple[int, ...] = (0,)) -> Rod:
    return Rod(
        "rod",
        straight((0, 0, 0), (0, 0, 0.04), n),
        section,
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        clamped={"tip": np.array([at])},
        fixed=np.array(fixed, dtype=int),
        density=900.0,
    )


def test_plates_hold_the_end_faces_of_solid_springs():
    robot = manipulator(replace(SHAPE, springs=replace(SPRINGS, elements_per_turn=24)))
    solid = with_solid_rods(robot)
    assert [body.name for body in solid.bodies] == list(SHAPE.spring_names)
    assert not solid.rods
    first, second = (body.mesh.node_sets for body in solid.bodies[:2])
    base, s1, *_ = solid.plates
    assert {name: nodes.tolist() for name, nodes in base.nodes.items()} == {"spring1": first["start"].tolist()}
    assert s1.nodes["spring1"].tolist() == first["end"].tolist()
    assert s1.nodes["spring2"].tolist() == second["start"].tolist()
    assert solid.bodies[0].density == 900.0
    ends = [solid.bodies[0].mesh.points[first[name]].mean(axis=0) for name in ("start", "end")]
    assert ends[0] == pytest.approx(robot.rods[0].centreline.nodes[0], abs=2e-4)
    assert ends[1] == pytest.approx(robot.rods[0].centreline.nodes[-1], abs=2e-4)


def test_parameters_keep_their_names():
    robot = manipulator(SHAPE)
    before, after = robot_parameters(robot), robot_parameters(with_solid_rods(robot, ["spring2"]))
    assert set(before) == set(after)
    assert all(before[name].value == after[name].value for name in before)


def test_one_rod_alone_can_be_made_solid():
    robot = manipulator(SHAPE)
    solid = with_solid_rods(robot, ["spring3"], rings=2, element="P2")
    assert [body.name for body in solid.bodies] == ["spring3"]
    assert solid.bodies[0].mesh.n_tets == 18 * 72
    assert solid.bodies[0].element == "P2"
    assert [r.name for r in solid.rods] == ["spring1", "spring2", "spring4"]


@pytest.mark.parametrize(("given", "layers"), [({}, 23), ({"rings": 2}, 45), ({"layers_per_turn": 8}, 8)])
def test_layers_of_a_manipulators_springs(given, layers):
    """A turn of the default spring's wire is 99.7 mm long, a tet of one ring 4.5 mm wide."""
    springs = replace(SPRINGS, turns=1.0, model="solid", **given)
    length = 0.018 + SHAPE.spring_length / 3.0
    shape = Manipulator(springs=springs, total_length=length, sections=1, cables=ONE_END)
    tets = 18 * given.get("rings", 1) ** 2
    assert manipulator(shape).bodies[0].mesh.n_tets == tets * layers


def test_fixed_ends_are_fixed():
    body = solid_body(rod())
    assert body.fixed.tolist() == body.mesh.node_sets["start"].tolist()
    plate = Plate("tip", {}, np.array([0, 0, 0.04]))
    solid = with_solid_rods(Robot(plates=(plate,), rods=(rod(),)))
    assert solid.plates[0].nodes["rod"].tolist() == body.mesh.node_sets["end"].tolist()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (rod(section=RectangularBar(0.01, 0.02)), "round"),
        (rod(section=RoundBar(0.01, inner_diameter=0.006)), "round"),
        (rod(at=5), "ends only; got node 5"),
        (rod(fixed=(0, 3)), "node 3"),
        (rod(n=7, at=7), "even number"),
    ],
    ids=["flat", "tube", "clamped inside", "fixed inside", "odd"],
)
def test_what_cannot_be_solid_is_told(given, message):
    with pytest.raises(MeshError, match=message):
        solid_body(given)


def test_a_name_that_is_no_rod_is_told():
    with pytest.raises(MeshError, match="no such rod; got 'spring9'"):
        with_solid_rods(manipulator(SHAPE), ["spring9"])
