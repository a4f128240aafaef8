"""A twin of three formulas that answers as `softcal.twin.simulate.simulate` does, with exact sensitivities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.rig import Rig
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.mesh import TetMesh
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint

E, NU = "neck.youngs_modulus", "neck.poissons_ratio"
TRUE = {E: 2.3e6, NU: 0.43}
STEADY = {"front.tension_drift": 0.0, "plate.pitch_drift": 0.0}
"""Settings of an experiment whose instruments do not drift: its errors are its noise."""
# tension = E (A g d + B g^3 d^3) with g = 1 + C nu; pitch = K d (1 + D nu d)
A, B, C, K, D = 1.6e-4, 0.02, 0.3, 20.0, 1.0


def fake_robot(youngs_modulus: float = 1.0e6, poissons_ratio: float = 0.45) -> Robot:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float) * 0.01
    body = Body(
        "neck",
        TetMesh(points, np.array([[0, 1, 2, 3]])),
        fixed=np.array([0, 1, 2]),
        parameters={"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio},
    )
    plate = Plate("plate", {"neck": np.array([3])}, reference=np.array([0.0, 0.0, 0.01]))
    front = Cable("front", (ViaPoint(np.zeros(3)), ViaPoint(np.array([0.0, 0.0, 0.01]), "plate")))
    back = Cable("back", (ViaPoint(np.ones(3)), ViaPoint(np.array([0.0, 0.0, 0.01]), "plate")))
    return Robot((body,), (plate,), (front, back))


def _curve(d: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """T / E, its slope by d, and its derivative by nu."""
    g = 1 + C * nu
    return A * g * d + B * g**3 * d**3, A * g + 3 * B * g**3 * d**2, C * (A * d + 3 * B * g**2 * d**3)


def fake_simulate(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    parameters = parameter_values(robot, theta)
    e, nu = parameters[E], parameters[NU]
    ((cable, told),) = protocol.commands.items()
    controls = told.values
    if told.control == "shortening":
        d = controls
        over_e, slope, by_nu = _curve(d, nu)
        d_slope, t_slope = np.ones_like(d), e * slope
        d_by = {E: np.zeros_like(d), NU: np.zeros_like(d)}
        t_by = {E: over_e, NU: e * by_nu}
        tension = e * over_e
    else:
        d = np.zeros_like(controls)
        for _ in range(200):
            over_e, slope, _ = _curve(d, nu)
            d = d - (over_e - controls / e) / slope
        over_e, slope, by_nu = _curve(d, nu)
        tension, t_slope, d_slope = controls, np.ones_like(d), 1 / (e * slope)
        d_by = {E: -over_e / (e * slope), NU: -by_nu / slope}
        t_by = {E: np.zeros_like(d), NU: np.zeros_like(d)}
    p_by_d = K * (1 + 2 * D * nu * d)
    channels = {
        f"{cable}.shortening": d,
        f"{cable}.tension": tension,
        "plate.pitch": K * d * (1 + D * nu * d),
        "plate.roll": np.zeros_like(d),
    }
    by = {
        f"{cable}.shortening": d_by,
        f"{cable}.tension": t_by,
        "plate.pitch": {E: p_by_d * d_by[E], NU: p_by_d * d_by[NU] + K * D * d**2},
    }
    return Response(
        channels,
        {f"{cable}.shortening": "m", f"{cable}.tension": "N", "plate.pitch": "rad", "plate.roll": "rad"},
        "All samples were reached.",
        succeeded=True,
        n_factorisations=20,
        sensitivities={channel: {name: by[channel][name] for name in sensitivities} for channel in by},
        slopes={f"{cable}.shortening": d_slope, f"{cable}.tension": t_slope, "plate.pitch": p_by_d * d_slope},
    )


def soft_necks_fail(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    """As `fake_simulate`, but necks below 1 MPa or beyond nu 0.49 have no equilibrium."""
    parameters = parameter_values(robot, theta)
    if parameters[E] < 1.0e6 or parameters[NU] > 0.49:
        return Response({}, {}, "No equilibrium beyond 12.0 mm.", succeeded=False, n_factorisations=7)
    return fake_simulate(robot, protocol, theta, sensitivities=sensitivities)


def all_necks_fail(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    return Response({}, {}, "No equilibrium beyond 1.0 mm.", succeeded=False, n_factorisations=3)


def fake_experiment(
    name: str = "pull",
    *,
    drive: str = "shortening",
    reach: float = 0.04,
    slack: float = 0.0,
    tension_offset: float = 0.0,
    pitch_offset: float = 0.0,
    noise: float = 0.0,
    sigma: float = 0.0,
    n_samples: int = 41,
    rig: Rig | None = None,
    seed: int = 0,
    true: dict[str, float] | None = None,
    settings: Mapping[str, float] | None = None,
) -> Experiment:
    """What the fake twin gives at TRUE, seen through a rig, with noise [share of each channel's top]."""
    from softcal.twin.protocol import Command

    shortening = np.linspace(0.0, reach, n_samples)
    robot = with_parameters(fake_robot(), true or TRUE)
    pulled = Command("shortening", np.maximum(shortening - slack, 0.0))
    response = fake_simulate(robot, Protocol({"front": pulled}))
    random = np.random.default_rng(seed)
    tension = response.channels["front.tension"] + tension_offset
    pitch = response.channels["plate.pitch"] + pitch_offset
    tension = tension + noise * tension.max() * random.standard_normal(n_samples)
    pitch = pitch + noise * pitch.max() * random.standard_normal(n_samples)
    dataset = Dataset(
        name,
        {
            "shortening": Channel(shortening, "m", sigma * reach),
            "tension": Channel(tension, "N", sigma * 10.0),
            "pitch": Channel(pitch, "rad", sigma),
        },
    )
    return Experiment(name, dataset, "front", "plate", drive, rig=rig or Rig(), settings=settings or {})  # type: ignore[arg-type]
