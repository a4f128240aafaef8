"""Markers' poses from their corners: bundle adjustment, its uncertainty, ambiguity, and what does not fit together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from marker_bench import WEBCAM, Bench, glimpse, looking, manipulator, viewpoints

from softcal.errors import DatasetError
from softcal.geometry.pose import Pose
from softcal.plugins.markers import marker_pose
from softcal.plugins.markers.bundle import BASE, Bundle, Sighting, adjust, pose_candidates, square_corners
from softcal.plugins.markers.marker_pose import MarkerPoses, estimate_poses
from softcal.plugins.markers.marker_scene import Glimpse, MarkerSet
from softcal.plugins.markers.marker_table import marker_table

NOISE = 0.03  # [px]
MARKERS = MarkerSet({0: Pose.of()}, 0.02, names={1: "S1", 2: "S2", 3: "S3", 4: "S4"})


def views_of(bench: Bench, n: int, group: str = "rest", seed: int = 0, noise: float = NOISE) -> list[Glimpse]:
    return [
        glimpse(bench, view, group, name=f"{group}_{i}.png", noise=noise, seed=100 * seed + i)
        for i, view in enumerate(viewpoints(n))
    ]


def errors(found: MarkerPoses, bench: Bench, group: str = "rest") -> np.ndarray:
    """Distances [m] of the positions found from the true ones."""
    return np.array(
        [
            np.linalg.norm(one.pose.position - bench.in_base(k).position)
            for (g, k), one in found.estimates.items()
            if g == group
        ]
    )


def test_slopes_are_those_of_the_residuals():
    bundle = Bundle(
        WEBCAM, (Pose.of((0.1, 0.2, 3.0), (0.0, 0.02, 0.5)),), (Pose.of((0.3, 0.2, 0.1), (0.02, 0.03, 0.01)),)
    )
    sighting = Sighting(0, 0, square_corners(0.02), np.zeros((4, 2)))
    exact = np.hstack(bundle.slopes(sighting))
    for i, step in enumerate(1e-6 * np.eye(12)):
        slope = (bundle.moved(step).residuals(sighting) - bundle.moved(-step).residuals(sighting)) / 2e-6
        assert exact[:, i] == pytest.approx(slope.ravel(), rel=1e-6, abs=1e-4)


def test_exact_corners_give_exact_poses():
    bench = manipulator()
    found = estimate_poses(WEBCAM, MARKERS, views_of(bench, 2, noise=0.0))
    assert errors(found, bench).max() < 1e-8
    for (_, number), one in found.estimates.items():
        assert one.pose.angle_to(bench.in_base(number)) < 1e-7


def test_the_second_pose_of_a_marker_is_found_and_costs_more():
    pose = Pose.of((np.pi - 0.6, 0.0, 0.0), (0.02, 0.01, 0.5))
    points = square_corners(0.02)
    best, other = pose_candidates(WEBCAM, points, WEBCAM.project(pose.apply(points)))
    assert best.pose.angle_to(pose) < 1e-6
    assert np.degrees(other.pose.angle_to(pose)) == pytest.approx(70, abs=15)
    assert best.cost < 1e-12 < 0.1 < other.cost


@pytest.mark.slow
@pytest.mark.parametrize("n_views", [1, 3])
def test_the_stated_uncertainty_is_that_of_repeated_measurements(n_views: int):
    bench = manipulator()
    scores = []
    for seed in range(12):
        found = estimate_poses(WEBCAM, MARKERS, views_of(bench, n_views, seed=seed))
        for (_, number), one in found.estimates.items():
            sd = np.sqrt(np.diag(one.covariance)[3:])
            scores.append((one.pose.position - bench.in_base(number).position) / sd)
    # Unity for a perfect statement; the noise of a single view is itself known from few residuals.
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.3


def test_more_views_and_more_markers_on_the_base_make_it_surer():
    bench = manipulator()
    single, triple = (estimate_poses(WEBCAM, MARKERS, views_of(bench, n)) for n in (1, 3))
    board = {0: Pose.of(), 7: Pose.of((0, 0, 0.3), (0.05, 0, 0)), 8: Pose.of((0, 0, 0), (-0.05, -0.01, 0.02))}
    poses = {**bench.poses, **{k: bench.poses[0].after(p) for k, p in board.items()}}
    wide = Bench(poses, dict.fromkeys(poses, 0.02))
    placed = estimate_poses(WEBCAM, replace(MARKERS, base=board), views_of(wide, 1))
    companions = estimate_poses(WEBCAM, replace(MARKERS, companions=(7, 8)), views_of(wide, 3))

    def worst(found: MarkerPoses) -> float:
        return max(float(np.sqrt(np.diag(one.covariance)[3:].max())) for one in found.estimates.values())

    # Less what each thinks of the noise, which it knows from its few residuals.
    assert worst(triple) / triple.noise < 0.5 * worst(single) / single.noise
    assert worst(placed) / placed.noise < 0.5 * worst(single) / single.noise
    assert errors(placed, wide).max() < 4 * worst(placed)
    assert errors(companions, wide).max() < 4 * worst(companions)
    assert set(companions.companions) == {7, 8}
    for number, one in companions.companions.items():
        assert one.pose.position == pytest.approx(board[number].position, abs=2e-4)


@pytest.mark.slow
def test_companions_place_an_image_that_does_not_show_the_base_marker():
    bench = manipulator()
    board = {7: Pose.of((0.3, 0.0, 0.0), (0.04, 0.0, 0.0)), 8: Pose.of((0.0, 0.4, 0.0), (-0.04, 0.01, 0.0))}
    poses = {**bench.poses, **{k: bench.poses[0].after(p) for k, p in board.items()}}
    seen = views_of(Bench(poses, dict.fromkeys(poses, 0.02)), 3)
    other = Bench({**manipulator(seed=1).poses, **{k: poses[k] for k in (0, 7, 8)}}, dict.fromkeys(poses, 0.02))
    # Of the second state, one image shows the base marker and two do not; of the third, none does.
    mixed = [without(one, 0) if i else one for i, one in enumerate(views_of(other, 3, "mixed", seed=1))]
    late = [without(one, 0) for one in views_of(other, 2, "late", seed=2)]
    markers = replace(MARKERS, companions=(7, 8))
    found = estimate_poses(WEBCAM, markers, [*seen, *mixed, *late])
    assert found.lost == ()
    assert found.unplaced == {}
    assert {one.n_images for (group, _), one in found.estimates.items() if group != "rest"} == {2, 3}
    assert errors(found, other, "mixed").max() < 5e-4
    assert errors(found, other, "late").max() < 8e-4
    # Companions that no image with the base shows place nothing.
    alone = estimate_poses(WEBCAM, markers, [*(without(one, 7, 8) for one in seen), *late])
    assert alone.lost == tuple(one.image for one in late)
    assert set(alone.unplaced) == {"late"}


def without(one: Glimpse, *numbers: int) -> Glimpse:
    return replace(one, corners={k: c for k, c in one.corners.items() if k not in numbers})


def test_a_camera_that_stands_still_is_surer_of_the_base():
    benches = {f"load{i}": manipulator(seed=i) for i in range(6)}
    view = viewpoints(1)[0]

    def found(share: str) -> MarkerPoses:
        seen = [glimpse(b, view, g, share=share, noise=NOISE, seed=i) for i, (g, b) in enumerate(benches.items())]
        return estimate_poses(WEBCAM, MARKERS, seen)

    def mean_error(poses: MarkerPoses) -> float:
        return float(np.mean([errors(poses, bench, group).mean() for group, bench in benches.items()]))

    moving, still = found(""), found("tripod")
    assert len(still.estimates) == 24
    assert mean_error(still) < 0.7 * mean_error(moving)


FAINT = 0.06  # [px]
EYE = (0.0, 0.0, 0.6)  # where the camera is [m]


@pytest.mark.slow
def test_images_from_one_place_do_not_average_away_what_is_alike_in_them():
    bench, view = manipulator(), viewpoints(1)[0]

    def sd(n: int, share: str) -> float:
        seen = [glimpse(bench, view, name=f"{i}.png", share=share, noise=0.005, seed=i) for i in range(n)]
        found = estimate_poses(WEBCAM, MARKERS, seen).estimates["rest", 4]
        return float(np.sqrt(np.diag(found.covariance)[3:].max()))

    single = sd(1, "")
    for share in ("", "tripod"):
        assert sd(9, share) == pytest.approx(single, rel=0.1)
    apart = estimate_poses(WEBCAM, MARKERS, views_of(bench, 3, noise=0.005)).estimates["rest", 4]
    assert np.sqrt(np.diag(apart.covariance)[3:].max()) < 0.5 * single


def frontal(number: int) -> Bench:
    """A bench whose marker `number` all but faces `EYE`, so that noise hides which way it is tilted."""
    bench = manipulator()
    place = bench.poses[number].position
    sight = (np.array(EYE) - place) / np.linalg.norm(np.array(EYE) - place)
    facing = Pose.of(np.cross((0.0, 0.0, 1.0), sight) * (np.arccos(sight[2]) / np.hypot(*sight[:2])))
    turned = Pose(Pose.of((0.0, 0.08, 0.0)).after(facing).rotation, place)
    return replace(bench, poses={**bench.poses, number: turned})


def test_an_ambiguous_marker_is_named_and_keeps_its_position(monkeypatch: pytest.MonkeyPatch):
    bench = frontal(2)
    seen = [glimpse(bench, looking(EYE, (0.0, 0.0, 0.0)), noise=FAINT, seed=1)]
    found = estimate_poses(WEBCAM, MARKERS, seen)
    assert found.estimates["rest", 2].is_ambiguous
    assert not found.estimates["rest", 1].is_ambiguous
    one, other = pose_candidates(WEBCAM, square_corners(0.02), seen[0].corners[2])
    monkeypatch.setattr(marker_pose, "_second_pose", lambda *_: None)
    unaware = estimate_poses(WEBCAM, MARKERS, seen).estimates["rest", 2]
    wider = np.trace((found.estimates["rest", 2].covariance - unaware.covariance)[3:, 3:])
    assert np.sqrt(wider) == pytest.approx(np.linalg.norm(one.pose.position - other.pose.position) / 2, rel=0.05)
    table = marker_table(MARKERS, seen, found)
    assert "S2 (marker 2) is ambiguous" in table.notes["rest"][0]
    header, row = (line.split(",") for line in table.csv().splitlines())
    cells = dict(zip(header, row, strict=True))
    assert cells["S2.rx [rad]"] == ""
    assert float(cells["S2.x [m]"]) == pytest.approx(bench.in_base(2).position[0], abs=4e-3)


def test_an_ambiguous_base_places_nothing():
    bench = frontal(0)
    view = looking(EYE, (0.0, 0.0, 0.0))
    seen = [glimpse(bench, view, "bad", noise=FAINT, seed=2), *views_of(manipulator(), 1, "good", noise=FAINT)]
    found = estimate_poses(WEBCAM, MARKERS, seen)
    assert list(found.unplaced) == ["bad"]
    assert {group for group, _ in found.estimates} == {"good"}
    table = marker_table(MARKERS, seen, found)
    assert "two poses of the base" in table.notes["bad"][0]


def test_another_view_decides_between_the_poses_of_the_base():
    bench = frontal(0)
    seen = [
        glimpse(bench, looking((x, 0.0, 0.6), (0.0, 0.0, 0.0)), name=f"{x}", noise=FAINT, seed=2 + i)
        for i, x in enumerate((0.0, 0.12))
    ]
    found = estimate_poses(WEBCAM, MARKERS, seen)
    assert not found.unplaced
    assert errors(found, bench).max() < 5e-3


def test_a_missing_marker_is_named():
    bench = manipulator()
    whole = views_of(bench, 1, "whole")
    partly = [
        replace(one, corners={k: c for k, c in one.corners.items() if k != 3}) for one in views_of(bench, 1, "partly")
    ]
    seen = [*whole, *partly]
    table = marker_table(MARKERS, seen, estimate_poses(WEBCAM, MARKERS, seen), {"partly_0.png": (3,)})
    assert table.notes == {"whole": (), "partly": ("S3 (marker 3) has no clear edges",)}
    rows = table.csv().splitlines()
    assert rows[0].startswith(
        "group,images [1],S1.x [m],S1.y [m],S1.z [m],S1.x_sd [m],S1.y_sd [m],S1.z_sd [m],S1.rx [rad]"
    )
    assert rows[2].startswith("partly,1,")
    assert ",,,,,,,,,,,,0," in rows[2]
    assert rows[2].endswith("S3 (marker 3) has no clear edges")


def test_a_name_that_is_in_no_image():
    bench = manipulator()
    seen = views_of(bench, 1)
    markers = replace(MARKERS, names={**MARKERS.names, 9: "S9"})
    table = marker_table(markers, seen, estimate_poses(WEBCAM, markers, seen))
    assert table.names == ("S1", "S2", "S3", "S4")
    assert table.remarks == (
        "S9 (marker 9) is in none of the images, which show markers 0, 1, 2, 3, 4; the table leaves it out",
    )
    assert not any(table.notes.values())


def test_names_none_of_which_is_in_an_image():
    seen = views_of(manipulator(), 1)
    markers = replace(MARKERS, names={8: "S8", 9: "S9"})
    with pytest.raises(DatasetError, match=r"got S8 \(marker 8\), S9 \(marker 9\); allowed: markers 0, 1, 2, 3, 4"):
        marker_table(markers, seen, estimate_poses(WEBCAM, markers, seen))


def test_images_without_the_base():
    bench = manipulator()
    first, second = views_of(bench, 2)
    blind = replace(second, corners={k: c for k, c in second.corners.items() if k != 0})
    found = estimate_poses(WEBCAM, MARKERS, [first, blind])
    assert found.lost == ("rest_1.png",)
    assert found.estimates["rest", 1].n_images == 1
    with pytest.raises(DatasetError, match="the base is in none of the images; got markers 1, 2, 3, 4"):
        estimate_poses(WEBCAM, MARKERS, [blind])


def test_images_of_different_states_do_not_fit_together():
    seen = [replace(one, group="rest") for i in range(2) for one in views_of(manipulator(seed=i), 1, f"state{i}")]
    seen[1] = replace(seen[1], viewpoint="other")
    with pytest.raises(DatasetError, match=r"do not fit together with the other images of 'rest'.*px away on average"):
        estimate_poses(WEBCAM, MARKERS, seen)


def test_a_marker_that_moved_a_little_is_less_certain_than_the_others():
    bench, view = manipulator(), viewpoints(1)[0]
    shaken = replace(bench, poses={**bench.poses, 4: Pose.of((0, 0, 0), (0.0, 0.0003, 0.0)).after(bench.poses[4])})
    still = [glimpse(bench, view, name=f"{i}.png", share="tripod", noise=NOISE, seed=i) for i in range(4)]
    moved = [*still[:2], *(glimpse(shaken, view, name=f"{i}.png", share="tripod", noise=NOISE, seed=i) for i in (2, 3))]

    def against_its_neighbour(seen: list[Glimpse]) -> float:
        found = estimate_poses(WEBCAM, MARKERS, seen).estimates
        sd = {number: np.sqrt(np.diag(found["rest", number].covariance)[3:]).max() for number in (3, 4)}
        return float(sd[4] / sd[3])

    assert against_its_neighbour(moved) > 1.5 * against_its_neighbour(still)


def test_a_marker_that_nobody_asked_for_may_move():
    first, second = views_of(manipulator(), 2)
    stray = square_corners(0.02)[:, :2] * 1500 + (900, 500)
    seen = [replace(one, corners={**one.corners, 9: stray + 100 * i}) for i, one in enumerate((first, second))]
    found = estimate_poses(WEBCAM, MARKERS, seen)
    assert {number for _, number in found.estimates} == {1, 2, 3, 4}
    assert "markers without a name were left out: 9" in marker_table(MARKERS, seen, found).remarks
    with pytest.raises(DatasetError, match="do not fit together"):
        estimate_poses(WEBCAM, replace(MARKERS, names={}), seen)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"size": 0.0}, "the size of a marker is not above zero"),
        ({"sizes": {3: -0.01}}, "the size of marker 3 is not above zero"),
        ({"names": {1: "S1", 2: "S1"}}, "two markers have the same name; got 'S1'"),
        ({"companions": (0,)}, "marker 0 is named twice"),
        ({"base": {}}, "no marker is the base"),
    ],
)
def test_a_bench_that_cannot_be(changes: dict[str, object], said: str):
    with pytest.raises(DatasetError, match=said):
        replace(MARKERS, **changes)  # type: ignore[arg-type]


def test_covariances_are_those_of_the_normal_equations():
    bundle = Bundle(WEBCAM, (viewpoints(1)[0],), (Pose.of((0.4, 0.1, 0.0), (0.03, 0.05, 0.0)),))
    points = square_corners(0.02)
    sightings = [
        replace(
            Sighting(0, body, points, np.zeros((4, 2))),
            pixels=bundle.residuals(Sighting(0, body, points, np.zeros((4, 2)))),
        )
        for body in (BASE, 0)
    ]
    found = adjust(bundle, sightings)
    slopes = np.zeros((16, 12))
    slopes[:8, :6] = bundle.slopes(sightings[0])[0]
    slopes[8:] = np.hstack(bundle.slopes(sightings[1]))
    expected = np.linalg.inv(slopes.T @ slopes)[6:, 6:]
    assert found.covariances([0])[0] == pytest.approx(expected, rel=1e-5, abs=1e-12)
