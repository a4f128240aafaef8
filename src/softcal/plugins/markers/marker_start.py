"""Start of the bundle adjustment: resolves the two-fold ambiguity of a flat marker's pose.

A viewpoint whose pose is ambiguous from the base alone is tried in all its poses, together with the other viewpoints of
the same state: only the correct ones agree on the other markers' positions.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.geometry.pose import Pose
from softcal.plugins.markers.bundle import BASE, Adjustment, Bundle, PoseCandidate, Sighting, adjust, pose_candidates
from softcal.plugins.markers.camera import Camera
from softcal.plugins.markers.marker_scene import Glimpse, MarkerSet

# Excess cost [px²] above which a pose is discarded: impossible by chance for corners accurate to 0.1 px.
_CLEARLY_WORSE = 0.3
_MOST_COMBINATIONS = 32
_SAME, _NEAR = np.radians(1.0), np.radians(4.0)


@dataclass(frozen=True)
class GroupStart:
    """Approximate poses of a state's viewpoints and markers.

    margin: excess cost [px²] of the second best choice of the viewpoints' poses; infinite if there is none.
    """

    views: Mapping[str, Pose]
    bodies: Mapping[int, Pose]
    margin: float


def view_candidates(camera: Camera, markers: MarkerSet, glimpses: Sequence[Glimpse]) -> tuple[PoseCandidate, ...]:
    """Poses (base frame to camera frame) of one viewpoint, from the base in all its images; best first.

    Parameters
    ----------
    camera
        The camera of the images.
    markers
        Sizes [m] of the markers, and those that are the base.
    glimpses
        The images of the viewpoint.
    """
    seen = [(number, one.corners[number]) for one in glimpses for number in markers.base if number in one.corners]
    if not seen:
        return ()
    points = np.concatenate([markers.base_corners(number) for number, _ in seen])
    found = pose_candidates(camera, points, np.concatenate([pixels for _, pixels in seen]))
    return tuple(one for one in found if one.cost < found[0].cost + _CLEARLY_WORSE)


def start_group(
    camera: Camera,
    markers: MarkerSet,
    glimpses: Sequence[Glimpse],
    views: Mapping[str, Sequence[PoseCandidate]],
) -> GroupStart:
    """The choice of poses with the least cost over all images of one state.

    Parameters
    ----------
    camera, markers, glimpses
        Detections in the state's images, all from viewpoints in `views`.
    views
        Viewpoint -> its possible poses.
    """
    numbers = sorted({number for one in glimpses for number in one.corners if number not in markers.base})
    single = {
        (i, number): pose_candidates(camera, markers.corners(number), one.corners[number])
        for i, one in enumerate(glimpses)
        for number in numbers
        if number in one.corners
    }
    names = list(dict.fromkeys(one.viewpoint for one in glimpses))
    tried: list[tuple[float, dict[str, Pose], dict[int, Pose]]] = []
    for choice in itertools.islice(itertools.product(*(views[name] for name in names)), _MOST_COMBINATIONS):
        poses = {name: candidate.pose for name, candidate in zip(names, choice, strict=True)}
        tried.append(_settled(camera, markers, glimpses, poses, single))
    tried.sort(key=lambda one: one[0])
    cost, poses, bodies = tried[0]
    others = [
        other - cost
        for other, found, _ in tried[1:]
        if any(found[name].angle_to(poses[name]) > _SAME for name in names)
    ]
    return GroupStart(poses, bodies, min(others, default=np.inf))


def _settled(
    camera: Camera,
    markers: MarkerSet,
    glimpses: Sequence[Glimpse],
    poses: Mapping[str, Pose],
    single: Mapping[tuple[int, int], Sequence[PoseCandidate]],
) -> tuple[float, dict[str, Pose], dict[int, Pose]]:
    """Cost [px²] and adjusted poses of a state for one choice of its viewpoints' poses."""
    names = list(poses)
    views = tuple(poses.values())
    bodies: dict[int, Pose] = {}
    sightings: list[Sighting] = []
    for number in sorted({number for _, number in single}):
        seen = [
            Sighting(names.index(one.viewpoint), 0, markers.corners(number), one.corners[number])
            for one in glimpses
            if number in one.corners
        ]
        options = [
            poses[glimpses[i].viewpoint].inverse().after(candidate.pose)
            for (i, candidate_number), candidates in single.items()
            if candidate_number == number
            for candidate in candidates
        ]
        if options:
            tries: list[Adjustment] = []
            for option in options:
                if all(option.angle_to(other.bundle.bodies[0]) > _NEAR for other in tries):
                    tries.append(adjust(Bundle(camera, views, (option,)), seen, hold_views=True))
            best = min(tries, key=lambda one: one.cost)
            sightings += [Sighting(s.view, len(bodies), s.points, s.pixels) for s in seen]
            bodies[number] = best.bundle.bodies[0]
    sightings += [
        Sighting(names.index(one.viewpoint), BASE, markers.base_corners(number), one.corners[number])
        for one in glimpses
        for number in markers.base
        if number in one.corners
    ]
    best = adjust(Bundle(camera, views, tuple(bodies.values())), sightings)
    return (
        best.cost,
        dict(zip(names, best.bundle.views, strict=True)),
        dict(zip(bodies, best.bundle.bodies, strict=True)),
    )
