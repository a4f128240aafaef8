"""The model of a page to pull: tensions of up to three cables to poses of plates, shortenings and compliance.

The twin is solved on a grid of tensions, one axis per cable, with its exact derivatives by every tension. Between the
nodes it is interpolated by tensor-product cubic Hermite polynomials: values and slopes are the twin's, mixed
derivatives are those of splines through the slopes. Orientations are quaternions, which have no jumps; the compliance
is the derivative of the interpolant, consistent with the poses. The error is measured with the exported evaluator at
random points between the nodes. A page has it for the shapes and bands at the nodes, which have no derivatives; a
controller has `softcal.export.reduced`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from softcal.checks import Floats, Ints
from softcal.errors import Fault, ParameterError, SimulationError, unknown
from softcal.export.engine import actuator_faults, history_faults
from softcal.export.reduced import efforts_along
from softcal.export.rotations import align, angle_between, product, quaternions
from softcal.export.tension_grid_model import GridModel
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

MOST_CABLES = 3
HELD_OUT, SEED = 40, 0  # random points between the nodes, at which the error is measured
POSE = 7  # numbers of a plate: position, quaternion


@dataclass(frozen=True)
class Reach:
    """Largest pull of a cable: a tension [N], or the tension of a shortening [m] with no other pulled."""

    value: float
    unit: str  # N or m


@dataclass(frozen=True)
class ChannelError:
    """Error of the model at the held-out points, and the largest change of the channel over them."""

    unit: str
    largest: float
    rms: float
    change: float


@dataclass(frozen=True)
class TensionGrid:
    """A model over a grid of tensions.

    Attributes
    ----------
    model
        Axes, names, and values and slopes at the nodes.
    error
        Channel -> measured error.
    nodes, between
        Shapes at the nodes, the last cable's changing first, and at the held-out points; empty where not asked for.
    points
        The held-out points (n, n_cables) [N].
    tets
        Body -> connectivity of the shapes.
    rates
        Measure -> its derivatives by the parameters at the nodes (n_nodes, n_parameters).
    """

    model: Mapping[str, Any]
    error: Mapping[str, ChannelError]
    nodes: tuple[Snapshot, ...]
    between: tuple[Snapshot, ...]
    points: Floats
    tets: Mapping[str, Ints]
    rates: Mapping[str, Floats]


def tension_grid(
    robot: Robot,
    reaches: Mapping[str, Reach],
    samples: int,
    *,
    tell: Callable[[str], None] = lambda sentence: None,
    parameters: Sequence[str] = (),
    shapes: bool = False,
) -> TensionGrid:
    """The cable-space model of a robot.

    Parameters
    ----------
    reaches
        Cables that the controller pulls, at most three, and their largest pull; of all others, those with a
        pretension stay at zero shortening, and the rest are slack.
    samples
        Nodes along each cable; for a reach in length evenly spaced in length.
    tell
        Called with the sentence on bodies that penetrate within reach.
    parameters
        Those of the robot by which the measures have derivatives.
    shapes
        Whether shapes are kept.

    Raises
    ------
    ParameterError
        For an unknown cable, more than three, or an invalid reach or number of samples.
    SimulationError
        If a state within reach has no equilibrium.
    """
    known = [cable.name for cable in robot.cables]
    faults = [unknown("there is no such cable", name, name, known, got="") for name in reaches if name not in known]
    faults += history_faults(robot, "a page to pull") + actuator_faults(robot, "a page to pull")
    if any(cable.line.friction_memory for cable in robot.cables):
        rough = ", ".join(cable.name for cable in robot.cables if cable.line.friction_memory)
        faults.append(Fault("the page has no memory", "friction_memory", rough, "friction without a memory"))
    if not 1 <= len(reaches) <= MOST_CABLES:
        faults.append(
            Fault(
                "the model has a grid over its cables",
                "cables",
                f"{len(reaches)} of them",
                f"1 to {MOST_CABLES}",
                "those that the controller pulls",
            )
        )
    faults += [
        Fault("the reach of a cable must be positive", f"{name}, reach", f"{reach.value:g} {reach.unit}", "> 0")
        for name, reach in reaches.items()
        if not 0.0 < reach.value < np.inf
    ]
    if samples < 2:
        faults.append(Fault("there are too few samples", "samples", str(samples), "2 or more"))
    if faults:
        raise ParameterError(faults)
    axes = [_axis(robot, cable, reach, samples) for cable, reach in reaches.items()]
    cables = list(reaches)
    grid = np.array(_snake([len(axis) for axis in axes]))
    tensions = np.column_stack([axis[grid[:, k]] for k, axis in enumerate(axes)])
    shape = tuple(len(axis) for axis in axes)
    plates, pulled = _moving(robot), [cable.name for cable in robot.cables]
    sampled, at_nodes = _sampled(robot, cables, tensions, tell, parameters, shapes=shapes)
    in_order = np.lexsort(grid.T[::-1])
    n_channels = POSE * len(plates) + len(pulled)
    table = sampled[in_order, : 1 + len(cables), :n_channels].reshape(*shape, 1 + len(cables), n_channels)
    # The neighbour before it along the last axis on which it is not the first.
    steps = np.cumprod([1, *shape[:0:-1]])[::-1]
    near = [
        k - next((int(step) for step, i in zip(steps[::-1], index[::-1], strict=True) if i > 0), 0)
        for k, index in enumerate(np.ndindex(shape))
    ]
    align(table.reshape(-1, *table.shape[-2:]), near, [slice(POSE * k + 3, POSE * k + 7) for k in range(len(plates))])
    rows = [f"{name}.{key}" for name in plates for key in ("x", "y", "z", "rx", "ry", "rz")]
    others = "All other cables are slack."
    tight = [c.name for c in robot.cables if c.name not in cables and "pretension" in c.properties]
    if tight:
        others = f"At zero shortening, with their pretension: {', '.join(tight)}. {others}"
    model: dict[str, Any] = {
        "units": "m, N, rad; quaternions (x, y, z, w) of the rotation from rest",
        "cables": cables,
        "axes": [axis.tolist() for axis in axes],
        "plates": plates,
        "shortenings": pulled,
        "rows": rows + [f"{name}.shortening" for name in pulled],
        "parameters": {f"{name} [{info.unit}]": info.value for name, info in robot_parameters(robot).items()},
        "nodes": with_mixed(table, axes).tolist(),
        "others": others,
        "error": {},
    }
    rng = np.random.default_rng(SEED)
    points = rng.uniform(size=(HELD_OUT, len(axes))) * [axis[-1] for axis in axes]
    points = points[np.lexsort(points.T[::-1])]
    exact, between = _sampled(robot, cables, points, shapes=shapes)
    error = _errors(model, points, exact)
    model["error"] = {
        "measured at": f"{HELD_OUT} random points between the nodes",
        **{
            name: {"unit": e.unit, "max": e.largest, "rms": e.rms, "largest change": e.change}
            for name, e in error.items()
        },
    }
    return TensionGrid(
        model,
        error,
        tuple(at_nodes.snapshots[k] for k in in_order) if shapes else (),
        between.snapshots,
        points,
        at_nodes.tets,
        _rates_of_measures(robot, np.delete(sampled[in_order], np.s_[1 : 1 + len(cables)], axis=1)),
    )


def _errors(model: Mapping[str, Any], points: Floats, table: Floats) -> dict[str, ChannelError]:
    cables, read = model["cables"], GridModel(model)
    states = [read.state(dict(zip(cables, map(float, at), strict=True))) for at in points]
    compliance = np.array([state["compliance"] for state in states]).transpose(0, 2, 1)
    exact = _compliance(table, len(model["plates"]), len(model["shortenings"]))
    errors: dict[str, ChannelError] = {}
    for k, name in enumerate(model["plates"]):
        own, turn, rows = slice(POSE * k, POSE * k + 3), slice(POSE * k + 3, POSE * k + 7), slice(6 * k, 6 * k + 3)
        at = np.array([state["plates"][name]["position"] for state in states])
        q = np.array([state["plates"][name]["quaternion"] for state in states])
        rest = np.array([0.0, 0.0, 0.0, 1.0])
        errors[f"{name}.position"] = _error("m", at - table[:, 0, own], np.ptp(table[:, 0, own], axis=0))
        errors[f"{name}.rotation"] = _error(
            "rad",
            angle_between(q, table[:, 0, turn])[:, None],
            angle_between(np.broadcast_to(rest, q.shape), table[:, 0, turn]).max(),
        )
        for what, unit, block in (("position", "m/N", rows), ("rotation", "rad/N", slice(6 * k + 3, 6 * k + 6))):
            errors[f"d {name}.{what} / d tension"] = _error(
                unit, (compliance - exact)[:, :, block].reshape(-1, 3), np.ptp(exact[:, :, block], axis=0)
            )
    for k, name in enumerate(model["shortenings"]):
        values = table[:, 0, POSE * len(model["plates"]) + k]
        ours = np.array([state["shortenings"][name] for state in states])
        errors[f"{name}.shortening"] = _error("m", (ours - values)[:, None], np.ptp(values))
        row = 6 * len(model["plates"]) + k
        errors[f"d {name}.shortening / d tension"] = _error(
            "m/N", (compliance - exact)[:, :, row].reshape(-1, 1), np.ptp(exact[:, :, row], axis=0)
        )
    return errors


def _error(unit: str, difference: Floats, change: Floats | float) -> ChannelError:
    """Error from the norms of differences (n, components)."""
    size = np.linalg.norm(difference, axis=1)
    return ChannelError(unit, float(size.max()), float(np.sqrt(np.mean(size**2))), float(np.max(change)))


def _axis(robot: Robot, cable: str, reach: Reach, samples: int) -> Floats:
    """Grid of tensions [N] from zero to a cable's reach."""
    if reach.unit == "N":
        return np.linspace(0.0, reach.value, samples)
    (part,) = (one for one in robot.cables if one.name == cable)
    return efforts_along(robot, part, (-np.inf, reach.value), samples, curve_tolerance=0.0)


