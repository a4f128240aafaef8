"""
What the mesh does to a number
==============================

Linear tets lock in bending, and the more so the nearer Poisson's ratio is to 0.5. Elements of quadratic displacement
with linear pressure, softcal's default, do not. The bending stiffness of a bar against that of a beam, on ever finer
meshes.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

side, length, E, nu = 0.01, 0.12, 1e6, 0.49


def stiffness(element, layers):
    """The moment of a bar over its rotation, over E I / L."""
    mesh = softcal.box_mesh((side, side, length), (layers, layers, 6 * layers))
    material = {"youngs_modulus": E, "poissons_ratio": nu}
    bar = softcal.Body("bar", mesh, fixed=mesh.node_sets["z0"], parameters=material, element=element)
    end = softcal.Plate("end", {"bar": mesh.node_sets["z1"]}, (side / 2, side / 2, length))
    moment = 1e-5
    robot = softcal.Robot(bodies=(bar,), plates=(end,), loads=(softcal.Moment("m", "end", (0.0, moment, 0.0)),))
    pitch = softcal.simulate(robot, softcal.Protocol({})).channels["end.pitch"][0]
    return moment / abs(pitch) * length / (E * side**4 / 12)


layers = {"P1": (1, 2, 3, 4, 6), "P2": (1, 2, 3), "P2P1": (1, 2, 3)}
found = {element: [stiffness(element, n) for n in numbers] for element, numbers in layers.items()}
for element, values in found.items():
    print(element, dict(zip(layers[element], np.round(values, 3).tolist(), strict=True)))

# %%
# Two quadratic elements across are within a few per cent of the beam (the clamp takes a little); six linear ones
# are not.
assert abs(found["P2P1"][1] - 1) < 0.05
assert found["P1"][-1] > 1.5
assert np.all(np.diff(found["P1"]) < 0)

figure, axes = plt.subplots(figsize=(6, 3.8), layout="constrained")
for element, values in found.items():
    axes.semilogy(layers[element], values, "o-", label=element)
axes.axhline(1.0, color="0.5", ls="--", label="beam")
axes.set(xlabel="bricks across", ylabel="stiffness in bending over E I / L", xticks=range(1, 7))
axes.set_yticks([1, 2, 5, 10, 20], ["1", "2", "5", "10", "20"])
axes.legend()
