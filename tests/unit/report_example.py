"""Synthetic report content for the tests: a bent column as twin, cyclic data, searches with failures."""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay

from softcal.calibration.results.result import CalibrationResult, ExperimentFit, Trial
from softcal.calibration.statistics.estimate import Estimate
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.geometry.mesh import TetMesh
from softcal.materials.infill import PrintInfill
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.twin_view import TwinView
from softcal.twin.response import Snapshot
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, ViaPoint

E_NAME, NU_NAME = "neck.youngs_modulus", "neck.poissons_ratio"


def column_mesh(height: float = 0.1067, radius: float = 0.019, n_rings: int = 12) -> TetMesh:
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    ring = np.concatenate([[[0.0, 0.0]], radius * np.column_stack([np.cos(angle), np.sin(angle)])])
    levels = np.linspace(0, height, n_rings)
    points = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in levels])
    return TetMesh(points, positive(points, Delaunay(points, qhull_options="QJ").simplices))


def positive(points: np.ndarray, tets: np.ndarray) -> np.ndarray:
    edges = points[tets[:, 1:]] - points[tets[:, :1]]
    volume = np.linalg.det(edges)
    tets = tets[np.abs(volume) > 1e-12].copy()
    wrong = np.linalg.det(points[tets[:, 1:]] - points[tets[:, :1]]) < 0
    tets[wrong] = tets[wrong][:, [0, 2, 1, 3]]
    return tets


def neck_robot(mesh: TetMesh, socket: float = 0.014, collar: float = 0.0966) -> Robot:
    z = mesh.points[:, 2]
    top = float(z.max())
    cables = tuple(
        Cable(
            name,
            (
                ViaPoint((0.05 * np.cos(a), 0.05 * np.sin(a), socket)),
                ViaPoint((0.05 * np.cos(a), 0.05 * np.sin(a), top), on="plate"),
            ),
        )
        for name, a in (("front", 0.0), ("left", 2 * np.pi / 3), ("right", 4 * np.pi / 3))
    )
    body = Body("neck", mesh, np.flatnonzero(z <= socket), {"youngs_modulus": 2e6, "poissons_ratio": 0.45})
    plate = Plate("plate", {"neck": np.flatnonzero(z >= collar)}, np.array([0.0, 0.0, top]), mass=0.1)
    load = PointLoad("payload", "plate", np.array([0.0, 0.0, top]), np.array([0.0, 0.0, -5.0]))
    return Robot((body,), (plate,), cables, (load,), gravity=np.array([0.0, 0.0, -9.81]))


def bent_by(points: np.ndarray, angle: float, low: float, high: float) -> np.ndarray:
    share = np.clip((points[:, 2] - low) / (high - low), 0, 1)
    theta, length = angle * share, high - low
    curve = length / max(angle, 1e-9)
    x = curve * (1 - np.cos(theta)) + points[:, 0] * np.cos(theta)
    z = low + curve * np.sin(theta) - points[:, 0] * np.sin(theta)
    rest = np.where(points[:, 2] < low, points[:, 2] - low, np.where(points[:, 2] > high, points[:, 2] - high, 0.0))
    return np.column_stack([x + rest * np.sin(theta), points[:, 1], z + rest * np.cos(theta)])


def twin_view(mesh: TetMesh, angle: float = 0.7) -> TwinView:
    robot = neck_robot(mesh)
    snapshots = []
    for label, theta in (("At rest", 1e-9), (f"Largest pitch: {np.rad2deg(angle):.1f} deg", angle)):

        def move(points: np.ndarray, theta: float = theta) -> np.ndarray:
            return bent_by(np.atleast_2d(points), theta, 0.014, 0.0966)

        routes = {
            cable.name: np.concatenate([cable.via_points[0].at[None], move(cable.via_points[1].at)])
            for cable in robot.cables
        }
        rotation = np.array([[np.cos(theta), 0, np.sin(theta)], [0, 1, 0], [-np.sin(theta), 0, np.cos(theta)]])
        plates = {"plate": (move(robot.plates[0].reference)[0], rotation)}
        snapshots.append(Snapshot(label, {"neck": move(mesh.points)}, routes, plates, {"front": 0.04 * theta}))
    return TwinView(robot, snapshots[0], snapshots[1], {"neck": mesh.tets})


