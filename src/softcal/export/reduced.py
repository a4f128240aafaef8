"""Reduced model for a controller: commands and loads to poses of plates, places of markers, and coordinates.

The twin is solved at samples of the inputs u, efforts of actuators and parameters of the robot, each with its exact
derivatives by all of them. With s_k from -1 to 1 over the range of each input, every output y is then

    y(u) = sum over a of c_a prod over k of T_a_k(t_k),    t = D s,    sum over k of a_k w_k <= d,

with Chebyshev polynomials T, by least squares over values and derivatives. The rows of D are the eigenvectors of the
mean of J^T J, each scaled so that |t_k| <= 1: directions in which the outputs change much, such as bending, and little,
as where antagonists pull against each other. The latter get lower powers: w_k = 1 + 0.3 log(strength of the first / its
own). Since every equilibrium gives 1 + n numbers of an output, their number grows with n, the number of inputs, and not
as a grid does. Samples are low-discrepancy points, denser towards the ends of each range as Chebyshev polynomials need
them; the degree d is the lowest whose error at samples that are left out is small, else that of the smallest error.

Orientations are quaternions, which have no jumps; the Jacobian is the derivative of the polynomials, consistent with
the poses. The error is measured at other, random states.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, ParameterError, SimulationError, unknown
from softcal.export import reduced_model as evaluator
from softcal.export.engine import history_faults
from softcal.export.reduced_c import c_source
from softcal.export.rotations import align, angle_between, quaternions, rotation_rates
from softcal.limits import LIMITS
from softcal.sensing.kind import ChannelKind
from softcal.twin.actuated import ActuatedPart
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate
from softcal.units import format_quantity

MODEL, EVALUATOR, SOURCE, README = "model.json", "reduced_model.py", "reduced_model.c", "README.txt"
POSE = 7  # numbers of a plate: position, quaternion
SAMPLES = 64  # equilibria for each input, by default
TESTED, SEED = 100, 0  # random states at which the error is measured
LEFT_OUT = 5  # of the samples every fifth chooses the degree
N_SAMPLES = replace(LIMITS["samples"], least=2 * LEFT_OUT, most=20_000)  # the order of n is found in n^2 steps
PATH = 33  # steps of a coordinate along which the effort must be monotonic
MOST_TERMS, MOST_DEGREE = 1500, 30
DETERMINED = 2.0  # numbers of the twin for each coefficient, at least
WEAK = 0.3  # by which a direction e times as weak has lower powers
RIDGE = 1e-12  # of the mean square of a term
ENOUGH = 1e-4  # of the change of an output: the error for which no higher degree is taken
QUANTILES = {"p50": 0.5, "p95": 0.95, "max": 1.0}


@dataclass(frozen=True)
class Span:
    """Range of an input [unit]: of an actuator's effort, of its coordinate, or of a parameter of the robot."""

    least: float
    most: float
    unit: str


@dataclass(frozen=True)
class Input:
    """An input of a model.

    Attributes
    ----------
    name, unit
        Of an actuator, or the dotted name of a parameter; its SI unit.
    least, most
        Its range [unit].
    default
        Of an actuator no effort, or what is nearest to it; of a parameter the robot's value.
    control
        What commands it, an actuator's effort; "" of a parameter.
    """

    name: str
    unit: str
    least: float
    most: float
    default: float
    control: str = ""

    @property
    def derivative(self) -> str:
        """Name by which the twin has derivatives."""
        return f"{self.name}.{self.control}" if self.control else self.name


@dataclass(frozen=True)
class OutputError:
    """The distribution of an output's error over the random states [unit], and its largest change over them."""

    unit: str
    p50: float
    p95: float
    largest: float
    change: float


@dataclass(frozen=True)
class Bands:
    """The 95 % bands of a calibration.

    Attributes
    ----------
    parameters
        Those of the robot by which predictions have derivatives.
    width
        Half the width (n,) of predictions with derivatives (n, n_parameters).
    """

    parameters: Sequence[str]
    width: Callable[[Floats], Floats]