def _snake(shape: Sequence[int]) -> list[tuple[int, ...]]:
    """All nodes of a grid in an order of neighbours, so that each solve starts near its solution."""
    order: list[tuple[int, ...]] = [()]
    for n in shape:
        ways = itertools.cycle([range(n), range(n - 1, -1, -1)])
        order = [(*before, i) for before, way in zip(order, ways, strict=False) for i in way]
    return order


def _moving(robot: Robot) -> list[str]:
    return [plate.name for plate in robot.plates if not plate.fixed]


def _sampled(
    robot: Robot,
    cables: Sequence[str],
    tensions: Floats,
    tell: Callable[[str], None] = lambda sentence: None,
    parameters: Sequence[str] = (),
    *,
    shapes: bool = False,
) -> tuple[Floats, Response]:
    """The channels and the positions of markers at tensions (n, n_cables), then their derivatives by each and by the
    parameters: (n, 1 + n_cables + n_parameters, n_channels); and the response.
    """
    protocol = Protocol({name: Command("tension", tensions[:, k]) for k, name in enumerate(cables)})
    by = [*(f"{name}.tension" for name in cables), *parameters]
    kept = "samples" if shapes else False
    response = simulate(robot, protocol, sensitivities=by, snapshots=kept, curve_tolerance=0.0)
    if not response.succeeded:
        raise SimulationError(f"The robot cannot be pulled that far: {response.status} Try a smaller reach.")
    for sentence in response.warnings:
        tell(sentence)

    def of(channel: str) -> Floats:
        rates = [response.sensitivities[channel][name] for name in by]
        return np.stack([response.channels[channel], *rates], axis=1)

    columns: list[Floats] = []
    for plate in _moving(robot):
        columns += [of(f"{plate}.{axis}") for axis in "xyz"]
        columns += list(np.moveaxis(quaternions(*(of(f"{plate}.{key}") for key in ("pitch", "roll", "yaw"))), 2, 0))
    columns += [of(f"{cable.name}.shortening") for cable in robot.cables]
    columns += [of(f"{marker.name}.{axis}") for marker in robot.markers for axis in "xyz"]
    table = np.stack(columns, axis=2)
    if not np.isfinite(table).all():
        raise SimulationError("A plate rolls by a right angle within reach, where the twin's angles have no rates.")
    return table, response


