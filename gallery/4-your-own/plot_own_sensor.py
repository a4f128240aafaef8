"""
A sensor of your own
====================

A sensor reads channels from places and rotations of parts, and gives their rates; exact derivatives follow. Here a
string potentiometer between two points of a strip.
"""

from dataclasses import dataclass, replace

import matplotlib.pyplot as plt
import numpy as np

import softcal

stretch = softcal.ChannelKind("stretch", "m", offset=("stretch_offset", softcal.quantity("length")), most=1.0)


@softcal.register_sensor
@dataclass(frozen=True)
class StringPotentiometer(softcal.Sensor):
    """The length of a string between two markers or plates."""

    between: tuple[str, str]
    name, kinds = "gallery-string", (stretch,)

    def sense(self, robot):
        return [np.linalg.norm(self.span(robot))]

    def rates(self, robot, moving):
        span = self.span(robot)
        return [span @ self.span(moving) / np.linalg.norm(span)]

    def span(self, of):
        first, last = self.between
        return of.point(last) - of.point(first)


# %%
# On the strip of the calibrations, at 4 MPa: from a marker at its foot to the tip.
strip = softcal.with_parameters(softcal.load("../strip/project.yaml").robot, {"strip.youngs_modulus": 4e6})
foot = softcal.Marker("foot", "strip", (-0.02, 0.0, 0.0))
pot = softcal.NamedSensor("pot", StringPotentiometer(("tip", "foot")))
robot = replace(strip, markers=(foot,), sensors=(pot,))
d = np.linspace(0.0, 0.03, 31)
pull = softcal.Protocol({"front": softcal.Command("shortening", d)})
response = softcal.simulate(robot, pull, sensitivities=["front.shortening"], snapshots="samples")

# %%
# What it reads is the distance of its ends, and its derivative that of the readings.
length = response.channels["pot.stretch"]
ends = np.array([[response.channels[f"{end}.{axis}"] for axis in "xyz"] for end in ("tip", "foot")])
assert np.allclose(length, np.linalg.norm(ends[0] - ends[1], axis=0), rtol=1e-9)
rate = response.sensitivities["pot.stretch"]["front.shortening"]
assert np.allclose(rate[1:-1], np.gradient(length, d)[1:-1], atol=0.02)
print(f"{1e3 * length[0]:.2f} mm at rest, {1e3 * length[-1]:.2f} mm at the end, {rate[-1]:.3f} mm a mm of cable")

figure, (left, right) = plt.subplots(1, 2, figsize=(7.5, 3.6), layout="constrained")
response.plot_shape(ax=left)
response.plot("pot.stretch", "front.shortening", ax=right)