@dataclass(frozen=True)
class ReducedModelFit:
    """A reduced model.

    Attributes
    ----------
    model
        Content of `model.json`.
    error
        Output -> measured error.
    sampled, tested
        The twin at the equilibria to which it was fitted, and at the random states.
    """

    model: Mapping[str, Any]
    error: Mapping[str, OutputError]
    sampled: Sampled
    tested: Sampled


def reduced(
    robot: Robot,
    spans: Mapping[str, Span],
    samples: int | None = None,
    *,
    tell: Callable[[str], None] = lambda sentence: None,
    bands: Bands | None = None,
    shapes: bool = False,
    tested: int = TESTED,
) -> ReducedModelFit:
    """The reduced model of a robot.

    Parameters
    ----------
    robot
        The robot.
    spans
        Actuator or parameter -> its range. That of an actuator is of its effort, or of its coordinate, then the efforts
        that lead there with no other actuator. All other actuators have no effort, or, of a cable with a pretension,
        zero shortening.
    samples
        Equilibria at which the twin is solved; None: 64 for each input.
    tell
        Called with each warning of the twin within the ranges, such as of a robot that snaps.
    bands
        Bands of the calibration; None: the model has none.
    shapes
        Whether the shapes are kept.
    tested
        Number of random states.

    Raises
    ------
    ParameterError
        With all faults: an unknown input, an empty range, a robot with a memory, too few or too many samples; where no
        output changes with the inputs.
    SimulationError
        Where a state within the ranges has no equilibrium.
    """
    inputs = _inputs(robot, spans)
    n = SAMPLES * len(inputs) if samples is None else samples
    if fault := N_SAMPLES.fault(n, "samples"):
        raise ParameterError(fault)
    sampled = Sampled.at(robot, inputs, _scattered(len(inputs), n), tell, bands, shapes=shapes)
    outputs = _Outputs.of(robot)
    directions, powers = _best_terms(sampled, outputs.changes(sampled.values))
    tight = [part.name for part in robot.pretensioned if part.name not in spans]
    others = f"At zero shortening, with their pretension: {', '.join(tight)}. " if tight else ""
    if not {part.name for part in robot.commandable} <= {*spans}:
        others += f"All other {robot.actuator_word}s have no effort. "
    model: dict[str, Any] = {
        "format": "softcal-reduced",
        "version": 3,
        "units": "SI; quaternions (x, y, z, w) of the rotation from rest",
        "inputs": [asdict(one) for one in inputs],
        "plates": outputs.plates,
        "coordinates": outputs.coordinates,
        "markers": outputs.markers,
        "rows": outputs.rows,
        "directions": directions.tolist(),
        "powers": powers.tolist(),
        "coefficients": _fitted(sampled, directions, powers).tolist(),
        "parameters": {f"{name} [{info.unit}]": info.value for name, info in robot_parameters(robot).items()},
        "others": others,
        "bands": sampled.widths_fitted(directions),
        "error": {},
    }
    random = np.random.default_rng(SEED).uniform(size=(tested, len(inputs)))
    exact = Sampled.at(robot, inputs, random, bands=bands, shapes=shapes)
    error = measured_error(robot, model, exact)
    model["error"] = {
        "measured at": f"{tested} random states",
        **{
            name: {"unit": e.unit, "p50": e.p50, "p95": e.p95, "max": e.largest, "largest change": e.change}
            for name, e in error.items()
        },
    }
    return ReducedModelFit(model, error, sampled, exact)


