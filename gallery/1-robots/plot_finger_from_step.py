"""
A finger from STEP with a tendon in its bore
============================================

A part as it comes from CAD, with the channel of its tendon, becomes a mesh and a robot by a few lines of a project
file. The tendon follows the bore between the points that are stated. A finger of constant section whose tendon runs
at a constant distance from its middle bends, at first, by T a L / (E I).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

print(Path("../finger/project.yaml").read_text())
robot = softcal.load("../finger/project.yaml").robot
response = softcal.simulate(robot, softcal.pull(robot, "tendon", "tension", 2.0), snapshots=True)

# %%
# The closed form, about the middle of the section that the bore leaves:
side, length, bore, arm = 12.0, 70.0, 3.0, 3.0  # [mm]
area, hollow = side**2, np.pi * bore**2 / 4
middle = -hollow * arm / (area - hollow)
inertia = side**4 / 12 + area * middle**2 - np.pi * bore**4 / 64 - hollow * (arm - middle) ** 2
slope = (arm - middle) * length / inertia  # [1/mm^2], at 1 MPa: [rad/N]
pitch = response.channels["tip.pitch"]
first = pitch[1] / response.channels["tendon.tension"][1]
print(f"{len(robot.bodies[0].mesh.tets)} tets, {np.degrees(pitch[-1]):.1f} deg at 2 N, {first:.4f} rad/N at first")
print(f"closed form {slope:.4f} rad/N")
assert abs(abs(first) / slope - 1) < 0.05

figure, (left, right) = plt.subplots(1, 2, figsize=(6, 4.5), layout="constrained")
robot.plot_shape(ax=left)
response.plot_shape(ax=right)
