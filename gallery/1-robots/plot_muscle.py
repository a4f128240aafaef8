"""
A muscle by its pressure and by its volume
==========================================

A chamber is a cavity that gas fills, driven by its pressure or by the volume that its pump displaces. A tube that a
thread is wound around widens and shortens where the thread runs along it, as a muscle does, and lengthens where it runs
around; at 54.7 degrees it hardly does either.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

inner, outer, length = 0.02, 0.024, 0.08  # [m]

# A box that is bent to a tube: nodes that meet become one.
flat = softcal.box_mesh((outer - inner, 2 * np.pi, length), (1, 6, 4), order=2, origin=(inner, 0.0, 0.0))
r, around, z = flat.points.T
places = np.column_stack([r * np.cos(around), r * np.sin(around), z])
_, first, number = np.unique(places.round(9), axis=0, return_index=True, return_inverse=True)
number = number.ravel()
mesh = softcal.TetMesh(places[first], number[flat.tets])
wall, top = number[flat.face_sets["x0"]], np.unique(number[flat.node_sets["z1"]])
air = softcal.Chamber({"tube": wall}, medium="gas", dead_volume=5e-6)
rubber = {"youngs_modulus": 3e5, "poissons_ratio": 0.49, "fibre_modulus": 1e7}


def blown(angle, control, values):
    """The tube with a cap on top, with fibres at an angle [deg] to its axis, at pressures [Pa] or volumes [m^3]."""
    tube = softcal.Body(
        "tube",
        mesh,
        np.unique(number[flat.node_sets["z0"]]),
        rubber,
        law="neo-hooke-fibres",
        winding=softcal.Winding(np.deg2rad(angle)),
    )
    cap = softcal.Plate("cap", {"tube": top}, (0.0, 0.0, length))
    robot = softcal.Robot((tube,), plates=(cap,), actuators=(softcal.NamedActuator("air", air),))
    response = softcal.simulate(robot, softcal.Protocol({"air": softcal.Command(control, values)}), snapshots=True)
    assert response.succeeded, response.status
    return response


# %%
# Up to 20 kPa at three angles.
pressure = np.linspace(0.0, 20e3, 5)
found = {angle: blown(angle, "pressure", pressure) for angle in (35.0, 54.7, 75.0)}
longer = {angle: one.channels["cap.z"] / length - 1 for angle, one in found.items()}
print({angle: f"{100 * one[-1]:+.1f} %" for angle, one in longer.items()})
assert longer[35.0][-1] < -0.05 < abs(longer[54.7][-1]) < 0.015 < 0.1 < longer[75.0][-1]

# %%
# By the volume that the pump displaced it comes to the same pressure.
volume = found[75.0].channels["air.volume"]
again = blown(75.0, "volume", volume[-1:]).channels["air.pressure"][-1]
print(f"{1e6 * volume[-1]:.1f} ml bring it to {again / 1e3:.3f} kPa")
assert abs(again / pressure[-1] - 1) < 1e-3

figure, axes = plt.subplots(1, 3, figsize=(9, 3.6), layout="constrained")
for ax, angle in zip(axes, (35.0, 75.0), strict=False):
    found[angle].plot_shape(ax=ax)
    ax.set_title(f"thread at {angle:.0f}°")
for angle, one in longer.items():
    axes[2].plot(1e6 * found[angle].channels["air.volume"], 100 * one, "o-", label=f"{angle}°")
axes[2].set(xlabel="volume of the pump [ml]", ylabel="longer by [%]")
axes[2].legend()
