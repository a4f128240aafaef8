"""
A reduced model for a controller
================================

`write_export("reduced", …)` solves the twin at samples of its inputs, with its derivatives, and writes a file of
numbers and evaluators in Python and C that need no softcal, with an inverse: from a wanted height to the tension. The
error is measured at random states and stated in the file.
"""

import importlib.util
import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

folder, project = Path(tempfile.mkdtemp()) / "reduced", softcal.load("../strip/project.yaml")
written = softcal.write_export("reduced", softcal.ExportRequest(project), folder, reach="0.15N")
print(*sorted(path.name for path in written))

# %%
# As a controller would: the evaluator alone, without softcal.
spec = importlib.util.spec_from_file_location("reduced_model", folder / "reduced_model.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
model = module.ReducedModel(folder / "model.json")

tensions = np.linspace(0.0, 0.15, 31)
states = [model.state({"front": float(force)}) for force in tensions]
height = np.array([state["plates"]["tip"]["position"][2] for state in states])
twin = softcal.simulate(project.robot, softcal.Protocol({"front": softcal.Command("tension", tensions)})).channels
off = np.abs(height - twin["tip.z"]).max()
stated = json.loads((folder / "model.json").read_text())["error"]["tip.position"]
print(
    f"largest difference of the height {1e6 * off:.1f} um; of a place, as the file states: {1e6 * stated['max']:.1f} um"
)
assert off < 1.5 * stated["max"] < 0.2e-3
compliance = np.gradient(twin["front.shortening"], tensions)[5]
row = model.rows.index("front.shortening")
assert abs(states[5]["jacobian"][row][0] / compliance - 1) < 0.01

# %%
# The other way: the tension that brings the tip to a height.
wanted = float(twin["tip.z"][20])
found = model.inverse({"tip.z": wanted})
print(f"{found['commands']['front']:.4f} N, where the twin needs {tensions[20]:.4f} N")
assert abs(found["commands"]["front"] - tensions[20]) < 1e-3

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
left.plot(tensions, 1e3 * twin["tip.z"], lw=4, color="0.75", label="twin")
left.plot(tensions, 1e3 * height, color="C3", label="reduced model")
left.set(xlabel="tension [N]", ylabel="height of the tip [mm]")
left.legend()
right.plot(tensions, 1e6 * (height - twin["tip.z"]), color="C3")
right.set(xlabel="tension [N]", ylabel="difference [um]")
