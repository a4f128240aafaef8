"""
The calibrated robot as a scene of SOFA
=======================================

`write_export("sofa", …)` writes a scene in SOFA's own Python, with its mesh and its cables, that runs without
softcal. Bodies are P1 there, so the twin is best compared, or calibrated, with the same element.
"""

import ast
import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

folder, project = Path(tempfile.mkdtemp()) / "scene", softcal.load("../../examples/fleet/project.yaml")
written = softcal.write_export("sofa", softcal.ExportRequest(project), folder)
for path in sorted(written):
    print(f"{path.name:20s} {path.stat().st_size / 1024:7.1f} kB")

# %%
# The scene is a program, and its numbers are those of the project.
scene = folder / "scene.py"
functions = {node.name for node in ast.walk(ast.parse(scene.read_text())) if isinstance(node, ast.FunctionDef)}
assert "createScene" in functions
(numbers,) = (json.loads(path.read_text()) for path in written if path.name == "parameters.json")
assert numbers["bodies"]["neck"]["youngs_modulus"] == 2e6
assert numbers["bodies"]["neck"]["poissons_ratio"] == 0.43

# %%
# What the scene should show at rest: the twin at the end of the pull.
response = softcal.simulate(project, snapshots=True)
assert response.succeeded
pitch = np.degrees(response.channels["plate.pitch"][-1])
print(f"{response.channels['front.tension'][-1]:.2f} N, {pitch:.2f} deg at the end of the pull")
figure, (left, right) = plt.subplots(1, 2, figsize=(7.5, 3.8), layout="constrained")
project.robot.plot_shape(ax=left)
response.plot_shape(ax=right)
