"""The robot that parameters.json describes, in SOFA. Units: m, kg, s, N, Pa.

SOFA v23.12 to v26.06 with SoftRobots; components that changed their names are chosen when the robot is made. Young's
moduli, densities, loads and damping are read from parameters.json every time: change them there.
"""

import json
import os

from .parts import add_fixed, carried_points, put_together
from .robot_state import pull, read_state
from .rods import add_rod

HERE = os.path.dirname(os.path.abspath(__file__))
PLUGINS = [
    "SoftRobots",
    "Sofa.Component.Constraint.Lagrangian.Correction",
    "Sofa.Component.Constraint.Projective",
    "Sofa.Component.IO.Mesh",
    "Sofa.Component.LinearSolver.Direct",
    "Sofa.Component.Mapping.Linear",
    "Sofa.Component.Mapping.NonLinear",
    "Sofa.Component.Mass",
    "Sofa.Component.MechanicalLoad",
    "Sofa.Component.ODESolver.Backward",
    "Sofa.Component.SolidMechanics.FEM.Elastic",
    "Sofa.Component.SolidMechanics.FEM.HyperElastic",
    "Sofa.Component.StateContainer",
    "Sofa.Component.Topology.Container.Dynamic",
]


class Placed:
    """A robot in a scene.

    node: the robot's node; parameters: content of parameters.json; parts: the nodes of its "bodies", "rods", "plates",
    "cables" and "chambers", by name.
    """

    def __init__(self, node, parameters, parts):
        self.node, self.parameters, self.parts = node, parameters, parts

    def pull(self, values, dt):
        """Command shortenings [m] or tensions [N] of cables and pressures [Pa] of chambers, by name; dt: time step of
        the scene [s].
        """
        pull(self.parts, self.parameters, values, dt)

    def state(self, dt):
        """Tension [N] and shortening [m] of the cables, pressure [Pa] and volume [m^3] of the chambers, poses of the
        plates, positions of the markers [m].
        """
        return read_state(self.parts, self.parameters, dt)


def add_robot(parent, name="robot", seen=True, parameters=None):
    """The robot below a node of any scene.

    The scene above it has the gravity, the time step, a FreeMotionAnimationLoop and a constraint solver; the robot
    brings its own time integration and linear solver.

    Parameters
    ----------
    parent
        The node of the scene.
    name
        Name of the robot's node, a child of `parent`.
    seen
        Add surfaces and markers to look at.
    parameters
        By default the content of parameters.json.
    """
    parameters = parameters or read_parameters()
    robot = parent.addChild(name)
    robot.addObject("RequiredPlugin", name="plugins", pluginName=PLUGINS)
    placed = Placed(robot, parameters, build(robot, parameters))
    if seen:
        from .visuals import add_surfaces

        add_surfaces(robot, parameters, placed.parts)
    return placed


def read_parameters():
    with open(os.path.join(HERE, "parameters.json"), encoding="utf-8") as file:
        return json.load(file)


def build(robot, parameters):
    """Everything below the robot's node; the nodes of its bodies, rods, plates, cables and chambers by name."""
    time = parameters["time"]
    robot.addObject(
        "EulerImplicitSolver", rayleighStiffness=time["rayleigh_stiffness"], rayleighMass=time["rayleigh_mass"]
    )
    # Rigid frames have six unknowns, so the matrix is one of numbers, not of 3 x 3 blocks.
    robot.addObject("SparseLDLSolver", template="CompressedRowSparseMatrixd")
    robot.addObject("GenericConstraintCorrection")

    parts = {"bodies": {}, "rods": {}, "plates": {}, "cables": {}, "chambers": {}}
    for name, plate in parameters["plates"].items():
        if not plate["fixed"]:
            parts["plates"][name] = add_plate(robot, name, plate)
    for name in bodies_in_order(parameters):
        parts["bodies"][name] = add_body(robot, name, parameters, parts)
    for name, rod in parameters["rods"].items():
        parts["rods"][name] = add_rod(robot, name, rod, parts)
    for name, load in parameters["loads"].items():
        add_load(name, load, parts)
    for name, cable in parameters["cables"].items():
        parts["cables"][name] = add_cable(robot, name, cable, parts)
    for name, chamber in parameters["chambers"].items():
        parts["chambers"][name] = add_chamber(name, chamber, parts)
    return parts


