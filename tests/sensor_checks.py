"""What every sensor promises, as checks of one on a robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from project_case import bar_robot

from softcal.mechanics.state import moved, rest_state
from softcal.sensing.channel import carriers, channel_name, channel_unit
from softcal.sensing.sensor import PARTS, NamedSensor, Sensor
from softcal.twin.build import Twin, build_twin
from softcal.twin.channels import channels_of, sensors_of
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Marker, Robot
from softcal.twin.sensors import sense, sense_rates
from softcal.units import unit_factor


def robot_with(*own: NamedSensor) -> Robot:
    """A bar with a plate, a cable and markers on both, and sensors of its own."""
    markers = (Marker("m1", "bar", np.array([0.01, 0.0, 0.05])), Marker("m2", "plate", np.array([0.0, 0.02, 0.11])))
    return replace(bar_robot(), markers=markers, sensors=own)


def instances(sensor: type[Sensor], robot: Robot) -> list[NamedSensor]:
    """The sensors of a class on a robot; there is one at least."""
    found = [one for one in sensors_of(robot) if type(one.sensor) is sensor]
    assert found, f"give tests/sensor_checks.py an example of the sensor {sensor.name}"
    return found


def _bent(twin: Twin, seed: int = 3):
    layout = twin.system.layout
    rng = np.random.default_rng(seed)
    state = moved(layout, rest_state(layout), rng.uniform(-0.02, 0.02, layout.n_unknowns))
    return state, rng.uniform(-0.05, 0.05, layout.n_unknowns)


def rates_are_derivatives(sensor: type[Sensor], robot: Robot) -> None:
    twin, theta = build_twin(robot), parameter_values(robot)
    state, dz = _bent(twin)
    columns = [twin.columns[channel] for channel in channels_of(instances(sensor, robot))]
    base, rate = sense(twin, state, theta), sense_rates(twin, state, theta, dz[:, None])[:, 0]
    assert (np.abs(rate[columns]) > 0.0).any()

    def left(h: float) -> np.ndarray:
        return np.abs(sense(twin, moved(twin.system.layout, state, h * dz), theta) - base - h * rate)[columns]

    # The rest of the first-order Taylor series falls with the square of the step.
    scale = 1e-9 * np.abs(base[columns]).max() + 1e-12
    assert np.all(left(1e-3) <= 0.3 * left(2e-3) + scale)


def one_value_for_each_kind(sensor: type[Sensor], robot: Robot) -> None:
    twin = build_twin(robot)
    values = sense(twin, rest_state(twin.system.layout), parameter_values(robot))
    assert len(values) == len(twin.columns)
    assert np.isfinite(values).all()


def names_are_unique_and_read_again(sensor: type[Sensor], robot: Robot) -> None:
    every = [str(channel) for channel in channels_of(sensors_of(robot))]
    assert len(set(every)) == len(every)
    for channel in channels_of(instances(sensor, robot)):
        assert channel_name(str(channel)) == channel
        assert channel.is_known
        of = sensor.of or "sensors"
        assert (of if of in ("sensors", *PARTS) else "actuators") in carriers(channel.kind)


def units_are_known(sensor: type[Sensor], robot: Robot) -> None:
    for channel in channels_of(instances(sensor, robot)):
        assert unit_factor(channel.kind.unit, channel.kind.unit) == 1.0
        assert channel_unit(str(channel)) == channel.kind.unit
        if channel.kind.offset is not None:
            assert channel.kind.offset[1].unit == channel.kind.unit
            assert channel.offset.startswith(channel.carrier)


def what_it_reads_at_rest_is_plausible(sensor: type[Sensor], robot: Robot) -> None:
    twin = build_twin(robot)
    values = sense(twin, rest_state(twin.system.layout), parameter_values(robot))
    for channel in channels_of(instances(sensor, robot)):
        assert abs(values[twin.columns[channel]]) < channel.kind.most
        assert channel.kind.mistake


CHECKS: tuple[Callable[[type[Sensor], Robot], None], ...] = (
    rates_are_derivatives,
    one_value_for_each_kind,
    names_are_unique_and_read_again,
    units_are_known,
    what_it_reads_at_rest_is_plausible,
)
