"""
A column that buckles
=====================

A cable along a slender column presses it until it gives way sideways: at Euler's load, and from there on along the
elastica. The response says where it happened.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import softcal

E, length, width, thickness, elements = 5e7, 0.2, 0.01, 0.004, 40
stiffness = E * width * thickness**3 / 12
top = (0.0, 0.0, length)
column = softcal.Rod(
    "column",
    softcal.straight((0.0, 0.0, 0.0), top, elements),
    softcal.RectangularBar(width, thickness),
    {"youngs_modulus": E, "poissons_ratio": 0.3},
    fixed=[0],
    clamped={"top": [elements]},
)
cable = softcal.Cable("cable", (softcal.ViaPoint((0.0, 0.0, 0.0)), softcal.ViaPoint(top, "top")), pulled_end="first")
robot = softcal.Robot(plates=(softcal.Plate("top", {}, top),), rods=(column,), cables=(cable,))
pull = softcal.pull(robot, "cable", "shortening", 0.06, samples=61)
response = softcal.simulate(robot, pull, snapshots=True)
print(response.instabilities)
assert "Not stable" in response.instabilities


# %%
# The elastica: its chord and its load by the elliptic integrals of a modulus k.
def load(shortening):
    chord = 1 - shortening / length
    k = brentq(lambda k: 2 * ellipe(k * k) / ellipk(k * k) - 1 - chord, 1e-9, 0.995)
    return 4 * ellipk(k * k) ** 2 * stiffness / length**2


d = pull.commands["cable"].values[1:]
exact = np.array([load(one) for one in d])
tension = response.channels["cable.tension"][1:]
print(f"Euler {np.pi**2 * stiffness / length**2:.4f} N; at 60 mm {tension[-1]:.4f} N, elastica {exact[-1]:.4f} N")
assert np.abs(tension / exact - 1).max() < 2e-3

axes = response.plot("cable.tension", "cable.shortening")
axes.plot(1e3 * d, exact, "k--", label="elastica")
axes.legend()
inset = axes.inset_axes((0.25, 0.12, 0.5, 0.6))
response.plot_shape(ax=inset)
