"""Rods in tension: one whose elements are too long for it is refused, and not said to buckle."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.twin.dead_loads import PointLoad
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Marker, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate

E, LONG, WIRE = 2e5, 0.1, RoundBar(0.004)
PULL = Protocol({"pull": Command("tension", np.array([0.02, 0.1, 0.25]))})
TOLD = r"rod wire is stretched by .* %, and one of its elements bears about .* too long for its tension"


def wire(elements: int, **constants: float) -> Robot:
    """Of 4 mm and 100 mm, pulled along its axis; with constants of its softening, one that remembers."""
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, -LONG), elements)
    history = ("softening",) if constants else ()
    own = {"youngs_modulus": E, "poissons_ratio": 0.45, **constants}
    rod = Rod("wire", line, WIRE, own, fixed=np.array([0]), history=history)
    via = (ViaPoint([0.0, 0.0, -LONG], "wire"), ViaPoint([0.0, 0.0, -5.0 * LONG]))
    return Robot(rods=(rod,), cables=(Cable("pull", via),), markers=(Marker("tip", "wire", [0.0, 0.0, -LONG]),))


@pytest.mark.parametrize("elements", [12, 16])
def test_a_wire_in_tension_stretches_and_is_straight(elements: int) -> None:
    response = simulate(wire(elements), PULL)
    assert response.succeeded, response.status
    assert response.instabilities == ""
    tensions = np.array([0.02, 0.1, 0.25])
    expected = -LONG * (1.0 + tensions / (E * WIRE.constants.area))
    np.testing.assert_allclose(response.channels["tip.z"], expected, rtol=1e-9)
    np.testing.assert_allclose(response.channels["tip.x"], 0.0, atol=1e-9)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_elements_too_long_for_their_tension_are_refused(elements: int) -> None:
    """Above N l^2 = 12 EI. The samples below that are reached: the first, and with eight elements the second."""
    response = simulate(wire(elements), PULL)
    assert not response.succeeded
    np.testing.assert_array_less(
        response.channels["pull.tension"], 12.6 * E * WIRE.constants.I1 / (LONG / elements) ** 2
    )
    assert re.search(TOLD, response.status), response.status
    assert "buckles" not in response.status


def test_so_they_are_where_the_rod_remembers() -> None:
    response = simulate(wire(4, softening_amount=1e6, softening_energy=1e3), PULL)
    assert not response.succeeded
    assert re.search(TOLD, response.status), response.status


@pytest.mark.parametrize(
    ("elements", "share", "error"), [(1, 0.25, 0.06), (1, 0.5, 0.12), (2, 0.25, 0.015), (2, 0.5, 0.03)]
)
def test_deflections_across_a_tension_are_said_to_be_too_large_where_they_are(
    elements: int, share: float, error: float
) -> None:
    """A tip that a small force moves across the tension, and the cable that pulls holds back: tanh's formula."""
    EI = E * WIRE.constants.I1
    N = 12.0 * EI * share / (LONG / elements) ** 2
    force = 1e-4 * N
    robot = wire(elements)
    across = PointLoad("across", "wire", np.array([0.0, 0.0, -LONG]), np.array([force, 0.0, 0.0]))
    response = simulate(replace(robot, loads=(across,)), Protocol({"pull": Command("tension", np.array([N]))}))
    k, long = np.sqrt(N / EI), LONG * (1.0 + N / (E * WIRE.constants.area))
    alone = (long - np.tanh(k * long) / k) / N
    expected = force * alone / (1.0 + N * alone / (5.0 * LONG - long))
    assert 0.0 < response.channels["tip.x"][-1] / expected - 1.0 < error
    assert ("may be too large by some per cent" in response.remarks) == (share > 0.3)
