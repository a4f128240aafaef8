"""What people see of the exported scene, in SOFA itself: surfaces move with their parts; without OpenGL it runs too."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import tensed
from scipy.spatial.transform import Rotation
from sofa_case import many_parts
from test_sofa_rods import hung

from softcal.geometry.surface import boundary_triangles
from softcal.plugins.sofa.install import find_sofa
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.visual import skins, split_at_edges
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.robot import Robot

pytestmark = pytest.mark.skipif("SOFA_ROOT" not in os.environ, reason="SOFA is not installed: SOFA_ROOT is not set")

STEPS = 200


def stepped(robot: Robot, cable: str, folder: Path, *, opengl: bool) -> dict:
    """What a scene's parts are after some steps of being pulled."""
    write_sofa(robot, tensed(0.5, cable=cable), folder, "seen")
    sofa = find_sofa()
    done = subprocess.run(
        [sofa.python, "-c", SCRIPT, str(STEPS), "1" if opengl else ""],
        cwd=folder, env=sofa.environment(), capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    # SOFA's own messages are on the same stream.
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("{"))
    found = json.loads(line)
    if opengl and not found["opengl"]:
        pytest.skip("this SOFA has no Sofa.GL")
    return found


def test_surfaces_move_with_bodies_and_plates(tmp_path):
    robot = replace(many_parts(), cables=many_parts().cables[:1])
    found = stepped(robot, "through", tmp_path, opengl=True)
    assert set(found["surfaces"]) == {"low", "high", "head"}
    linear = linear_robot(robot).robot
    for body in linear.bodies:
        source, _ = split_at_edges(body.mesh.points, boundary_triangles(body.mesh.tets))
        nodes = np.array(found["parts"][body.name])
        assert np.abs(nodes - body.mesh.points).max() > 1e-5
        np.testing.assert_allclose(found["surfaces"][body.name], nodes[source], rtol=0, atol=1e-9)
    frame = np.array(found["parts"]["head"][0])
    offsets = skins(linear_robot(robot))["head"].points - linear.plates[1].centre_of_mass
    there = frame[:3] + Rotation.from_quat(frame[3:]).apply(offsets)
    np.testing.assert_allclose(found["surfaces"]["head"], there, rtol=0, atol=1e-9)


def test_a_wires_surface_rides_on_its_frames(tmp_path):
    robot = hung()
    found = stepped(robot, "pull", tmp_path, opengl=True)
    wire = skins(linear_robot(robot))["wire"]
    frames = np.array(found["parts"]["wire"])[wire.nodes]
    parameters = json.loads((tmp_path / "robot" / "parameters.json").read_text())
    at_rest = np.array(parameters["rods"]["wire"]["nodes"])[wire.nodes]
    assert np.abs(frames[:, :3] - at_rest).max() > 1e-5
    there = frames[:, :3] + Rotation.from_quat(frames[:, 3:]).apply(wire.points - at_rest)
    np.testing.assert_allclose(found["surfaces"]["wire"], there, rtol=0, atol=1e-9)


WITH_CABLES = [(replace(many_parts(), cables=many_parts().cables[:1]), "through"), (hung(), "pull")]


@pytest.mark.parametrize(("robot", "cable"), WITH_CABLES)
def test_without_opengl_the_scene_runs(tmp_path, robot, cable):
    found = stepped(robot, cable, tmp_path, opengl=False)
    assert found["surfaces"] == {}
    assert found["visual_style"]
    assert all(np.isfinite(positions).all() for positions in found["parts"].values())


@pytest.mark.parametrize(("robot", "cable"), WITH_CABLES)
def test_surfaces_change_nothing_in_the_motion(tmp_path, robot, cable):
    folders = tmp_path / "without", tmp_path / "with"
    for folder in folders:
        folder.mkdir()
    bare, shown = (stepped(robot, cable, folder, opengl=folder.name == "with") for folder in folders)
    for name, positions in bare["parts"].items():
        np.testing.assert_allclose(shown["parts"][name], positions, rtol=0, atol=1e-12, err_msg=name)


SCRIPT = """
import json, sys
import Sofa, Sofa.Core, Sofa.Simulation, SofaRuntime
steps, opengl = int(sys.argv[1]), bool(sys.argv[2])
known = opengl and SofaRuntime.importPlugin("Sofa.GL.Component.Rendering3D")
if not opengl:
    SofaRuntime.importPlugin = lambda name: False
from scene import createScene

root = Sofa.Core.Node("root")
createScene(root)
getattr(Sofa.Simulation, "initRoot", Sofa.Simulation.init)(root)
for _ in range(steps):
    Sofa.Simulation.animate(root, root.dt.value)
parts = root.pulling.parts
there = {**parts["bodies"], **parts["rods"], **parts["plates"]}
shown = {n: node for n, node in there.items() if any(child.name.value == "visual" for child in node.children)}
print(json.dumps({
    "opengl": known,
    "surfaces": {name: node.visual.surface.position.value.tolist() for name, node in shown.items()},
    "parts": {name: node.dofs.position.value.tolist() for name, node in there.items()},
    "visual_style": any(one.getClassName() == "VisualStyle" for one in root.objects),
}))
"""
