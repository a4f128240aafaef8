"""
Silicone that softens: Mullins' effect
======================================

The first pull of a rubber is stiffer than all that stay below it. A body has such a memory by its `history`; the
samples of the protocol are then the way, in their order.
"""

import numpy as np

import softcal

mesh = softcal.box_mesh((0.01, 0.01, 0.04), (1, 1, 2))
strip = softcal.Body(
    "strip",
    mesh,
    fixed=mesh.node_sets["z0"],
    parameters={
        "youngs_modulus": 0.5e6,
        "poissons_ratio": 0.45,
        "softening_amount": 3.0,  # Ogden and Roxburgh's r, m and beta
        "softening_energy": 2e4,
        "softening_range": 0.1,
    },
    history=("softening",),
)
grip = softcal.Plate("grip", {"strip": mesh.node_sets["z1"]}, (0.005, 0.005, 0.04))
rope = softcal.Cable("rope", (softcal.ViaPoint((0.005, 0.005, 0.04), "grip"), softcal.ViaPoint((0.005, 0.005, 0.2))))
robot = softcal.Robot(bodies=(strip,), plates=(grip,), cables=(rope,))

# %%
# Pulled to 15 mm, let go, pulled to 15 mm again and on to 25 mm.
up, n = np.linspace(0.0, 1.0, 16), 16
way = np.concatenate([0.015 * up, 0.015 * up[::-1][1:], 0.025 * up[1:]])
response = softcal.simulate(robot, softcal.Protocol({"rope": softcal.Command("shortening", way)}))
assert response.succeeded, response.status
tension, d = response.channels["rope.tension"], response.channels["rope.shortening"]

first, again = np.interp(0.01, d[:n], tension[:n]), np.interp(0.01, d[2 * n - 2 :], tension[2 * n - 2 :])
print(f"at 10 mm: {first:.3f} N in the first pull, {again:.3f} N in the second")
assert again < 0.9 * first

# %%
# On the way back and in the second pull the strip is the same; beyond the largest strain so far it is as if new.
virgin = softcal.simulate(robot, softcal.pull(robot, "rope", "shortening", 0.025)).channels
back = np.interp(0.01, d[n - 1 : 2 * n - 1][::-1], tension[n - 1 : 2 * n - 1][::-1])
assert abs(again / back - 1) < 0.02
assert abs(tension[-1] / virgin["rope.tension"][-1] - 1) < 1e-3

axes = response.plot("rope.tension", "rope.shortening")
axes.set_title("A first pull, and a second one that goes further")
