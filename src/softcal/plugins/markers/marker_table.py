"""Table of measured markers: a row per state, columns with units, and notes on missing or doubtful values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.csv_text import csv_text
from softcal.errors import DatasetError, Fault
from softcal.plugins.markers.marker_pose import MarkerEstimate, MarkerPoses
from softcal.plugins.markers.marker_scene import Glimpse, MarkerSet

_COORDINATES = ("x", "y", "z")


@dataclass(frozen=True)
class MarkerTable:
    """Markers relative to the base.

    Attributes
    ----------
    groups
        States, one row each.
    names
        Markers in the order of their columns.
    cells
        (state, name) -> estimate, if available.
    n_images
        Number of images of each state.
    notes
        State -> sentences on missing or doubtful markers.
    remarks
        Sentences that concern no single state.
    noise
        Standard deviation of a marker's corner [px].
    """

    groups: tuple[str, ...]
    names: tuple[str, ...]
    cells: Mapping[tuple[str, str], MarkerEstimate]
    n_images: Mapping[str, int]
    notes: Mapping[str, tuple[str, ...]]
    remarks: tuple[str, ...]
    noise: float

    def csv(self) -> str:
        """The table as CSV text with SI units in the header; missing values are empty cells.

        For each marker: position with standard deviations, rotation vector with standard deviations of rotations about
        the base's axes, and the number of images that show it.
        """
        rows: list[list[object]] = []
        for group in self.groups:
            cells: list[str] = []
            for name in self.names:
                estimate = self.cells.get((group, name))
                if estimate is None:
                    cells += [""] * 12 + ["0"]
                    continue
                sd = np.sqrt(np.diag(estimate.covariance))
                turns = (*estimate.pose.rotation_vector, *sd[:3])
                cells += [f"{value:.9g}" for value in (*estimate.pose.position, *sd[3:])]
                cells += ["" if estimate.is_ambiguous else f"{value:.9g}" for value in turns]
                cells.append(str(estimate.n_images))
            rows.append([group, self.n_images[group], *cells, "; ".join(self.notes[group])])
        of_each = [
            pattern.format(axis)
            for pattern in ("{} [m]", "{}_sd [m]", "r{} [rad]", "r{}_sd [rad]")
            for axis in _COORDINATES
        ]
        header = [f"{name}.{column}" for name in self.names for column in (*of_each, "images [1]")]
        return csv_text(["group", "images [1]", *header, "notes"], rows)


def marker_table(
    markers: MarkerSet,
    glimpses: Sequence[Glimpse],
    poses: MarkerPoses,
    unclear: Mapping[str, Sequence[int]] | None = None,
) -> MarkerTable:
    """The table of the measured markers, with notes on the missing ones.

    Parameters
    ----------
    markers, glimpses, poses
        Marker set, detections, and the result of `estimate_poses`.
    unclear
        Image -> markers detected without clear edges.

    Raises
    ------
    DatasetError
        If no named marker is in any image, or the images show only the base.
    """
    unclear = unclear or {}
    seen = {number for one in glimpses for number in one.corners}
    base = set(markers.standing)
    wanted = [number for number in (markers.names or sorted(seen)) if number not in base]
    never = [number for number in wanted if number not in seen]
    there = ", ".join(map(str, sorted(seen)))
    if never == wanted and never:
        raise DatasetError(
            Fault(
                "none of the named markers is in the images",
                "--names",
                ", ".join(markers.label(number) for number in never),
                f"markers {there}",
            )
        )
    wanted = [number for number in wanted if number in seen]
    if not wanted:
        raise DatasetError(Fault("there is no marker in the images but the base", got=str(sorted(seen))))
    groups = poses.groups
    notes: dict[str, tuple[str, ...]] = {}
    for group in groups:
        found: list[str] = []
        mine = [one for one in glimpses if one.group == group]
        for number in () if group in poses.unplaced else wanted:
            estimate = poses.estimates.get((group, number))
            if estimate is None:
                blurred = any(number in unclear.get(one.image, ()) for one in mine)
                why = "has no clear edges" if blurred else "is missing"
                found.append(f"{markers.label(number)} {why}")
            elif estimate.is_ambiguous:
                found.append(f"{markers.label(number)} is ambiguous: two orientations fit the images equally well")
        if group in poses.unplaced:
            found = [f"no marker could be located: {poses.unplaced[group]}"]
        notes[group] = tuple(found)
    strangers = sorted(seen - base - set(wanted))
    remarks = [
        f"{markers.label(number)} is in none of the images, which show markers {there}; the table leaves it out"
        for number in never
    ]
    remarks += [f"{image} shows no base with clear edges and was not used" for image in poses.lost]
    if strangers:
        remarks.append(f"markers without a name were left out: {', '.join(map(str, strangers))}")
    remarks += [
        f"{markers.label(number)}, which is fixed to the base, could not be located"
        for number in markers.companions
        if number not in poses.companions
    ]
    return MarkerTable(
        groups,
        tuple(markers.name(number) for number in wanted),
        {
            (group, markers.name(number)): poses.estimates[group, number]
            for group in groups
            for number in wanted
            if (group, number) in poses.estimates
        },
        {group: sum(one.group == group for one in glimpses) for group in groups},
        notes,
        tuple(remarks),
        poses.noise,
    )
