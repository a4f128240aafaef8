"""Robots whose forces are those of their materials alone: at moduli s times as large their shapes are the same, and
their forces s times as large. One load path then serves every value of the modulus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.term import part_theta
from softcal.quantities import GRAVITY
from softcal.twin.build import Twin
from softcal.twin.channels import sensors_of
from softcal.twin.parameters import MODULUS, robot_parameters
from softcal.twin.response import Derivatives, Response
from softcal.twin.robot import Robot

WEIGHT = ("kg", "kg/m^3", "m/s^2")  # units of the parameters of weights
WITHOUT_FORCE = ("1", "m", "rad", "rad/m", *WEIGHT)  # of parameters that scale no force, where nothing has a weight
DEGREES = {"N": 1, "m": 0, "rad": 0}  # of the channels of cables, plates and markers


def at_own_moduli(twin: Twin, theta: Mapping[str, float]) -> tuple[dict[str, float], float, str | None]:
    """theta with all moduli divided by s, so that the first has the robot's own value; s; and the modulus, where there
    is one only. Theta itself, one and None where the robot's forces are not proportional to its moduli.
    """
    infos = robot_parameters(twin.robot)
    moduli = [name for name, info in infos.items() if info.unit == MODULUS]
    if not moduli or not is_proportional(twin.robot, theta):
        return dict(theta), 1.0, None
    first = moduli[0]
    own = infos[first].value
    s = theta[first] / own
    only = first if len(moduli) == 1 else None
    return {**theta, **{name: theta[name] / s for name in moduli}, first: own}, s, only


def at_moduli(twin: Twin, response: Response, s: float) -> Response:
    """A response at moduli s times as large.

    Parameters
    ----------
    twin
        The twin.
    response
        The response.
    s
        Factor on all moduli [-].
    """
    if s == 1.0:
        return response
    infos, rates = robot_parameters(twin.robot), response.sensitivities
    # One unit more of a modulus, or of a weight that is zero here, bends a stiffer robot less.
    of_forces = np.array([infos[name].unit in (MODULUS, *WEIGHT) for name in rates.parameters], dtype=int)
    degrees = np.array([DEGREES[response.units[channel]] for channel in rates.channels], dtype=int)

    def scaled(values: Mapping[str, Floats]) -> dict[str, Floats]:
        return {channel: of * s ** DEGREES[response.units[channel]] for channel, of in values.items()}

    return replace(
        response,
        channels=scaled(response.channels),
        slopes=scaled(response.slopes),
        sensitivities=replace(rates, rates=rates.rates * s ** (degrees[:, None] - of_forces)),
        snapshots=tuple(
            replace(
                shape,
                efforts={name: s * effort for name, effort in shape.efforts.items()},
                pressures={material: s * pressure for material, pressure in shape.pressures.items()},
            )
            for shape in response.snapshots
        ),
    )


def with_modulus(response: Response, name: str, modulus: float, names: Sequence[str]) -> Response:
    """A response with its derivatives by the only modulus, at a prescribed shortening.

    Parameters
    ----------
    response
        The response.
    name
        Dotted name of the modulus.
    modulus
        Its value [Pa].
    names
        Parameters of the derivatives, in their order.
    """
    channels = tuple(response.channels)
    by_modulus = [DEGREES[response.units[channel]] * values / modulus for channel, values in response.channels.items()]
    rates = [np.array(by_modulus).T if by == name else response.sensitivities.by(by, channels) for by in names]
    return replace(response, sensitivities=Derivatives(channels, tuple(names), np.stack(rates, axis=-1)))


def is_proportional(robot: Robot, theta: Mapping[str, float]) -> bool:
    """Whether all forces are proportional to the moduli at theta [SI], by what the robot consists of."""
    infos = robot_parameters(robot)
    return (
        all(type(each.sensor).__module__.startswith("softcal.sensing.") for each in sensors_of(robot))
        and not robot.actuators
        and not robot.loads
        and not robot.remembers
        and not (any(theta[n] for n in GRAVITY) and any(theta[n] for n, i in infos.items() if i.unit in WEIGHT[:2]))
        and (robot.contact is None or robot.contact.follows_moduli)
        and all(info.unit in (MODULUS, *WITHOUT_FORCE) for info in infos.values())
        and all(body.elasticity.is_proportional(part_theta(theta, body.name)) for body in robot.bodies)
    )
