"""Soft robots for tests of the search: a hanging tentacle before a camera, a notched finger on a testing machine."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from mechanics_cases import column_robot, side_cable

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import rotation
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.rig import Rig
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.cables import CableLine
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Body, Cable, Marker, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

TENTACLE_E, TENTACLE_NU = 140e3, 0.49
LENGTH, WIDTH = 0.12, 0.018
TENDONS = ("front", "left", "right")
CAMERA = (0.004, -0.006, 0.4, 0.03, -0.05, 0.08)  # t [m], rotation vector [rad]: it looks at the tentacle from 400 mm
FINGER_E, FINGER_NU = 550e3, 0.45


def tentacle(element: str = "P2P1") -> Robot:
    """Of silicone, square, hanging from its base, with three tendons and four markers."""
    divisions = (2, 2, 6)
    mesh = box_mesh((WIDTH, WIDTH, LENGTH), divisions, origin=(-WIDTH / 2, -WIDTH / 2, -LENGTH))
    body = Body(
        "tentacle",
        mesh,
        mesh.node_sets["z1"],
        {"youngs_modulus": TENTACLE_E, "poissons_ratio": TENTACLE_NU},
        element=element,
        density=1070.0,
    )
    tip = Plate("tip", {"tentacle": mesh.node_sets["z0"]}, (0.0, 0.0, -LENGTH), mass=0.004)
    cables: list[Cable] = []
    for k, name in enumerate(TENDONS):
        angle = 2 * np.pi * k / 3 + 0.3
        x, y = 0.006 * np.cos(angle), 0.006 * np.sin(angle)
        inside = [ViaPoint((x, y, z), "tentacle") for z in (-0.02, -0.045, -0.07, -0.095)]
        cables.append(
            Cable(name, (ViaPoint((x, y, 0.005)), *inside, ViaPoint((x, y, -LENGTH), "tip")), pulled_end="first")
        )
    heights = (-0.03, -0.06, -0.09)
    markers = [Marker(f"m{k + 1}", "tentacle", (WIDTH / 2, 0.0, z)) for k, z in enumerate(heights)]
    markers.append(Marker("m4", "tip", (0.0, 0.0, -LENGTH)))
    return Robot((body,), (tip,), tuple(cables), gravity=np.array([0.0, 0.0, -9.81]), markers=tuple(markers))


TENTACLE = tentacle("P1")
ROUGH = replace(
    TENTACLE,
    cables=tuple(replace(c, friction_coefficient=0.1, line=CableLine(friction_memory=True)) for c in TENTACLE.cables),
)
COLUMN = column_robot(
    "P1", cables=tuple(side_cable(f"c{k}", (0.05 * np.cos(2 * k), 0.05 * np.sin(2 * k))) for k in range(3))
)


@functools.cache
def _pulled(element: str, cable: str, forces: tuple[float, ...]) -> Response:
    seen = simulate(tentacle(element), Protocol({cable: Command("tension", np.array(forces))}), curve_tolerance=0.0)
    assert seen.succeeded, seen.status
    return seen


def tentacle_problem(
    loss: Loss,
    *,
    element: str = "P2P1",
    bounds: tuple[float, float] = (20e3, 1e6),
    scale: str = "log",
    frame_z: tuple[float, float] = (0.3, 0.5),
    frame: tuple[float, float] = (0.1, 0.35),
    nu: tuple[float, float] | None = None,
    noise: float = 5e-4,
    seed: int = 0,
    forces: tuple[float, ...] = (0.5, 1.0, 1.5),
) -> Problem:
    """E and the camera's frame from markers at some forces on each tendon; frame: how far x, y [m] and rx … may be."""
    random = np.random.default_rng(seed)
    experiments: list[Experiment] = []
    for cable in TENDONS:
        seen = _pulled(element, cable, forces)
        channels = {f"{cable}.tension": Channel(np.array(forces), "N")}
        for marker in ("m1", "m2", "m3", "m4"):
            places = np.column_stack([seen.channels[f"{marker}.{axis}"] for axis in "xyz"])
            places = places @ rotation(np.array(CAMERA[3:])).T + np.array(CAMERA[:3])
            places = places + noise * random.standard_normal(places.shape)
            sigma = max(noise, 5e-4)
            channels |= {f"{marker}.{axis}": Channel(places[:, k], "m", sigma) for k, axis in enumerate("xyz")}
        dataset = Dataset(cable, channels)
        rig = Rig(length=LENGTH)
        experiments.append(Experiment(cable, dataset, drive=(f"{cable}.tension",), rig=rig, set_up="camera"))
    away, turned = frame
    free = [
        FreeParameter("tentacle.youngs_modulus", "Pa", *bounds, scale),  # type: ignore[arg-type]
        FreeParameter("frame.x", "m", -away, away),
        FreeParameter("frame.y", "m", -away, away),
        FreeParameter("frame.z", "m", *frame_z),
        *(FreeParameter(f"frame.r{axis}", "rad", -turned, turned) for axis in "xyz"),
    ]
    if nu is not None:
        free.append(FreeParameter("tentacle.poissons_ratio", "1", *nu))
    return make_problem(tentacle(element), experiments, free, loss)


