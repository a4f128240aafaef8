"""The robot in a scene of its own: `runSofa -l SofaPython3 scene.py`. Units: m, kg, s, N, Pa."""

import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
if HERE not in sys.path:
    sys.path.insert(0, HERE)

from ROBOT_PACKAGE import add_robot, read_parameters
from ROBOT_PACKAGE.parts import first_known
from ROBOT_PACKAGE.pulling import Pulling

PLUGINS = ["Sofa.Component.AnimationLoop", "Sofa.Component.Constraint.Lagrangian.Solver"]


def createScene(root, seen=True):
    """What runSofa calls; seen: with what there is to see."""
    parameters = read_parameters()
    placed = build(root, parameters, seen)
    if seen:
        from ROBOT_PACKAGE.visuals import add_view

        add_view(root, parameters)
    root.addObject(Pulling(root, parameters, placed.parts, name="pulling"))
    return root


def build(root, parameters, seen=False):
    """Gravity, time step, loop and constraint solver at the root, and the robot below it.

    Parameters
    ----------
    root
        The scene's node.
    parameters
        Content of parameters.json.
    seen
        Add surfaces and markers to look at.
    """
    root.gravity = parameters["gravity"]
    root.dt = parameters["time"]["dt"]
    root.addObject("RequiredPlugin", name="plugins", pluginName=PLUGINS)
    root.addObject("FreeMotionAnimationLoop")
    # The second is the name up to v25.06, the first since v25.12.
    kind = first_known("BlockGaussSeidelConstraintSolver", "GenericConstraintSolver")
    solver = parameters["constraint_solver"]
    root.addObject(kind, maxIterations=solver["iterations"], tolerance=solver["tolerance"])
    return add_robot(root, "robot", seen, parameters)
