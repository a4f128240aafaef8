"""What people see: shaded surfaces, cables as lines, markers as balls. `createScene` adds it, `run.py` does without."""

import os

import Sofa
import SofaRuntime

from .parts import carried_points

HERE = os.path.dirname(os.path.abspath(__file__))
OPENGL = "Sofa.GL.Component.Rendering3D"
# Force fields would draw every tet; a cable is an interaction, whatever it is called elsewhere.
FLAGS = "showVisualModels hideBehaviorModels hideForceFields showInteractionForceFields"
COLOURS = {"bodies": [0.95, 0.55, 0.25], "rods": [0.95, 0.55, 0.25], "plates": [0.65, 0.7, 0.78]}
CABLE, MARKER = [0.05, 0.2, 0.45, 1.0], [0.1, 0.55, 0.25, 1.0]


def add_view(root, parameters):
    """Add the display flags and the camera, of which a scene has one each."""
    root.addObject("RequiredPlugin", name="visual_plugins", pluginName=["Sofa.Component.Visual"])
    root.addObject("VisualStyle", displayFlags=FLAGS)
    root.addObject("InteractiveCamera", name="camera", **parameters["visual"]["camera"])


def add_surfaces(robot, parameters, parts):
    """Show the cables, markers, plates and surfaces of the robot; without OpenGL no surfaces.

    Parameters
    ----------
    robot
        The robot's node.
    parameters
        Content of parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    shown = parameters["visual"]
    for node in parts["cables"].values():
        node.cable.color.value = CABLE
        node.cable.drawPoints.value = False
        node.cable.drawPullPoint.value = False
    for name, marker in parameters["markers"].items():
        if marker["on"]:
            ball = {"showObject": True, "drawMode": 1, "showObjectScale": shown["marker_radius"], "showColor": MARKER}
            carried_points(parts, marker["on"], name, [marker["at"]], **ball)
    for name, node in parts["plates"].items():
        if name not in shown["surfaces"]:
            node.dofs.showObject.value = True
            node.dofs.showObjectScale.value = 5.0 * shown["marker_radius"]
    if not SofaRuntime.importPlugin(OPENGL):
        Sofa.msg_warning(robot, "This SOFA has no " + OPENGL + ", so there are no surfaces to see.")
        return
    robot.addObject("RequiredPlugin", name="opengl", pluginName=[OPENGL])
    for name, surface in shown["surfaces"].items():
        add_surface(robot, name, surface, parts)


def add_surface(robot, name, surface, parts):
    """The surface of a part, which moves with it, or of a plate that stands still.

    Parameters
    ----------
    robot, name
        The robot's node, and the name of the body, rod or plate.
    surface
        Its entry in parameters.json.
    parts
        The robot's nodes by kind and name.
    """
    kind = next((kind for kind in COLOURS if name in parts[kind]), "plates")
    node = (parts[kind].get(name) or robot.addChild(name)).addChild("visual")
    node.addObject("MeshOBJLoader", name="loader", filename=os.path.join(HERE, surface["file"]))
    look = material(COLOURS[kind], surface["opacity"])
    node.addObject("OglModel", name="surface", src="@loader", material=look)
    if kind == "bodies":
        node.addObject("BarycentricMapping")
    elif kind == "rods":
        node.addObject("RigidMapping", globalToLocalCoords=True, rigidIndexPerPoint=surface["nodes"])
    elif name in parts["plates"]:
        node.addObject("RigidMapping", globalToLocalCoords=True)


def material(colour, opacity):
    """A colour as SOFA writes it: with `color` alone, what runSofa's light does not reach is nearly black."""
    lit, unlit = ([share * value for value in colour] for share in (0.8, 0.55))
    words = ["softcal", "Diffuse", 1, *lit, opacity, "Ambient", 1, *unlit, 1.0, "Specular", 0, 1, 1, 1, 1]
    words += ["Emissive", 0, 0, 0, 0, 0, "Shininess", 0, 45]
    return " ".join(str(word) for word in words)
