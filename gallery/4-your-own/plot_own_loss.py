"""
A loss of your own
==================

A loss is a convex function of the residuals of each channel, with the weights of the quadratic one that touches it.
Here absolute errors, which a few bad samples do not pull away. A registered loss is a word of the project file.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal


@softcal.register_loss
@dataclass(frozen=True)
class Absolute(softcal.Loss):
    """The mean absolute error over the noise, rounded at its least."""

    name = "gallery-absolute"
    rooted, degree, unit = False, 1, ""
    options = (softcal.Option("width", softcal.quantity("positive ratio"), 1.0),)

    width: float = 1.0

    def block_value(self, block, residual):
        return float(np.sum(np.hypot(residual / block.sigma, self.width) - self.width))

    def square_weights(self, block, residual):
        return 0.5 / (block.sigma**2 * np.hypot(residual / block.sigma, self.width))

    def share(self, blocks):
        return 1.0 / sum(len(block.residual) for block in blocks)

    def faults(self, experiments):
        return []


# %%
# A pull of the strip of which six samples were read from a wrong row.
home, name = Path(tempfile.mkdtemp()), "strip.youngs_modulus"
head, _, tail = Path("../strip/project.yaml").read_text().partition("  pull_20mm:")
(home / "project.yaml").write_text(head + "parameters:" + tail.partition("parameters:")[2])
table = np.loadtxt("../strip/pull_10mm.csv", delimiter=",", skiprows=1)
table[5:23:3, 1] += 0.06
np.savetxt(home / "pull_10mm.csv", table, delimiter=",", header="d [mm],T [N],pitch [deg]", comments="", fmt="%.4f")

project = softcal.load(home / "project.yaml")
found = {loss: softcal.calibrate(project, loss=loss).headline for loss in ("likelihood", "gallery-absolute")}
off = {loss: result.parameters[name].value / 3.96e6 - 1 for loss, result in found.items()}
print({loss: f"{100 * error:+.1f} %" for loss, error in off.items()}, "from the truth")
assert abs(off["gallery-absolute"]) < 0.03
assert abs(off["likelihood"]) > 3 * abs(off["gallery-absolute"])

figure, axes = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained", sharey=True)
for ax, (loss, result) in zip(axes, found.items(), strict=True):
    result.plot_fit("tension", ax=ax)
    ax.set_title(f"{loss}: {result.parameters[name].value / 1e6:.2f} MPa")
