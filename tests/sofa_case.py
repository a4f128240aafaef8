"""What the tests around SOFA share: the robots of ../shared/data/sofa, and the stand-in for SOFA in tests/fake_sofa."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mechanics_cases import SHARED, elastic

from softcal.geometry.primitives import box_mesh
from softcal.geometry.read import read_mesh
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.visual import visual_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Body, Cable, Disc, Marker, Plate, PointLoad, Robot, SurfaceLoad, Tie, ViaPoint

FAKE = Path(__file__).parent / "fake_sofa"
OF_THE_SCENE = ("Sofa", "SofaRuntime", "scene", "robot", "run", "fake_mechanics")


def neck_robot(data: dict) -> Robot:
    mesh = read_mesh(SHARED / "data" / "sofa" / data["mesh"])
    D, z = data["outer_diameter_m"], mesh.points[:, 2]
    body = Body(
        "neck",
        mesh,
        fixed=np.flatnonzero(z <= 0.37 * D + 1e-12),
        parameters=elastic(data["youngs_modulus_Pa"], data["poissons_ratio"]),
        element="P1",
    )
    collar = np.flatnonzero(z >= D * (0.617 + 4 * 0.481) - 1e-9)
    plate = Plate("plate", {"neck": collar}, reference=np.array([0.0, 0.0, data["height_m"]]))
    ends = (ViaPoint(np.array(data["cable"]["on_plate_m"]), "plate"), ViaPoint(np.array(data["cable"]["pull_point_m"])))
    return Robot((body,), (plate,), (Cable("front", ends),))


def beam_robot(data: dict) -> Robot:
    mesh = read_mesh(SHARED / "data" / "sofa" / data["mesh"])
    body = Body(
        "beam",
        mesh,
        fixed=np.flatnonzero(mesh.points[:, 0] <= 1e-4),
        parameters=elastic(data["youngs_modulus_Pa"], data["poissons_ratio"]),
        element="P1",
    )
    inside = [ViaPoint(np.array(at), "beam", 0.0) for at in data["cable"]["via_points_m"]]
    pull = ViaPoint(np.array(data["cable"]["pull_point_m"], dtype=float))
    return Robot((body,), (), (Cable("tendon", (*reversed(inside), pull)),))


def assert_neck_as_measured(response: Response, rows: list[dict]) -> None:
    """The neck's states are those that SOFA had: rows of neck-shortening.json or neck-tension.json."""
    assert response.succeeded, response.status
    for channel, key in {
        "front.tension": "tension_N",
        "front.shortening": "shortening_m",
        "plate.x": "plate_x_m",
        "plate.z": "plate_z_m",
    }.items():
        np.testing.assert_allclose(response.channels[channel], [row[key] for row in rows], rtol=1e-4, err_msg=channel)
    pitch = [row["pitch_rad"] for row in rows]
    np.testing.assert_allclose(response.channels["plate.pitch"], pitch, rtol=0, atol=1e-4)


def beam_tip(robot: Robot) -> np.ndarray:
    """Which nodes of the beam are at its free end."""
    tip = robot.bodies[0].mesh.points[:, 0] > 0.1 - 1e-9
    assert tip.any()
    return tip


def assert_tip_as_measured(robot: Robot, shape: Snapshot, row: dict) -> None:
    """The beam's tip has moved as in SOFA: a row of beam-cable.json."""
    moved = (shape.points["beam"] - robot.bodies[0].mesh.points)[beam_tip(robot)].mean(axis=0)
    expected = np.array(row["tip_displacement_m"])
    assert np.linalg.norm(moved - expected) < 1e-4 * np.linalg.norm(expected)


