"""Definition of a marker set (base, sizes, names), and the markers detected in an image."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.geometry.pose import Pose
from softcal.plugins.markers.bundle import square_corners


@dataclass(frozen=True)
class MarkerSet:
    """The markers of a bench.

    Attributes
    ----------
    base
        Marker -> pose in the base frame, for fixed markers at known poses.
    companions
        Markers fixed relative to the base, with poses to be estimated from the images.
    size
        Side of the black square [m].
    sizes
        Marker -> side, for markers of another size [m].
    names
        Marker -> name; empty: all detected markers are measured.
    """

    base: Mapping[int, Pose]
    size: float
    companions: tuple[int, ...] = ()
    sizes: Mapping[int, float] = field(default_factory=dict[int, float])
    names: Mapping[int, str] = field(default_factory=dict[int, str])

    def __post_init__(self) -> None:
        faults = [
            Fault(f"the size of marker {number} is not above zero", got=f"{size:g} m")
            for number, size in {-1: self.size, **self.sizes}.items()
            if not (np.isfinite(size) and size > 0)
        ]
        given = list(self.names.values())
        faults += [
            Fault("two markers have the same name", "--names", f"'{name}'")
            for name in sorted({name for name in given if given.count(name) > 1})
        ]
        if not self.base:
            faults.append(Fault("no marker is the base", "--base"))
        both = sorted(set(self.base) & set(self.companions))
        faults += [Fault(f"marker {number} is named twice", "--base") for number in both]
        if faults:
            raise DatasetError([replace(f, what=f.what.replace("marker -1", "a marker")) for f in faults])

    @property
    def standing(self) -> tuple[int, ...]:
        """All markers of the base."""
        return (*self.base, *self.companions)

    def name(self, number: int) -> str:
        """Name of a marker in tables: its name, or `m3` for marker 3."""
        return self.names.get(number, f"m{number}")

    def label(self, number: int) -> str:
        """Name of a marker in messages."""
        return f"{self.names[number]} (marker {number})" if number in self.names else f"marker {number}"

    def corners(self, number: int) -> Floats:
        """Corners (4, 3) [m] of a marker in its own frame."""
        return square_corners(self.sizes.get(number, self.size))

    def base_corners(self, number: int) -> Floats:
        """Corners (4, 3) [m] of a marker of the base in the base's frame."""
        return self.base[number].apply(self.corners(number))


@dataclass(frozen=True)
class Glimpse:
    """The markers in one image: marker -> corners (4, 2) [px].

    image: its name, for messages. group: its state. viewpoint: images of one viewpoint have the same camera pose.
    """

    image: str
    group: str
    viewpoint: str
    corners: Mapping[int, Floats]
