"""
Two materials in one body
=========================

A strip of which one half is five times as stiff: each material is an inclusion of the body, with constants of its own
that can be calibrated. Under a moment it bends as the theory of composite beams says.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

length, width, height = 0.1, 0.01, 0.012
soft, stiff = 1e6, 5e6  # [Pa]
mesh = softcal.box_mesh((length, width, height), (12, 1, 4))
upper = np.flatnonzero(mesh.points[mesh.tets].mean(axis=1)[:, 2] > height / 2)
strip = softcal.Body(
    "strip",
    mesh,
    fixed=mesh.node_sets["x0"],
    parameters={"youngs_modulus": soft, "poissons_ratio": 0.0},
    inclusions=(softcal.Material("hard", upper, {"youngs_modulus": stiff}),),
)
end = softcal.Plate("end", {"strip": mesh.node_sets["x1"]}, (length, width / 2, height / 2))

# %%
# The closed form: the neutral axis is at the mean of both halves, weighed by their moduli.
half = height / 2
centres, moduli = np.array([half / 2, 1.5 * half]), np.array([soft, stiff])
neutral = centres @ moduli / moduli.sum()
stiffness = width * np.sum(moduli * (half**3 / 12 + half * (centres - neutral) ** 2))  # E I [N m^2]

angles = []
moments = np.array([1e-5, 5e-4, 2e-3])
for moment in moments:
    load = softcal.Moment("bending", "end", (0.0, moment, 0.0))
    robot = softcal.Robot(bodies=(strip,), plates=(end,), loads=(load,))
    response = softcal.simulate(robot, softcal.Protocol({}), snapshots=True)
    angles.append(abs(response.channels["end.pitch"][0]))
exact = moments * length / stiffness
print("twin  [deg]:", np.degrees(angles).round(4))
print("beam  [deg]:", np.degrees(exact).round(4))
assert np.allclose(angles, exact, rtol=0.02)
print("parameters:", [name for name in softcal.robot_parameters(robot) if "youngs" in name])

# %%
# The stress along the strip jumps where the materials meet. A shape is a grid of PyVista, whose filters cut it here;
# `grid.plot()` draws it in three dimensions.
grid = softcal.shape_grid(robot, response.snapshots[-1])
grid["along"] = grid.cell_data["stress"][:, 0]
centres = mesh.points[mesh.tets].mean(axis=1)
modulus = np.full(len(centres), soft)
modulus[upper] = stiff
bent = modulus * moments[-1] / stiffness * (centres[:, 2] - neutral)
inner = np.abs(centres[:, 0] - length / 2) < length / 4
error = np.abs(grid["along"] - bent)[inner].max() / np.abs(bent).max()
print(f"largest difference to the beam's stress, away from the ends: {100 * error:.2f} % of the largest stress")
assert error < 0.01

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
cut = grid.slice("y", generate_triangles=True)
x, _, z = 1e3 * cut.points.T
colours = left.tripcolor(x, z, cut.regular_faces, facecolors=1e-3 * cut["along"], cmap="viridis")
figure.colorbar(colours, ax=left, label="stress [kPa]", location="bottom")
left.set(xlabel="x [mm]", ylabel="z [mm]", aspect=3)
right.plot(1e3 * moments, np.degrees(angles), "o", label="twin")
right.plot(1e3 * moments, np.degrees(exact), label="composite beam")
right.set(xlabel="moment [N mm]", ylabel="rotation of the end [deg]")
right.legend()
