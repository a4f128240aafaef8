"""Markers of a .c3d file, and the mean over the end of a record."""

from __future__ import annotations

import io

import c3d
import numpy as np
import pytest

from softcal.errors import DatasetError, StorageError, UnitError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.motion_capture import read_c3d
from softcal.experiments.prepare import prepare
from softcal.experiments.steps.averaging import average

LABELS = ("Tip - 1", "Tip - 2", "Base")
RATE = 100.0
N_FRAMES = 60


def positions(n_frames: int = N_FRAMES) -> np.ndarray:
    """(n_frames, 3, 3): every marker moves, every axis by an amount of its own."""
    frame = np.arange(n_frames)[:, None, None]
    return 10.0 * np.arange(9.0).reshape(3, 3) + frame * 0.1 * (1 + np.arange(3.0))


def written(folder, xyz=None, *, units="mm", labels=LABELS, hidden=(), scale=-1.0, rate=RATE, name="take.c3d"):
    """A .c3d file with these positions; hidden: (frame, marker) without a valid sample."""
    xyz = positions() if xyz is None else xyz
    writer = c3d.Writer(point_rate=rate, analog_rate=0.0, point_scale=scale, point_units=units)
    points = np.zeros((*xyz.shape[:2], 5), dtype=np.float32)
    points[:, :, :3] = xyz
    for frame, marker in hidden:
        points[frame, marker] = [0, 0, 0, -1, -1]
    writer.set_point_labels([label.ljust(12) for label in labels])
    writer.set_analog_labels([""])
    for frame in points:
        writer.add_frames((frame, np.zeros((0, 1))))
    stream = io.BytesIO()
    writer.write(stream)
    path = folder / name
    path.write_bytes(stream.getvalue())
    return path


@pytest.fixture(autouse=True)
def _quiet_writer():
    import warnings

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="No analog data found")
        yield


MARKERS = {"tip1": "Tip - 1", "tip2": " Tip - 2 ", "base": "Base"}


def test_positions_are_in_metres_by_the_files_unit(tmp_path):
    for units, factor in (("mm", 1e-3), ("m", 1.0), ("cm  ", 1e-2)):
        data = read_c3d(written(tmp_path, units=units), MARKERS)
        for marker, name in enumerate(MARKERS):
            for axis, letter in enumerate("xyz"):
                expected = positions()[:, marker, axis] * factor
                np.testing.assert_allclose(data.values(f"{name}.{letter}"), expected, rtol=1e-6, atol=1e-9)
        assert {channel.unit for key, channel in data.channels.items() if key != "time"} == {"m"}


def test_whole_numbers_are_scaled(tmp_path):
    data = read_c3d(written(tmp_path, np.round(positions(), 2), scale=0.01), MARKERS)
    np.testing.assert_allclose(data.values("base.z"), np.round(positions(), 2)[:, 2, 2] * 1e-3, atol=6e-6)


def test_time_begins_at_the_first_frame(tmp_path):
    data = read_c3d(written(tmp_path, rate=50.0), {"base": "Base"})
    np.testing.assert_allclose(data.values("time"), np.arange(N_FRAMES) / 50.0, rtol=1e-12)
    assert set(data.channels) == {"time", "base.x", "base.y", "base.z"}


def test_a_sample_that_was_not_seen_is_missing_and_on_record(tmp_path):
    data = read_c3d(written(tmp_path, hidden=[(3, 1), (4, 1)]), MARKERS)
    assert np.flatnonzero(np.isnan(data.values("tip2.y"))).tolist() == [3, 4]
    assert set(data.incomplete) == {"tip2.x", "tip2.y", "tip2.z"}
    assert "tip2 in 2 frames" in data.provenance[0].outcome


def test_what_is_no_c3d_file_is_refused(tmp_path):
    path = tmp_path / "take.c3d"
    for content in (b"", b"time,x\n1,2\n" * 100):
        path.write_bytes(content)
        with pytest.raises(DatasetError, match=r"not a \.c3d file") as caught:
            read_c3d(path, MARKERS)
        assert str(path) in str(caught.value)
    with pytest.raises(StorageError, match="cannot be read"):
        read_c3d(tmp_path / "none.c3d", MARKERS)