def write_reduced(fit: ReducedModelFit, folder: Path, of_bands: str = "") -> list[Path]:
    """Write the model, its evaluators in Python and C, and a README into an existing folder.

    Parameters
    ----------
    fit
        The model.
    folder
        The folder.
    of_bands
        The sentence on its bands, or on why there are none.
    """
    model, source, readme = folder / MODEL, folder / SOURCE, folder / README
    model.write_text(json.dumps(fit.model, separators=(",", ":")), encoding="utf-8")
    code = Path(shutil.copyfile(evaluator.__file__, folder / EVALUATOR))
    source.write_text(c_source(fit.model), encoding="utf-8")
    entries = fit.model["inputs"]
    spans = ", ".join(f"{one['name']} {one['least']:.6g} to {one['most']:.6g} {one['unit']}" for one in entries)
    lines = "\n".join(
        f"  {name}: {e.p50:.2g}, {e.p95:.2g} and {e.largest:.2g} {e.unit} (it changes by up to {e.change:.3g})"
        for name, e in fit.error.items()
    )
    first = entries[0]
    powers = np.array(fit.model["powers"])
    readme.write_text(
        f"Inputs ({spans}) to poses of plates, places of markers, coordinates of actuators, and the Jacobian.\n"
        f"{fit.model['others']}Statics only: no dynamics, no hysteresis.\n"
        f"Polynomials of degree {powers.max()} with {len(powers)} terms, from {len(fit.sampled.points)} equilibria.\n\n"
        f"{EVALUATOR} needs Python and NumPy:\n"
        "  from reduced_model import ReducedModel\n"
        f'  model = ReducedModel("{MODEL}")\n'
        f'  state = model.state({{"{first["name"]}": {0.5 * (first["least"] + first["most"]):.3g}}})\n'
        f'  model.inverse({{"{(fit.model["rows"] or [""])[0]}": 0.01}}, start={{}})["commands"]\n'
        "The Jacobian has the rows that it names: positions and coordinates in their units by those of the inputs,\n"
        ".rx .ry .rz in rad, small rotations about the world's axes. It refuses inputs outside the model.\n\n"
        f"{SOURCE} is the same in C99, without dependencies: see its first lines.\n\n"
        + (f"{of_bands}\n\n" if of_bands else "")
        + ('state["bands"] has half the width of each channel.\n\n' if fit.model["bands"] else "")
        + f"Error against the twin at {fit.model['error']['measured at']}: median, 95th percentile and largest.\n"
        f"{lines}\n",
        encoding="utf-8",
    )
    return [model, code, source, readme]


def evaluator_of(model: Mapping[str, Any]) -> evaluator.ReducedModel:
    """The evaluator of a model, as it is exported."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / MODEL
        path.write_text(json.dumps(model), encoding="utf-8")
        return evaluator.ReducedModel(path)


def measured_error(robot: Robot, model: Mapping[str, Any], exact: Sampled) -> dict[str, OutputError]:
    """Errors of a model against the twin: distances of plates and markers, angles, coordinates, and of its Jacobian and
    bands.

    Parameters
    ----------
    robot
        The robot.
    model
        Content of `model.json`.
    exact
        The twin at some states, with the bands that the model has.
    """
    inputs = [Input(**one) for one in model["inputs"]]
    read = evaluator_of(model)
    states = [read.state(dict(zip(read.inputs, at.tolist(), strict=True))) for at in exact.points]
    rates = np.array([np.reshape(state["jacobian"], (-1, len(inputs))) for state in states])
    n_plates = len(model["plates"])
    exact_rates = row_rates(exact.values[:, None], exact.rates, n_plates)
    errors: dict[str, OutputError] = {}

    def add(name: str, unit: str, difference: Floats, change: float, rows: slice) -> None:
        errors[name] = _distribution(unit, np.linalg.norm(difference, axis=1), change)
        for k, one in enumerate(inputs):
            apart = np.linalg.norm((rates - exact_rates)[:, rows, k], axis=1)
            largest = float(np.linalg.norm(exact_rates[:, rows, k], axis=1).max())
            errors[f"d {name} / d {one.name}"] = _distribution(f"{unit}/{one.unit}", apart, largest)
        if model["bands"] is not None:
            ours = np.array([[*state["bands"].values()][rows] for state in states])
            apart = np.abs(ours - exact.widths[:, rows]).max(axis=1)
            errors[f"band of {name}"] = _distribution(unit, apart, float(exact.widths[:, rows].max()))

    for k, name in enumerate(model["plates"]):
        pose = exact.values[:, POSE * k : POSE * (k + 1)]
        at = np.array([state["plates"][name]["position"] for state in states])
        q = np.array([state["plates"][name]["quaternion"] for state in states])
        change = float(np.ptp(pose[:, :3], axis=0).max())
        add(f"{name}.position", "m", at - pose[:, :3], change, slice(6 * k, 6 * k + 3))
        rest = np.array([0.0, 0.0, 0.0, 1.0])
        turned = float(angle_between(np.broadcast_to(rest, q.shape), pose[:, 3:]).max())
        add(f"{name}.rotation", "rad", angle_between(q, pose[:, 3:])[:, None], turned, slice(6 * k + 3, 6 * k + 6))
    first, row = POSE * n_plates, 6 * n_plates
    units = {name: kind.unit for name, kind in _coordinates(robot).items()}
    for k, name in enumerate(model["coordinates"]):
        values = exact.values[:, first + k]
        ours = np.array([state["coordinates"][name] for state in states])
        add(name, units[name], (ours - values)[:, None], float(np.ptp(values)), slice(row + k, row + k + 1))
    first, row = first + len(units), row + len(units)
    for k, name in enumerate(model["markers"]):
        values = exact.values[:, first + 3 * k : first + 3 * k + 3]
        ours = np.array([state["markers"][name] for state in states])
        change = float(np.ptp(values, axis=0).max())
        add(f"{name}.position", "m", ours - values, change, slice(row + 3 * k, row + 3 * k + 3))
    return errors


def _distribution(unit: str, size: Floats, change: float) -> OutputError:
    """Of errors (n,)."""
    p50, p95, largest = np.quantile(size, [*QUANTILES.values()]).tolist()
    return OutputError(unit, p50, p95, largest, change)


def _coordinates(robot: Robot) -> dict[str, ChannelKind]:
    """The channels of all actuators' coordinates."""
    return {f"{part.name}.{part.channels[0].name}": part.channels[0] for part in robot.actuated}


