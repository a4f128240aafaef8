"""
Where a manipulator reaches, and how stiff it is there
======================================================

Three cables pull the manipulator with 6 N at most. Where can its tip be, what ends it there, how does it yield to a
push, and what does a wall take away? The :doc:`workspace </workspace>` answers with equilibria of the exact twin:
inside, and at every point of the border.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

project = softcal.load("../../examples/manipulator/project.yaml")
pulled = dict.fromkeys(["cable4", "cable5", "cable6"], "tension")  # those that end at the last disc
limits, tip = {"tension": (0.0, 6.0)}, ("S4.x", "S4.y")
found = softcal.workspace(project, tip, controls=pulled, limits=limits, states=128)
wall = {"wall": softcal.HalfSpace((0.08, 0.0, 0.0), (-1.0, 0.0, 0.0))}  # free where x is below 80 mm
beside = softcal.workspace(project, tip, controls=pulled, limits=limits, obstacles=wall, states=128)
print(found)
print(f"{1e4 * found.size:.0f} cm^2, and {1e4 * beside.size:.0f} beside the wall")
assert beside.size < found.size

# %%
# Every state of the border names what ends it.
ends = [limit for k in beside.border for limit in beside.states[k].limits]
for name in dict.fromkeys(ends):
    print(f"{ends.count(name):3} {name}")
assert any("touches wall" in name for name in ends)

# %%
# The triangles of the workspace are flat between states, here in the colours of the compliance along x.
figure, panels = plt.subplots(1, 2, figsize=(8.5, 3.8), layout="constrained", sharey=True)
for axes, one, title in zip(panels, (found, beside), ("free", "beside a wall"), strict=True):
    x, y = 1e3 * one.places.T
    soft = np.array([1e3 * state.compliances["S4.x"] for state in one.states])
    shown = axes.tripcolor(x, y, one.simplices, soft, shading="gouraud", vmin=100.0, vmax=135.0)
    for a, b in one.outline:
        axes.plot(x[[a, b]], y[[a, b]], color="k", lw=1)
    axes.set(title=title, xlabel="x of the tip [mm]", aspect="equal")
panels[0].set_ylabel("y of the tip [mm]")
figure.colorbar(shown, ax=panels, label="compliance along x [mm/N]")
