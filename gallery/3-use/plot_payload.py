"""
A circle under an unknown payload
=================================

The tip of a manipulator with six cables is to follow a circle, and carries a mass that the controller does not know.
A :doc:`reduced model </exports>` with the payload as an input gives the tensions, and an extended
Kalman filter on the same model takes the payload from markers, measured with noise of 0.2 mm. The robot is the exact
twin, with 60 g more than its model.
"""

import importlib.util
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

project = softcal.load("../../examples/manipulator/project.yaml")
robot = project.robot
own = softcal.robot_parameters(robot)["S4.mass"].value
cables = ["cable4", "cable5", "cable6"]  # those that end at the last disc
reach = ",".join(f"{name}=8N" for name in cables) + f",S4.mass={own}kg..{own + 0.15}kg"
folder = Path(tempfile.mkdtemp()) / "reduced"
softcal.write_export("reduced", softcal.ExportRequest(project), folder, reach=reach, samples=120)

# %%
# From here on as on the robot's computer: NumPy and the file alone.
spec = importlib.util.spec_from_file_location("reduced_model", folder / "reduced_model.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
model = module.ReducedModel(folder / "model.json")
error = model.error["S4.position"]
print(f"95 % of the model's errors at the tip are below {1e6 * error['p95']:.0f} um")
payload = module.KalmanFilter(model, {"S4.mass": own}, {"S4.mass": 0.05})

# %%
# The loop: command at the present estimate, measure, update.
truth, noise, random = own + 0.06, dict.fromkeys(("S4.x", "S4.y", "S4.z"), 2e-4), np.random.default_rng(1)
plant = softcal.LiveTwin(softcal.with_parameters(robot, {"S4.mass": truth}), "tension")
commands, tips, wanted, masses = {}, [], [], []
for turn in np.linspace(0.0, 4.0 * np.pi, 81):
    goal = {"S4.x": 0.05 * np.cos(turn), "S4.y": 0.05 * np.sin(turn)}
    estimate = {"S4.mass": float(payload.mean[0])}
    commands = model.inverse(goal, start=commands, inputs=estimate)["commands"]
    state = plant.at(commands)
    assert state.succeeded, state.status
    measured = {name: state.channels[name] + random.normal(0.0, sigma) for name, sigma in noise.items()}
    payload.update(commands, measured, noise)
    tips.append([state.channels["S4.x"], state.channels["S4.y"]])
    wanted.append(list(goal.values()))
    masses.append((payload.mean[0], np.sqrt(payload.covariance[0, 0])))

off = 1e3 * np.linalg.norm(np.subtract(tips, wanted), axis=1)
mean, deviation = masses[-1]
print(f"the tip is {off[0]:.2f} mm off at first, {off[-1]:.3f} mm at the end")
print(f"payload {1e3 * (mean - own):.2f} g (95 %: +- {1.96e3 * deviation:.2f} g), where 60 g hang")
assert abs(mean - truth) < 3.0 * deviation < 0.003
assert off[0] > 10.0 * off[-20:].max()

figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
left.plot(*1e3 * np.transpose(wanted), color="0.7", lw=4, label="wanted")
left.plot(*1e3 * np.transpose(tips), color="C3", lw=1, label="tip of the twin")
left.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
left.legend(loc="center")
grams, band = 1e3 * (np.array(masses)[:, 0] - own), 1.96e3 * np.array(masses)[:, 1]
right.fill_between(range(81), grams - band, grams + band, alpha=0.3)
right.plot(grams, label="estimate, 95 %")
right.axhline(60.0, color="k", ls="--", lw=1, label="truth")
right.set(xlabel="step", ylabel="payload [g]", ylim=(0, 80))
right.legend()
