"""A cable that stretches against MuJoCo's spatial tendon: lengths, tensions and equilibria.

MuJoCo's tendon through sites is a spring of the length beyond its own; from 0 to that length it is slack.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mechanics_cases import pulled
from scipy.optimize import root

from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.twin.cables import CableLine
from softcal.twin.robot import Cable, Plate, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate

mujoco: Any = pytest.importorskip("mujoco", reason="MuJoCo, a peer of the benchmarks, is not installed")

E, WIRE, PIECE = 2e5, 0.03, 0.1
SPRING = E * RoundBar(WIRE).constants.area / PIECE  # of a rod along its axis [N/m]
MASSES = (0.03, 0.05)
RATE, PRETENSION = 400.0, 3.0
SHORTENINGS = np.linspace(0.0, 0.045, 10)
# On both sides of the axis, the plates' points at other distances: forces across the axis are in balance.
HALF = ((-0.08, "", 0.3), (-0.03, "lower", 0.1), (-0.05, "", 0.3), (-0.01, "upper", 0.2))


def via_points() -> list[tuple[np.ndarray, str]]:
    half = [(np.array([x, 0.0, z]), on) for x, on, z in HALF]
    return [*half, *((point * [-1, 1, 1], on) for point, on in reversed(half))]


def chain(line: CableLine) -> Robot:
    """Two plates on two wires along one axis, stretched by weights (gravity is along +z) and a cable through both."""
    rods = tuple(
        Rod(
            name,
            straight((0.0, 0.0, low), (0.0, 0.0, low + PIECE), 1, first=(1.0, 0.0, 0.0)),
            RoundBar(WIRE),
            {"youngs_modulus": E, "poissons_ratio": 0.3},
            clamped=clamped,
            fixed=fixed,
        )
        for name, low, clamped, fixed in (
            ("below", 0.0, {"lower": np.array([1])}, np.array([0])),
            ("above", PIECE, {"lower": np.array([0]), "upper": np.array([1])}, np.zeros(0, dtype=np.int64)),
        )
    )
    plates = tuple(
        Plate(name, {}, np.array([0.0, 0.0, z]), mass=mass)
        for name, z, mass in zip(("lower", "upper"), (PIECE, 2 * PIECE), MASSES, strict=True)
    )
    cable = Cable("front", tuple(ViaPoint(at, on) for at, on in via_points()), line=line)
    return Robot(plates=plates, rods=rods, cables=(cable,), gravity=np.array([0.0, 0.0, 9.81]))


def tendon_of(bodies: dict[str, str], points: list[tuple[np.ndarray, str]], origin: dict[str, np.ndarray]) -> Any:
    """MuJoCo's model with bodies (joint and inertia, in XML) and one tendon through points given at rest."""
    sites: dict[str, str] = dict.fromkeys(["", *bodies], "")
    for i, (at, on) in enumerate(points):
        sites[on] += f'<site name="s{i}" pos="{" ".join(map(repr, (at - origin.get(on, np.zeros(3))).tolist()))}"/>'
    inside = "".join(
        f'<body name="{name}" pos="{" ".join(map(str, origin[name]))}">{inner}{sites[name]}</body>'
        for name, inner in bodies.items()
    )
    through = "".join(f'<site site="s{i}"/>' for i in range(len(points)))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 9.81"/><worldbody>{sites[""]}{inside}</worldbody>'
        f'<tendon><spatial name="front" stiffness="{RATE!r}" springlength="0 1">{through}</spatial></tendon></mujoco>'
    )


def tension(model: Any, data: Any) -> float:
    return model.tendon_stiffness[0] * max(data.ten_length[0] - model.tendon_lengthspring[0, 1], 0.0)


@pytest.mark.parametrize("pretension", [PRETENSION, None])
def test_equilibria_of_a_chain_of_two_plates_are_those_of_mujoco(pretension):
    line = CableLine(spring_rate=RATE, pretension=pretension)
    found = simulate(chain(line), pulled(*SHORTENINGS), curve_tolerance=0.0)
    assert found.succeeded, found.status

    slider = '<joint type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="{}" diaginertia="1e-4 1e-4 1e-4"/>'
    origin = {"lower": np.array([0.0, 0.0, PIECE]), "upper": np.array([0.0, 0.0, 2 * PIECE])}
    bodies = {name: slider.format(mass) for name, mass in zip(origin, MASSES, strict=True)}
    model = tendon_of(bodies, via_points(), origin)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rest = float(data.ten_length[0])

    def residual(q: np.ndarray) -> np.ndarray:
        """Force [N] on each plate, of the tendon and of the weights by MuJoCo, and of the wires."""
        data.qpos[:] = q
        mujoco.mj_forward(model, data)
        pull = SPRING * np.diff([0.0, *q])
        return data.qfrc_passive - data.qfrc_bias - pull + [pull[1], 0.0]

    q = np.zeros(2)
    for i, d in enumerate(SHORTENINGS):
        model.tendon_lengthspring[0, 1] = rest - d - (pretension or 0.0) / RATE
        solution = root(residual, q, tol=1e-13)
        assert np.abs(residual(solution.x)).max() < 1e-9
        q = solution.x
        theirs = [*(origin[name][2] + z for name, z in zip(origin, q, strict=True)), tension(model, data)]
        ours = [found.channels[name][i] for name in ("lower.z", "upper.z", "front.tension")]
        np.testing.assert_allclose(ours, theirs, rtol=1e-8)
    assert (found.channels["front.tension"] < 1e-9).any() == (pretension is None)  # slack at first
    assert found.channels["front.tension"][-1] > 1.0