def _inputs(robot: Robot, spans: Mapping[str, Span]) -> list[Input]:
    """The inputs, checked."""
    actuated, parameters = {part.name: part for part in robot.commandable}, robot_parameters(robot)
    faults = history_faults(robot, "a reduced model")
    if rough := ", ".join(cable.name for cable in robot.cables if cable.line.friction_memory):
        faults.append(Fault("a reduced model has no memory", "friction_memory", rough, "friction without a memory"))
    if not spans:
        faults.append(Fault("the model has no inputs", "inputs", "none", ", ".join(actuated)))
    found: list[Input] = []
    for name, span in spans.items():
        text = f"{format_quantity(span.least, span.unit)} to {format_quantity(span.most, span.unit)}"
        if name not in actuated and name not in parameters:
            what = f"there is no such {robot.actuator_word} or parameter"
            faults.append(unknown(what, name, name, [*actuated, *parameters], got=""))
        elif not span.least < span.most < np.inf or not np.isfinite(span.least):
            faults.append(Fault("the range of an input must not be empty", name, text, "least below most"))
        elif name in parameters:
            kind, value = parameters[name].quantity, parameters[name].value
            out = [fault for end in (span.least, span.most) if (fault := kind.fault(end, name)) is not None]
            faults += out
            if not out and not span.least <= value <= span.most:
                at = format_quantity(value, span.unit)
                faults.append(Fault("the range must contain the robot's own value", name, text, f"a range with {at}"))
            found.append(Input(name, span.unit, span.least, span.most, value))
        elif not faults:
            part = actuated[name]
            coordinate, effort = part.channels
            if span.unit not in (effort.unit, coordinate.unit):
                wanted = f"a range in {effort.unit} or {coordinate.unit}"
                raise ParameterError(Fault("this is no range of the actuator", name, f"in {span.unit}", wanted))
            ends = span.least, span.most
            if span.unit != effort.unit:
                efforts = efforts_along(robot, part, ends)
                ends = max(float(efforts[0]), part.ranges[1].lower), float(efforts[-1])
            for end in ends:
                if (fault := part.command_fault(effort.name, np.array([end]))) is not None:
                    raise ParameterError(fault)
            found.append(Input(name, effort.unit, *ends, min(max(0.0, ends[0]), ends[1]), effort.name))
    if faults:
        raise ParameterError(faults)
    return found


