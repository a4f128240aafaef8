"""
Lengths of a body as parameters
===============================

A printed part is not as it was drawn: its walls are thicker, all of it has shrunk. `DrawnShape` makes the scale of
any mesh and the offset of its walls parameters, with exact derivatives, beside the moduli; the lengths of a primitive
are by `PrimitiveShape`. The stiffness of a square bar in bending grows with the fourth power of its side.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

side, length = 0.012, 0.12
mesh = softcal.box_mesh((side, side, length), (2, 2, 10), origin=(-side / 2, -side / 2, 0.0))
bar = softcal.Body(
    "bar",
    mesh,
    fixed=mesh.node_sets["z0"],
    parameters={"youngs_modulus": 1e6, "poissons_ratio": 0.3},
    shape=softcal.DrawnShape(),
)
tip = softcal.Plate("tip", {"bar": mesh.node_sets["z1"]}, (0.0, 0.0, length))
cable = softcal.Cable("cable", (softcal.ViaPoint((0.0, 0.0, length), "tip"), softcal.ViaPoint((0.1, 0.0, length))))
robot = softcal.Robot(bodies=(bar,), plates=(tip,), cables=(cable,))
small = softcal.pull(robot, "cable", "shortening", 1e-3, samples=2)

# %%
# Every length that can be calibrated, and the derivative of the tension by two of them.
print([name for name in softcal.robot_parameters(robot) if name.startswith("bar.")])
names = ["bar.wall_offset", "bar.scale", "bar.youngs_modulus"]
response = softcal.simulate(robot, small, sensitivities=names)
tension, by = response.channels["cable.tension"][-1], response.sensitivities["cable.tension"]
wall = by["bar.wall_offset"][-1] * side / tension
beam = 4 - 3 * side / length  # both ends move too, by as much as the walls
modulus = by["bar.youngs_modulus"][-1] * 1e6 / tension
print(f"d log T / d log side: {wall / 2:.2f}, of a beam {beam:.2f}; d log T / d log E: {modulus:.6f}")
assert abs(wall / 2 - beam) < 0.05
assert abs(modulus - 1) < 1e-6

# %%
# Walls that are thicker, without another mesh.
offsets = np.linspace(-1e-3, 1e-3, 9)
forces = [softcal.simulate(robot, small, {"bar.wall_offset": one}).channels["cable.tension"][-1] for one in offsets]
assert abs(np.gradient(forces, offsets)[4] / by["bar.wall_offset"][-1] - 1) < 0.02

figure, (left, right) = plt.subplots(1, 2, figsize=(7.5, 3.6), layout="constrained")
softcal.with_parameters(robot, {"bar.wall_offset": 1e-3}).plot_shape(ax=left)
left.set_title("walls 1 mm thicker")
right.plot(1e3 * offsets, 1e3 * np.array(forces), "o-")
right.set(xlabel="offset of the walls [mm]", ylabel="tension at a shortening of 1 mm [mN]")
