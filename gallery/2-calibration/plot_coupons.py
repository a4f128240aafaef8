"""
Which law for this rubber? Tests of coupons
===========================================

Strips of the material alone, pulled, sheared and inflated, tell its law better than the robot does. `compare_laws`
fits laws to all of them, judges each by tests that it was not fitted to and by its stability, and recommends the
simplest that does. Here the tests are those of a Mooney-Rivlin material, with noise.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

C10, C01, chance = 2.0e5, 0.6e5, np.random.default_rng(2)
stretch = np.linspace(1.05, 2.4, 25)
true = {
    "uniaxial": 2 * (stretch - stretch**-2) * (C10 + C01 / stretch),
    "planar": 2 * (stretch - stretch**-3) * (C10 + C01),
    "equibiaxial": 2 * (stretch - stretch**-5) * (C10 + C01 * stretch**2),
}
tests = [
    softcal.Coupon(kind, kind, stretch[:, None], (stress + chance.normal(0, 4e3, 25))[:, None])
    for kind, stress in true.items()
]
compared = softcal.compare_laws(tests, ["neo-hooke", "mooney-rivlin", "yeoh", "gent", "ogden-1"])
for one in compared.laws:
    E = one.fit.small_strain.youngs_modulus
    print(f"{one.name:14s} error {100 * one.held_out_error:5.1f} % on tests held out, E {E / 1e6:.2f} MPa", *one.doubts)

# %%
# The law that made the tests is found, with its constants and its modulus at small strain, 6 (C10 + C01).
best = compared.recommended
assert best is not None
assert best.name == "mooney-rivlin"
constants = {name: one.value for name, one in best.fit.estimates.items()}
print(best.name, {name: f"{value:.4g}" for name, value in constants.items()})
assert abs(best.fit.small_strain.youngs_modulus / (6 * (C10 + C01)) - 1) < 0.02

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
for k, test in enumerate(tests):
    axes.plot(test.strain, test.stress / 1e6, "o", ms=4, mfc="none", color=f"C{k}", label=test.name)
    axes.plot(stretch, true[test.name] / 1e6, color=f"C{k}")
axes.set(xlabel="stretch [-]", ylabel="nominal stress [MPa]", title="Points: tests; lines: the law that made them")
axes.legend()
