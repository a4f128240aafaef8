"""Where to start the bundle adjustment: of the two poses that one view of a flat marker leaves, the right one.

A viewpoint whose pose is not clear from the base alone is tried in all its poses, together with the other viewpoints of
the same state: only the right ones agree on where the other markers are.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.geometry.pose import Pose
from softcal.vision.bundle import BASE, Adjustment, Bundle, Sighting, adjust
from softcal.vision.camera import Camera
from softcal.vision.marker_scene import Glimpse, MarkerSet
from softcal.vision.square_pose import Candidate, pose_candidates

# Cost [px²] by which a pose must be worse to be left out at once: a chance of nil for corners good to 0.1 px.
_CLEARLY_WORSE = 0.3
_MOST_COMBINATIONS = 32
_SAME, _NEAR = np.radians(1.0), np.radians(4.0)


@dataclass(frozen=True)
class GroupStart:
    """A state's viewpoints and markers, roughly.

    margin: cost [px²] by which the next best choice of the viewpoints' poses is worse; infinite where there is none.
    """

    views: Mapping[str, Pose]
    bodies: Mapping[int, Pose]
    margin: float


def view_candidates(camera: Camera, markers: MarkerSet, glimpses: Sequence[Glimpse]) -> tuple[Candidate, ...]:
    """Poses (base's frame to camera's) of one viewpoint, from the base as seen in all its images; best first."""
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
    views: Mapping[str, Sequence[Candidate]],
) -> GroupStart:
    """The choice of poses that meets all images of one state best.

    Parameters
    ----------
    camera, markers, glimpses
        What was seen in the state's images, all from viewpoints in `views`.
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


def _best(camera: Camera, views: tuple[Pose, ...], options: Sequence[Pose], seen: Sequence[Sighting]) -> Adjustment:
    """The best pose of one body near any of several; options near a pose that was found already are left out."""
    tries: list[Adjustment] = []
    for option in options:
        if all(option.angle_to(other.bundle.bodies[0]) > _NEAR for other in tries):
            tries.append(adjust(Bundle(camera, views, (option,)), seen, hold_views=True))
    return min(tries, key=lambda one: one.cost)


def _settled(
    camera: Camera,
    markers: MarkerSet,
    glimpses: Sequence[Glimpse],
    poses: Mapping[str, Pose],
    single: Mapping[tuple[int, int], Sequence[Candidate]],
) -> tuple[float, dict[str, Pose], dict[int, Pose]]:
    """Cost [px²] and poses of a state, adjusted from one choice of its viewpoints' poses."""
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
            best = _best(camera, views, options, seen)
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
