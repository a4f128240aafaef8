"""
A manipulator of discs and springs
==================================

Helical springs of a manipulator are rods: their wire twists and bends, and the coil does what a spring does. One
alone has, for small loads, the stiffness G d^4 / (8 D^3 n) of the textbooks; a manipulator has several, with discs
and cables.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

wire, coil, turns, E, nu = 0.002, 0.03, 6, 1.6e9, 0.43
line = softcal.helix((0, 0, 0), (0, 0, 1), diameter=coil, pitch=0.05 / turns, turns=turns, at=24 * turns)
last = len(line.nodes) - 1
top = softcal.Plate("top", {}, (0.0, 0.0, 0.05))
material = {"youngs_modulus": E, "poissons_ratio": nu}
spring = softcal.Rod("spring", line, softcal.RoundBar(wire), material, fixed=[0], clamped={"top": [last]})
pressed = softcal.Cable("rope", (softcal.ViaPoint((0, 0, 0.05), "top"), softcal.ViaPoint((0, 0, -0.05))))
alone = softcal.Robot(plates=(top,), rods=(spring,), cables=(pressed,))
response = softcal.simulate(alone, softcal.pull(alone, "rope", "shortening", 1e-3, samples=3))
stiffness = response.channels["rope.tension"][-1] / 1e-3
textbook = E / (2 * (1 + nu)) * wire**4 / (8 * coil**3 * turns)
print(f"one spring: {stiffness:.1f} N/m, by the textbook {textbook:.1f} N/m")
assert abs(stiffness / textbook - 1) < 0.05  # the textbook's coil has no pitch

# %%
# The published manipulator: four springs, discs, cables that end at the second and at the last disc.
robot = softcal.manipulator(
    softcal.Manipulator(springs=softcal.Springs(youngs_modulus=E, poissons_ratio=nu, density=900.0), hanging=False)
)
print(len(robot.rods), "springs,", len(robot.plates), "discs,", len(robot.cables), "cables")
pull = softcal.pull(robot, robot.cables[-1].name, "tension", 8.0, samples=5)
bent = softcal.simulate(robot, pull, snapshots=True)
assert bent.succeeded, bent.status
tip = robot.plates[-1].name
moved = np.array([bent.channels[f"{tip}.{axis}"] for axis in "xyz"]).T
away = np.linalg.norm(moved[-1] - moved[0])
print(f"at 8 N {tip} is {1e3 * away:.0f} mm from where it was")
assert 0.02 < away < 0.4

bent.plot_shape(ax=plt.figure(figsize=(4, 5.5), layout="constrained").add_subplot())
