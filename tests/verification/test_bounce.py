"""Contacts in time have no damping of their own: what falls comes to rest without it, and with it would stick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.barrier import Contact
from softcal.twin.in_time import simulate_in_time
from softcal.twin.protocol import Command
from softcal.twin.robot import Body, Cable, Marker, Robot, ViaPoint
from softcal.twin.schedule import Schedule
from softcal.twin.time_settings import TimeSettings

G, DENSITY, EDGE, FLOOR = 9.81, 1200.0, 0.02, 0.01
WEIGHT = DENSITY * EDGE**3 * G


def block_above_floor(height: float) -> Robot:
    """A soft block at some height over a hard floor, with a cable straight up from its top."""
    floor, block = box_mesh((0.06, 0.04, FLOOR), (3, 2, 1)), box_mesh((EDGE, EDGE, EDGE), (2, 2, 2))
    block = TetMesh(block.points + [0.011, 0.012, FLOOR + height], block.tets)
    middle = np.array([0.021, 0.022, FLOOR + height + 0.5 * EDGE])
    top = middle + [0.0, 0.0, 0.5 * EDGE]
    bottom = np.flatnonzero(floor.points[:, 2] < 1e-9)
    robot = Robot(
        bodies=(
            Body("floor", floor, bottom, {"youngs_modulus": 1e9, "poissons_ratio": 0.3}, element="P1"),
            Body("block", block, [], {"youngs_modulus": 5e5, "poissons_ratio": 0.3}, element="P1", density=DENSITY),
        ),
        cables=(Cable("up", (ViaPoint(top, "block"), ViaPoint(top + [0.0, 0.0, 0.5]))),),
        markers=(Marker("middle", "block", middle),),
        gravity=np.array([0.0, 0.0, -G]),
    )
    return replace(robot, contact=Contact(stiffness=5e5))


@pytest.mark.parametrize("step", [0.01, 0.002])
def test_a_block_that_falls_does_not_bounce(step: float):
    height = 0.02
    robot = block_above_floor(height)
    settings = TimeSettings(time_step=step, rayleigh_mass=0.0, start="undeformed")
    response = simulate_in_time(robot, Schedule(np.array([0.0, 0.3]), {}), settings)
    assert response.succeeded, response.status
    z = response.channels["middle.z"] - FLOOR - 0.5 * EDGE
    assert robot.fitted_contact is not None
    near = 0.75 * robot.fitted_contact.depth
    lands = int(np.argmax(z < near))
    assert 0 < lands < len(z) - 1
    assert z[lands:].max() < near


def test_a_block_that_is_lifted_leaves_the_floor_at_once():
    robot = block_above_floor(1.5e-4)
    pull = Schedule(
        np.array([0.0, 0.1, 0.102, 0.15]), {"up": Command("tension", WEIGHT * np.array([0.0, 0.0, 2.0, 2.0]))}
    )
    settings = TimeSettings(time_step=2e-3, rayleigh_mass=0.0, start="undeformed")
    response = simulate_in_time(robot, pull, settings)
    time, z = response.channels["time"], response.channels["middle.z"]
    risen = z[-1] - np.interp(0.1, time, z)
    assert risen == pytest.approx(0.5 * G * 0.049**2, rel=0.1)