def _rates_of_measures(robot: Robot, table: Floats) -> dict[str, Floats]:
    """Derivatives (n_nodes, n) of what a page shows of a state: how far every plate and marker is from where it is at
    the first node, by which angle a plate is turned from there, and the shortenings.

    table: channels, and their n derivatives, at the nodes.
    """

    def along(direction: Floats, rate: Floats) -> Floats:  # of the length of a vector
        length = np.linalg.norm(direction, axis=1, keepdims=True)
        unit = np.divide(direction, length, out=np.zeros_like(direction), where=length > 0.0)
        return np.einsum("nc,npc->np", unit, rate - rate[:1])

    plates, rates = _moving(robot), dict[str, Floats]()
    first = POSE * len(plates) + len(robot.cables)
    places = {name: POSE * k for k, name in enumerate(plates)}
    places |= {marker.name: first + 3 * k for k, marker in enumerate(robot.markers)}
    for name, k in places.items():
        at, q = table[..., k : k + 3], table[..., k + 3 : k + POSE]
        if name in plates:
            back = q[:, :1] * [-1.0, -1.0, -1.0, 1.0]
            turned = product(q[:, 0], np.broadcast_to(back[0], q[:, 0].shape))
            axis = turned[:, :3] * np.where(turned[:, 3:] < 0.0, -1.0, 1.0)
            rates[f"{name}.rotation"] = along(axis, 2.0 * product(q[:, 1:], back)[..., :3])
        rates[f"{name}.displacement"] = along(at[:, 0] - at[0, 0], at[:, 1:])
    for k, cable in enumerate(robot.cables):
        rates[f"{cable.name}.shortening"] = table[:, 1:, POSE * len(plates) + k]
    return rates


