"""
A motor that pulls one cable and pays out the other
===================================================

A drive winds cables on its pulley. Turned to and fro, a motor with backlash turns freely on the way back, while the
robot stands still; friction along the cables, with its memory, opens the loop further.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

E, length, arm, radius, backlash = 1e9, 0.1, 0.01, 0.008, np.radians(20.0)
line = softcal.straight((0.0, 0.0, 0.0), (0.0, 0.0, length), 3)
material = {"youngs_modulus": E, "poissons_ratio": 0.35}
spine = softcal.Rod("spine", line, softcal.RoundBar(0.003), material, fixed=[0], clamped={"tip": [3]})
tip = softcal.Plate("tip", {}, (0.0, 0.0, length))
cables = [
    softcal.Cable(
        name,
        (softcal.ViaPoint((2 * x, 0, 0)), softcal.ViaPoint((x, 0, 0)), softcal.ViaPoint((x, 0, length), "tip")),
        friction_coefficient=0.2,
        pulled_end="first",
        line=softcal.CableLine(stiffness=2e3, pretension=1.0, friction_memory=True, presliding=1e-4),
    )
    for name, x in (("left", arm), ("right", -arm))
]


def turned(gear_backlash):
    """The robot as its motor turns to 40 degrees and back to -40 degrees."""
    drive = softcal.Drive({"left": 1.0, "right": -1.0}, radius, gear_backlash=gear_backlash)
    robot = softcal.Robot(
        plates=(tip,), rods=(spine,), cables=cables, actuators=(softcal.NamedActuator("servo", drive),)
    )
    response = softcal.simulate(robot, softcal.Protocol({"servo": softcal.Command("angle", angle)}), snapshots=True)
    assert response.succeeded, response.status
    return response


angle = np.radians(np.concatenate([np.linspace(0, 40, 3), np.linspace(36, -40, 20)]))
with_backlash, without = turned(backlash), turned(None)

# %%
# At no torque the motor turns by the backlash, and the robot does not move.
torque, pitch = with_backlash.channels["servo.torque"], np.degrees(with_backlash.channels["tip.pitch"])
free = (np.abs(torque) < 5e-4) & (np.arange(len(angle)) > 2)
print(f"free over {np.degrees(np.ptp(angle[free])):.0f} deg, in which the tip turns by {np.ptp(pitch[free]):.3f} deg")
assert abs(np.ptp(angle[free]) - backlash) < np.radians(4.1)
assert np.ptp(pitch[free]) < 0.02 * np.ptp(pitch)

# %%
# The motor's torque is that of the tensions on its pulley.
tensions = [with_backlash.channels[f"{name}.tension"] for name in ("left", "right")]
assert np.allclose(torque, radius * (tensions[0] - tensions[1]), atol=1e-9)

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
with_backlash.plot_shape(ax=left)
for response, name in ((without, "without backlash"), (with_backlash, "with 20° of backlash")):
    right.plot(np.degrees(angle), 1e3 * response.channels["servo.torque"], label=name)
right.set(xlabel="angle of the motor [deg]", ylabel="torque [mN m]")
right.legend()
