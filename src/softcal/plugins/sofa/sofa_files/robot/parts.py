"""What bodies, rods, plates and cables of scene.py are made with."""

import Sofa
import Sofa.Core


def first_known(*names):
    """The first of several component names that this SOFA has."""
    known = {entry.className for entry in Sofa.Core.ObjectFactory.components}
    for name in names:
        if name in known:
            return name
    raise RuntimeError("This SOFA has none of the components " + ", ".join(names))


def add_fixed(node, indices):
    """Nodes that do not move."""
    if indices:
        # The second is the name up to v23.12, the first since v24.06.
        node.addObject(first_known("FixedProjectiveConstraint", "FixedConstraint"), indices=indices)


def put_together(node, parents, pairs, template="Vec3"):
    """Put the points or frames of a node together from those of others.

    Parameters
    ----------
    node
        The node, with its degrees of freedom.
    parents
        The other nodes.
    pairs
        (number of the parent, number of its point), of each point of the node.
    template
        Kind of the points, of SOFA.
    """
    node.addObject(
        "SubsetMultiMapping",
        template=template + "," + template,
        input=[parent.dofs.getLinkPath() for parent in parents],
        output=node.dofs.getLinkPath(),
        indexPairs=[number for pair in pairs for number in pair],
    )


def carried_points(parts, on, name, points, **shown):
    """A node with points that ride on a plate or in a body.

    Parameters
    ----------
    parts
        The robot's nodes by kind and name.
    on
        Name of the plate or body.
    name
        Name of the new node.
    points
        Positions (n, 3) [m].
    shown
        How SOFA draws the points.
    """
    if on in parts["plates"]:
        node = parts["plates"][on].addChild(name)
        node.addObject("MechanicalObject", name="dofs", template="Vec3", position=points, **shown)
        node.addObject("RigidMapping", globalToLocalCoords=True)
    else:
        node = parts["bodies"][on].addChild(name)
        node.addObject("MechanicalObject", name="dofs", template="Vec3", position=points, **shown)
        node.addObject("BarycentricMapping")
    return node
