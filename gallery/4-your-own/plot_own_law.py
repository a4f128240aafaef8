"""
A law of your own
=================

A law is an energy as text with its constants; derivatives, project files, calibration and charts follow from it. Here
Gent's, whose chains cannot be stretched beyond a limit, pulled in a strip and compared with the stress by hand.
"""

import matplotlib.pyplot as plt
import numpy as np

import softcal

gent = softcal.register_law(
    softcal.Law(
        name="gallery-gent",
        parameters=(
            softcal.Parameter("shear_modulus", "mu", "μ", softcal.quantity("modulus"), typical=4e5),
            softcal.Parameter("limit", "Jm", "J_m", softcal.quantity("positive ratio"), typical=50.0),
            softcal.Parameter("bulk_modulus", "kappa", "κ", softcal.quantity("modulus"), typical=5e6),
        ),
        symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
        distortional="-mu*Jm/2*log(1 - (I1_bar - 3)/Jm)",
        volumetric_strain="J - 1",
        bulk="kappa",
        reference="Gent, Rubber Chemistry and Technology 69 (1996) 59",
    )
)
constants = {"shear_modulus": 0.2e6, "limit": 4.0, "bulk_modulus": 100e6}
print(f"at small strain E {gent.youngs_modulus(constants) / 1e6:.4f} MPa, nu {gent.poissons_ratio(constants):.4f}")
assert abs(gent.youngs_modulus(constants) / 0.6e6 - 1) < 1e-2

# %%
# A long thin strip, so that its clamped ends matter little.
side, length = 0.002, 0.06
mesh = softcal.box_mesh((side, side, length), (1, 1, 10))
strip = softcal.Body("strip", mesh, fixed=mesh.node_sets["z0"], law="gallery-gent", parameters=constants)
middle = (side / 2, side / 2)
grip = softcal.Plate("grip", {"strip": mesh.node_sets["z1"]}, (*middle, length))
rope = softcal.Cable("rope", (softcal.ViaPoint((*middle, length), "grip"), softcal.ViaPoint((*middle, 4 * length))))
robot = softcal.Robot(bodies=(strip,), plates=(grip,), cables=(rope,))
response = softcal.simulate(robot, softcal.pull(robot, "rope", "shortening", 1.0 * length, samples=31))
assert response.succeeded, response.status

stretch = 1 + response.channels["rope.shortening"] / length
invariant = stretch**2 + 2 / stretch - 3
exact = constants["shear_modulus"] * 4.0 / (4.0 - invariant) * (stretch - stretch**-2)
stress = response.channels["rope.tension"] / side**2
off = np.abs(stress[1:] / exact[1:] - 1).max()
print(
    f"at a stretch of 2: {stress[-1] / 1e6:.4f} MPa, by hand {exact[-1] / 1e6:.4f} MPa; at most {100 * off:.1f} % off"
)
assert off < 0.03

figure, axes = plt.subplots(figsize=(6, 3.8), layout="constrained")
axes.plot(stretch, stress / 1e6, lw=4, color="0.75", label="twin")
axes.plot(stretch, exact / 1e6, "k--", label="by hand, incompressible")
neo_hooke = constants["shear_modulus"] * (stretch - stretch**-2)
axes.plot(stretch, neo_hooke / 1e6, ":", label="without the limit: neo-Hooke")
axes.set(xlabel="stretch [-]", ylabel="nominal stress [MPa]")
axes.legend()
