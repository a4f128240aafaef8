"""A cable in a bore beside the axis bends a bar as a beam that bears a tension times its distance all along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bore_case import AT, BORE, LONG, WIDE, drilled_robot
from mechanics_cases import tensed

from softcal.twin.robot import Plate, Robot
from softcal.twin.simulate import simulate

TENSION = 0.01  # [N]: small rotations


def with_tip(robot: Robot) -> Robot:
    body = robot.bodies[0]
    tip = Plate("tip", {"bar": body.mesh.node_sets["z1"]}, np.array([0.0, 0.0, LONG]))
    return replace(
        robot, bodies=(replace(body, parameters={"youngs_modulus": 1e6, "poissons_ratio": 0.0}),), plates=(tip,)
    )


def bending() -> tuple[float, float]:
    """The cable's distance from the section's centroid [m], and the section's second moment about it [m^4]."""
    area = WIDE**2 - BORE**2
    centroid = -(BORE**2) * AT / area
    second = WIDE**4 / 12 + WIDE**2 * centroid**2 - BORE**4 / 12 - BORE**2 * (AT - centroid) ** 2
    return AT - centroid, second


@pytest.mark.slow
@pytest.mark.parametrize("aside", [pytest.param(0.0, marks=pytest.mark.long), 0.35 * BORE])
def test_the_bar_bends_by_the_cables_moment(aside: float):
    """Wherever in the bore the via points lie, the moment is about where they are, and not about the wall."""
    robot = with_tip(drilled_robot("P2", (aside, 0.0)))
    response = simulate(robot, tensed(TENSION, cable="front"))
    assert response.succeeded, response.status
    distance, second = bending()
    expected = TENSION * (distance + aside) * LONG / (1e6 * second)
    assert response.channels["tip.pitch"][0] == pytest.approx(expected, rel=0.02)


@pytest.mark.long
def test_the_cables_length_is_that_of_a_line_in_the_bore():
    """Shortening is tension's work: T dL = 2 U for a linear beam, of bending and of compression together."""
    robot = with_tip(drilled_robot("P2"))
    response = simulate(robot, tensed(TENSION, cable="front"))
    distance, second = bending()
    by_bending = TENSION * distance**2 * LONG / (1e6 * second)
    by_compression = TENSION * LONG / (1e6 * (WIDE**2 - BORE**2))
    assert response.channels["front.shortening"][0] == pytest.approx(by_bending + by_compression, rel=0.03)
