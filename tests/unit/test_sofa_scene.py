"""The exported SOFA scene against a recorder of its calls: every component, link and number, for old and new SOFAs."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, shared_json, side_cable, tensed
from sofa_case import beam_robot, many_parts, neck_robot, recorded, scene_modules, use_fake

from softcal.errors import InputError, ParameterError
from softcal.geometry.quadratic import to_quadratic
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.scene import legacy_vtk, package_name, scene_parameters, schedule_csv
from softcal.plugins.sofa.writing import furthest, write_sofa
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import SurfaceLoad
from softcal.twin.simulate import simulate


def kinds(node) -> list[str]:
    return [getattr(part, "kind", type(part).__name__) for part in node.objects]


def test_beam_scene_has_every_component_and_number(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    data = shared_json("beam-cable.json")
    robot = beam_robot(data)
    body = replace(robot.bodies[0], density=data["density_kg_m3"])
    root, _ = recorded(replace(robot, bodies=(body,)), tensed(0.08, cable="tendon"), tmp_path)
    assert kinds(root) == [
        "RequiredPlugin", "FreeMotionAnimationLoop", "BlockGaussSeidelConstraintSolver", "Pulling",
    ]  # fmt: skip
    assert root.gravity.value == [0.0, 0.0, 0.0]
    assert root.dt.value == 0.01
    assert root.own("RequiredPlugin").pluginName.value == [
        "Sofa.Component.AnimationLoop", "Sofa.Component.Constraint.Lagrangian.Solver",
    ]  # fmt: skip
    assert root.own("BlockGaussSeidelConstraintSolver").given == {"maxIterations": 500, "tolerance": 1e-9}

    (solver,) = root.children
    assert "SoftRobots" in solver.own("RequiredPlugin").pluginName.value
    assert kinds(solver) == ["RequiredPlugin", "EulerImplicitSolver", "SparseLDLSolver", "GenericConstraintCorrection"]
    assert solver.own("EulerImplicitSolver").given == {"rayleighStiffness": 0.2, "rayleighMass": 0.1}
    assert solver.own("SparseLDLSolver").given == {"template": "CompressedRowSparseMatrixd"}

    (beam,) = solver.children
    assert beam.name == "beam"
    assert kinds(beam) == [
        "MeshVTKLoader", "TetrahedronSetTopologyContainer", "TetrahedronSetGeometryAlgorithms", "MechanicalObject",
        "MeshMatrixMass", "TetrahedronHyperelasticityFEMForceField", "FixedProjectiveConstraint",
    ]  # fmt: skip
    assert beam.own("MeshVTKLoader").filename.value == str(tmp_path / "robot" / "beam.vtk")
    assert beam.own("TetrahedronSetTopologyContainer").src.value == "@loader"
    assert beam.own("MechanicalObject").given == {"template": "Vec3", "position": "@loader.position"}
    E, nu = data["youngs_modulus_Pa"], data["poissons_ratio"]
    law = beam.own("TetrahedronHyperelasticityFEMForceField")
    assert law.materialName.value == "NeoHookean"
    assert law.topology.value == "@topology"
    expected = [E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))]
    np.testing.assert_allclose(law.ParameterSet.value, expected, rtol=1e-15)
    mass = beam.own("MeshMatrixMass").given
    assert mass == {"massDensity": data["density_kg_m3"], "lumping": False, "topology": "@topology"}
    x = body.mesh.points[:, 0]
    assert beam.own("FixedProjectiveConstraint").indices.value == np.flatnonzero(x <= 1e-4).tolist()

    (tendon,) = beam.children
    assert kinds(tendon) == ["MechanicalObject", "BarycentricMapping", "CableConstraint"]
    assert tendon.own("MechanicalObject").position.value == data["cable"]["via_points_m"]
    cable = tendon.own("CableConstraint")
    assert cable.pullPoint.value == data["cable"]["pull_point_m"]
    assert cable.hasPullPoint.value is True
    assert cable.indices.value == list(range(20))
    assert cable.valueType.value == "force"
    assert cable.value.value == [0.0]
    assert "minForce" not in cable.given
    assert cable.cableInitialLength.value == pytest.approx(0.1, rel=1e-12)


def test_neck_scene_is_rigidified(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    data = shared_json("neck-shortening.json")
    robot = neck_robot(data)
    mesh, fixed, collar = robot.bodies[0].mesh, robot.bodies[0].fixed, robot.plates[0].nodes["neck"]
    root, _ = recorded(robot, pulled(0.04), tmp_path)
    plate, free = root.children[0].children
    assert (plate.name, free.name) == ("plate", "neck_free")

    assert kinds(plate) == ["MechanicalObject"]  # it has no mass
    frame = plate.own("MechanicalObject")
    assert frame.template.value == "Rigid3"
    assert frame.position.value == [[0.0, 0.0, data["height_m"], 0.0, 0.0, 0.0, 1.0]]
    riders, cable = plate.children
    assert (riders.name, cable.name) == ("neck_on_plate", "front")
    assert kinds(riders) == ["MechanicalObject", "RigidMapping"]
    assert riders.own("RigidMapping").given == {"globalToLocalCoords": True}
    np.testing.assert_array_equal(riders.own("MechanicalObject").position.value, mesh.points[collar])

    others = np.setdiff1d(np.arange(mesh.n_points), collar)
    assert kinds(free) == ["MechanicalObject", "FixedProjectiveConstraint"]
    np.testing.assert_array_equal(free.own("MechanicalObject").position.value, mesh.points[others])
    held = others[free.own("FixedProjectiveConstraint").indices.value]
    np.testing.assert_array_equal(held, fixed)

    (neck,) = free.children
    assert neck in riders.children
    assert neck.parents == [free, riders]
    assert "FixedProjectiveConstraint" not in kinds(neck)
    mapping = neck.own("SubsetMultiMapping")
    assert mapping.input.value == ["@/robot/neck_free/dofs", "@/robot/plate/neck_on_plate/dofs"]
    assert mapping.output.value == "@/robot/neck_free/neck/dofs"
    pairs = np.array(mapping.indexPairs.value).reshape(-1, 2)
    there = [others, collar]
    assert [there[parent][k] for parent, k in pairs] == list(range(mesh.n_points))

    assert kinds(cable) == ["MechanicalObject", "RigidMapping", "CableConstraint"]
    assert cable.own("MechanicalObject").position.value == [data["cable"]["on_plate_m"]]
    constraint = cable.own("CableConstraint")
    assert constraint.pullPoint.value == data["cable"]["pull_point_m"]
    assert constraint.valueType.value == "displacement"
    assert constraint.minForce.value == 0.0  # a cable cannot push
    length = data["cable"]["on_plate_m"][2] - data["cable"]["pull_point_m"][2]
    assert constraint.cableInitialLength.value == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize(
    ("version", "solver", "fixed"),
    [
        ("23.12", "GenericConstraintSolver", "FixedConstraint"),
        ("24.06", "GenericConstraintSolver", "FixedProjectiveConstraint"),
        ("25.12", "BlockGaussSeidelConstraintSolver", "FixedProjectiveConstraint"),
        ("26.06", "BlockGaussSeidelConstraintSolver", "FixedProjectiveConstraint"),
    ],
)
def test_names_are_chosen_when_the_scene_is_loaded(tmp_path, monkeypatch, version, solver, fixed):
    use_fake(monkeypatch, version=version)
    root, _ = recorded(column_robot(), pulled(0.01), tmp_path)
    assert root.own(solver).given == {"maxIterations": 500, "tolerance": 1e-9}
    assert len(root.find(fixed)) == 1
    assert {"FixedConstraint", "FixedProjectiveConstraint"} & {part for n in root.all() for part in kinds(n)} == {fixed}


def test_many_parts_go_into_the_scene(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    robot = many_parts()
    protocol = Protocol({"through": Command("tension", [1.0]), "between": Command("shortening", [0.004])})
    root, parameters = recorded(robot, protocol, tmp_path)
    solver = root.children[0]
    by_name = {node.name: node for node in root.all()}
    assert root.gravity.value == [0.5, 0.0, -9.81]
    assert "foot" not in by_name  # what stands still is fixed

    low, high = by_name["low"], by_name["high"]
    np.testing.assert_array_equal(
        low.own("FixedProjectiveConstraint").indices.value, robot.bodies[0].mesh.node_sets["z0"]
    )
    assert [parent.name for parent in high.parents] == ["high_free", "high_on_head", "high_on_joint"]
    assert by_name["high_on_joint"].parents == [low]
    assert by_name["high_on_joint"].own("BarycentricMapping")

    head = by_name["head"]
    assert head.own("MechanicalObject").position.value[0][:3] == [
        0.002,
        0.0,
        0.11,
    ]  # SOFA's frame is the centre of mass
    m, volume, *inertia = head.own("UniformMass").vertexMass.value
    assert (m, volume) == (0.03, 1.0)
    across, along = 0.06**2 / 16 + 0.01**2 / 12, 0.06**2 / 8
    np.testing.assert_allclose(np.array(inertia).reshape(3, 3), np.diag([across, across, along]), atol=1e-18)

    through = by_name["through"]
    assert [parent.name for parent in through.parents] == ["through_on_low", "through_on_high", "through_on_head"]
    assert through.own("CableConstraint").pullPoint.value == [0.012, 0.0, -0.02]
    assert through.own("CableConstraint").valueType.value == "force"
    at = through.own("MechanicalObject").position.value
    assert at == [[0.012, 0.0, 0.03], [0.009, 0.0, 0.07], [0.01, 0.0, 0.1]]  # from the pull point on
    inner = by_name["inner"].own("CableConstraint")
    assert inner.pullPoint.value == [-0.02, 0.0, 0.0]  # on a plate that stands still
    assert inner.valueType.value == "force"  # not driven: slack
    between = by_name["between"].own("CableConstraint")
    assert between.hasPullPoint.value is False  # no end of it is in space
    assert by_name["between_on_ground"].own("FixedProjectiveConstraint").indices.value == [0]
    assert parameters["cables"]["between"]["points"][0]["on"] == "head"

    push, tip = by_name["push"], by_name["tip"]
    assert push.own("ConstantForceField").given == {"indices": [0], "forces": [[0.0, 0.05, 0.0]]}
    assert push.own("BarycentricMapping")
    assert tip.own("RigidMapping")
    (wind,) = [part for part in low.objects if part.name == "wind"]
    np.testing.assert_allclose(np.sum(wind.forces.value, axis=0), 0.03 * 0.05 * np.array([-20.0, 5.0, 0.0]), atol=1e-15)

    assert high.own("MeshMatrixMass").massDensity.value == 1000.0
    (weightless,) = [part for part in high.objects if part.name == "high_weightless"]
    volume = 0.02 * 0.02 * 0.05
    np.testing.assert_allclose(np.sum(weightless.forces.value, axis=0), -1000.0 * volume * robot.gravity)
    assert not [part for part in low.objects if part.name == "low_weightless"]

    assert solver.name == "robot"


def test_quadratic_meshes_lose_their_middles_and_nothing_else():
    robot = many_parts()
    meshes = {body.name: to_quadratic(body.mesh) for body in robot.bodies}

    def raised(name: str, nodes):
        from softcal.twin.joints import nodes_in_use

        old = next(body.mesh for body in robot.bodies if body.name == name)
        return nodes_in_use(old, meshes[name], nodes)

    quadratic = replace(
        robot,
        bodies=tuple(
            replace(b, mesh=meshes[b.name], fixed=raised(b.name, b.fixed), element="P2P1") for b in robot.bodies
        ),
        plates=tuple(
            replace(p, nodes={name: raised(name, nodes) for name, nodes in p.nodes.items()}) for p in robot.plates
        ),
        ties=tuple(replace(tie, nodes=raised(tie.body, tie.nodes)) for tie in robot.ties),
        loads=tuple(
            replace(x, faces=meshes[x.on].face_sets["x1"]) if isinstance(x, SurfaceLoad) else x for x in robot.loads
        ),
    )
    protocol = Protocol({"through": Command("tension", [1.0])})
    assert scene_parameters(linear_robot(quadratic), protocol) == scene_parameters(linear_robot(robot), protocol)


def test_nodes_of_no_tet_are_left_out():
    robot = column_robot()
    mesh = robot.bodies[0].mesh
    points = np.vstack([[[9.0, 9.0, 9.0]], mesh.points])
    stray = type(mesh)(points, mesh.tets + 1)
    moved = replace(
        robot,
        bodies=(replace(robot.bodies[0], mesh=stray, fixed=robot.bodies[0].fixed + 1),),
        plates=(replace(robot.plates[0], nodes={"neck": robot.plates[0].nodes["neck"] + 1}),),
    )
    assert scene_parameters(linear_robot(moved), pulled(0.01)) == scene_parameters(linear_robot(robot), pulled(0.01))
    np.testing.assert_array_equal(linear_robot(moved).robot.bodies[0].mesh.points, mesh.points)


def test_mesh_file_is_the_mesh_to_the_last_digit(tmp_path):
    mesh = column_robot().bodies[0].mesh
    (tmp_path / "neck.vtk").write_text(legacy_vtk(mesh, "neck"))
    read = meshio.read(tmp_path / "neck.vtk")
    np.testing.assert_array_equal(read.points, mesh.points)
    np.testing.assert_array_equal(read.cells[0].data, mesh.tets)


def test_what_no_scene_can_hold_is_refused():
    robot = column_robot()
    with pytest.raises(ParameterError, match=r"no friction; got 0.1"):
        linear_robot(replace(robot, cables=(replace(robot.cables[0], friction_coefficient=0.1),)))


@pytest.mark.parametrize(("protocol", "said"), [(pulled(0.5), "more than its length"), (tensed(-1.0), "cannot push")])
def test_a_pull_that_no_cable_can_follow_is_no_schedule(tmp_path, protocol, said):
    with pytest.raises(InputError, match=said):
        write_sofa(column_robot(), protocol, tmp_path, "robot")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("root", [True, False])
def test_the_scene_finds_sofa_by_sofa_root(tmp_path, monkeypatch, root):
    """As its README says: no PYTHONPATH; and a sentence where there is no SOFA."""
    write_sofa(column_robot(), pulled(0.01), tmp_path, "robot")
    (tmp_path / "robot" / "schedule.csv").write_text("time [s],front.shortening [m]\n0,0\n1,0.001\n")
    use_fake(monkeypatch)
    monkeypatch.delenv("PYTHONPATH", raising=False)
    if not root:
        monkeypatch.delenv("SOFA_ROOT")
    python = [sys.executable] if root else [sys.executable, "-S"]  # which may have SOFA among its own packages
    done = subprocess.run([*python, "run.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == root, done.stdout + done.stderr
    assert "3 states at rest" in done.stdout if root else "Set SOFA_ROOT" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("rows", "said"), [("", "1 state at rest, in response.csv.\n"), ("0,0\n", "2 states at rest, in response.csv.\n")]
)
def test_the_scene_counts_its_states(tmp_path, monkeypatch, rows, said):
    write_sofa(column_robot(), pulled(0.01), tmp_path, "robot")
    (tmp_path / "robot" / "schedule.csv").write_text(f"time [s],front.shortening [m]\n{rows}")
    use_fake(monkeypatch)
    done = subprocess.run([sys.executable, "run.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == said, done.stderr


def test_schedule_pulls_at_the_papers_speed():
    rows = [line.split(",") for line in schedule_csv(pulled(0.0, 0.01, 0.03)).splitlines()]
    assert rows[0] == ["time [s]", "front.shortening [m]"]
    values = np.array(rows[1:], dtype=float)
    np.testing.assert_allclose(values[[0, -2, -1]], [[0.0, 0.0], [5.01, 0.01], [15.01, 0.03]])
    by_force = schedule_csv(tensed(*np.linspace(0.0, 8.0, 400))).splitlines()
    assert len(by_force) <= 43
    assert by_force[-1].split(",")[1] == "8"
    assert float(by_force[-1].split(",")[0]) == pytest.approx(20.0, abs=0.05)


def test_the_schedule_is_the_furthest_pull_within_one_control():
    assert furthest({"a": pulled(0.01), "b": pulled(0.04), "c": pulled(0.02)}) == "b"
    assert furthest({"a": tensed(8.0), "b": pulled(0.02), "c": pulled(0.04)}) == "c"
    assert furthest({"a": tensed(2.0), "b": tensed(8.0)}) == "b"
    assert furthest({"a": Protocol({}), "b": tensed(1.0)}) == "b"


def test_controller_follows_the_schedule_until_a_key_is_pressed(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    robot = column_robot(cables=(side_cable("front", (0.05, 0.0)), side_cable("left", (0.0, 0.05))))
    protocol = Protocol({"front": Command("shortening", [0.02])})
    write_sofa(robot, protocol, tmp_path, "robot")
    with scene_modules(tmp_path) as modules:
        root = modules.Sofa.Core.Node("root")
        modules.scene.createScene(root)
        controller = root.objects[-1]
        front, left = (root.find("CableConstraint")[k] for k in (0, 1))
        root.time.value = 4.99
        controller.onAnimateBeginEvent({"dt": 0.01})
        assert front.value.value == [pytest.approx(0.01)]  # 5 s at 2 mm/s
        assert left.value.value == [0.0]
        controller.onKeypressedEvent({"key": "-"})
        controller.onAnimateBeginEvent({})
        assert front.value.value == [pytest.approx(0.01 - 0.02 / 50)]
        for key in "2++":
            controller.onKeypressedEvent({"key": key})
        controller.onAnimateBeginEvent({})
        assert front.value.value == [pytest.approx(0.01 - 0.02 / 50)]
        assert left.value.value == [pytest.approx(0.2 * 0.01)]  # 0.2 N as SOFA's impulse
        modules.Sofa.Simulation.initRoot(root)
        modules.Sofa.Simulation.animate(root, 0.01)
        controller.onKeypressedEvent({"key": "P"})
        assert "front: " in modules.Sofa.messages[-1]
        assert "plate at (" in modules.Sofa.messages[-1]
        root.time.value = 0.99  # as after a reset, and a second
        controller.onAnimateBeginEvent({})
        assert front.value.value == [pytest.approx(0.002)]
        assert left.value.value == [0.0]


@pytest.mark.slow
def test_foreign_bodies_are_identified_anew_and_say_so(tmp_path):
    robot = column_robot("P2P1", parameters=elastic(2e6, 0.47), divisions=(2, 2, 6))
    protocol = pulled(*np.linspace(0.0, 0.02, 9))
    write_sofa(robot, protocol, tmp_path, "robot")
    parameters = json.loads((tmp_path / "robot" / "parameters.json").read_text())
    body = parameters["bodies"]["neck"]
    assert body["poissons_ratio"] <= 0.45  # no nearer to 0.5, where linear tets lock
    assert body["youngs_modulus"] < 1.6e6
    assert parameters["re_identified"]["neck.youngs_modulus"] == {"twin": 2e6, "scene": body["youngs_modulus"]}
    scene_robot = linear_robot(replace(robot, bodies=(replace(robot.bodies[0], parameters=elastic(
        body["youngs_modulus"], body["poissons_ratio"])),))).robot  # fmt: skip
    theirs, ours = simulate(scene_robot, protocol), simulate(robot, protocol)
    left = parameters["differences_left"]["front.tension"]
    difference = np.abs(theirs.channels["front.tension"] - ours.channels["front.tension"]).max()
    assert left["largest_difference"] == pytest.approx(difference, rel=1e-3)
    assert difference < 0.02 * ours.channels["front.tension"].max()
    readme = (tmp_path / "README.md").read_text()
    found = f"{body['youngs_modulus'] / 1e6:.5g} MPa (twin: 2 MPa)"
    assert f"re-identified on this mesh and pull: neck.youngs_modulus {found}, neck.poissons_ratio" in readme
    assert "Largest remaining difference" in readme


@pytest.mark.parametrize("law", ["stable-neo-hooke", "stvenant-kirchhoff"])
def test_foreign_bodies_of_other_laws_are_identified_within_what_their_ratio_may_be(tmp_path, law):
    robot = column_robot("P2P1", parameters=elastic(2e6, 0.47), divisions=(1, 1, 4))
    robot = replace(robot, bodies=(replace(robot.bodies[0], law=law),))
    write_sofa(robot, pulled(*np.linspace(0.0, 0.01, 5)), tmp_path, "robot")
    parameters = json.loads((tmp_path / "robot" / "parameters.json").read_text())
    assert parameters["re_identified"]["neck.poissons_ratio"]["scene"] <= 0.49


def test_angles_that_are_zero_but_for_rounding_are_not_compared(tmp_path, monkeypatch):
    def symmetric(robot, protocol):
        found = simulate(robot, protocol)
        angles = {name for name, unit in found.units.items() if unit == "rad"}
        return replace(found, channels={n: x * (1e-16 if n in angles else 1.0) for n, x in found.channels.items()})

    monkeypatch.setattr("softcal.plugins.sofa.identify._simulated", symmetric)
    robot = column_robot("P2P1", parameters=elastic(2e6, 0.47), divisions=(1, 1, 4))
    write_sofa(robot, pulled(*np.linspace(0.0, 0.01, 5)), tmp_path, "robot")
    left = json.loads((tmp_path / "robot" / "parameters.json").read_text())["differences_left"]
    assert "front.tension" in left
    assert "plate.pitch" not in left


def test_own_bodies_keep_their_parameters(tmp_path):
    robot = column_robot("P1", parameters=elastic(2e6, 0.3))
    write_sofa(robot, pulled(0.01), tmp_path, "robot")
    parameters = json.loads((tmp_path / "robot" / "parameters.json").read_text())
    assert parameters["bodies"]["neck"]["youngs_modulus"] == 2e6
    assert parameters["re_identified"] == {}
    assert "re-identified" not in (tmp_path / "README.md").read_text()


def test_a_pull_that_moves_nothing_cannot_identify(tmp_path):
    with pytest.raises(ParameterError, match="--pull"):
        write_sofa(column_robot("P2P1"), Protocol({}), tmp_path, "robot")


def test_two_robots_are_put_into_one_scene_of_ones_own(tmp_path, monkeypatch):
    """Each from a package of its own name, twice if wanted; gravity, loop and constraint solver are the scene's."""
    use_fake(monkeypatch)
    other = column_robot(parameters=elastic(5e5, 0.3), cables=(side_cable("side", (0.0, 0.04)),))
    write_sofa(column_robot(), pulled(0.01), written_to(tmp_path / "one"), "Soft neck, 2")
    write_sofa(other, tensed(1.0, cable="side"), written_to(tmp_path / "two"), "arm")
    monkeypatch.syspath_prepend(str(tmp_path / "one"))
    monkeypatch.syspath_prepend(str(tmp_path / "two"))
    with scene_modules(tmp_path / "none", names=("Sofa",)) as modules:
        neck, arm = (importlib.import_module(name) for name in ("soft_neck_2", "arm"))
        root = modules.Sofa.Core.Node("root")
        left = neck.add_robot(root, "left")
        neck.add_robot(root, "right", seen=False)
        third = arm.add_robot(root)
        assert not root.objects
        assert [child.name for child in root.children] == ["left", "right", "robot"]
        for node in root.children:
            assert node.own("EulerImplicitSolver")
            assert node.own("GenericConstraintCorrection")
        moduli = [body["youngs_modulus"] for one in (left, third) for body in one.parameters["bodies"].values()]
        assert moduli == [2.3e6, 5e5]
        left.pull({"front": 0.002}, 0.01)
        third.pull({"side": 3.0}, 0.01)
        values = {cable.node.path: cable.value.value for cable in root.find("CableConstraint")}
        assert sorted(values.values()) == [[0.0], [0.002], [pytest.approx(0.03)]]
        assert next(path for path, value in values.items() if value == [0.002]).startswith("/left/")
        assert {node.path.split("/")[1] for node in root.all() if node.name == "visual"} == {"left", "robot"}
        files = [loader.filename.value for loader in root.find("MeshVTKLoader")]
        assert [Path(file).parent.name for file in files] == ["soft_neck_2", "soft_neck_2", "arm"]
        for name in [name for name in sys.modules if name.split(".")[0] in ("soft_neck_2", "arm")]:
            del sys.modules[name]