def notched_mesh() -> TetMesh:
    """A bar of 80 mm with four notches on one side, cut to half its depth."""
    whole = box_mesh((0.014, 0.012, 0.08), (4, 2, 18), origin=(-0.007, -0.006, -0.08))
    middles = whole.points[whole.tets].mean(axis=1)
    slot = np.floor(-middles[:, 2] / 0.08 * 18).astype(int)
    kept = whole.tets[~(np.isin(slot, (3, 6, 9, 12)) & (middles[:, 0] > 0.0))]
    used = np.unique(kept)
    number = np.full(len(whole.points), -1)
    number[used] = np.arange(len(used))
    points = whole.points[used]
    ends = {"foot": np.flatnonzero(points[:, 2] == 0.0), "head": np.flatnonzero(points[:, 2] <= -0.08 + 1e-9)}
    return TetMesh(points, number[kept], node_sets=ends)


def finger(element: str = "P2P1") -> Robot:
    """Hanging, with a tendon along the notched side that a testing machine pulls."""
    mesh = notched_mesh()
    body = Body(
        "finger",
        mesh,
        mesh.node_sets["foot"],
        {"youngs_modulus": FINGER_E, "poissons_ratio": FINGER_NU},
        element=element,
        density=1100.0,
    )
    tip = Plate("tip", {"finger": mesh.node_sets["head"]}, (0.0, 0.0, -0.08))
    inside = [ViaPoint((0.005, 0.0, -0.08 * (k + 0.5) / 18), "finger") for k in (1, 4, 7, 10, 14)]
    cable = Cable(
        "tendon", (ViaPoint((0.005, 0.0, 0.005)), *inside, ViaPoint((0.005, 0.0, -0.08), "tip")), pulled_end="first"
    )
    return Robot((body,), (tip,), (cable,), gravity=np.array([0.0, 0.0, -9.81]))


@functools.cache
def _flexed(element: str, slack: float) -> tuple[np.ndarray, Response]:
    shortening = np.linspace(0.0, 0.006, 61)
    command = Command("shortening", np.maximum(shortening - slack, 0.0))
    seen = simulate(finger(element), Protocol({"tendon": command}))
    assert seen.succeeded, seen.status
    return shortening, seen


def finger_problem(
    loss: Loss,
    *,
    element: str = "P2P1",
    bounds: tuple[float, float] = (50e3, 10e6),
    scale: str = "log",
    tension_offset: tuple[float, float] = (0.001, 0.5),
    pitch_offset: tuple[float, float] = (np.deg2rad(0.1), np.deg2rad(12.0)),
    slack: tuple[float, float] | None = None,
    nu: tuple[float, float] | None = None,
    noise: float = 0.01,
    seed: int = 0,
) -> Problem:
    """E and the instruments' offsets from tension and angle over the travel; noise: of each channel's top."""
    shortening, seen = _flexed(element, 0.0003 if slack else 0.0)
    random = np.random.default_rng(seed)
    angle = "pitch"
    true = {"tension": 0.12, angle: np.deg2rad(4.0)}
    twin = {"tension": seen.channels["tendon.tension"], angle: seen.channels[f"tip.{angle}"]}
    channels = {"shortening": Channel(shortening, "m")}
    for name, values in twin.items():
        sigma = max(noise, 1e-3) * float(np.abs(values).max())
        shown = values + true[name] + noise * float(np.abs(values).max()) * random.standard_normal(len(values))
        channels[name] = Channel(shown, "N" if name == "tension" else "rad", sigma)
    experiment = Experiment("flexed", Dataset("flexed", channels), "tendon", "tip", compared=("tension", angle))
    free = [
        FreeParameter("finger.youngs_modulus", "Pa", *bounds, scale),  # type: ignore[arg-type]
        FreeParameter("tendon.tension_offset", "N", *tension_offset),
        FreeParameter(f"tip.{angle}_offset", "rad", *pitch_offset),
    ]
    if slack is not None:
        free.append(FreeParameter("tendon.slack", "m", *slack))
    if nu is not None:
        free.append(FreeParameter("finger.poissons_ratio", "1", *nu))
    return make_problem(finger(element), [experiment], free, loss)


def begun_at(problem: Problem, z: Sequence[float] | Mapping[str, float]) -> Problem:
    """The problem with the search beginning at a point of the unit box."""
    from dataclasses import replace

    from softcal.calibration.problem.parameters import SearchSpace

    theta = z if isinstance(z, Mapping) else problem.space.to_model(z)
    free = tuple(replace(p, start=theta[p.label]) for p in problem.space.parameters)
    robot = with_parameters(problem.robot, {})
    return replace(problem, robot=robot, space=SearchSpace(free))
