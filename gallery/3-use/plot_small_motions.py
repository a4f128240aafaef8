"""
Frequencies and a step response
===============================

`linearise` gives the linear system of small motions about an equilibrium: frequencies, damping, and a state space for
SciPy or python-control. Here a strip with a cable, and what a step of its tension does, beside the motion in time of
the whole twin.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import step

import softcal

E, density, length, width, thickness, n = 2e7, 1100.0, 0.2, 0.01, 0.004, 8
strip = softcal.Rod(
    "strip",
    softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, length), n),
    softcal.RectangularBar(width, thickness),
    {"youngs_modulus": E, "poissons_ratio": 0.3},
    fixed=[0],
    clamped={"end": [n]},
    density=density,
)
end = softcal.Plate("end", {}, (0.0, 0.0, length))
rope = softcal.Cable("rope", (softcal.ViaPoint((0, 0, length), "end"), softcal.ViaPoint((0, 0.5, length))))
robot = softcal.Robot(plates=(end,), rods=(strip,), cables=(rope,))

# %%
# At rest the first frequency is that of a beam, 3.516 / (2 pi) sqrt(E I / (rho A L^4)).
settings = softcal.TimeSettings(time_step=0.002, rayleigh_stiffness=5e-3, rayleigh_mass=0.0)
at_rest = softcal.linearise(robot, settings=settings)
exact = 3.516 / (2 * np.pi) * np.sqrt(E * thickness**2 / (12 * density * length**4))
print(f"{at_rest.frequencies.round(3)} Hz; the first by the theory of beams {exact:.3f} Hz")
assert abs(at_rest.frequencies[0] / exact - 1) < 0.01

# %%
# A step of the cable's tension, by the linear system and by the twin in time.
y, stepped = at_rest.channels.index("end.y"), 1e-3
A, B, C, D = at_rest.state_matrices
times, gain = step((A, B, C[[y]], D[[y]]), T=np.linspace(0.0, 0.7, 351))
tension = softcal.Command("tension", np.array([0.0, stepped, stepped]))
schedule = softcal.Schedule(np.array([0.0, 1e-4, 0.7]), {"rope": tension})
motion = softcal.simulate_in_time(robot, schedule, settings)
assert motion.succeeded, motion.status
whole, linear = motion.channels["end.y"], stepped * np.interp(motion.channels["time"], times, gain)
off = np.abs(whole - linear).max() / np.abs(whole).max()
settled, by_hand = at_rest.static_gain[y, 0], 4 * length**3 / (E * width * thickness**3)
print(f"{settled:.3f} m/N at rest, by the theory of beams {by_hand:.3f}")
print(f"the twin in time is at most {100 * off:.1f} % of its motion off")
assert off < 0.06
assert abs(settled / by_hand - 1) < 0.01

# %%
# The cable that is pulled stiffens the strip a little, which the frequency response about that equilibrium shows.
figure, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.6), layout="constrained")
left.plot(motion.channels["time"], 1e3 * whole, lw=4, color="0.75", label="twin in time")
left.plot(times, 1e3 * stepped * gain, "k--", label="linear system")
left.set(xlabel="time [s]", ylabel="the end moves by [mm]")
left.legend()
rates = np.geomspace(0.3, 100.0, 400)
pulled = softcal.linearise(robot, {"rope": 0.05}, settings=settings)
for system, name in ((at_rest, "at rest"), (pulled, "at 50 mN")):
    A, B, C, D = system.state_matrices
    response = [C[y] @ np.linalg.solve(2j * np.pi * rate * np.eye(len(A)) - A, B[:, 0]) + D[y, 0] for rate in rates]
    right.loglog(rates, np.abs(response), label=f"{name}: {system.frequencies[0]:.2f} Hz")
right.set(xlabel="frequency [Hz]", ylabel="gain of the end [m/N]")
right.legend()