@pytest.mark.parametrize(
    ("name", "package"),
    [
        ("Soft neck, 2", "soft_neck_2"), ("arm", "arm"), ("3 springs", "robot_3_springs"), ("Größe", "groe"),
        ("scene", "robot_scene"), ("import", "robot_import"), ("日本", "robot_"), ("x" * 90, "x" * 40),
    ],
)  # fmt: skip
def test_a_robots_package_has_a_name_that_python_imports(name, package):
    assert package_name(name) == package
    assert package.isidentifier()


def test_the_readme_says_that_the_slack_is_taken_off(tmp_path):
    write_sofa(column_robot(), pulled(0.01), written_to(tmp_path / "a"), "robot", slack={"front": 0.002})
    write_sofa(column_robot(), pulled(0.01), written_to(tmp_path / "b"), "robot", slack={"front": 0.0})
    assert "the slack of the bench is subtracted, 2 mm of front, until a key" in (tmp_path / "a/README.md").read_text()
    assert "slack of the bench" not in (tmp_path / "b/README.md").read_text()


def written_to(folder: Path) -> Path:
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    ("law", "parameters", "material", "constants"),
    [
        ("stable-neo-hooke", elastic(2e6, 0.3), "StableNeoHookean", None),
        ("stvenant-kirchhoff", elastic(2e6, 0.3), "StVenantKirchhoff", None),
        ("sofa-mooney-rivlin", {"C10": 2e5, "C01": 3e4, "bulk_modulus": 5e6}, "MooneyRivlin", [2e5, 3e4, 5e6]),
        ("sofa-ogden", {"mu1": 4e5, "alpha1": 2.5, "bulk_modulus": 5e6}, "Ogden", [1e6, 2.5, 5e6]),
        ("sofa-arruda-boyce", {"chain_modulus": 4e5, "bulk_modulus": 5e6}, "ArrudaBoyce", [4e5, 5e6]),
    ],
)
def test_laws_that_sofa_has_are_exported_by_its_names(tmp_path, law, parameters, material, constants):
    robot = column_robot("P1")
    robot = replace(robot, bodies=(replace(robot.bodies[0], law=law, parameters=parameters),))
    write_sofa(robot, pulled(0.001), tmp_path, "robot")
    body = json.loads((tmp_path / "robot" / "parameters.json").read_text())["bodies"]["neck"]
    assert body["material"] == material
    assert body.get("constants") == (None if constants is None else pytest.approx(constants))
    if constants is None:
        assert (body["youngs_modulus"], body["poissons_ratio"]) == (2e6, 0.3)


def test_a_law_that_cannot_be_identified_anew_is_refused_with_what_sofa_has(tmp_path):
    own = {"C10": 2e5, "C01": 3e4, "bulk_modulus": 5e6}
    for law, element, text in (
        ("mooney-rivlin", "P1", "SOFA does not support this law"),
        ("sofa-mooney-rivlin", "P2P1", "SOFA has this law in linear tets only"),
    ):
        robot = column_robot(element)
        robot = replace(robot, bodies=(replace(robot.bodies[0], law=law, parameters=own),))
        with pytest.raises(ParameterError, match=text):
            write_sofa(robot, pulled(0.001), tmp_path / law, "robot")
        assert not (tmp_path / law).exists()
