"""
Young's modulus from three pulls
================================

A project file names the robot, the tables of the bench and what is free. The tables of this strip were made by its
own twin at 4 MPa with noise, slack and a difference of 2 % between the tests, so that it is known what should come
out.
"""

import matplotlib.pyplot as plt

import softcal

found = softcal.calibrate("../strip/project.yaml")
result = found.headline
print(result.status)
for name, one in result.parameters.items():
    print(f"{name}: {one.value:.4g} {one.unit}, 95 % interval {one.interval[0]:.4g} to {one.interval[1]:.4g}")

# %%
# The interval has the truth in it, and says that the tests differ by more than their noise.
modulus = result.parameters["strip.youngs_modulus"]
assert modulus.interval[0] < 4e6 < modulus.interval[1]
assert abs(modulus.value / 4e6 - 1) < 0.02
for name, slack in (("pull_10mm", 0.3e-3), ("pull_20mm", 0.6e-3), ("pull_30mm", 0.1e-3)):
    assert abs(result.parameters[f"front.slack[{name}]"].value - slack) < 0.05e-3
between = result.spreads["strip.youngs_modulus"]
print(f"between the tests: {between.spread / 1e3:.0f} kPa, by chance in {100 * between.chance:.1f} % of such studies")
assert between.differs

figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout="constrained")
found.plot_fit("tension", "pull_30mm", ax=axes[0, 0])
found.plot_fit("pitch", "pull_30mm", ax=axes[0, 1])
found.plot_loss(ax=axes[1, 0])
found.plot_intervals("front.slack", ax=axes[1, 1]).set_xlim(-0.1, 0.8)
