"""The twin's response: channels over the samples of a protocol, and their derivatives by parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from softcal.checks import Floats, Ints, ReadOnly
from softcal.display import displayed, pictures_of, plotted
from softcal.errors import Fault, ParameterError
from softcal.html_text import curve, heading, html_table, paragraph, picture
from softcal.units import format_quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Shown = bool | Literal["samples"]


@displayed
@dataclass(frozen=True)
class Snapshot(ReadOnly):
    """A solved shape to draw: positions of every body's mesh points, routes of actuators, plate poses.

    Attributes
    ----------
    label
        Text of the sample, control or time.
    points
        Body -> positions (n_points, 3) [m] of the points of the element's own mesh.
    routes
        Cable, or other actuator with a route -> its via points (n_via, 3) [m].
    plates
        Plate -> position (3,) [m] and rotation (3, 3) [-].
    controls
        Actuator -> its command, a coordinate or an effort [SI].
    efforts, coordinates
        Actuator -> its effort and coordinate [SI]: tension and shortening of a cable (of a slack one that of its way),
        pressure and volume of a chamber, torque and angle of a drive.
    rods
        Rod -> positions of its nodes (n_nodes, 3) [m].
    pressures
        Material of a P2P1 body -> nodal pressure (n_points,) [Pa], zero at nodes other than corners.
    markers
        Marker -> position (3,) [m].
    drive, drive_unit
        Place in an animation: coordinate or effort of the one driven actuator, or time [s]; with several driven
        actuators the number of the sample, from 1, in the unit "".
    rod_strains
        Rod -> root mean square over its elements of stretch and shear [-].
    """

    label: str
    points: Mapping[str, Floats]
    routes: Mapping[str, Floats]
    plates: Mapping[str, tuple[Floats, Floats]]
    controls: Mapping[str, float]
    efforts: Mapping[str, float] = field(default_factory=dict)
    coordinates: Mapping[str, float] = field(default_factory=dict)
    rods: Mapping[str, Floats] = field(default_factory=dict)
    pressures: Mapping[str, Floats] = field(default_factory=dict)
    markers: Mapping[str, Floats] = field(default_factory=dict)
    drive: float = 0.0
    drive_unit: str = ""
    rod_strains: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Derivatives(ReadOnly, Mapping[str, Mapping[str, Floats]]):
    """Derivatives of channels by parameters in one array; `derivatives[channel][parameter]` is a column of it.

    Attributes
    ----------
    channels, parameters
        Their names.
    rates
        d channel / d parameter, (n_samples, n_channels, n_parameters) [SI].
    """

    channels: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    rates: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))

    @staticmethod
    def of(each: Mapping[str, Mapping[str, Floats]]) -> Derivatives:
        """Channel -> parameter -> derivative (n_samples,) as one array.

        Raises
        ------
        ParameterError
            Where a channel does not have the derivatives that the first one has.
        """
        if isinstance(each, Derivatives):
            return each
        parameters = tuple(next(iter(each.values()), ()))
        for channel, by in each.items():
            if set(by) != set(parameters):
                what = "every channel has derivatives by the same parameters"
                raise ParameterError(Fault(what, channel, ", ".join(by) or "none", ", ".join(parameters) or "none"))
        if not parameters:
            return Derivatives()
        rates = np.array([[by[name] for name in parameters] for by in each.values()], dtype=float)
        return Derivatives(tuple(each), parameters, np.moveaxis(rates, -1, 0))

    def by(self, parameter: str, channels: Iterable[str]) -> Floats:
        """The derivatives (n_samples, n) of n channels by one parameter."""
        return self.rates[:, [self.channels.index(name) for name in channels], self.parameters.index(parameter)]

    def __getitem__(self, channel: str) -> Mapping[str, Floats]:
        if channel not in self.channels:
            raise KeyError(channel)
        return by_column(self.parameters, self.rates[:, self.channels.index(channel)])

    def __iter__(self) -> Iterator[str]:
        return iter(self.channels)

    def __len__(self) -> int:
        return len(self.channels)


@displayed
@dataclass(frozen=True)
class Response(ReadOnly):
    """Channels by name, each of shape (n_samples,), in SI.

    Attributes
    ----------
    channels
        `<cable>.shortening` [m], `<cable>.tension` [N], `<cable>.slack` [-] (1 where slack), `<plate>.x`, `.y`, `.z`
        [m], `<plate>.pitch`, `.roll`, `.yaw` [rad], `<marker>.x`, `.y`, `.z` [m]; values (n_samples,).
    units
        Channel -> SI unit.
    status
        How the simulation ended, in sentences; includes the warnings.
    succeeded
        Whether every sample was reached.
    n_factorisations
        Number of factorisations of the tangent.
    sensitivities
        Channel -> parameter -> d channel / d parameter, shape (n_samples,). A mapping of mappings will do.
    slopes
        Channel -> d channel / d control, shape (n_samples,), along the one driven actuator; empty for several.
    snapshots
        Shapes to draw.
    tets
        Body -> connectivity (n_tets, 4 or 10) of `Snapshot.points`.
    walls
        Actuator -> body -> faces (n, 3 or 6) of these that it acts on, such as the wall of a chamber.
    instabilities
        Sentences on snap-through or buckling along the load path, or "".
    crossings
        Sentence on bodies that pass through themselves or each other, and where, or "".
    drawn_out
        Sentence on cables with friction that slide opposite to the modelled direction, or "".
    remarks
        Sentences on the furthest state: bodies whose law softens or is unstable at the strains reached; on contact that
        another engine leaves out; or "".
    samples
        Numbers, from 0, of the protocol's samples in the channels. None: all, or those before the first one that could
        not be reached.
    stopped_by
        The signal that stopped it, such as Ctrl-C; the samples that were ready are there.
    """

    channels: Mapping[str, Floats]
    units: Mapping[str, str]
    status: str
    succeeded: bool
    n_factorisations: int
    sensitivities: Derivatives = field(default_factory=Derivatives)
    slopes: Mapping[str, Floats] = field(default_factory=dict)
    snapshots: tuple[Snapshot, ...] = ()
    tets: Mapping[str, Ints] = field(default_factory=dict)
    walls: Mapping[str, Mapping[str, Ints]] = field(default_factory=dict)
    instabilities: str = ""
    crossings: str = ""
    drawn_out: str = ""
    remarks: str = ""
    samples: tuple[int, ...] | None = None
    stopped_by: KeyboardInterrupt | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensitivities", Derivatives.of(self.sensitivities))
        super().__post_init__()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on the solved shapes, a sentence each: snap-through, intersections, cables drawn out, laws beyond
        their stability.
        """
        return tuple(self._doubtful.values())

    @property
    def doubts(self) -> str:
        """Reasons to doubt the solved shapes, in a few words; "" without any."""
        return ", ".join(self._doubtful)

    @property
    def _doubtful(self) -> dict[str, str]:
        """Reason for doubt in a few words -> the sentence on it."""
        kinds = {
            "the robot buckles or snaps": self.instabilities,
            "bodies intersect": self.crossings,
            "a cable slides opposite to the modelled direction": self.drawn_out,
            "a part of the model is left out or beyond its range": self.remarks,
        }
        return {words: sentence for words, sentence in kinds.items() if sentence}

    def _repr_html_(self) -> str:
        """The status, a row for each channel, and what must be known of the shapes."""
        rows: list[list[object]] = []
        for name, values in self.channels.items():
            known = values[np.isfinite(values)]
            ends = (
                [format_quantity(float(x), self.units[name]) for x in (known.min(), known.max(), known[-1])]
                if len(known)
                else ["–"] * 3
            )
            rows.append([name, *ends, curve(values.tolist())])
        samples = max((len(values) for values in self.channels.values()), default=0)
        return "".join(
            [
                heading(f"{'' if self.succeeded else 'Failed: '}{self.status}"),
                html_table(["channel", "least", "largest", "last", f"over {samples} samples"], rows),
                *(paragraph(f"Warning: {warning}") for warning in self.warnings),
                *(picture(png, "shape") for png in pictures_of(self)),
            ]
        )

    def plot(self, channel: str, over: str = "", *, ax: Axes | None = None) -> Axes:
        """One channel over another one, or over the number of the sample, as the report draws it.

        Parameters
        ----------
        channel
            The channel, such as "front.tension".
        over
            The channel of the horizontal axis, such as "front.shortening" or, of a motion, "time".
        ax
            Axes to which the curve is added; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes
            The axes; nothing is shown or saved.

        Raises
        ------
        ParameterError
            Where there is no such channel, or `ax` are no axes.
        """
        return plotted("plot_channel", self, channel, over, ax)

    def plot_shape(self, *, ax: Axes | None = None) -> Axes:
        """The shape that is furthest from the first one, coloured by its displacement, over the first one in grey.

        Parameters
        ----------
        ax
            Axes to draw into; by default those of a new figure.

        Returns
        -------
        matplotlib.axes.Axes
            The axes; nothing is shown or saved.

        Raises
        ------
        ParameterError
            Where there are no two shapes (`snapshots=True` keeps them), or `ax` are no axes.
        """
        return plotted("plot_shape", self, ax)

    def over(self, n_samples: int) -> Response:
        """The response with a row for each of the protocol's samples: NaN for those that were not reached."""
        held = next((len(values) for values in self.channels.values()), 0)
        if held == n_samples:
            return self
        rows, rates = list(range(held)) if self.samples is None else list(self.samples), self.sensitivities

        def spread(values: Floats) -> Floats:
            out = np.full((n_samples, *values.shape[1:]), np.nan)
            out[rows] = values
            return out

        return replace(
            self,
            channels={name: spread(values) for name, values in self.channels.items()},
            sensitivities=replace(rates, rates=spread(rates.rates)) if rates.parameters else Derivatives(),
            slopes={name: spread(values) for name, values in self.slopes.items()},
            samples=None,
        )


def by_column(names: Iterable[str], table: Floats) -> dict[str, Floats]:
    """The columns of a table (n_samples, n_names, …) by their names."""
    return {name: table[:, k] for k, name in enumerate(names)}
