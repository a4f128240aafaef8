"""
What the tests are sensitive to
===============================

Sobol's indices say how much of the variance of each channel comes from which parameter, over the whole bounds of the
search: what has no part in any channel cannot be calibrated by these tests.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

home = Path(tempfile.mkdtemp())
head, _, tail = Path("../strip/project.yaml").read_text().partition("  pull_20mm:")
text = head + "parameters:" + tail.partition("parameters:")[2]
(home / "project.yaml").write_text(text.replace("[0.5 MPa, 20 MPa]", "[3 MPa, 5 MPa]").replace("[-1 mm", "[0 mm"))
(home / "pull_10mm.csv").write_text(Path("../strip/pull_10mm.csv").read_text())

study = softcal.importance(home / "project.yaml", simulations=200, seed=1)
names = list(study.ranges)
for output, one in study.outputs.items():
    print(output, {name: f"{one.total[name].value:.2f}" for name in names})
print({fact: round(value) for fact, value in study.facts.items()})

# %%
# The angle of a cable that is pulled by a length hardly depends on the modulus: it tells the slack. The force has
# both.
tension, pitch = study.outputs["tension"], study.outputs["pitch"]
modulus, slack = names
assert tension.total[modulus].value > 0.2
assert pitch.total[modulus].value < 0.05
assert pitch.total[slack].value > 0.95
assert all(abs(sum(index.value for index in one.first.values()) - 1) < 0.2 for one in (tension, pitch))

figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
width = 0.8 / len(study.outputs)
for k, (output, one) in enumerate(study.outputs.items()):
    axes.bar(np.arange(len(names)) + k * width, [one.total[name].value for name in names], width, label=output)
axes.set_xticks(np.arange(len(names)) + 0.4 - width / 2, names)
axes.set_ylabel("total Sobol index")
axes.legend(loc="upper center")
