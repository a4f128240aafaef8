"""
A figure of eight, with its band
================================

A printed neck with three cables, whose modulus comes from one noisy pull. Its
[reduced model](../../exports.md#the-reduced-model) gives the tensions that lead the plate through a figure of eight of
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
places = {"front": (50.0, 0.0), "left": (-25.0, 43.301), "right": (-25.0, -43.301)}
cables = "\n".join(
    f"    {name}: {{via: [{{on: plate, at: [{x} mm, {y} mm, 106.704 mm]}}, {{at: [{x} mm, {y} mm, 14.06 mm]}}]}}"
    for name, (x, y) in places.items()
)
(folder / "project.yaml").write_text(f"""
softcal: 1
name: Neck with three cables
robot:
  bodies:
    neck:
      mesh: {{primitive: neck, tets: 1500, order: 1}}
      youngs_modulus: 3 MPa
      poissons_ratio: 0.43
      fixed: socket
  plates: {{plate: {{body: neck, region: collar, reference: [0 mm, 0 mm, 106.704 mm]}}}}
  cables:
{cables}
experiments:
  pull:
    cable: front
    plate: plate
    files: [{{path: pull.csv, columns: {{shortening: {{name: "d [mm]"}}, tension: {{name: "F [N]"}}}}}}]
    noise: {{tension: 0.3 N}}
parameters: {{neck.youngs_modulus: {{bounds: [0.5 MPa, 10 MPa], scale: log}}}}
calibration: {{loss: likelihood, method: least-squares, mesh_error: false}}
""")
(folder / "pull.csv").write_text("d [mm],F [N]\n0,0\n1,0\n")
robot = softcal.with_parameters(softcal.load(folder / "project.yaml").robot, {"neck.youngs_modulus": truth})
pull = np.linspace(0.5e-3, 12e-3, 24)
force = softcal.simulate(robot, softcal.Protocol({"front": softcal.Command("shortening", pull)})).channels
noisy = force["front.tension"] + np.random.default_rng(2).normal(0.0, 0.3, 24)
rows = "\n".join(f"{1e3 * d},{F}" for d, F in zip(pull, noisy))
(folder / "pull.csv").write_text(f"d [mm],F [N]\n{rows}\n")

# %%
# From the bench to the controller: calibrate, then write the reduced model of the run.
found = softcal.calibrate(folder / "project.yaml", out=folder / "run").headline.parameters["neck.youngs_modulus"]
low, high = found.interval
print(f"E = {1e-6 * found.value:.2f} MPa (95 %: {1e-6 * low:.2f} to {1e-6 * high:.2f}), truth {1e-6 * truth} MPa")
calibrated = softcal.load_calibrated(folder / "run")
request = softcal.ExportRequest(calibrated, run=folder / "run")
softcal.write_export("reduced", request, folder / "reduced", reach="4N", samples=120)
spec = importlib.util.spec_from_file_location("reduced_model", folder / "reduced" / "reduced_model.py")
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
model = module.ReducedModel(folder / "reduced" / "model.json")

# %%
# Once round the figure. Two angles leave one of the three tensions free: each step stays near to the last one.
robot_now, commands = softcal.LiveTwin(robot, "tension"), {}
around = np.linspace(0.0, 2.0 * np.pi, 61)
wanted, real, tensions, bands = [], [], [], []
for t in around:
    goal = {"plate.pitch": np.radians(8.0) * np.sin(t), "plate.roll": np.radians(5.0) * np.sin(2.0 * t)}
    commands = model.inverse(goal, start=commands)["commands"]
    state = robot_now.at(commands)
    assert state.succeeded, state.status
    band = model.state(commands)["bands"]
    wanted.append([*goal.values()])
    real.append([state.channels[name] for name in goal])
    tensions.append([commands[name] for name in places])
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
right.plot(np.degrees(around), tensions, label=list(places))
right.set(xlabel="way round [deg]", ylabel="tension [N]", ylim=(0.0, 3.2))
right.legend(loc="upper center", ncols=3)
