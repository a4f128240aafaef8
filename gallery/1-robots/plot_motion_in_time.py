"""
Motion in time
==============

`simulate_in_time` integrates the same robot with its masses. A strip that is let go swings at its first natural
frequency, 3.516 / (2 pi) sqrt(E I / (rho A L^4)).
"""

import numpy as np

import softcal

E, density, length, width, thickness, n = 2e7, 1100.0, 0.2, 0.01, 0.004, 16
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
# Pulled slowly to the side, and let go after a second.
schedule = softcal.Schedule(
    np.array([0.0, 1.0, 1.01, 2.5]), {"rope": softcal.Command("tension", np.array([0.0, 0.004, 0.0, 0.0]))}
)
settings = softcal.TimeSettings(time_step=0.002, rayleigh_stiffness=5e-4, rayleigh_mass=0.0)
motion = softcal.simulate_in_time(robot, schedule, settings)
print(motion.status)
time, y = motion.channels["time"], motion.channels["end.y"]
free = time > 1.1
crossings = time[free][1:][np.diff(np.sign(y[free])) != 0]
frequency = 0.5 / np.diff(crossings).mean()
inertia, area = width * thickness**3 / 12, width * thickness
exact = 3.516 / (2 * np.pi) * np.sqrt(E * inertia / (density * area * length**4))
print(f"{frequency:.3f} Hz, by the theory of beams {exact:.3f} Hz")
assert abs(frequency / exact - 1) < 0.03

motion.plot("end.y", "time")