def add_plate(robot, name, plate):
    """A rigid frame at the plate's centre of mass.

    Parameters
    ----------
    robot, name
        The robot's node, and the name of the plate's.
    plate
        Its entry in parameters.json.
    """
    node = robot.addChild(name)
    node.addObject(
        "MechanicalObject",
        name="dofs",
        template="Rigid3",
        position=[plate["centre_of_mass"] + [0.0, 0.0, 0.0, 1.0]],
    )
    if plate["mass"] > 0.0:
        inertia = [value for row in plate["inertia_per_mass"] for value in row]
        node.addObject("UniformMass", vertexMass=[plate["mass"], 1.0] + inertia)
    return node


def bodies_in_order(parameters):
    """Every body after those that it is tied to."""
    left, done = list(parameters["bodies"]), []
    while left:
        ready = [n for n in left if all(tie["on"] in done for tie in ties_of(parameters, n).values())]
        if not ready:
            raise ValueError("These bodies are tied in a circle: " + ", ".join(left))
        done += ready
        left = [n for n in left if n not in ready]
    return done


def ties_of(parameters, body):
    return {name: tie for name, tie in parameters["ties"].items() if tie["body"] == body}


def add_body(robot, name, parameters, parts):
    """A deformable body of linear tetrahedra; nodes on plates and other bodies follow them, the rest is free.

    Parameters
    ----------
    robot, name
        The robot's node, and the body's name.
    parameters
        Content of parameters.json.
    parts
        The robot's nodes by kind and name, those of plates and of the bodies that it is tied to.
    """
    body = parameters["bodies"][name]
    mesh = os.path.join(HERE, body["mesh"])
    points = read_points(mesh)
    held = {p: plate["nodes"][name] for p, plate in parameters["plates"].items() if name in plate["nodes"]}
    tied = ties_of(parameters, name)
    if not held and not tied:
        node = robot.addChild(name)
        add_solid(node, mesh, body)
        add_fixed(node, body["fixed"])
        return node

    # Rigidification: the mesh's nodes are those of a free part, of plates and of other bodies, put together.
    carried = {**held, **{t: tie["nodes"] for t, tie in tied.items()}}
    elsewhere = {n for nodes in carried.values() for n in nodes}
    free = [n for n in range(len(points)) if n not in elsewhere]
    free_node = robot.addChild(name + "_free")
    free_node.addObject("MechanicalObject", name="dofs", template="Vec3", position=[points[n] for n in free])
    place = {n: k for k, n in enumerate(free)}
    add_fixed(free_node, [place[n] for n in body["fixed"]])
    parents = [(free_node, free)]
    for carrier, nodes in carried.items():
        on = tied[carrier]["on"] if carrier in tied else carrier
        parents.append((carried_points(parts, on, name + "_on_" + carrier, [points[n] for n in nodes]), nodes))
    node = free_node.addChild(name)
    for parent, _ in parents[1:]:
        parent.addChild(node)
    add_solid(node, mesh, body)
    pairs = {n: (p, k) for p, (_, nodes) in enumerate(parents) for k, n in enumerate(nodes)}
    put_together(node, [parent for parent, _ in parents], [pairs[n] for n in range(len(points))])
    return node


def add_solid(node, mesh, body):
    """Mesh, mass and law of a body.

    Parameters
    ----------
    node
        The body's node.
    mesh
        Path of its mesh.
    body
        Its entry in parameters.json.
    """
    constants = body.get("constants")
    if constants is None:
        E, nu = body["youngs_modulus"], body["poissons_ratio"]
        # SOFA's second parameter is Lame's lambda, whatever it is called elsewhere.
        constants = [E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))]
    node.addObject("MeshVTKLoader", name="loader", filename=mesh)
    node.addObject("TetrahedronSetTopologyContainer", name="topology", src="@loader")
    node.addObject("TetrahedronSetGeometryAlgorithms", template="Vec3")
    node.addObject("MechanicalObject", name="dofs", template="Vec3", position="@loader.position")
    node.addObject("MeshMatrixMass", massDensity=body["density"], lumping=False, topology="@topology")
    node.addObject(
        "TetrahedronHyperelasticityFEMForceField",
        name="law",
        template="Vec3",
        materialName=body["material"],
        ParameterSet=constants,
        topology="@topology",
    )


