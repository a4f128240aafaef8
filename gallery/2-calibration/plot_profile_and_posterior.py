"""
Three ways to an interval
=========================

The quick interval is by the derivatives at the best values. A profile fixes one parameter at a time and fits the
others; a posterior draws from the likelihood by a chain. Where the twin is nearly linear over its intervals the three
agree.
"""

import tempfile

import matplotlib.pyplot as plt
import numpy as np

import softcal

run = tempfile.mkdtemp() + "/run"
softcal.calibrate("../strip/project.yaml", out=run)
profile = softcal.intervals(run, by="profile")
posterior = softcal.intervals(run, by="posterior", samples=2000, seed=1)

name = "strip.youngs_modulus"
ways = {
    "quick": profile.intervals[name].quick,
    "profile": profile.intervals[name].found,
    "posterior": posterior.intervals[name].found,
}
for way, (low, high) in ways.items():
    print(f"{way}: {low / 1e6:.3f} to {high / 1e6:.3f} MPa")
print({fact: round(value) for fact, value in posterior.facts.items() if value > 1})
length = {way: high - low for way, (low, high) in ways.items()}
assert abs(length["profile"] / length["quick"] - 1) < 0.02
assert 0.6 < length["posterior"] / length["quick"] < 1.1  # its difference between tests is known, not estimated
assert all(low < 4e6 < high for low, high in ways.values())

# %%
# The draws, and the intervals above them. Beside the pitch, the slack says hardly anything of E.
E, slack = (np.array(posterior.points[one]) for one in (name, "front.slack[pull_30mm]"))
print(f"correlation of E and the slack of the longest pull: {np.corrcoef(E, slack)[0, 1]:.2f}")
assert abs(np.corrcoef(E, slack)[0, 1]) < 0.3
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
left.hist(E / 1e6, bins=30, color="0.8")
for k, (way, ends) in enumerate(ways.items()):
    left.plot(np.array(ends) / 1e6, [20 + 18 * k] * 2, lw=4, label=way)
left.set(xlabel="E [MPa]", ylabel="draws")
left.legend()
right.plot(E / 1e6, 1e3 * slack, ".", ms=3, color="0.5")
right.set(xlabel="E [MPa]", ylabel="slack of the longest pull [mm]")
