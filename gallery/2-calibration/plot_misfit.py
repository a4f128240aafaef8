"""
Intervals that know that the model is wrong
===========================================

The machine of this bench adds a wobble to the force, of which the twin knows nothing. The best fit then leaves
residuals that are no noise: they come in runs of one sign. The result says so, and its interval is as long as that
makes it.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

home, name = Path(tempfile.mkdtemp()), "strip.youngs_modulus"
head, _, tail = Path("../strip/project.yaml").read_text().partition("  pull_20mm:")
(home / "project.yaml").write_text(head + "parameters:" + tail.partition("parameters:")[2])
table = home / "pull_10mm.csv"
d, chance = 1e-3 * np.linspace(1, 10, 60), np.random.default_rng(5)
table.write_text("d [mm],T [N],pitch [deg]\n" + "1,1,1\n" * 5)
robot = softcal.load(home / "project.yaml").robot
pull = softcal.Protocol({"front": softcal.Command("shortening", d)})


def fitted(wobble):
    """The calibration of a bench whose machine adds a wobble of an amplitude [N] to the tension."""
    seen = softcal.simulate(robot, pull, {name: 4e6}).channels
    tension = seen["front.tension"] + wobble * np.sin(d / 1.2e-3) + chance.normal(0, 5e-3, len(d))
    pitch = np.degrees(seen["tip.pitch"]) + chance.normal(0, 0.2, len(d))
    columns = np.column_stack([1e3 * d, tension, pitch])
    np.savetxt(table, columns, delimiter=",", header="d [mm],T [N],pitch [deg]", comments="", fmt="%.5f")
    return softcal.calibrate(home / "project.yaml").headline


clean, wrong = fitted(0.0), fitted(0.02)
for one in (clean, wrong):
    low, high = one.parameters[name].interval
    record = one.residuals["pull_10mm"]["tension"]
    shares = {source: f"{100 * share:.0f} %" for source, share in one.parameters[name].shares.items()}
    print(f"{low / 1e6:.3f} to {high / 1e6:.3f} MPa; correlation {record.correlation:.2f}, {record.n} residuals")
    print(f"tell as much as {record.effective:.0f} independent ones; the variance is from {shares}")
length = [np.diff(one.parameters[name].interval)[0] for one in (clean, wrong)]
assert length[1] > 2 * length[0]
assert wrong.residuals["pull_10mm"]["tension"].effective < 0.5 * 60
assert all(one.parameters[name].interval[0] < 4e6 < one.parameters[name].interval[1] for one in (clean, wrong))

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
wrong.plot_fit("tension", ax=left)
wrong.plot_loss(ax=right)
