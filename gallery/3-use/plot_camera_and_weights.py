"""
Markers before a camera: a beam under weights
=============================================

Real measurements: a beam of silicone, a motion capture, two weights. The places of the markers are known in the
camera's frame, whose pose is free beside Young's modulus; distances are compared marker by marker.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import softcal

project = softcal.load("../../examples/beam/project.yaml")
found = softcal.calibrate(project, fit="joint", mesh_error=False)
result = found.headline
modulus = result.parameters["beam.youngs_modulus"]
low, high = modulus.interval
print(f"E {modulus.value / 1e3:.1f} kPa, 95 % interval {low / 1e3:.0f} to {high / 1e3:.0f} kPa")
print({name: f"{1e3 * fit.distance.rms:.2f} mm" for name, fit in result.experiments.items()})

# %%
# The maker's data sheet has 151 kPa at 100 % strain; at small strain it is stiffer. As stored:
assert abs(modulus.value / 281.3e3 - 1) < 0.02
assert low < modulus.value < high
assert all(fit.distance.rms < 2e-3 for fit in result.experiments.values())

# %%
# The twin under the heavier weight, and how far its markers are from the measured ones.
weight = {f"{place}.force": 0.33354 for place in ("left", "middle", "right")}
robot = softcal.with_parameters(project.robot, {"beam.youngs_modulus": modulus.value, **weight})
light = softcal.simulate(replace(robot, loads=(), gravity=np.zeros(3)), softcal.Protocol({}), snapshots=True)
heavy = softcal.simulate(robot, softcal.Protocol({}), snapshots=True)
sunk = light.channels["tip1.z"][0] - heavy.channels["tip1.z"][0]
print(f"the tip sinks by {1e3 * sunk:.1f} mm")
assert 0.005 < sunk < 0.08

figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
replace(heavy, snapshots=(*light.snapshots[:1], *heavy.snapshots[-1:])).plot_shape(ax=left)
for k, (name, fit) in enumerate(result.experiments.items()):
    right.bar(
        np.arange(len(fit.distances)) + 0.27 * k, [1e3 * d.mean for d in fit.distances.values()], 0.25, label=name
    )
right.set_xticks(np.arange(len(fit.distances)) + 0.27, list(fit.distances))
right.set_ylabel("mean distance [mm]")
right.legend()
