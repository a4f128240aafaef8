"""A manipulator like paper B's, hanging: discs on helical springs, six cables, and what its bench would measure."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import Frame, rotation
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.rig import Rig
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.centreline import helix
from softcal.geometry.section import RoundBar
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Marker, Plate, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate

LENGTH, DISC, TURNS, PER_TURN = 0.425, 0.008, 3, 12
MODULI = {f"spring{i + 1}.youngs_modulus": value for i, value in enumerate((0.7e9, 0.85e9, 1.1e9, 0.75e9))}
FORCES = (4.905, 9.81, 14.715)
CABLES = tuple(f"cable{k + 1}" for k in range(6))
MARKERS = ("m1", "m2", "m3", "m4")
FREE = tuple(FreeParameter(name, "Pa", 0.1e9, 10e9, "log") for name in MODULI)
TIED = FreeParameter("springs.youngs_modulus", "Pa", 0.1e9, 10e9, "log", of=("spring*.youngs_modulus",))


def manipulator(youngs_modulus: float = 1.6e9) -> Robot:
    """Discs `base`, `S1` to `S4` with springs between, cables 1 to 3 to S2 and 4 to 6 to S4, a marker on every disc."""
    height = LENGTH / 4
    discs = ("base", "S1", "S2", "S3", "S4")
    plates = tuple(
        Plate(name, {}, np.array([0.0, 0.0, -i * height]), mass=0.02, fixed=i == 0) for i, name in enumerate(discs)
    )
    rods = []
    for i in range(4):
        line = helix(
            (0.0, 0.0, -i * height - DISC / 2),
            (0.0, 0.0, -1.0),
            diameter=0.03,
            pitch=(height - DISC) / TURNS,
            turns=TURNS,
            at=TURNS * PER_TURN,
            towards=(1.0, 0.0, 0.0),
        )
        last = len(line.nodes) - 1
        rods.append(
            Rod(
                f"spring{i + 1}",
                line,
                RoundBar(0.010),
                {"youngs_modulus": youngs_modulus, "poissons_ratio": 0.43},
                clamped={discs[i]: np.array([0]), discs[i + 1]: np.array([last])},
                density=900.0,
            )
        )
    cables = []
    for k, name in enumerate(CABLES):
        angle = 2 * np.pi * (k % 3) / 3 + (np.pi / 3 if k >= 3 else 0.0)
        hole = 0.025 * np.array([np.cos(angle), np.sin(angle), 0.0])
        down = np.array([0.0, 0.0, -height])
        last = 2 if k < 3 else 4
        via = [ViaPoint(hole - 0.5 * down), *(ViaPoint(hole + j * down, discs[j]) for j in range(last + 1))]
        cables.append(Cable(name, tuple(via), pulled_end="first"))
    markers = tuple(Marker(f"m{j}", discs[j], np.array([0.02, 0.0, -j * height])) for j in range(1, 5))
    return Robot(
        plates=plates, rods=tuple(rods), cables=tuple(cables), gravity=np.array([0.0, 0.0, -9.81]), markers=markers
    )


@functools.cache
def true_places(cable: str, forces: tuple[float, ...] = FORCES) -> Mapping[str, np.ndarray]:
    """Positions [m] of the markers, (n, 3), with the cable pulled by the forces [N] and the springs as in `MODULI`."""
    command = Command("tension", np.array(forces))
    response = simulate(manipulator(), Protocol({cable: command}), MODULI, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return {m: np.column_stack([response.channels[f"{m}.{axis}"] for axis in "xyz"]) for m in MARKERS}


def experiment(
    cable: str,
    *,
    noise: float = 0.0,
    seed: int = 0,
    frame: Sequence[float] = (0.0,) * 6,
    nominal: Mapping[str, float] | None = None,
    forces: tuple[float, ...] = FORCES,
) -> Experiment:
    """The markers at each force as a camera sees them in its frame (t [m], r [rad]), with noise [m] on every number."""
    random = np.random.default_rng([seed, CABLES.index(cable)])
    channels = {f"{cable}.tension": Channel(np.array(forces), "N")}
    for marker, places in true_places(cable, forces).items():
        seen = places @ rotation(np.array(frame[3:])).T + np.array(frame[:3])
        seen = seen + noise * random.standard_normal(seen.shape)
        channels |= {f"{marker}.{axis}": Channel(seen[:, k], "m", noise) for k, axis in enumerate("xyz")}
    rig = Rig(length=LENGTH, frame=Frame(**(nominal or {})))
    return Experiment(cable, Dataset(cable, channels), drive=(f"{cable}.tension",), rig=rig)
