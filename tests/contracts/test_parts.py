"""Python's values for the parts of a robot: what is of the wrong kind or out of range is refused by part and field."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from softcal.errors import InputError
from softcal.geometry.centreline import straight
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RoundBar
from softcal.twin.cables import Cable, RoutingAxis, ViaPoint
from softcal.twin.clamp import Clamp
from softcal.twin.robot import (
    Body,
    Disc,
    Marker,
    Material,
    Plate,
    PointLoad,
    Robot,
    Rod,
    SurfaceLoad,
    Tie,
)

MESH = box_mesh((0.01, 0.01, 0.02), (1, 1, 1))
ELASTIC = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
LINE = straight((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 2)
NONE = np.zeros(0, dtype=int)

# What makes a part of its name, with values as they should be; and for some of its fields what is refused.
PARTS: list[tuple[str, Callable[..., object], dict[str, Any]]] = [
    (
        "core.",
        lambda **given: Material("core", **{"elements": [0], "parameters": {}, **given}),
        {"elements": [0.5], "density": -1.0, "parameters": {"youngs_modulus": "1 MPa"}},
    ),
    (
        "bar.",
        lambda **given: Body("bar", **{"mesh": MESH, "fixed": [0], "parameters": ELASTIC, **given}),
        {
            "mesh": "bar.msh",
            "fixed": MESH.points[:, 2] < 1e-9,
            "law": "neo-hook",
            "element": "P3",
            "density": "3",
            "inclusions": [MESH],
        },
    ),
    (
        "bar.",
        lambda **given: Body("bar", MESH, [0], ELASTIC | given),
        {"youngs_modulus": -1e6, "poissons_ratio": 0.5},
    ),
    (
        "rod.",
        lambda **given: Rod("rod", **{"centreline": LINE, "section": RoundBar(0.01), "parameters": ELASTIC, **given}),
        {"density": math.nan, "section": 0.01, "fixed": [-1], "clamped": {"top": [[0]]}},
    ),
    (
        "top.",
        lambda **given: Plate("top", **{"nodes": {}, "reference": (0.0, 0.0, 0.0), **given}),
        {
            "nodes": {"bar": ["z0"]},
            "reference": (0.0, 0.0),
            "mass": -1.0,
            "centre_of_mass": (0.0, 0.0, math.nan),
            "fixed": 1,
            "holes": {"h1": (0.0, "1 mm", 0.0)},
            "disc": 0.05,
            "inertia": (1.0, 2.0),
        },
    ),
    ("top.", lambda **given: Plate("top", {}, (0.0, 0.0, 0.0), **given), {"inertia": (1.0, 1.0, 3.0)}),
    (
        "",
        lambda **given: Disc(**{"diameter": 0.05, "thickness": 0.01, **given}),
        {"diameter": 0.0, "thickness": "1", "axis": (0, 0, 0), "centre": "top", "hole_diameter": -0.1},
    ),
    ("bond.", lambda **given: Tie("bond", "a", [0], "b", **given), {"tolerance": 0.0}),
    ("eye.", lambda **given: Marker("eye", **{"on": "top", **given}), {"on": None, "at": (0.0, 0.0), "offset": "1 mm"}),
    (
        "weight.",
        lambda **given: PointLoad("weight", "top", **given),
        {"at": (0.0, 0.0, math.inf), "force": 2.0, "direction": (0, 0, 0)},
    ),
    (
        "wind.",
        lambda **given: SurfaceLoad("wind", "bar", **given),
        {"faces": [0, 1, 2], "traction": [[0.0, 0.0, 1.0]]},
    ),
    (
        "via point, ",
        ViaPoint,
        {"at": [0.0, 0.0], "radius": -1.0, "on": 3},
    ),
    (
        "front.",
        lambda **given: Cable("front", **given),
        {"via_points": [(0, 0, 0)], "friction_coefficient": 3.0, "pulled_end": "top", "routing_offset": True},
    ),
    ("", RoutingAxis, {"point": (0.0, 0.0), "direction": (0.0, 0.0, 0.0)}),
    ("", Clamp, {"direction": (0.0, 0.0, 0.0), "depth": "1 mm"}),
    ("", Robot, {"bodies": [MESH], "gravity": (0.0, -9.81), "contact": True}),
]


@pytest.mark.parametrize(("name", "make", "refused"), PARTS)
def test_all_that_is_wrong_with_a_part_is_told_by_its_field(
    name: str, make: Callable[..., object], refused: dict[str, Any]
) -> None:
    with pytest.raises(InputError) as error:
        make(**refused)
    told = {fault.where.removeprefix(name).split(".")[0].split("[")[0] for fault in error.value.faults}
    assert told == set(refused)
    assert all(fault.where.startswith(name) for fault in error.value.faults)


def test_a_mask_in_place_of_numbers_is_told_what_makes_numbers_of_it() -> None:
    with pytest.raises(InputError, match=r"bar\.fixed: these are not whole numbers.*numpy\.flatnonzero"):
        Body("bar", MESH, MESH.points[:, 2] < 1e-9, ELASTIC)


def test_lists_are_kept_as_arrays_that_cannot_change() -> None:
    plate = Plate("top", {"bar": [0, 1]}, [0, 0, 1], holes={"h1": [0, 0, 1]}, inertia=(1.0, 2.0, 3.0))
    for kept in (plate.nodes["bar"], plate.reference, plate.centre_of_mass, plate.holes["h1"], plate.inertia):
        assert isinstance(kept, np.ndarray)
        assert not kept.flags.writeable
    np.testing.assert_array_equal(plate.inertia, np.diag([1.0, 2.0, 3.0]))


def test_a_disc_is_around_the_reference_of_its_plate_by_default() -> None:
    reference = np.array([0.0, 0.01, 0.02])
    plate = Plate("top", {}, reference, disc=Disc(0.05, 0.01, axis=(0.0, 3.0, 4.0)))
    assert plate.disc is not None
    np.testing.assert_array_equal(plate.disc.centre, reference)
    np.testing.assert_array_equal(plate.disc.axis, [0.0, 0.6, 0.8])
