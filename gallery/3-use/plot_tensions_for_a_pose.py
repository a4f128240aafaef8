"""
Tensions for a pose, by exact derivatives
=========================================

Which tensions bring the tip of a finger to a place? The derivatives of every channel by every command come with the
solution, so that Newton's method needs a few steps, where differences would need more simulations and lose digits.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

side, length = 0.012, 0.08
mesh = softcal.box_mesh((side, side, length), (2, 2, 6), origin=(-side / 2, -side / 2, 0.0))
material = {"youngs_modulus": 0.6e6, "poissons_ratio": 0.45}
finger = softcal.Body("finger", mesh, fixed=mesh.node_sets["z0"], parameters=material)
tip = softcal.Plate("tip", {"finger": mesh.node_sets["z1"]}, (0.0, 0.0, length))


def cable(name, x, y):
    inside = [softcal.ViaPoint((x, y, z), "finger") for z in np.linspace(0.1, 0.9, 5) * length]
    ends = softcal.ViaPoint((x, y, -0.005)), softcal.ViaPoint((x, y, length), "tip")
    return softcal.Cable(name, (ends[0], *inside, ends[1]), pulled_end="first")


names = ("a", "b")
robot = softcal.Robot(bodies=(finger,), plates=(tip,), cables=(cable("a", 0.004, 0.0), cable("b", 0.0, 0.004)))
wanted, tension, misses = np.array([0.030, 0.015]), np.array([0.5, 0.5]), []

# %%
# Newton's method on the place of the tip, x and y.
for step in range(12):
    at = softcal.Protocol({c: softcal.Command("tension", tension[[k]]) for k, c in enumerate(names)})
    shape = softcal.simulate(robot, at, sensitivities=["a.tension", "b.tension"], snapshots="samples")
    rates = shape.sensitivities
    jacobian = np.array([[rates[f"tip.{xy}"][f"{c}.tension"][0] for c in names] for xy in "xy"])
    miss = np.array([shape.channels[f"tip.{xy}"][0] for xy in "xy"]) - wanted
    misses.append(np.linalg.norm(miss))
    print(f"step {step}: {tension.round(4)} N, {misses[-1]:.2e} m off")
    if misses[-1] < 1e-9:
        break
    tension = np.maximum(tension - np.linalg.solve(jacobian, miss), 0.0)
assert misses[-1] < 1e-9
assert len(misses) < 10

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
pull = softcal.Protocol(
    {c: softcal.Command("tension", t * np.array([0.0, 1.0])) for c, t in zip(names, tension, strict=True)}
)
softcal.simulate(robot, pull, snapshots="samples").plot_shape(ax=left)
right.semilogy(misses, "o-")
right.set(xlabel="step of Newton's method", ylabel="distance from the goal [m]")