def efforts_along(robot: Robot, part: ActuatedPart, ends: tuple[float, float]) -> Floats:
    """Efforts [SI] of an actuator at even steps of its coordinate, with no other actuator.

    Parameters
    ----------
    robot
        The robot.
    part
        The actuator.
    ends
        Ends of the coordinate [SI]; what only pulls begins where it is taut.

    Raises
    ------
    ParameterError
        Where it has no effort up to the end, or one that is not monotonic.
    SimulationError
        Where a coordinate is not reached.
    """
    (coordinate, effort), (least, most) = part.channels, ends
    if part.ranges[1].lower >= 0.0:
        taut = float(simulate(robot, Protocol({})).channels[f"{part.name}.{coordinate.name}"][0])
        if most <= taut:
            what, got = "the actuator has no effort there", format_quantity(most, coordinate.unit)
            raise ParameterError(Fault(what, part.name, got, f"> {format_quantity(taut, coordinate.unit)}"))
        least = max(least, taut)
    steps = np.linspace(least, most, PATH)
    protocol = Protocol({part.name: Command(coordinate.name, steps)})
    response = simulate(robot, protocol)
    if not response.succeeded:
        raise SimulationError(f"{part.name}: {response.status}")
    efforts = response.channels[f"{part.name}.{effort.name}"].copy()
    if least > ends[0]:
        efforts[0] = 0.0
    falls = np.flatnonzero(np.diff(efforts) <= 0.0)
    if len(falls):
        raise ParameterError(
            Fault(
                f"its {effort.name} is not monotonic, so that it does not determine the robot's state",
                part.name,
                format_quantity(most, coordinate.unit),
                f"up to {format_quantity(float(steps[falls[0]]), coordinate.unit)}",
            )
        )
    return efforts


@dataclass(frozen=True)
class _Outputs:
    """The outputs: plates that move, channels of coordinates, markers; rows: of the Jacobian."""

    plates: list[str]
    coordinates: list[str]
    markers: list[str]

    @classmethod
    def of(cls, robot: Robot) -> _Outputs:
        plates = [plate.name for plate in robot.plates if not plate.fixed]
        return cls(plates, [*_coordinates(robot)], [marker.name for marker in robot.markers])

    @property
    def rows(self) -> list[str]:
        places = [f"{name}.{key}" for name in self.plates for key in ("x", "y", "z", "rx", "ry", "rz")]
        return places + self.coordinates + [f"{name}.{axis}" for name in self.markers for axis in "xyz"]

    @property
    def channels(self) -> list[str]:
        """Of the model, as `rows`, with a plate's angles in the place of small rotations."""
        places = [f"{name}.{key}" for name in self.plates for key in ("x", "y", "z", "pitch", "roll", "yaw")]
        return places + self.rows[len(places) :]

    def changes(self, values: Floats) -> Floats:
        """The change of each output (n_outputs,) over values (n, n_outputs): of a position or quaternion that of the
        component which changes most; infinite where nothing does.
        """
        sizes = [3, 4] * len(self.plates) + [1] * len(self.coordinates) + [3] * len(self.markers)
        each = np.split(np.ptp(values, axis=0), np.cumsum(sizes)[:-1])
        return np.repeat([float(one.max()) or np.inf for one in each], sizes)


