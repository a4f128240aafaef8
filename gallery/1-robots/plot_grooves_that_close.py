"""
Grooves that close
==================

A finger with notches is soft until the walls of the notches meet. Without contact they pass through each other, and
the simulation says so; with it, the tendon's tension grows.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import softcal

length, layers = 0.08, 18
whole = softcal.box_mesh((0.014, 0.012, length), (4, 2, layers), origin=(-0.007, -0.006, 0.0))
middles = whole.points[whole.tets].mean(axis=1)
notch = np.isin((middles[:, 2] / length * layers).astype(int), (3, 6, 9, 12, 15)) & (middles[:, 0] > -0.0035)
used, numbers = np.unique(whole.tets[~notch], return_inverse=True)
mesh = softcal.TetMesh(whole.points[used], numbers.reshape(-1, 4))
z = mesh.points[:, 2]

finger = softcal.Body(
    "finger",
    mesh,
    fixed=np.flatnonzero(z < 1e-9),
    parameters={"youngs_modulus": 2e6, "poissons_ratio": 0.4},
    element="P1",
)
tip = softcal.Plate("tip", {"finger": np.flatnonzero(z > length - 1e-9)}, (0.0, 0.0, length))
ribs = [softcal.ViaPoint((0.005, 0.0, length * (k + 0.5) / layers), "finger") for k in (1, 4, 7, 10, 13, 16)]
tendon = softcal.Cable(
    "tendon",
    (softcal.ViaPoint((0.005, 0.0, -0.005)), *ribs, softcal.ViaPoint((0.005, 0.0, length), "tip")),
    pulled_end="first",
)
robot = softcal.Robot(bodies=(finger,), plates=(tip,), cables=(tendon,))
touching = replace(robot, contact=softcal.Contact())

pull = softcal.pull(robot, "tendon", "shortening", 0.03, samples=31)
free = softcal.simulate(robot, pull)
closed = softcal.simulate(touching, pull, snapshots=True)
print("without contact:", free.crossings)

# %%
# Until the walls meet both are the same; then the tension of the finger with contact rises faster.
tension = [one.channels["tendon.tension"] for one in (free, closed)]
apart = np.flatnonzero(np.abs(tension[1] - tension[0]) > 1e-3 * tension[0].max())
meet = pull.commands["tendon"].values[apart[0]]
print(f"the notches close at {1e3 * meet:.0f} mm; at the end {tension[0][-1]:.1f} and {tension[1][-1]:.1f} N")
assert "intersect" in free.crossings or "pass" in free.crossings
assert not closed.crossings
assert tension[1][-1] > 1.1 * tension[0][-1]

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
closed.plot_shape(ax=left)
free.plot("tendon.tension", "tendon.shortening", ax=right)
closed.plot("tendon.tension", "tendon.shortening", ax=right)
right.legend(["without contact", "with contact"])
