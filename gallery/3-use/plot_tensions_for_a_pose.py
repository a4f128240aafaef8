"""
Tensions for a pose
===================

Which tensions of three cables bring the tip of a finger along a circle? `reach` searches on the twin itself, with its
exact derivatives, within limits: each target from the last one, no cable below a pretension, and what is out of reach
is answered by the nearest state. The commands can be replayed.
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


turn = 2 * np.pi * np.arange(3) / 3
cables = tuple(cable(name, 0.004 * np.cos(a), 0.004 * np.sin(a)) for name, a in zip("abc", turn, strict=True))
robot = softcal.Robot(bodies=(finger,), plates=(tip,), cables=cables)

# %%
# A circle of 20 mm, with 0.2 N at least in every cable.
angle = np.linspace(0.0, 2 * np.pi, 25)
circle = {"tip.x": (0.02 * np.cos(angle)).tolist(), "tip.y": (0.02 * np.sin(angle)).tolist()}
found = softcal.reach(robot, circle, pretension=0.2)
tension = np.array([list(step.commands.values()) for step in found.steps])
off = max(abs(miss) for step in found.steps for miss in step.misses.values())
print(f"{len(found.steps)} targets, at most {1e6 * off:.2g} µm off; {tension.min():.2f} to {tension.max():.2f} N")
assert all(step.outcome == "reached" for step in found.steps)
assert tension.min() > 0.199

# %%
# Replayed, and a target that 1 N does not reach.
again = softcal.simulate(robot, found.protocol).channels
assert np.abs(again["tip.x"] - circle["tip.x"]).max() < 1e-5
(far,) = softcal.reach(robot, {"tip.x": 0.05, "tip.y": 0.0}, limits={"tension": (0.0, 1.0)}).steps
print(far.status)
assert far.outcome == "nearest"

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
left.plot(1e3 * np.array(circle["tip.x"]), 1e3 * np.array(circle["tip.y"]), "0.7", lw=4)
left.plot(1e3 * again["tip.x"], 1e3 * again["tip.y"], ".-")
left.set(xlabel="x of the tip [mm]", ylabel="y of the tip [mm]", aspect="equal")
right.plot(np.degrees(angle), tension, label=[f"cable {name}" for name in "abc"])
right.set(xlabel="place on the circle [deg]", ylabel="tension [N]")
right.legend()
