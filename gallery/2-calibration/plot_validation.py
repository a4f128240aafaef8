"""
A test that was not fitted
==========================

How far is a prediction off? `validate` leaves each test out in turn, fits the others, and predicts it; what belongs to
a set-up, here the slack of its cable, is fitted to it. A model that is wrong predicts worse than it fits.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

found = softcal.validate("../strip/project.yaml")
(model,) = found.models
pooled = found.errors(model)
for one in found.models[model]:
    modulus = one.result.parameters["strip.youngs_modulus"].value
    (name,) = one.left_out
    slack = one.held_out[name].own[f"front.slack[{name}]"]
    print(f"without {name}: E {modulus / 1e6:.3f} MPa, its slack {1e3 * slack:.2f} mm")
    assert abs(modulus / 4e6 - 1) < 0.05
print(f"predicted to {1e3 * pooled['tension']:.1f} mN and {np.degrees(pooled['pitch']):.2f} deg, all tests")

# %%
# The tables have noise of 5 mN and 0.2 deg; beyond it, the tests differ by 2 % of their modulus, which no fit of the
# others can know.
assert 0.8 * 5e-3 < pooled["tension"] < 3 * 5e-3
assert 0.8 * 0.2 < np.degrees(pooled["pitch"]) < 1.5 * 0.2

figure, axes = plt.subplots(1, 3, figsize=(9, 3.4), layout="constrained")
for ax, one in zip(axes, found.models[model], strict=True):
    (name,) = one.left_out
    fit = one.held_out[name].fit
    pulled = 1e3 * fit.measured["shortening"]
    ax.plot(pulled, fit.measured["tension"], ".", color="0.6", label="measured")
    ax.plot(pulled, fit.simulated["tension"], "k", label="predicted")
    ax.set(title=name, xlabel="shortening [mm]", ylabel="tension [N]")
axes[0].legend()