def test_a_file_that_was_cut_off_is_refused(tmp_path):
    whole = written(tmp_path).read_bytes()
    path = tmp_path / "cut.c3d"
    path.write_bytes(whole[:600])
    with pytest.raises(DatasetError, match=r"damaged|no frames|no points"):
        read_c3d(path, MARKERS)
    path.write_bytes(whole[:-1536])
    with pytest.raises(DatasetError, match="ends after"):
        read_c3d(path, MARKERS)


def test_a_label_that_is_not_there_is_told_with_the_nearest(tmp_path):
    with pytest.raises(DatasetError) as caught:
        read_c3d(written(tmp_path), {"tip1": "Tip-1", "base": "Sockel"})
    text = str(caught.value)
    assert "'Tip-1'" in text
    assert "'Sockel'" in text
    assert "Tip - 1, Tip - 2, Base" in text
    assert caught.value.faults[0].attempt == "'Tip - 1'"


def test_two_points_of_one_label_are_refused_where_it_is_asked_for(tmp_path):
    path = written(tmp_path, labels=("A", "A", "B"))
    with pytest.raises(DatasetError, match="two points have this label"):
        read_c3d(path, {"m": "A"})
    assert read_c3d(path, {"m": "B"}).n_samples == N_FRAMES


def test_a_unit_that_is_none_is_refused(tmp_path):
    with pytest.raises(UnitError, match="POINT:UNITS"):
        read_c3d(written(tmp_path, units="furz"), MARKERS)
    with pytest.raises(UnitError, match="POINT:UNITS"):
        read_c3d(written(tmp_path, units="s "), MARKERS)


def test_the_mean_over_the_end_with_its_spread(tmp_path):
    data = average(read_c3d(written(tmp_path), MARKERS), last=0.1)
    end = positions()[-10:] * 1e-3
    assert data.n_samples == 1
    for marker, name in enumerate(MARKERS):
        channel = data.channels[f"{name}.y"]
        assert channel.values[0] == pytest.approx(end[:, marker, 1].mean(), rel=1e-6)
        assert channel.sigma == pytest.approx(end[:, marker, 1].std(ddof=1), rel=1e-4)
    assert "10 samples" in data.provenance[-1].outcome


def test_what_was_seen_in_part_of_the_window_is_averaged_over_that(tmp_path):
    hidden = [(frame, 0) for frame in range(55, 60)]
    data = prepare(read_c3d(written(tmp_path, hidden=hidden), MARKERS), [{"average": "0.1 s"}])
    assert data.values("tip1.x")[0] == pytest.approx(positions()[50:55, 0, 0].mean() * 1e-3, rel=1e-6)
    assert not data.incomplete


def test_what_was_not_seen_in_the_window_is_told_with_its_last_sight(tmp_path):
    hidden = [(frame, marker) for frame in range(40, 60) for marker in (0, 2)]
    with pytest.raises(DatasetError) as caught:
        average(read_c3d(written(tmp_path, hidden=hidden), MARKERS), last=0.1)
    text = str(caught.value)
    assert len(caught.value.faults) == 2
    assert "tip1 was not measured" in text
    assert "base was not measured" in text
    assert "last at 0.39 s of 0.59 s" in text
    with pytest.raises(DatasetError, match="not once in the record"):
        average(Dataset("m", {"m.x": Channel(np.array([np.nan, np.nan]), "m")}))


def test_a_window_of_no_length_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="above 0 s"):
        average(read_c3d(written(tmp_path), MARKERS), last=0.0)


def test_deviations_of_single_samples_add_to_the_spread():
    values = np.array([1.0, 3.0])
    data = Dataset("m", {"m.x": Channel(values, "m"), "m.x_sd": Channel(np.array([2.0, 2.0]), "m")})
    found = average(data)
    assert set(found.channels) == {"m.x"}
    assert found.channels["m.x"].sigma == pytest.approx(np.hypot(np.sqrt(2.0), 2.0))
