"""
A backbone that tapers: rods at a hundredth of the cost
=======================================================

Slender parts are rods, geometrically exact at any bending, with a section that may vary. Under a pure moment at its
end a uniform rod is an arc of a circle, here a whole turn; a tapered one winds up towards its tip.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

E, length, thick, thin, n = 2e6, 0.3, 0.01, 0.005, 60


def wound(section, moment):
    """The rod with a moment on the plate at its end."""
    end = softcal.Plate("end", {}, (0.0, 0.0, length))
    rod = softcal.Rod(
        "rod",
        softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, length), n),
        section,
        {"youngs_modulus": E, "poissons_ratio": 0.45},
        fixed=[0],
        clamped={"end": [n]},
    )
    robot = softcal.Robot(plates=(end,), rods=(rod,), loads=(softcal.Moment("turn", "end", (0.0, moment, 0.0)),))
    response = softcal.simulate(robot, softcal.Protocol({}), snapshots=True)
    assert response.succeeded, response.status
    return response.snapshots[-1].rods["rod"]


# %%
# A moment of 2 pi E I / L closes the uniform rod to a ring.
inertia = np.pi * thick**4 / 64
ring = wound(softcal.RoundBar(thick), 2 * np.pi * E * inertia / length)
gap = np.linalg.norm(ring[-1] - ring[0])
print(f"the ends of the ring are {1e6 * gap:.1f} um apart; its diameter is {1e3 * np.ptp(ring[:, 2]):.2f} mm")
assert gap < 1e-3 * length
assert abs(np.ptp(ring[:, 2]) / (length / np.pi) - 1) < 0.01

tapered = softcal.VariedSection((0.0, 1.0), (softcal.RoundBar(thick), softcal.RoundBar(thin)))
spiral = wound(tapered, 2 * np.pi * E * inertia / length / 3)
turns = np.diff(spiral, axis=0)
angle = np.unwrap(np.arctan2(turns[:, 0], turns[:, 2]))
share = (np.arange(n) + 0.5) / n  # the middles of the elements
taper = 1 - thin / thick
exact = 2 * np.pi / 9 / taper * ((1 - taper * share) ** -3 - 1)  # the integral of M / (E I)
print(f"the tapered rod has turned by {np.degrees(angle[-1]):.1f} deg, by the integral {np.degrees(exact[-1]):.1f}")
assert np.allclose(angle, exact, rtol=0.01)

figure, axes = plt.subplots(figsize=(5.5, 4.5), layout="constrained")
for places, name in ((ring, "uniform, a whole turn"), (spiral, "tapered, a third of the moment")):
    axes.plot(1e3 * places[:, 0], 1e3 * places[:, 2], label=name, lw=3)
axes.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
figure.legend(loc="outside lower center", ncols=2)
