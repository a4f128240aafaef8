"""
A reduced model for a controller
================================

`write_export("reduced", …)` solves the twin on a grid of tensions, with its derivatives, and writes a file of numbers
and an evaluator of fifty lines that needs nothing but Python. Its error is measured at random places and stated in
the file.
"""

import importlib.util
import json
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

folder, project = Path(tempfile.mkdtemp()) / "reduced", softcal.load("../strip/project.yaml")
written = softcal.write_export("reduced", softcal.ExportRequest(project), folder, reach="0.15N", samples=9)
print(*sorted(path.name for path in written))

# %%
# As a controller would: the evaluator alone, without softcal.
spec = importlib.util.spec_from_file_location("reduced_model", folder / "reduced_model.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
model = module.ReducedModel(folder / "model.json")

tensions = np.linspace(0.0, 0.15, 31)
states = [model.state({"front": force}) for force in tensions]
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
assert abs(states[5]["compliance"][row][0] / compliance - 1) < 0.01

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
left.plot(tensions, 1e3 * twin["tip.z"], lw=4, color="0.75", label="twin")
left.plot(tensions, 1e3 * height, color="C3", label="reduced model")
left.set(xlabel="tension [N]", ylabel="height of the tip [mm]")
left.legend()
right.plot(tensions, 1e6 * (height - twin["tip.z"]), color="C3")
right.set(xlabel="tension [N]", ylabel="difference [um]")
