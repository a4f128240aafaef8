"""What the twin answers: channels over the samples of a protocol, and their derivatives by parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats, Ints

Shown = bool | Literal["samples"]


@dataclass(frozen=True)
class Snapshot:
    """A solved shape to draw: positions of every body's mesh points, cable polylines, plate poses.

    rod_strains: of every rod, the root mean square over its elements of what its axis is stretched and sheared by.

    drive: where it stands in a film: the shortening [m] or tension [N] of the one cable that is driven, or the time
    [s]; with several driven cables the number of the sample, from 1, in the unit "".
    """

    label: str
    points: Mapping[str, Floats]  # body -> (n_points, 3) [m], the points of the element's own mesh
    cables: Mapping[str, Floats]  # cable -> (n_via, 3) [m]
    plates: Mapping[str, tuple[Floats, Floats]]  # plate -> (position (3,) [m], rotation (3, 3))
    controls: Mapping[str, float]  # cable -> commanded tension [N] or shortening [m]
    tensions: Mapping[str, float] = field(default_factory=dict)  # cable -> tension [N]
    rods: Mapping[str, Floats] = field(default_factory=dict)  # rod -> (n_nodes, 3) [m]
    pressures: Mapping[str, Floats] = field(
        default_factory=dict
    )  # material of a P2P1 body -> (n_points,) [Pa], zero but at corners
    markers: Mapping[str, Floats] = field(default_factory=dict)  # marker -> (3,) [m]
    drive: float = 0.0
    drive_unit: str = ""
    rod_strains: Mapping[str, float] = field(default_factory=dict)  # rod -> [-]


@dataclass(frozen=True)
class Response:
    """Channels by name, each of shape (n_samples,), in SI.

    Names: `<cable>.shortening` [m], `<cable>.tension` [N], `<cable>.slack` [-] (1 where slack),
    `<plate>.x`, `.y`, `.z` [m], `<plate>.pitch`, `.roll`, `.yaw` [rad], `<marker>.x`, `.y`, `.z` [m].
    sensitivities: channel -> parameter -> d channel / d parameter, shape (n_samples,).
    slopes: channel -> d channel / d control, shape (n_samples,), along the one cable that is driven.
    status: a sentence; falls: what of it tells where the robot was not stable, or ""; crossings: which bodies pass
    through themselves or each other, and where, or ""; drawn_out: which cables with friction slide the other way than
    it is modelled for, or "".
    samples: which of the protocol's samples, counted from 0, the channels hold. None: all, or those before the first
    one that could not be reached.
    """

    channels: Mapping[str, Floats]
    units: Mapping[str, str]
    status: str
    succeeded: bool
    n_factorisations: int
    sensitivities: Mapping[str, Mapping[str, Floats]] = field(default_factory=dict)
    slopes: Mapping[str, Floats] = field(default_factory=dict)
    snapshots: tuple[Snapshot, ...] = ()
    tets: Mapping[str, Ints] = field(default_factory=dict)  # body -> connectivity of `Snapshot.points`
    falls: str = ""
    crossings: str = ""
    drawn_out: str = ""
    samples: tuple[int, ...] | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What must be known of shapes that were solved, a sentence each: falls, crossings, cables drawn out."""
        return tuple(told for told in (self.falls, self.crossings, self.drawn_out) if told)

    def over(self, n_samples: int) -> Response:
        """The response with a row for each of the protocol's samples: NaN for those that were not reached."""
        held = next((len(values) for values in self.channels.values()), 0)
        if held == n_samples:
            return self
        rows = list(range(held)) if self.samples is None else list(self.samples)

        def spread(values: Floats) -> Floats:
            out = np.full(n_samples, np.nan)
            out[rows] = values
            return out

        return replace(
            self,
            channels={name: spread(values) for name, values in self.channels.items()},
            sensitivities={
                channel: {name: spread(values) for name, values in by.items()}
                for channel, by in self.sensitivities.items()
            },
            slopes={name: spread(values) for name, values in self.slopes.items()},
            samples=None,
        )
