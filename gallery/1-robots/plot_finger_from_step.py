"""
A finger from STEP with a tendon in its bore
============================================

A part as it comes from CAD, with the channel of its tendon, becomes a mesh and a robot by a few lines of a project file. The
tendon follows the bore between the points that are stated. A finger of constant section whose tendon runs at a constant
distance from its middle bends, at first, by T a L / (E I).
"""

import tempfile
from pathlib import Path

import gmsh
import matplotlib.pyplot as plt
import numpy as np

import softcal

folder, side, length, bore, arm = Path(tempfile.mkdtemp()), 12.0, 70.0, 3.0, 3.0  # [mm]

# %%
# Here a script draws the part; yours is a file from CAD.
gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
box = gmsh.model.occ.addBox(-side / 2, -side / 2, 0, side, side, length)
hole = gmsh.model.occ.addCylinder(arm, 0, 0, 0, 0, length, bore / 2)
gmsh.model.occ.cut([(3, box)], [(3, hole)])
gmsh.model.occ.synchronize()
gmsh.write(str(folder / "finger.step"))
gmsh.finalize()

(folder / "project.yaml").write_text(f"""
softcal: 1
name: a finger
robot:
  bodies:
    finger:
      mesh: {{file: finger.step, size: 5 mm, edges_around: 6}}
      youngs_modulus: 1 MPa
      poissons_ratio: 0.45
      regions:
        foot: {{plane: {{point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}}}}
        end: {{plane: {{point: [0 mm, 0 mm, {length} mm], normal: [0, 0, 1]}}}}
      fixed: foot
  plates: {{tip: {{body: finger, region: end, reference: [0 mm, 0 mm, {length} mm]}}}}
  cables:
    tendon:
      via: [{{on: tip, at: [{arm} mm, 0 mm, {length} mm]}}, {{on: finger, at: [{arm} mm, 0 mm, 0.5 mm]}},
            {{at: [{arm} mm, 0 mm, -10 mm]}}]
""")
robot = softcal.load(folder / "project.yaml").robot
response = softcal.simulate(robot, softcal.pull(robot, "tendon", "tension", 2.0), snapshots=True)

# %%
# The closed form, about the middle of the section that the bore leaves:
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