def with_mixed(table: Floats, axes: Sequence[Floats]) -> Floats:
    """Values and all derivatives of a node: (n_nodes, 2) for each cable in turn, then n_channels.

    The twin gives the first derivatives; a mixed one is the mean of splines through those of one order less, along each
    cable.
    """
    n = len(axes)
    known: list[Floats] = [table[..., 0, :]]
    for bits in range(1, 2**n):
        own = [k for k in range(n) if bits >> k & 1]
        if len(own) == 1:
            known.append(table[..., 1 + own[0], :])
        else:
            along = [CubicSpline(axes[k], known[bits ^ 1 << k], axis=k).derivative()(axes[k]) for k in own]
            known.append(np.mean(along, axis=0))
    # Of the bits by which `known` is counted, that of the last cable comes first.
    apart = np.stack(known, axis=-2).reshape(*table.shape[:n], *[2] * n, table.shape[-1])
    return apart.transpose([*(axis for k in range(n) for axis in (k, 2 * n - 1 - k)), 2 * n])


def _compliance(table: Floats, n_plates: int, n_cables: int) -> Floats:
    """The twin's compliance (n, n_cables, n_rows) from its channels and their derivatives."""
    rows: list[Floats] = []
    for k in range(n_plates):
        q = table[:, :1, POSE * k + 3 : POSE * k + 7] * [-1.0, -1.0, -1.0, 1.0]
        rates = table[:, 1:, POSE * k + 3 : POSE * k + 7]
        rows += [table[:, 1:, POSE * k : POSE * k + 3], 2.0 * product(rates, q)[..., :3]]
    return np.concatenate([*rows, table[:, 1:, POSE * n_plates : POSE * n_plates + n_cables]], axis=2)
