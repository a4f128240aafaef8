"""Markers as a table: a row for each state, columns with units, and in words what is missing or doubtful."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.csv_text import csv_text
from softcal.errors import DatasetError, Fault
from softcal.vision.marker_pose import MarkerEstimate, MarkerPoses
from softcal.vision.marker_scene import Glimpse, MarkerSet

_COORDINATES = ("x", "y", "z")


@dataclass(frozen=True)
class MarkerTable:
    """Markers relative to the base.

    groups: states, one row each. names: markers, in the order of their columns. cells: (state, name) -> estimate,
    for those that could be placed. n_images: of each state. notes: state -> what is missing or doubtful; remarks:
    the same of no single state. noise: of a marker's corner [px].
    """

    groups: tuple[str, ...]
    names: tuple[str, ...]
    cells: Mapping[tuple[str, str], MarkerEstimate]
    n_images: Mapping[str, int]
    notes: Mapping[str, tuple[str, ...]]
    remarks: tuple[str, ...]
    noise: float

    def csv(self) -> str:
        """The table as text: SI units in the header, a cell left empty where there is nothing to say.

        For each marker its position and the standard deviations, its rotation vector and the standard deviations of
        turns about the base's axes, and the number of images that show it.
        """
        rows: list[list[object]] = []
        for group in self.groups:
            cells = [cell for name in self.names for cell in _cells(self.cells.get((group, name)))]
            rows.append([group, self.n_images[group], *cells, "; ".join(self.notes[group])])
        return csv_text(["group", "images [1]", *(h for name in self.names for h in _headers(name)), "notes"], rows)


def marker_table(
    markers: MarkerSet,
    glimpses: Sequence[Glimpse],
    poses: MarkerPoses,
    unclear: Mapping[str, Sequence[int]] | None = None,
) -> MarkerTable:
    """The table of what was found, and by name what was not.

    Parameters
    ----------
    markers, glimpses, poses
        The bench, what was seen, and what `estimate_poses` made of it.
    unclear
        Image -> markers that were found in it without clear edges.

    Raises
    ------
    DatasetError
        Where markers have names and none of them is in any image, or the images show the base alone.
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
    notes = {group: _notes(markers, group, wanted, glimpses, poses, unclear) for group in groups}
    strangers = sorted(seen - base - set(wanted))
    remarks = [
        f"{markers.label(number)} is in none of the images, which show markers {there}; the table leaves it out"
        for number in never
    ]
    remarks += [f"{image} shows no base with clear edges and was left out" for image in poses.lost]
    if strangers:
        remarks.append(f"markers without a name were left out: {', '.join(map(str, strangers))}")
    remarks += [
        f"{markers.label(number)}, which stands still with the base, could not be placed"
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


def _notes(
    markers: MarkerSet,
    group: str,
    wanted: Sequence[int],
    glimpses: Sequence[Glimpse],
    poses: MarkerPoses,
    unclear: Mapping[str, Sequence[int]],
) -> tuple[str, ...]:
    if group in poses.unplaced:
        return (f"nothing could be placed: {poses.unplaced[group]}",)
    mine = [one for one in glimpses if one.group == group]
    found: list[str] = []
    for number in wanted:
        estimate = poses.estimates.get((group, number))
        if estimate is None:
            blurred = any(number in unclear.get(one.image, ()) for one in mine)
            why = "has no clear edges" if blurred else "is missing"
            found.append(f"{markers.label(number)} {why}")
        elif estimate.is_ambiguous:
            found.append(f"{markers.label(number)} is ambiguous: two orientations meet the images equally well")
    return tuple(found)


def _headers(name: str) -> list[str]:
    return [
        *(f"{name}.{axis} [m]" for axis in _COORDINATES),
        *(f"{name}.{axis}_sd [m]" for axis in _COORDINATES),
        *(f"{name}.r{axis} [rad]" for axis in _COORDINATES),
        *(f"{name}.r{axis}_sd [rad]" for axis in _COORDINATES),
        f"{name}.images [1]",
    ]


def _cells(estimate: MarkerEstimate | None) -> list[str]:
    if estimate is None:
        return [""] * 12 + ["0"]
    sd = np.sqrt(np.diag(estimate.covariance))
    turns = [*estimate.pose.rotation_vector, *sd[:3]]
    return [
        *(f"{value:.9g}" for value in (*estimate.pose.position, *sd[3:])),
        *("" if estimate.is_ambiguous else f"{value:.9g}" for value in turns),
        str(estimate.n_images),
    ]