def many_parts() -> Robot:
    """Two tied blocks, a fixed and a moving plate with mass, cables over all kinds of points, loads and markers.

    The forces of its cables act at points of the blocks, as SOFA's do.
    """
    low = box_mesh((0.03, 0.03, 0.05), (2, 2, 3), origin=(-0.015, -0.015, 0.0))
    high = box_mesh((0.02, 0.02, 0.05), (2, 2, 3), origin=(-0.01, -0.01, 0.05))
    foot = Plate("foot", {"low": low.node_sets["z0"]}, np.zeros(3), fixed=True)
    head = Plate(
        "head", {"high": high.node_sets["z1"]}, np.array([0.0, 0.0, 0.1]), mass=0.03,
        centre_of_mass=np.array([0.002, 0.0, 0.11]),
        disc=Disc(0.06, 0.01, centre=np.array([0.0, 0.0, 0.1])),
    )  # fmt: skip
    bodies = (
        Body("low", low, [], elastic(1e6, 0.4), element="P1", density=1100.0),
        Body("high", high, [], elastic(8e5, 0.35), element="P1"),
    )
    through = Cable(
        "through",
        (
            ViaPoint((0.01, 0.0, 0.1), "head"), ViaPoint((0.009, 0.0, 0.07), "high", 0.0),
            ViaPoint((0.012, 0.0, 0.03), "low", 0.0), ViaPoint((0.012, 0.0, -0.02)),
        ),
    )  # fmt: skip
    inner = Cable("inner", (ViaPoint((-0.02, 0.0, 0.1), "head"), ViaPoint((-0.02, 0.0, 0.0), "foot")))
    between = Cable(
        "between",
        (ViaPoint((0.05, 0.0, 0.1), "head"), ViaPoint((0.05, 0.0, 0.05)), ViaPoint((0.0, 0.014, 0.04), "low", 0.0)),
        pulled_end="first",
    )
    loads = (
        PointLoad("push", "high", (0.005, 0.0, 0.08), (0.0, 0.05, 0.0)),
        PointLoad("tip", "head", (0.0, 0.0, 0.12), (0.02, 0.0, 0.0)),
        SurfaceLoad("wind", "low", low.face_sets["x1"], (-20.0, 5.0, 0.0)),
    )
    markers = (
        Marker("on_head", "head", (0.01, 0.01, 0.12)), Marker("on_low", "low", (0.016, 0.0, 0.02)),
        Marker("still", "foot", (0.0, 0.0, -0.01)),
    )  # fmt: skip
    ties = (Tie("joint", "high", high.node_sets["z0"], "low"),)
    return Robot(
        bodies, (foot, head), (through, inner, between), loads, gravity=(0.5, 0.0, -9.81), ties=ties, markers=markers
    )


def use_fake(monkeypatch: pytest.MonkeyPatch, *, version: str = "26.06", mechanics: str = "spring", fault: str = ""):
    """SOFA_ROOT is the stand-in, of a version, with mechanics, and with something that goes wrong (`nan@150`)."""
    monkeypatch.setenv("SOFA_ROOT", str(FAKE))
    monkeypatch.setenv("SOFA_PYTHON", sys.executable)
    monkeypatch.setenv("FAKE_SOFA_VERSION", version)
    monkeypatch.setenv("FAKE_SOFA_MECHANICS", mechanics)
    monkeypatch.setenv("FAKE_SOFA_FAULT", fault)


@contextmanager
def scene_modules(
    folder: Path, names: Sequence[str] = ("Sofa", "scene", "robot.rods", "robot.pulling", "robot.robot_state")
) -> Iterator[SimpleNamespace]:
    """The modules of a scene's folder, imported here against the stand-in."""

    def forget() -> None:
        for name in list(sys.modules):
            if name.split(".")[0] in OF_THE_SCENE:
                del sys.modules[name]

    path = list(sys.path)
    forget()
    sys.path[:0] = [str(folder), str(FAKE / "lib" / "python3" / "site-packages")]
    try:
        yield SimpleNamespace(**{name.rpartition(".")[2]: importlib.import_module(name) for name in names})
    finally:
        sys.path[:] = path
        forget()


def recorded(robot: Robot, protocol: Protocol, folder: Path, *, seen: bool = False):
    """The scene of a robot as `createScene` builds it: the root of the recorded graph, and its parameters.

    seen: with what there is to see.
    """
    linear = linear_robot(robot)
    parameters = scene_parameters(linear, protocol) | ({"visual": visual_parameters(linear)} if seen else {})
    write_scene(linear, parameters, folder)
    with scene_modules(folder) as modules:
        root = modules.Sofa.Core.Node("root")
        assert modules.scene.createScene(root, seen) is root
    return root, parameters
