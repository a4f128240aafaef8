"""
A sweep: the loss on a grid
===========================

A sweep simulates the tests in every cell of a grid over any parameters. The map shows whether the tests tell these
apart: round contours where they do, a valley where they do not. Here the angle tells the slack, the force the modulus.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

project = softcal.load("../strip/project.yaml")
over = {"strip.youngs_modulus": "3.2MPa:4.8MPa:0.2MPa", "front.slack": "0mm:1.2mm:0.1mm"}
swept = softcal.sweep(project, over=over, experiments=["pull_20mm"])
result = swept.result
print(len(result.trials), "cells,", result.n_failed_trials, "failed; the best:")
best = result.best.theta
print({name: f"{value:.4g}" for name, value in best.items()})

# %%
# The best cell is the one that is nearest to the truth of this test, 4.08 MPa and 0.6 mm.
assert abs(best["strip.youngs_modulus"] - 4.0e6) < 0.21e6
assert abs(best["front.slack"] - 0.6e-3) < 0.11e-3
losses = result.losses
assert losses.shape == (9, 13)
assert np.nanmin(losses) == result.loss

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
result.plot_loss(ax=left)
values, slacks = (np.array(one) for one in result.axes.values())
for k in (0, 4, 8):
    right.semilogy(1e3 * slacks, losses[k], "o-", label=f"E {values[k] / 1e6:.1f} MPa")
right.set(xlabel="slack [mm]", ylabel="loss")
right.legend()