@dataclass(frozen=True)
class Sampled:
    """The twin at samples.

    Attributes
    ----------
    points
        Inputs (n, n_inputs).
    places
        The same, each from -1 to 1 over its range.
    values
        Poses of plates, coordinates, places of markers (n, n_outputs); quaternions with the signs of neighbours.
    rates
        Their derivatives by the inputs (n, n_inputs, n_outputs).
    half
        Half of each range (n_inputs,).
    widths
        Half the width of the band of each channel of the model (n, n_rows); (n, 0) without bands.
    snapshots, tets
        Shapes, and their bodies' connectivity; empty where they are not kept.
    """

    points: Floats
    places: Floats
    values: Floats
    rates: Floats
    half: Floats
    widths: Floats
    snapshots: Sequence[Snapshot] = ()
    tets: Mapping[str, Ints] = field(default_factory=dict[str, Ints])

    @classmethod
    def at(
        cls,
        robot: Robot,
        inputs: Sequence[Input],
        shares: Floats,
        tell: Callable[[str], None] = lambda sentence: None,
        bands: Bands | None = None,
        *,
        shapes: bool = False,
    ) -> Sampled:
        """Solve the twin, each sample after one that is near.

        Parameters
        ----------
        robot
            The robot.
        inputs
            The inputs.
        shares
            Shares of their ranges (n, n_inputs).
        tell
            Called with each warning of the twin.
        bands
            Bands of the calibration; None: there are none.
        shapes
            Whether the shapes are kept.

        Raises
        ------
        SimulationError
            Where one has no equilibrium.
        """
        least, most = (np.array([getattr(one, end) for one in inputs]) for end in ("least", "most"))
        order = _tour(shares)
        shares = shares[order]
        points = least + shares * (most - least)
        commands = [k for k, one in enumerate(inputs) if one.control]
        by = [*(one.derivative for one in inputs), *(() if bands is None else bands.parameters)]
        # Samples of one robot are one simulation.
        fixed = [k for k in range(len(inputs)) if k not in commands]
        each = [np.arange(len(points))] if not fixed else np.arange(len(points))[:, None]
        responses = list[Response]()
        for rows in each:
            protocol = Protocol({inputs[k].name: Command(inputs[k].control, points[rows, k]) for k in commands})
            theta = {inputs[k].name: float(points[rows[0], k]) for k in fixed}
            kept = "samples" if shapes else False
            response = simulate(robot, protocol, theta, sensitivities=by, snapshots=kept, curve_tolerance=0.0)
            if not response.succeeded:
                raise SimulationError(
                    f"The robot has no equilibrium within the ranges: {response.status} Try smaller ones."
                )
            responses.append(response)
        for sentence in dict.fromkeys(sentence for response in responses for sentence in response.warnings):
            tell(sentence)
        table = np.concatenate([_outputs(robot, response, by) for response in responses])
        places = 2.0 * shares - 1.0
        near = [int(((places[:k] - places[k]) ** 2).sum(axis=1).argmin()) for k in range(1, len(places))]
        n_plates, n_inputs = sum(not plate.fixed for plate in robot.plates), len(inputs)
        align(table, [0, *near], [slice(POSE * k + 3, POSE * k + 7) for k in range(n_plates)])
        widths = np.zeros((len(table), 0))
        if bands is not None:
            channels = _Outputs.of(robot).channels
            of_each = [[one.sensitivities.by(name, channels) for one in responses] for name in bands.parameters]
            rates = np.stack([np.concatenate(each) for each in of_each], axis=2)
            widths = np.stack([bands.width(each) for each in np.moveaxis(rates, 1, 0)], axis=1)
        half = 0.5 * (most - least)
        shown, tets = [shape for one in responses for shape in one.snapshots], responses[0].tets
        return cls(points, places, table[:, 0], table[:, 1 : 1 + n_inputs], half, widths, shown, tets)

    def widths_fitted(self, directions: Floats) -> Mapping[str, Any] | None:
        """Polynomials of the squares of the bands, which are smooth also where a band is zero: of the highest degree
        that the samples determine.
        """
        if not self.widths.shape[1]:
            return None
        alike, most = np.ones(len(directions)), min(MOST_TERMS, len(self.places) / (2.0 * DETERMINED))
        degree, powers = 1, _powers(alike, 1)
        while degree < MOST_DEGREE and len(further := _powers(alike, degree + 1)) <= most:
            degree, powers = degree + 1, further
        return self.fitted(directions, powers, self.widths**2)

    def fitted(self, directions: Floats, powers: Ints, values: Floats) -> Mapping[str, Any]:
        """Polynomials of values (n, k) that have no derivatives: their `powers` and `coefficients`.

        Parameters
        ----------
        directions
            Directions of the model (n_inputs, n_inputs).
        powers
            Those of the model (n_terms, n_inputs), of which the highest are left out where there are too many.
        values
            At the samples.
        """
        low = powers[np.argsort(powers.sum(axis=1), kind="stable")[: int(len(self.places) / DETERMINED)]]
        coefficients = np.linalg.lstsq(terms_at(self.places, directions, low), values, rcond=None)[0]
        return {"powers": low.tolist(), "coefficients": coefficients.tolist()}

    def take(self, rows: Ints) -> Sampled:
        own = (self.points[rows], self.places[rows], self.values[rows], self.rates[rows])
        return Sampled(*own, self.half, self.widths[rows])