def bench_experiment(
    name: str, travel: float, modulus: float, *, pitch: bool = True, seed: int = 0
) -> ExperimentContent:
    rng = np.random.default_rng(seed)
    time, shortening, tension, angle, cycle = [], [], [], [], []
    for number in range(-1, 8):
        phase = np.linspace(0, 1, 200)
        d = travel * (1 - np.abs(2 * phase - 1)) * (0.3 if number < 0 else 1.0)
        up = phase < 0.5
        base = 170e-6 * modulus * d * (1 + 6 * d)
        loop = 1 + 0.05 * np.where(up, 1, -1) * np.sin(np.pi * d / travel) + 0.08 * (number == 0) * up
        tension.append(np.maximum(base * loop + 0.02 * rng.normal(size=200), 0.1))
        shortening.append(d)
        angle.append(d / 0.05 + 0.002 * rng.normal(size=200))
        time.append((number + 1 + phase) * 2 * travel / 0.002)
        cycle.append(np.full(200, number))
    channels = {
        "time": Channel(np.concatenate(time), "s"),
        "shortening": Channel(np.concatenate(shortening), "m"),
        "tension": Channel(np.concatenate(tension), "N", 0.02),
    }
    if pitch:
        channels["pitch"] = Channel(np.concatenate(angle), "rad", 0.002)
    steps = (
        Step("read", {"file": f"{name}.csv", "delimiter": ";"}, "1800 samples"),
        Step("pulley friction", {"n": 2, "friction_coefficient": 0.1, "wrap_angle": np.pi}, "force times 0.5335"),
        Step("cycles", {"lower_limit": 0.1}, "8 cycles"),
    )
    record = Dataset(name, channels, steps, np.concatenate(cycle))
    d = np.linspace(0, travel, 50)
    used = {
        "shortening": Channel(d, "m"),
        "tension": Channel(170e-6 * modulus * d * (1 + 6 * d), "N", 0.02),
    }
    if pitch:
        used["pitch"] = Channel(d / 0.05, "rad", 0.002)
    chosen = Step("branch", {"branch": "loading", "cycles": [2, 3, 4, 5, 6, 7, 8]}, "50 samples")
    return ExperimentContent(name, record, Dataset(name, used, (*steps, chosen)), record)


def fit_of(experiment: ExperimentContent, *, error: float = 0.02) -> ExperimentFit:
    data = experiment.prepared
    wave = np.sin(np.linspace(0, 9, data.n_samples))
    measured = {name: data.values(name) for name in ("tension", "pitch") if name in data.channels}
    simulated = {
        "tension": data.values("tension") * (1 + error * wave) + 0.03,
        "pitch": data.values("shortening") / 0.0505,
    }
    rmse = {name: float(np.sqrt(np.mean((simulated[name] - values) ** 2))) for name, values in measured.items()}
    return ExperimentFit(
        rmse, {k: 0.6 * v for k, v in rmse.items()}, measured, simulated, {"tension": "N", "pitch": "rad"}
    )


def tpe_result(
    experiments: list[ExperimentContent], modulus: float, ratio: float, *,
    n_trials: int = 300, seed: int = 1, errors: tuple[float, float] | None = None, slack: bool = False,
) -> CalibrationResult:  # fmt: skip
    rng = np.random.default_rng(seed)
    trials = []
    for number in range(n_trials):
        width = 1.2 if number < 30 else 0.25
        e = float(np.clip(modulus * np.exp(width * rng.normal()), 1e5, 4e7))
        nu = float(np.clip(ratio + 0.1 * width * rng.normal(), 0.4, 0.4999))
        theta = {E_NAME: e, NU_NAME: nu}
        if e < 2.5e5:
            reason = (
                f"No equilibrium at {1e3 * rng.random():.1f} mm of shortening: det F fell below zero in tet {number}"
            )
            trials.append(Trial(number, theta, "FAILED", None, reason))
            continue
        loss = 0.2 + 3 * abs(np.log(e / modulus) + 2 * (nu - ratio)) + 4 * (nu - ratio) ** 2
        trials.append(Trial(number, theta, "COMPLETE", loss, n_factorisations=24, seconds=0.1))
    best = min(t.loss for t in trials if t.loss is not None)
    error_e, error_nu = errors or (None, None)
    parameters = {
        E_NAME: Estimate(modulus, "Pa", False, 1e5, 4e7, error_e),
        NU_NAME: Estimate(ratio, "1", ratio > 0.4998, 0.4, 0.4999, error_nu),
    }
    if slack:
        parameters |= {
            f"front.slack[{e.name}]": Estimate(0.002 + 0.001 * i, "m", False, 0.0, 0.01, 1e-4)
            for i, e in enumerate(experiments)
        }
    return CalibrationResult(
        parameters, best, "papers", "least-squares" if errors else "tpe", seed, n_trials, 24 * n_trials, 96.3,
        "The trial budget was used up", {e.name: fit_of(e) for e in experiments}, {E_NAME: 0.972, NU_NAME: 0.028},
        tuple(trials), sum(t.state == "FAILED" for t in trials), {"mesh": "3f5a" * 16},
        {"softcal": "0.1.0", "numpy": "2.3"}, extra={"importance_kind": "sensitivity" if errors else "fanova"},
    )  # fmt: skip


def example_content(mesh: TetMesh | None = None, *, n_trials: int = 60) -> ReportContent:
    speeds = (("20 mm, 2 mm/s", 0.020, 1.2e6, 0.497), ("20 mm, 5 mm/s", 0.020, 1.9e6, 0.446),
              ("35 mm, 2 mm/s", 0.035, 2.3e6, 0.431))  # fmt: skip
    experiments = {n: bench_experiment(n, d, e, pitch=i != 1, seed=i) for i, (n, d, e, _) in enumerate(speeds)}
    results = {
        n: tpe_result([experiments[n]], e, nu, n_trials=n_trials, seed=i) for i, (n, _, e, nu) in enumerate(speeds)
    }
    results["joint"] = tpe_result(
        list(experiments.values()), 1.9e6, 0.46, n_trials=n_trials, errors=(2.1e4, 0.031), slack=True
    )
    return ReportContent(
        "Soft neck, bench of May", results, experiments, twin_view(mesh or column_mesh()),
        print_infill=PrintInfill((8e6, 12e6), 0.3, (1.2, 1.6)), versions={"python": "3.11"},
        hashes={"project": "ab" * 32},
        created="2026-11-21",
    )  # fmt: skip
