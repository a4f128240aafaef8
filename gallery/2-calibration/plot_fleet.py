"""
A fleet of specimens
====================

Many specimens of one design are calibrated by one template and a table with a row for each. What they say together is
the mean, the spread of a further specimen, and the effect of what the table tells of them, here two filaments.
"""

import shutil
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import softcal

home = Path(tempfile.mkdtemp())
text = Path("../strip/project.yaml").read_text()
before, pulls, after = (
    text.partition("  pull_20mm:")[0],
    text.partition("parameters:")[1],
    text.partition("parameters:")[2],
)
(home / "project.yaml").write_text(before + pulls + after)
shutil.copy("../strip/pull_10mm.csv", home)

# %%
# Six strips of two filaments, the second one 30 % stiffer; printed strips of a filament differ by 4 %.
robot, chance = softcal.load(home / "project.yaml").robot, np.random.default_rng(3)
d, rows, truth = 1e-3 * np.linspace(1, 10, 25), ["specimen,filament,experiments.pull_10mm.file"], {}
pull = softcal.Protocol({"front": softcal.Command("shortening", d)})
for k in range(6):
    filament, modulus = "AB"[k % 2], (3e6, 3.9e6)[k % 2] * np.exp(chance.normal(0, 0.04))
    seen = softcal.simulate(robot, pull, {"strip.youngs_modulus": modulus}).channels
    tension = seen["front.tension"] + chance.normal(0, 5e-3, len(d))
    pitch = np.degrees(seen["tip.pitch"]) + chance.normal(0, 0.2, len(d))
    table = np.column_stack([1e3 * d, tension, pitch])
    np.savetxt(home / f"s{k}.csv", table, delimiter=",", header="d [mm],T [N],pitch [deg]", comments="", fmt="%.4f")
    rows.append(f"s{k},{filament},s{k}.csv")
    truth[f"s{k}"] = modulus
(home / "fleet.csv").write_text("\n".join(rows) + "\n")
fleet = softcal.fleet(home, out=home / "fleet")

# %%
# Every interval has its own truth.
name = "strip.youngs_modulus"
found = {one.name: one.parameters[name] for one in fleet.specimens}
for one in fleet.specimens:
    print(one.name, one.factors["filament"], f"{found[one.name].value / 1e6:.3f} of {truth[one.name] / 1e6:.3f} MPa")
assert all(found[one].interval[0] < truth[one] < found[one].interval[1] for one in truth)
assert all(abs(found[one].value / truth[one] - 1) < 0.04 for one in truth)
means = {f: np.mean([found[one.name].value for one in fleet.specimens if one.factors["filament"] == f]) for f in "AB"}
assert 1.15 < means["B"] / means["A"] < 1.45

figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
for k, one in enumerate(fleet.specimens):
    low, high = np.array(found[one.name].interval) / 1e6
    axes.plot([k, k], [low, high], lw=4, color="C0" if one.factors["filament"] == "A" else "C1")
    axes.plot(k, truth[one.name] / 1e6, "k_", ms=14)
axes.set_xticks(range(6), [f"{one.name}, {one.factors['filament']}" for one in fleet.specimens])
axes.set_ylabel("E [MPa], 95 % interval; dash: truth")