def row_rates(values: Floats, rates: Floats, n_plates: int) -> Floats:
    """Derivatives (n, n_rows, k) of the Jacobian's rows.

    Parameters
    ----------
    values
        Outputs (n, 1, n_outputs).
    rates
        Their derivatives (n, k, n_outputs).
    n_plates
        Number of plates, whose poses are first.
    """
    parts: list[Floats] = []
    for k in range(n_plates):
        own = slice(POSE * k + 3, POSE * k + 7)
        parts += [rates[..., POSE * k : POSE * k + 3], rotation_rates(values[..., own], rates[..., own])]
    return np.concatenate([*parts, rates[..., POSE * n_plates :]], axis=2).transpose(0, 2, 1)


def _scattered(n_inputs: int, n: int) -> Floats:
    """Shares (n, n_inputs) of the ranges: the corner of all least and each input's other end, then Sobol' points with
    the density of Chebyshev's points.
    """
    from scipy.stats.qmc import Sobol

    corners = np.concatenate([np.zeros((1, n_inputs)), np.eye(n_inputs)])[: n // 2]
    wanted = n - len(corners)
    points = Sobol(n_inputs, scramble=False).random_base2(wanted.bit_length())[1 : wanted + 1]  # the first is a corner
    return np.concatenate([corners, 0.5 - 0.5 * np.cos(np.pi * points)])


def _tour(shares: Floats) -> Ints:
    """An order of points (n, n_inputs) in which each is near to the one before; the first is nearest to the corner."""
    left, at, order = np.arange(len(shares)), np.zeros(shares.shape[1]), list[int]()
    while len(left):
        k = int(((shares[left] - at) ** 2).sum(axis=1).argmin())
        order.append(int(left[k]))
        at, left = shares[left[k]], np.delete(left, k)
    return np.array(order)


def _outputs(robot: Robot, response: Response, by: Sequence[str]) -> Floats:
    """Outputs, then their derivatives by the inputs: (n, 1 + n_inputs, n_outputs)."""

    def of(channel: str) -> Floats:
        return np.stack([response.channels[channel], *(response.sensitivities[channel][name] for name in by)], axis=1)

    columns: list[Floats] = []
    for plate in robot.plates:
        if not plate.fixed:
            columns += [of(f"{plate.name}.{axis}") for axis in "xyz"]
            angles = (of(f"{plate.name}.{key}") for key in ("pitch", "roll", "yaw"))
            columns += list(np.moveaxis(quaternions(*angles), 2, 0))
    columns += [of(name) for name in _coordinates(robot)]
    columns += [of(f"{marker.name}.{axis}") for marker in robot.markers for axis in "xyz"]
    table = np.stack(columns, axis=2)
    if not np.isfinite(table).all():
        raise SimulationError(
            "A plate rolls by a right angle within the ranges, where the twin's angles have no rates."
        )
    return table


def _powers(weights: Floats, degree: float) -> Ints:
    """Exponents (n_terms, n_inputs) of the terms up to a degree, with weights (n_inputs,) of the powers."""
    rows: list[tuple[int, ...]] = [()]
    for k, weight in enumerate(weights.tolist()):
        left = [degree - float(np.dot(row, weights[:k])) for row in rows]
        rows = [(*row, i) for row, most in zip(rows, left, strict=True) for i in range(int(most / weight + 1e-9) + 1)]
    return np.array(rows, dtype=np.int64)


def terms_at(places: Floats, directions: Floats, powers: Ints) -> Floats:
    """Terms (n, n_terms) at places.

    Parameters
    ----------
    places
        Inputs (n, n_inputs), each from -1 to 1 over its range.
    directions
        Directions of the model (n_inputs, n_inputs).
    powers
        Powers of the terms (n_terms, n_inputs).
    """
    return _design(places, directions, powers)[0]


def _design(places: Floats, directions: Floats, powers: Ints) -> tuple[Floats, Floats]:
    """Terms (n, n_terms) at places, and their derivatives by each direction (n, n_inputs, n_terms)."""
    from numpy.polynomial import chebyshev

    degree = int(powers.max(initial=1))
    slopes = np.zeros((degree + 1, degree + 1))  # of T_i in the others
    for i in range(1, degree + 1):
        slopes[i, :i] = chebyshev.chebder(np.eye(degree + 1)[i])[:i]
    table = chebyshev.chebvander(places @ directions.T, degree)
    factors = [table[:, k][:, powers[:, k]] for k in range(table.shape[1])]
    changes = [(table[:, k] @ slopes.T)[:, powers[:, k]] for k in range(table.shape[1])]
    rates = [np.prod([*factors[:k], changes[k], *factors[k + 1 :]], axis=0) for k in range(len(factors))]
    return np.prod(factors, axis=0), np.stack(rates, axis=1)


def _fitted(sampled: Sampled, directions: Floats, powers: Ints) -> Floats:
    """Coefficients (n_terms, n_outputs); derivatives count less as the degree grows, as Chebyshev polynomials are
    steeper.
    """
    from scipy.linalg import cho_factor, cho_solve

    terms, rates = _design(sampled.places, directions, powers)
    weight = 1.0 / max(int(powers.max()), 1)
    A = np.concatenate([terms, weight * rates.reshape(-1, len(powers))])
    # By a direction, the others at rest: s = D^-1 t.
    slopes = np.linalg.solve(directions.T, sampled.rates * sampled.half[:, None])
    values = np.concatenate([sampled.values, weight * slopes.reshape(-1, slopes.shape[2])])
    N = A.T @ A
    N[np.diag_indices_from(N)] += RIDGE * N.trace() / len(N)
    found: Any = cho_solve(cho_factor(N), A.T @ values)
    return found


def _best_terms(sampled: Sampled, change: Floats) -> tuple[Floats, Ints]:
    """Directions, and the powers of the degree that predicts the samples that are left out.

    change (n_outputs,): of the outputs.
    """
    n, n_inputs = sampled.places.shape
    is_out = np.arange(n) % LEFT_OUT == LEFT_OUT - 1
    kept, out = sampled.take(np.flatnonzero(~is_out)), sampled.take(np.flatnonzero(is_out))
    slopes = (sampled.rates * sampled.half[:, None] / change).transpose(1, 0, 2).reshape(n_inputs, -1)
    squares, vectors = np.linalg.eigh(slopes @ slopes.T)
    if not squares[-1] > 0.0:
        raise ParameterError(Fault("no output changes with the inputs", "inputs", attempt="other inputs, or gravity"))
    size = np.abs(vectors).sum(axis=0)
    strength = np.sqrt(np.maximum(squares, 1e-16 * squares.max())) * size
    order = np.argsort(-strength)
    directions, weights = (vectors / size).T[order], 1.0 + WEAK * np.log(strength.max() / strength[order])
    best, least = _powers(weights, 1.0), np.inf
    for degree in range(1, MOST_DEGREE + 1):
        powers = _powers(weights, degree)
        if len(powers) > min(MOST_TERMS, len(kept.places) * (1 + n_inputs) / DETERMINED):
            break
        terms = terms_at(out.places, directions, powers)
        apart = np.abs(terms @ _fitted(kept, directions, powers) - out.values) / change
        error = float(np.quantile(apart, QUANTILES["p95"], axis=0).max())
        if error < least:
            best, least = powers, error
        if error < ENOUGH:
            break
    return directions, best
