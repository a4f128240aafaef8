"""
A shape in PyVista
==================

A solved shape is a grid of PyVista, with displacements, stresses and strains: its filters cut and contour it, and its
plotter draws it in three dimensions. Here a bar with a cable, cut along its middle.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

side, length = 0.02, 0.1
mesh = softcal.box_mesh((side, side, length), (2, 2, 8), origin=(-side / 2, -side / 2, 0.0))
rubber = {"youngs_modulus": 1e6, "poissons_ratio": 0.45}
bar = softcal.Body("bar", mesh, fixed=mesh.node_sets["z0"], parameters=rubber)
disc = softcal.Disc(0.05, 0.003, centre=(0.0, 0.0, length + 0.0015))
top = softcal.Plate("top", {"bar": mesh.node_sets["z1"]}, (0.0, 0.0, length), disc=disc)
cable = softcal.Cable("cable", (softcal.ViaPoint((0.02, 0.0, length), "top"), softcal.ViaPoint((0.02, 0.0, 0.0))))
robot = softcal.Robot(bodies=(bar,), plates=(top,), cables=(cable,))
response = softcal.simulate(robot, softcal.pull(robot, "cable", "shortening", 0.02, samples=3), snapshots=True)
assert response.succeeded, response.status
grid = softcal.shape_grid(robot, response.snapshots[-1])

# %%
# What it holds, and numbers by filters: of the body alone its volume, and the area of a section.
names = grid.field_data["parts"].tolist()
print(names, grid.cell_data.keys())
body = grid.threshold([0, 0], scalars="part")
volume = body.volume
cut = body.slice(normal="z", origin=(0.0, 0.0, length / 4))
print(f"volume {1e6 * volume:.2f} ml, at rest {1e6 * side**2 * length:.2f} ml")
moved = np.linalg.norm(body["displacement"], axis=1).max()
print(f"von Mises at most {body['von_mises'].max() / 1e3:.0f} kPa; the body moved by up to {1e3 * moved:.1f} mm")
assert 0.95 < volume / (side**2 * length) < 1.0
assert 0.8 < cut.area / side**2 < 1.1
tension = grid.field_data["cable.tension [N]"][0]
assert abs(tension / response.channels["cable.tension"][-1] - 1) < 1e-9

# %%
# `grid.plot()` opens a window in which it can be turned. Here what a filter cuts, with its stress, in a flat picture.
section = body.cell_data_to_point_data().slice(normal="y").triangulate()
corners = section.faces.reshape(-1, 4)[:, 1:]
figure, axes = plt.subplots(figsize=(5, 4.5), layout="constrained")
x, _, z = 1e3 * section.points.T
filled = axes.tripcolor(x, z, corners, section["von_mises"] / 1e3, shading="gouraud")
for line in ("cable", "top"):
    part = grid.threshold([names.index(line)] * 2, scalars="part").points
    axes.plot(*1e3 * part[:, [0, 2]].T, ".-" if line == "cable" else ".", color="0.5", ms=3)
axes.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
figure.colorbar(filled, label="von Mises [kPa]")
