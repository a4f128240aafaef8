"""
A figure of eight, with its band
================================

A printed neck with three cables, whose modulus comes from one noisy pull. Its
:doc:`reduced model </exports>` gives the tensions that lead the plate through a figure of eight of
pitch and roll, and the 95 % band that the calibration leaves of every pose. The robot is the exact twin with the true
modulus: it stays inside the band, which says how well the pose is held without a sensor.
"""

import importlib.util
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

folder, truth = Path(tempfile.mkdtemp()), 2.3e6
run = softcal.calibrate("../three-cables/project.yaml", out=folder / "run")
found = run.headline.parameters["neck.youngs_modulus"]
low, high = found.interval
print(f"E = {1e-6 * found.value:.2f} MPa (95 %: {1e-6 * low:.2f} to {1e-6 * high:.2f}), truth {1e-6 * truth} MPa")

# %%
# From the bench to the controller: the reduced model of the run.
calibrated = softcal.load_calibrated(folder / "run")
request = softcal.ExportRequest(calibrated, run=folder / "run")
softcal.write_export("reduced", request, folder / "reduced", reach="4N", samples=120)
spec = importlib.util.spec_from_file_location("reduced_model", folder / "reduced" / "reduced_model.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
model = module.ReducedModel(folder / "reduced" / "model.json")

# %%
# Once round the figure. Two angles leave one of the three tensions free: each step stays near to the last one.
robot = softcal.with_parameters(calibrated.robot, {"neck.youngs_modulus": truth})
plant, commands = softcal.LiveTwin(robot, "tension"), {}
around = np.linspace(0.0, 2.0 * np.pi, 61)
wanted, real, tensions, bands = [], [], [], []
for t in around:
    goal = {"plate.pitch": np.radians(8.0) * np.sin(t), "plate.roll": np.radians(5.0) * np.sin(2.0 * t)}
    commands = model.inverse(goal, start=commands)["commands"]
    state = plant.at(commands)
    assert state.succeeded, state.status
    band = model.state(commands)["bands"]
    wanted.append([*goal.values()])
    real.append([state.channels[name] for name in goal])
    tensions.append([commands[name] for name in model.inputs])
    bands.append([band[name] for name in goal])
wanted, real, bands = (np.degrees(each) for each in (wanted, real, bands))
off = np.abs(real - wanted)
print(f"off by up to {off.max():.2f} deg, the band is +- {bands.max():.2f} deg where it is widest")
assert np.all(off <= bands + 0.02)
assert 0.1 < bands.max() < 1.0

figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
left.errorbar(*wanted.T, xerr=bands[:, 0], yerr=bands[:, 1], fmt="none", ecolor="C0", alpha=0.35, label="95 % band")
left.plot(*wanted.T, color="0.4", lw=1, label="wanted")
left.plot(*real.T, color="C3", lw=1.2, label="plate of the true neck")
left.set(xlabel="pitch [deg]", ylabel="roll [deg]", aspect="equal", ylim=(-6.5, 10.5))
left.legend(loc="upper center", fontsize=8)
right.plot(np.degrees(around), tensions, label=model.inputs)
right.set(xlabel="way round [deg]", ylabel="tension [N]", ylim=(0.0, 3.2))
right.legend(loc="upper center", ncols=3)
