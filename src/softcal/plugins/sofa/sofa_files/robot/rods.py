"""Rods: a frame at every node, and beams between neighbours with the stiffness that parameters.json says."""

import numpy as np
import Sofa
import Sofa.Core

from .parts import add_fixed, put_together
from .robot_state import turned

UNTURNED = [0.0, 0.0, 0.0, 1.0]


def add_rod(robot, name, rod, parts):
    """A rod whose nodes on plates follow them, whose fixed ones stay, and whose others are free.

    Parameters
    ----------
    robot, name
        The robot's node, and the rod's name.
    rod
        Its entry in parameters.json.
    parts
        The robot's nodes by kind and name, those of plates.
    """
    nodes = rod["nodes"]
    if not rod["plates"]:
        node = robot.addChild(name)
        node.addObject("MechanicalObject", name="dofs", template="Rigid3", position=frames(nodes))
        add_fixed(node, rod["fixed"])
    else:
        on_plates = {k for numbers in rod["plates"].values() for k in numbers}
        free = [k for k in range(len(nodes)) if k not in on_plates]
        free_node = robot.addChild(name + "_free")
        free_node.addObject(
            "MechanicalObject", name="dofs", template="Rigid3", position=frames([nodes[k] for k in free])
        )
        place = {k: i for i, k in enumerate(free)}
        add_fixed(free_node, [place[k] for k in rod["fixed"]])
        parents = [(free_node, free)]
        for plate, numbers in rod["plates"].items():
            riders = parts["plates"][plate].addChild(name + "_on_" + plate)
            riders.addObject(
                "MechanicalObject", name="dofs", template="Rigid3", position=frames([nodes[k] for k in numbers])
            )
            riders.addObject("RigidMapping", template="Rigid3,Rigid3", globalToLocalCoords=True)
            parents.append((riders, numbers))
        node = free_node.addChild(name)
        for parent, _ in parents[1:]:
            parent.addChild(node)
        node.addObject("MechanicalObject", name="dofs", template="Rigid3", position=frames(nodes))
        pairs = {k: (p, i) for p, (_, numbers) in enumerate(parents) for i, k in enumerate(numbers)}
        put_together(node, [parent for parent, _ in parents], [pairs[k] for k in range(len(nodes))], "Rigid3")
    add_beams(node, name, rod)
    for number, group in enumerate(rod["masses"]):
        add_mass(node, name + "_mass" + str(number), nodes, group)
    return node


def frames(points):
    return [point + UNTURNED for point in points]


def add_beams(node, name, rod):
    """Every element twice, from either end, with half its stiffness.

    Parameters
    ----------
    node, name
        The rod's node and name.
    rod
        Its entry in parameters.json.
    """
    n = len(rod["nodes"]) - 1
    edges = [edge for k in range(n) for edge in ([k, k + 1], [k + 1, k])]
    node.addObject("EdgeSetTopologyContainer", name="topology", edges=edges)
    # What it would make of these itself is replaced by `Stiffness`.
    node.addObject(
        "BeamFEMForceField",
        name="beams",
        topology="@topology",
        radius=rod["radius"],
        youngModulus=0.5 * rod["youngs_modulus"],
        poissonRatio=rod["poissons_ratio"],
    )
    node.addObject(Stiffness(node.beams, name, rod, name="stiffness"))


def add_mass(node, name, nodes, group):
    """Add the mass of some of the rod's nodes, in a child node: a UniformMass has one mass for all of its points.

    Parameters
    ----------
    node, name
        The rod's node, and the name of the child node.
    nodes
        All points (n, 3) [m] of the rod.
    group
        Numbers of the points that have the mass, the mass [kg] of each, and its inertia per mass [m^2].
    """
    some = node.addChild(name)
    some.addObject(
        "MechanicalObject", name="dofs", template="Rigid3", position=frames([nodes[k] for k in group["nodes"]])
    )
    some.addObject("SubsetMapping", template="Rigid3,Rigid3", indices=group["nodes"])
    inertia = (group["inertia_per_mass"] * np.eye(3)).ravel().tolist()
    some.addObject("UniformMass", vertexMass=[group["mass"], 1.0] + inertia)


class Stiffness(Sofa.Core.Controller):
    """Gives the beams their stiffness once SOFA has made them."""

    def __init__(self, beams, rod_name, rod, **kwargs):
        Sofa.Core.Controller.__init__(self, **kwargs)
        self.beams, self.rod_name, self.rod = beams, rod_name, rod

    def init(self):
        self.beams.beamsData.read(beams_data(self.rod))
        require_stiffness(self.beams, self.rod_name, self.rod)


def require_stiffness(beams, name, rod):
    """Check that the beams have taken their stiffness. What `init` above raises SOFA only reports.

    Parameters
    ----------
    beams
        SOFA's force field.
    name, rod
        The rod's name, and its entry in parameters.json.
    """
    there, wanted = (np.array(numbers(text)) for text in (beams.beamsData.getValueString(), beams_data(rod)))
    # SOFA writes six digits.
    if there.shape != wanted.shape or abs(there - wanted).max() > 1e-5 * abs(wanted).max():
        raise RuntimeError("This SOFA does not take the stiffness of beams: " + name)


def numbers(text):
    return [float(word) for word in text.replace("[", " ").replace("]", " ").replace(",", " ").split()]


def beams_data(rod):
    """The beams' `beamsData` as SOFA writes it: of each its modulus (twice), Poisson's ratio, length, radii, shear
    modulus, second moments, torsion constant, area and shear areas, none of which count any more, and the stiffness.
    """
    E, nu, r = rod["youngs_modulus"], rod["poissons_ratio"], rod["radius"]
    words = []
    for k, matrix in enumerate(stiffnesses(rod)):
        length = float(np.linalg.norm(np.subtract(rod["nodes"][k + 1], rod["nodes"][k])))
        second = 0.25 * np.pi * r**4
        head = [E, E, nu, length, r, 0.0, 0.5 * E / (1.0 + nu), second, second, 2.0 * second, np.pi * r**2, 0.0, 0.0]
        for seen_from in (slice(0, 6), slice(6, 12)):
            order = np.r_[seen_from, 6 - seen_from.start : 12 - seen_from.start]
            words += [repr(float(value)) for value in head]
            rows = [" ".join(repr(float(v)) for v in row) for row in 0.5 * matrix[np.ix_(order, order)]]
            words.append("[" + ",".join(rows) + "]")
    return " ".join(words)


def stiffnesses(rod):
    """Of every element (12, 12): forces and moments at both ends by their displacements and rotations, at rest."""
    E, nu = rod["youngs_modulus"], rod["poissons_ratio"]
    of_kinds = [
        E * np.linalg.inv(np.array(one["by_bending"]) + (1.0 + nu) * np.array(one["by_shear"]))
        for one in rod["flexibilities"]
    ]
    found = []
    for k, (kind, axes) in enumerate(zip(rod["kinds"], rod["axes"])):
        turn = np.kron(np.eye(2), np.transpose([turned(np.array(axes), e) for e in np.eye(3)]))
        later = turn @ of_kinds[kind] @ turn.T
        x, y, z = np.subtract(rod["nodes"][k + 1], rod["nodes"][k])
        carried = np.eye(6)  # what the later end does where the earlier one moves and nothing strains
        carried[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
        ends = np.hstack([-carried, np.eye(6)])
        found.append(ends.T @ later @ ends)
    return found
