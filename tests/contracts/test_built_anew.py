"""Every parameter of a robot against a robot that is built anew from the other value: derivatives of all channels, the
channels at theta, and those of `with_parameters`. The lengths of primitives: `verification/test_shape_parameters.py`.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import blown_box, elastic

from softcal.geometry.primitives import box_mesh
from softcal.geometry.shape import LENGTHS, DrawnShape
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.actuators.drive import Drive
from softcal.twin.cables import CableLine, RoutingAxis
from softcal.twin.clamp import Clamp
from softcal.twin.material import Material
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import kinds_of_quantity, robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Marker, Moment, Plate, PointLoad, Robot, ViaPoint
from softcal.twin.simulate import simulate

Values = Mapping[str, float]
STEPS = {"m": 1e-6, "rad": 1e-5, "rad/m": 1e-3}  # of parameters that are zero, by unit
HIDDEN = {"rotor_inertia"}  # has no effect without time
MESH = box_mesh((0.024, 0.018, 0.07), (1, 1, 4))
AXIS = RoutingAxis((0.01, 0.009, 0.0), (0.01, 0.0, 1.0))
WAY = np.array([0.6, 0.0, -0.8])


def offset(v: Values, owner: str) -> np.ndarray:
    return np.array([v.get(f"{owner}.{axis}_offset", 0.0) for axis in "xyz"])


def via(v: Values, cable: str, name: str, at: list[float], on: str = "") -> ViaPoint:
    by = offset(v, f"{cable}.{name}")
    return ViaPoint(at + by, on, name=name, offset=by)


def of(v: Values, owner: str, *keys: str) -> dict[str, float]:
    return {key: v[f"{owner}.{key}"] for key in keys}


def arm(v: Values) -> Robot:
    """Two materials, gravity sideways, a scale about the foot, and lines that are stated in three ways."""
    s, shift = v["arm.scale"], (v["arm.scale"] - 1.0) * np.array([0.0, 0.0, 0.07])
    foot, head = MESH.node_sets["z0"], MESH.node_sets["z1"]
    centre = np.array([0.012, 0.009, 0.0])
    soft = Material("soft", np.arange(12, 24), of(v, "arm.soft", *elastic()), v["arm.soft.density"])
    body = Body(
        "arm", replace(MESH, points=centre + s * (MESH.points - centre)), foot, of(v, "arm", *elastic()), element="P1",
        density=v["arm.density"], inclusions=(soft,), clamp=Clamp((0.0, 0.0, 1.0), v["arm.clamp_depth"]),
        shape=DrawnShape(s),
    )  # fmt: skip
    tip = Plate("tip", {"arm": head}, [0.012, 0.009, 0.07] + shift, v["tip.mass"], [0.02, 0.009, 0.08] + shift)
    angles = [v[f"turned.routing_{kind}"] for kind in ("offset", "angle", "twist")]
    turned = AXIS.moved(np.array([[-0.01, 0.0, 0.07], [-0.012, 0.003, 0.0]]), *angles) + np.array([shift, 0.0 * shift])
    keys = ("stiffness", "compliance", "pretension", "presliding", "friction_preload")
    lines = (
        CableLine(**of(v, "front", *keys), friction_memory=True),
        CableLine(**of(v, "side", "spring_rate", "rest_length")),
        CableLine(**of(v, "turned", "compliance")),
    )
    cables = (
        Cable("front", (via(v, "front", "a", [0.034, 0.009, 0.07] + shift, "tip"), ViaPoint([0.034, 0.012, 0.0]),
                        ViaPoint([0.04, 0.01, -0.02])), v["front.friction_coefficient"], line=lines[0]),
        Cable("side", (via(v, "side", "a", [0.012, 0.03, 0.07] + shift, "tip"), via(v, "side", "b", [0.01, 0.03, 0.0])),
              line=lines[1]),
        Cable("turned", (ViaPoint(turned[0], "tip"), ViaPoint(turned[1])), 0.0, "last", AXIS, *angles, lines[2]),
    )  # fmt: skip
    loads = (
        PointLoad("push", "tip", [0.0, 0.0, 0.07] + shift, v["push.force"] * WAY, WAY),
        Moment("turn", "tip", v["turn.moment"] * WAY, direction=WAY),
    )
    marker = Marker("dot", "arm", centre + s * ([0.01, 0.005, 0.02] - centre) + offset(v, "dot"))
    return Robot((body,), (tip,), cables, loads, gravity=[v[f"gravity.g{axis}"] for axis in "xyz"], markers=(marker,))


def box(v: Values) -> Robot:
    """A chamber of gas that opens at the clamped foot."""
    robot = blown_box("P1", is_open=True, medium="gas")
    (part,) = robot.actuators
    filled = Chamber(part.actuator.walls, **of(v, "main", "dead_volume", "hose_compliance", "polytropic_exponent"))
    return replace(robot, actuators=(NamedActuator("main", filled),), gravity=np.array([0.0, 4.0, -3.0]))


def turned_arm(v: Values) -> Robot:
    robot = arm({**ARM, "side.spring_rate": 900.0, **v})
    cables = tuple(replace(cable, line=CableLine()) for cable in robot.cables)
    keys = ("radius", "spring_rate", "pretension", "gear_backlash", "zero")
    drive = Drive({"front": 1.0, "turned": -0.8}, gear_ratio=-3.0, **of(v, "servo", *keys))
    return replace(robot, cables=cables, actuators=(NamedActuator("servo", drive),))


ARM = {
    "arm.youngs_modulus": 0.31e6, "arm.poissons_ratio": 0.41, "arm.density": 1030.0, "arm.clamp_depth": 0.0005,
    "arm.soft.youngs_modulus": 0.17e6, "arm.soft.poissons_ratio": 0.43, "arm.soft.density": 800.0, "arm.scale": 1.0,
    "tip.mass": 0.011, "front.friction_coefficient": 0.13, "front.stiffness": 310.0, "front.compliance": 3e-4,
    "front.pretension": 0.23, "front.presliding": 2e-3, "front.friction_preload": 0.17, "side.spring_rate": 900.0,
    "gravity.gx": 3.0, "gravity.gy": -6.0, "gravity.gz": -4.0,
    "side.rest_length": 0.0695, "turned.compliance": 2e-3, "push.force": 0.03, "turn.moment": 4e-4,
    **{f"turned.routing_{kind}": 0.0 for kind in ("offset", "angle", "twist")},
    **{f"{owner}.{axis}_offset": 0.0 for owner in ("front.a", "side.a", "side.b", "dot") for axis in "xyz"},
}  # fmt: skip
BOX = {"main.dead_volume": 3e-6, "main.hose_compliance": 2e-11, "main.polytropic_exponent": 1.3}
DRIVE = {
    "servo.radius": 0.006, "servo.spring_rate": 3e3, "servo.pretension": 0.8, "servo.gear_backlash": 0.03,
    "servo.zero": 0.05,
}  # fmt: skip
CASES: dict[str, tuple[Callable[[Values], Robot], Values, dict[str, Command]]] = {
    "arm": (arm, ARM, {"front": Command("shortening", [0.001, 0.004]), "turned": Command("tension", [0.1, 0.4])}),
    "box": (box, BOX, {"main": Command("volume", [5e-7, 1e-6])}),
    "drive": (turned_arm, DRIVE, {"servo": Command("angle", [-0.5, -1.5])}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_parameter_does_what_building_anew_does(case, monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    build, values, commands = CASES[case]
    robot, protocol = build(values), Protocol(commands)
    infos = robot_parameters(robot)
    assert {name: infos[name].value for name in values} == pytest.approx(dict(values), rel=1e-9)
    found = simulate(robot, protocol, sensitivities=tuple(values), curve_tolerance=0.0)
    assert found.succeeded, found.status

    def channels(one: Robot, theta: Values | None = None) -> Mapping[str, np.ndarray]:
        return simulate(one, protocol, theta, curve_tolerance=0.0).channels

    for name, value in values.items():
        h = 1e-4 * abs(value) or STEPS[infos[name].unit]
        less, more = (channels(build({**values, name: value + sign * h})) for sign in (-1.0, 1.0))
        at_theta, changed = channels(robot, {name: value + h}), channels(with_parameters(robot, {name: value - h}))
        largest = dict.fromkeys(found.units.values(), 0.0)
        for channel, unit in found.units.items():
            largest[unit] = max(largest[unit], np.abs(more[channel] - less[channel]).max() / (2.0 * h))
        assert max(largest.values()) > 0.0, name
        for channel, unit in found.units.items():
            got, slope = found.sensitivities[channel][name], (more[channel] - less[channel]) / (2.0 * h)
            rounding = 1e-12 / h
            where = f"{channel} by {name}"
            np.testing.assert_allclose(got, slope, rtol=1e-4, atol=1e-5 * largest[unit] + rounding, err_msg=where)
            for one, anew in ((at_theta, more), (changed, less)):
                np.testing.assert_allclose(one[channel], anew[channel], rtol=1e-9, atol=1e-11, err_msg=where)


def test_no_kind_of_parameter_is_left_out():
    seen = {parameter_name(name).kind for _, values, _ in CASES.values() for name in values}
    assert kinds_of_quantity().keys() - LENGTHS.keys() - HIDDEN <= seen
