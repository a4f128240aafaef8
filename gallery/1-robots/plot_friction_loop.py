"""
A cable that rubs: the loop of a pull and its way back
======================================================

With a memory of its friction a cable is held on the way back by what it slides on. Over a drum of constant wrap the
force behind it is T exp(-mu phi) on the way in, and T exp(mu phi) on the way back: the two branches differ by exp(2
mu phi).
"""

import numpy as np

import softcal

mu, radius, lead = 0.15, 0.02, 0.3
mesh = softcal.box_mesh((0.01, 0.01, 0.1), (1, 1, 3), origin=(-0.005, -0.005, 0.0))
material = {"youngs_modulus": 0.4e6, "poissons_ratio": 0.45}
band = softcal.Body("band", mesh, fixed=mesh.node_sets["z0"], parameters=material)
head = softcal.Plate("head", {"band": mesh.node_sets["z1"]}, (0.0, 0.0, 0.1))
turn = np.linspace(0.0, np.pi / 2, 25)
drum = [softcal.ViaPoint((radius - radius * np.cos(a), 0.0, 0.1 + lead + radius * np.sin(a))) for a in turn]
machine = softcal.ViaPoint((0.2, 0.0, 0.1 + lead + radius))
cable = softcal.Cable(
    "cable",
    (softcal.ViaPoint((0.0, 0.0, 0.1), "head"), *drum, machine),
    friction_coefficient=mu,
    line=softcal.CableLine(friction_memory=True, presliding=1e-6),
)
robot = softcal.Robot(bodies=(band,), plates=(head,), cables=(cable,))

# %%
# Two cycles between 4 and 20 mm.
way = 1e-3 * np.concatenate([np.linspace(0, 20, 21), np.linspace(19, 4, 16), np.linspace(5, 20, 16)])
response = softcal.simulate(robot, softcal.Protocol({"cable": softcal.Command("shortening", way)}))
assert response.succeeded, response.status
tension = response.channels["cable.tension"]

pulled, let_go = tension[way == 0.012][:2]
print(f"at 12 mm: {pulled:.3f} N as it is pulled, {let_go:.3f} N as it is let go, ratio {pulled / let_go:.4f}")
wrap = 2 * mu * np.pi / 2
print(f"capstan: exp(2 mu phi) = {np.exp(wrap):.4f}")
assert abs(pulled / let_go / np.exp(wrap) - 1) < 0.01
lost = np.trapezoid(tension[20:], way[20:])
print(f"a cycle takes {1e3 * lost:.2f} mJ")
assert lost > 0

response.plot("cable.tension", "cable.shortening")
