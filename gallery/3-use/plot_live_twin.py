"""
A twin in a loop
================

A `LiveTwin` keeps its equilibrium and its factorisation between calls: for a controller, a visualisation, or a
filter. Here a controller holds the angle of a strip by the tension of its cable, although a weight is added on the
way.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

import softcal

robot = softcal.with_parameters(softcal.load("../strip/project.yaml").robot, {"strip.youngs_modulus": 4e6})
heavier = softcal.with_parameters(robot, {"tip.mass": 0.0065})
goal, tension, angles, tensions = np.radians(20.0), 0.0, [], []

began = time.perf_counter()
for twin in (softcal.LiveTwin(robot, {"front": "tension"}), softcal.LiveTwin(heavier, {"front": "tension"})):
    for _ in range(60):
        state = twin.at({"front": tension})
        assert state.succeeded, state.status
        error = goal - state.channels["tip.pitch"]
        tension = max(tension + 0.1 * error / state.by_commands()["tip.pitch", "front.tension"], 0.0)
        angles.append(np.degrees(state.channels["tip.pitch"]))
        tensions.append(tension)
took = time.perf_counter() - began
print(f"{len(angles)} states with derivatives in {took:.2f} s; {angles[59]:.3f} and {angles[-1]:.3f} deg")

# %%
# The channels are those of `simulate` at the same commands.
same = softcal.simulate(heavier, softcal.pull(heavier, "front", "tension", tensions[-1])).channels
assert abs(np.degrees(same["tip.pitch"][-1]) - 20.0) < 0.1
assert abs(angles[59] - 20.0) < 0.1
assert abs(angles[-1] - 20.0) < 0.1
assert tensions[-1] < tensions[59], "a weight on top helps to bend it"
assert angles[60] > 20.5

figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(6, 4), layout="constrained")
upper.plot(angles)
upper.axhline(20.0, color="0.6", ls="--")
upper.set(ylabel="pitch [deg]", title="A weight is added at step 60")
lower.plot(tensions, color="C1")
lower.set(xlabel="step of the controller", ylabel="tension [N]")
