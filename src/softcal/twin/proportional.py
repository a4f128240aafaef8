"""Robots whose forces are those of their materials alone: at moduli s times as large their shapes are the same, and
their forces s times as large. One load path then serves every value of the modulus.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from softcal.checks import Floats
from softcal.mechanics.term import part_theta
from softcal.twin.build import Twin
from softcal.twin.channels import sensors_of
from softcal.twin.parameters import MODULUS, robot_parameters
from softcal.twin.response import Response
from softcal.twin.robot import Robot

WITHOUT_FORCE = ("1", "m", "rad", "rad/m", "kg", "kg/m^3")  # units of parameters that scale no force, without gravity
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
    moduli = {name for name, info in robot_parameters(twin.robot).items() if info.unit == MODULUS}

    def scaled(channel: str, values: Floats, by: str = "") -> Floats:
        return values * s ** (DEGREES[response.units[channel]] - (by in moduli))

    return replace(
        response,
        channels={channel: scaled(channel, values) for channel, values in response.channels.items()},
        slopes={channel: scaled(channel, values) for channel, values in response.slopes.items()},
        sensitivities={
            channel: {name: scaled(channel, values, name) for name, values in each.items()}
            for channel, each in response.sensitivities.items()
        },
        snapshots=tuple(
            replace(
                shape,
                tensions={cable: s * tension for cable, tension in shape.tensions.items()},
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
    sensitivities = {
        channel: {
            by: DEGREES[response.units[channel]] * values / modulus
            if by == name
            else response.sensitivities[channel][by]
            for by in names
        }
        for channel, values in response.channels.items()
    }
    return replace(response, sensitivities=sensitivities)


def is_proportional(robot: Robot, theta: Mapping[str, float]) -> bool:
    """Whether all forces are proportional to the moduli at theta [SI], by what the robot consists of."""
    return (
        all(type(each.sensor).__module__.startswith("softcal.sensing.") for each in sensors_of(robot))
        and not robot.loads
        and not robot.remembers
        and not (robot.gravity.any() and any(theta[n] for n in theta if n.endswith((".density", ".mass"))))
        and (robot.contact is None or robot.contact.follows_moduli)
        and all(info.unit in (MODULUS, *WITHOUT_FORCE) for info in robot_parameters(robot).values())
        and all(body.elasticity.is_proportional(part_theta(theta, body.name)) for body in robot.bodies)
    )