def add_load(name, load, parts):
    """A dead force at a point, or dead forces on nodes of a body.

    Parameters
    ----------
    name, load
        The load's name, and its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    if "at" in load:
        node = carried_points(parts, load["on"], name, [load["at"]])
        node.addObject("ConstantForceField", indices=[0], forces=[load["force"]])
    else:
        node = parts["rods"].get(load["on"]) or parts["bodies"][load["on"]]
        node.addObject("ConstantForceField", name=name, indices=load["nodes"], forces=load["forces"])


def add_cable(robot, name, cable, parts):
    """A cable through its points, from the pull point on, or from the first point where none is fixed in space.

    It is pulled by a displacement [m], and never pushes, or by a force, which SOFA takes as an impulse [N s].

    Parameters
    ----------
    robot, name
        The robot's node, and the cable's name.
    cable
        Its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    points, pull_point = cable["points"], cable["pull_point"]
    by_carrier = {}
    for k, point in enumerate(points):
        by_carrier.setdefault(point["on"], []).append(k)
    nodes = []
    for on, numbers in by_carrier.items():
        own = name if len(by_carrier) == 1 else name + "_on_" + (on or "ground")
        positions = [points[k]["at"] for k in numbers]
        nodes.append(carried_points(parts, on, own, positions) if on else ground_points(robot, own, positions))
    node = nodes[0]
    if len(nodes) > 1:
        node = nodes[0].addChild(name)
        for parent in nodes[1:]:
            parent.addChild(node)
        node.addObject("MechanicalObject", name="dofs", template="Vec3", position=[point["at"] for point in points])
        pairs = {k: (p, i) for p, numbers in enumerate(by_carrier.values()) for i, k in enumerate(numbers)}
        put_together(node, nodes, [pairs[k] for k in range(len(points))])
    where = {"hasPullPoint": False} if pull_point is None else {"hasPullPoint": True, "pullPoint": pull_point}
    limit = {} if cable["control"] == "tension" else {"minForce": 0.0}
    node.addObject(
        "CableConstraint",
        name="cable",
        indices=list(range(len(points))),
        cableInitialLength=cable["length"],
        valueType="force" if cable["control"] == "tension" else "displacement",
        value=[0.0],
        **where,
        **limit,
    )
    return node


def add_chamber(name, chamber, parts):
    """The closed surface of a chamber, whose triangles' normals point out of it, on nodes of bodies.

    Its pressure is an impulse in SOFA [Pa s].

    Parameters
    ----------
    name, chamber
        The chamber's name, and its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    bodies = list(dict.fromkeys(chamber["bodies"]))
    parents = [parts["bodies"][body] for body in bodies]
    node = parents[0].addChild(name)
    for parent in parents[1:]:
        parent.addChild(node)
    node.addObject("MechanicalObject", name="dofs", template="Vec3", position=chamber["positions"])
    put_together(node, parents, [(bodies.index(b), n) for b, n in zip(chamber["bodies"], chamber["nodes"])])
    node.addObject(
        "SurfacePressureConstraint",
        name="chamber",
        triangles=chamber["triangles"],
        valueType="pressure",
        value=[0.0],
    )
    return node


def ground_points(robot, name, points):
    """Points fixed in space.

    Parameters
    ----------
    robot, name
        The robot's node, and the name of that of the points.
    points
        Positions (n, 3) [m].
    """
    node = robot.addChild(name)
    node.addObject("MechanicalObject", name="dofs", template="Vec3", position=points)
    add_fixed(node, list(range(len(points))))
    return node


def read_points(path):
    """The points of a legacy .vtk file of text."""
    with open(path, encoding="utf-8") as file:
        words = file.read().split()
    start = words.index("POINTS")
    values = [float(word) for word in words[start + 3 : start + 3 + 3 * int(words[start + 1])]]
    return [values[i : i + 3] for i in range(0, len(values), 3)]
