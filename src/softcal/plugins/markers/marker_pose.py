"""Poses of markers in the base frame from all images together, with their uncertainty."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.geometry.pose import Pose
from softcal.plugins.markers.bundle import BASE, Adjustment, Bundle, PoseCandidate, Sighting, adjust, pose_candidates
from softcal.plugins.markers.camera import Camera
from softcal.plugins.markers.marker_scene import Glimpse, MarkerSet
from softcal.plugins.markers.marker_start import GroupStart, start_group, view_candidates

# A pose is ambiguous if the cost of a second one is larger by less than this, in units of the corners' variance.
_TELLING = 9.0
_SMALLEST_NOISE = 0.02  # lower limit of a corner's noise, and its part that repeats in images from one viewpoint [px]
_PLACE = 0.02  # distance over that to the base below which two camera positions count as one
_LARGEST_MISFIT = 1.0  # rms of an image's residuals above which its markers contradict the other images [px]
_OTHER = np.radians(3.0)  # rotation above which a second pose is distinct

Key = tuple[str, int]  # group ("" for fixed markers) and marker


@dataclass(frozen=True)
class MarkerEstimate:
    """A marker in one state.

    Attributes
    ----------
    pose
        Pose in the base frame.
    covariance
        Covariance (6, 6) of the rotation about the base's axes [rad] and the position [m].
    n_images
        Number of images that show it.
    is_ambiguous
        Whether two orientations fit the images equally well. `pose` has one of them; the position is hardly affected,
        and the difference is included in the covariance.
    """

    pose: Pose
    covariance: Floats
    n_images: int
    is_ambiguous: bool = False


@dataclass(frozen=True)
class MarkerPoses:
    """All markers in all states.

    Attributes
    ----------
    groups
        States in the order of their images.
    estimates
        (state, marker) -> estimate.
    companions
        Marker fixed relative to the base -> pose.
    unplaced
        State whose base is ambiguous or not detected -> reason.
    lost
        Images without the base, not used.
    noise
        Standard deviation of a corner, estimated from the residuals [px].
    misfit
        Image -> RMS of its residuals [px].
    """

    groups: tuple[str, ...]
    estimates: Mapping[Key, MarkerEstimate]
    companions: Mapping[int, MarkerEstimate]
    unplaced: Mapping[str, str]
    lost: tuple[str, ...]
    noise: float
    misfit: Mapping[str, float]


def estimate_poses(camera: Camera, markers: MarkerSet, glimpses: Sequence[Glimpse]) -> MarkerPoses:
    """Poses of all markers relative to the base, estimated from all images together.

    Parameters
    ----------
    camera
        The camera of all images.
    markers
        Sizes [m] of the markers, and those that are the base.
    glimpses
        The markers' corners in each image.

    Raises
    ------
    DatasetError
        If no image shows the base, or the markers of an image contradict the other images.
    """
    everything = {number for one in glimpses for number in one.corners}
    if markers.names:  # other markers may move
        numbers = {*markers.names, *markers.standing}
        glimpses = [replace(g, corners={n: c for n, c in g.corners.items() if n in numbers}) for g in glimpses]
    candidates: dict[str, Sequence[PoseCandidate]] = {
        view: view_candidates(camera, markers, [one for one in glimpses if one.viewpoint == view])
        for view in dict.fromkeys(one.viewpoint for one in glimpses)
    }
    used = [one for one in glimpses if candidates[one.viewpoint]]
    if not used:
        base = ", ".join(markers.label(number) for number in markers.base)
        seen = sorted(everything)
        raise DatasetError(
            Fault(
                "the base is in none of the images",
                "--base",
                "markers " + ", ".join(map(str, seen)),
                f"images that show {base} with clear edges",
            )
        )
    starts = _starts(camera, markers, used, candidates)
    problem = _problem(camera, markers, used, starts)
    best = adjust(problem.start, problem.sightings)
    # Companions with certain poses that appear in images without the base.
    lost = {number for one in glimpses if not candidates[one.viewpoint] for number in one.corners}
    noise = _noise(best, problem)
    clear = {group for group, start in starts.items() if start.margin >= _TELLING * noise**2}
    seen = {number for group, number in problem.keys if group in clear}
    found = {
        number: best.bundle.bodies[problem.bodies["", number]]
        for number in markers.companions
        if number in lost & seen and ("", number) in problem.bodies
    }
    if found:
        known = replace(markers, base={**markers.base, **found}, companions=())
        late = {one.group for one in glimpses if not candidates[one.viewpoint]}
        for view in [view for view, poses in candidates.items() if not poses]:
            mine = [one for one in glimpses if one.viewpoint == view]
            candidates[view] = view_candidates(camera, known, mine)
        used = [one for one in glimpses if candidates[one.viewpoint]]
        again = [one for one in used if one.group in late]
        starts.update(_starts(camera, known, again, candidates))
        problem = _problem(camera, markers, used, starts, found)
        best = adjust(problem.start, problem.sightings)
    squares: dict[str, list[float]] = {}
    for sighting, image in zip(problem.sightings, problem.images, strict=True):
        squares.setdefault(image, []).extend(np.sum(best.bundle.residuals(sighting) ** 2, axis=1))
    misfit = {image: float(np.sqrt(np.mean(found))) for image, found in squares.items()}
    group_of = {one.image: one.group for one in used}
    faults = [
        Fault(
            f"the markers of this image do not fit together with the other images of '{group_of[image]}'",
            image,
            f"{rms:.2g} px away on average (rms)",
            f"below {_LARGEST_MISFIT:g} px",
            "check that the images show one state of the robot (--group-by), that the camera did not move where "
            "--viewpoints says so, and the markers' sizes, the base's layout and the camera file",
        )
        for image, rms in misfit.items()
        if not rms <= _LARGEST_MISFIT
    ]
    if faults:
        raise DatasetError(faults)
    noise = _noise(best, problem)
    problem = replace(problem, sightings=_weighed(markers, problem, best.bundle, noise))
    final = adjust(best.bundle, problem.sightings)
    bundle = final.bundle
    covariances = final.covariances(list(problem.bodies.values()))
    estimates: dict[Key, MarkerEstimate] = {}
    for (key, body), covariance in zip(problem.bodies.items(), covariances, strict=True):
        mine = [sighting for sighting in problem.sightings if sighting.body == body]
        cost = bundle.cost([replace(sighting, weight=1.0) for sighting in mine])
        n_images = len(mine)
        # Images that disagree on a marker's position (it moved or vibrated) increase its uncertainty.
        own = cost / (8 * n_images - 6) if n_images > 1 else 0.0
        variance = max(noise**2, own)
        second = _second_pose(bundle, mine, cost + _TELLING * variance)
        pose = bundle.bodies[body]
        spread = variance * covariance
        if second is not None:
            shift = (second.position - pose.position) / 2
            spread[3:, 3:] += np.outer(shift, shift)
        estimates[key] = MarkerEstimate(pose, spread, n_images, second is not None)
    unplaced = {
        group: "two poses of the base fit its images equally well"
        for group, start in starts.items()
        if start.margin < _TELLING * noise**2
    }
    groups = tuple(dict.fromkeys(one.group for one in glimpses))
    unplaced.update({group: "no image shows the base with clear edges" for group in groups if group not in starts})
    return MarkerPoses(
        groups,
        {key: one for key, one in estimates.items() if key[0] and key[0] not in unplaced},
        {key[1]: one for key, one in estimates.items() if not key[0]},
        unplaced,
        tuple(one.image for one in glimpses if not candidates[one.viewpoint]),
        noise,
        misfit,
    )


def _starts(
    camera: Camera, markers: MarkerSet, used: Sequence[Glimpse], candidates: dict[str, Sequence[PoseCandidate]]
) -> dict[str, GroupStart]:
    """The start of every state; the pose of a viewpoint shared by several states is stored in `candidates`."""
    starts: dict[str, GroupStart] = {}
    for group in dict.fromkeys(one.group for one in used):
        mine = [one for one in used if one.group == group]
        starts[group] = start_group(camera, markers, mine, candidates)
        for view, pose in starts[group].views.items():
            if len(candidates[view]) > 1 and sum(one.viewpoint == view for one in used) > len(mine):
                candidates[view] = (PoseCandidate(pose, 0.0),)  # shared with other states: determined once
    return starts


def _noise(best: Adjustment, problem: _Problem) -> float:
    """Standard deviation of a corner, from the residuals [px]."""
    n_free = 6 * (len(best.bundle.views) + len(best.bundle.bodies))
    n_seen = sum(sighting.pixels.size for sighting in problem.sightings)
    return max(_SMALLEST_NOISE, float(np.sqrt(best.cost / max(n_seen - n_free, 1))))


@dataclass(frozen=True)
class _Problem:
    """Start and sightings of the bundle, with the image, state and marker of each sighting, and the body numbers."""

    start: Bundle
    sightings: tuple[Sighting, ...]
    images: tuple[str, ...]
    keys: tuple[Key, ...]
    bodies: Mapping[Key, int]


def _problem(
    camera: Camera,
    markers: MarkerSet,
    used: Sequence[Glimpse],
    starts: Mapping[str, GroupStart],
    found: Mapping[int, Pose] | None = None,
) -> _Problem:
    """The bundle of all images; found: companions with known poses."""
    views: dict[str, Pose] = {}
    bodies: dict[Key, Pose] = {("", number): pose for number, pose in (found or {}).items()}
    for group, start in starts.items():
        for view, pose in start.views.items():
            views.setdefault(view, pose)
        for number, pose in start.bodies.items():
            bodies.setdefault(_key(markers, group, number), pose)
    view_numbers = {view: i for i, view in enumerate(views)}
    body_numbers = {key: i for i, key in enumerate(bodies)}
    sightings: list[Sighting] = []
    images: list[str] = []
    keys: list[Key] = []
    for one in used:
        for number, pixels in one.corners.items():
            if number in markers.base:
                body, points = BASE, markers.base_corners(number)
            elif _key(markers, one.group, number) in body_numbers:
                body, points = body_numbers[_key(markers, one.group, number)], markers.corners(number)
            else:
                continue
            sightings.append(Sighting(view_numbers[one.viewpoint], body, points, pixels))
            images.append(one.image)
            keys.append((one.group, number))
    start = Bundle(camera, tuple(views.values()), tuple(bodies.values()))
    return _Problem(start, tuple(sightings), tuple(images), tuple(keys), body_numbers)


def _key(markers: MarkerSet, group: str, number: int) -> Key:
    return ("", number) if number in markers.companions else (group, number)


def _weighed(markers: MarkerSet, problem: _Problem, bundle: Bundle, noise: float) -> tuple[Sighting, ...]:
    """Sightings with weights for the systematic error of repeated images from one viewpoint.

    A part of a corner's error is the same in each image (alignment of pixels, print and edge): the mean of n has the
    variance noise² / n plus that part squared. Fixed markers repeat over all states that share a viewpoint, others
    over the images of a state.
    """
    centres = [view.inverse().position for view in bundle.views]
    places = [
        next(i for i, other in enumerate(centres) if np.linalg.norm(centre - other) <= _PLACE * np.linalg.norm(centre))
        for centre in centres
    ]
    is_shared = len({(s.view, key[0]) for s, key in zip(problem.sightings, problem.keys, strict=True)}) > len(centres)
    alike = [
        (places[s.view], "" if is_shared and number in markers.standing else group, number)
        for s, (group, number) in zip(problem.sightings, problem.keys, strict=True)
    ]
    counts = Counter(alike)
    return tuple(
        replace(sighting, weight=noise / np.sqrt(noise**2 + (counts[one] - 1) * _SMALLEST_NOISE**2))
        for sighting, one in zip(problem.sightings, alike, strict=True)
    )


def _second_pose(bundle: Bundle, sightings: Sequence[Sighting], highest_cost: float) -> Pose | None:
    """Another pose of a body whose cost is at most `highest_cost` [px²]; None if there is none."""
    body = bundle.bodies[sightings[0].body]
    alone = [replace(s, body=0, weight=1.0) for s in sightings]
    for sighting in alone:
        view = bundle.views[sighting.view]
        for candidate in pose_candidates(bundle.camera, sighting.points, sighting.pixels):
            start = view.inverse().after(candidate.pose)
            if start.angle_to(body) < _OTHER:
                continue
            other = adjust(Bundle(bundle.camera, bundle.views, (start,)), alone, hold_views=True)
            pose = other.bundle.bodies[0]
            if other.cost <= highest_cost and pose.angle_to(body) > _OTHER:
                return pose
    return None
