"""
Which test to make next
=======================

After a calibration `next_test` simulates tests that could be made and ranks them by the interval that E is expected
to have then: changes of the tests that there are, and candidates of one's own.
"""

import tempfile

import matplotlib.pyplot as plt

import softcal

run = tempfile.mkdtemp() + "/run"
found = softcal.calibrate("../strip/project.yaml", out=run).headline
light = softcal.Candidate(name="twice without the weight", like="pull_20mm", settings={"tip.mass": 0.0}, repeats=2)
ranking = softcal.next_test(run, parameter="strip.youngs_modulus", candidates=[light])
for one in ranking.outlooks:
    low, high = one.interval
    print(f"{one.candidate.name:55s} {low / 1e6:.3f} to {high / 1e6:.3f} MPa, {100 * one.share:.0f} % of the present")
print(*ranking.notes, sep="\n")

# %%
# The tests differ among each other, so that one more of them is worth more than a better sensor: with any fourth
# test the interval is shorter by a fifth or more.
low, high = found.parameters["strip.youngs_modulus"].interval
assert abs((ranking.interval[1] - ranking.interval[0]) / (high - low) - 1) < 1e-3
shares = [one.share for one in ranking.outlooks]
assert shares == sorted(shares)
assert 0.5 < shares[0] < 0.85
assert shares[-1] < 1.0

figure, axes = plt.subplots(figsize=(7.5, 4), layout="constrained")
rows = {"now": ranking.interval} | {one.candidate.name: one.interval for one in ranking.outlooks}
for k, (low, high) in enumerate(rows.values()):
    axes.plot([low / 1e6, high / 1e6], [k, k], lw=5, color="C1" if k else "0.3", solid_capstyle="butt")
axes.set_yticks(range(len(rows)), list(rows))
axes.invert_yaxis()
axes.set_xlabel("expected 95 % interval of E [MPa]")
