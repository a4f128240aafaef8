"""CalculiX: the same mesh, law and loads under the actuators' efforts, by a deck."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softcal.checks import Floats
from softcal.export.engine import Engine, EngineState, Running, register_engine
from softcal.plugins.calculix.deck import calculix_deck, deck_faults, in_its_law
from softcal.plugins.calculix.load_path import LoadPath, by_cables, coordinates, load_path, positions
from softcal.plugins.calculix.run import HOW_TO_GET, TIMEOUT, find_calculix, run_calculix
from softcal.twin.build import twin_of
from softcal.twin.protocol import Protocol
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot


def _solve(robot: Robot, protocol: Protocol, shape: Snapshot, running: Running) -> EngineState:
    """Solve with CalculiX under gravity, loads and softcal's efforts."""
    twin, path = twin_of(robot), load_path(robot, shape)
    deck = calculix_deck(robot, path.shapes)
    layout = twin.system.layout
    with tempfile.TemporaryDirectory() as folder:
        x = layout.X + run_calculix(deck, Path(folder), timeout=running.timeout or TIMEOUT)[-1, : layout.n_points]
    plates: dict[str, tuple[Floats, Floats]] = {}
    for name, k in twin.frame.items():
        riders = np.flatnonzero(layout.rider == k)
        if k < layout.n_moving_frames and len(riders) >= 3:
            plates[name] = _fitted_pose(layout.X[riders], x[riders], layout.references[k])
    own = by_cables(robot)
    ours, theirs = (coordinates(own, at, shape.efforts) for at in (positions(twin, shape), x))
    return EngineState(
        efforts={},
        coordinates=theirs,
        plates=plates,
        points={name: x[deck.first[name] :][: mesh.n_points] for name, mesh in twin.meshes.items()},
        needed=_needed(path, shape, ours, theirs),
    )


def _needed(
    path: LoadPath, shape: Snapshot, ours: Mapping[str, float], theirs: Mapping[str, float]
) -> dict[str, float]:
    """Efforts [SI] that another engine needs for softcal's coordinates, from those under softcal's efforts."""
    if path.stiffness is None:
        return {}
    lacks = np.array([ours[name] - theirs[name] for name in path.acting])
    more = path.stiffness @ lacks
    return {name: shape.efforts[name] + float(change) for name, change in zip(path.acting, more, strict=True)}


def _fitted_pose(X: Floats, x: Floats, reference: Floats) -> tuple[Floats, Floats]:
    """Reference point and rotation moved by the least-squares rigid motion from X to x."""
    centre, now = X.mean(axis=0), x.mean(axis=0)
    U, _, Vt = np.linalg.svd((x - now).T @ (X - centre))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return now + R @ (reference - centre), R


engine = register_engine(
    Engine("calculix", in_its_law, lambda: "" if find_calculix() else HOW_TO_GET, _solve, deck_faults)
)
