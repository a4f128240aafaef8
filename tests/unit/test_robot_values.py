"""Values of a robot's parameters by name: what is none is refused with a sentence, wherever it is given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softcal.errors import InputError
from softcal.geometry.primitives import box_mesh
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Body, Robot
from softcal.twin.simulate import simulate

MESH = box_mesh((0.01, 0.01, 0.02), (1, 1, 1))
ROBOT = Robot(
    bodies=(Body("bar", MESH, fixed=MESH.node_sets["z0"], parameters={"youngs_modulus": 1e6, "poissons_ratio": 0.4}),)
)


@pytest.mark.parametrize("value", ["3 MPa", None, True, 3e6 + 1j, np.array([3e6]), np.array([3e6, 2e6])], ids=repr)
def test_a_value_that_is_no_number_is_refused(value: Any) -> None:
    for use in (lambda theta: simulate(ROBOT, Protocol({}), theta), lambda theta: with_parameters(ROBOT, theta)):
        with pytest.raises(InputError, match=r"bar\.youngs_modulus: this is .* number in SI"):
            use({"bar.youngs_modulus": value})


@pytest.mark.parametrize("value", [3_000_000, np.int64(3_000_000), np.float64(3e6), np.float32(3e6)], ids=repr)
def test_numbers_of_any_kind_are_values(value: Any) -> None:
    assert with_parameters(ROBOT, {"bar.youngs_modulus": value}).bodies[0].parameters["youngs_modulus"] == 3e6
