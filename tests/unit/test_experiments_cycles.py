"""Cycles of a bench record: found, classified, averaged; the whole of paper A's preparation on a known record."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bench_record
import numpy as np
import pytest
from bench_record import Motion
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from softcal.errors import DatasetError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.hysteresis import loops
from softcal.experiments.prepare import prepare
from softcal.experiments.read import read_table
from softcal.experiments.steps.branches import take_branch
from softcal.experiments.steps.corrections import detrend
from softcal.experiments.steps.cycles import classify_cycles, find_cycles, select_cycles
from softcal.experiments.synchronise import synchronise
from softcal.experiments.table_format import ColumnSpec


def record(moved: Motion, *, noise: float = 0.02, drift: float = 5e-4, seed: int = 1) -> Dataset:
    tension = bench_record.force(moved, noise, drift, seed)
    return Dataset(
        "bench",
        {
            "time": Channel(moved.time, "s"),
            "shortening": Channel(moved.shortening, "m"),
            "tension": Channel(tension, "N"),
        },
    )


def agreement(found: Dataset, moved: Motion) -> float:
    """Share of the samples that stand in the cycle they really belong to."""
    assert found.cycle is not None
    return float(np.mean(found.cycle == moved.cycle))


@settings(max_examples=25, deadline=None)
@given(
    noise=st.floats(0, 0.2),
    drift=st.floats(-5e-3, 1e-2),
    bottom=st.floats(0.1, 3.0),
    top=st.floats(0.0, 3.0),
    n_cycles=st.integers(1, 10),
    seed=st.integers(0, 99),
)
@example(noise=1.0061877534394982e-14, drift=0.0, bottom=0.5, top=1.0, n_cycles=1, seed=3)
def test_cycles_under_noise_drift_and_dwell(
    noise: float, drift: float, bottom: float, top: float, n_cycles: int, seed: int
) -> None:
    moved = bench_record.motion(n_cycles, bottom_dwell=bottom, top_dwell=top)
    found = find_cycles(record(moved, noise=noise, drift=drift, seed=seed))
    assert found.cycle is not None
    assert found.cycle.max() == n_cycles - 1
    assert agreement(found, moved) > 0.97
    assert f"{n_cycles} whole cycle(s)" in found.provenance[-1].outcome


@pytest.mark.parametrize("cut", [2.0, 4.0, 6.0, 8.0])
def test_last_cycle_cut_short_is_left_out(cut: float) -> None:
    moved = bench_record.motion(8, cut=cut)
    found = find_cycles(record(moved))
    assert found.cycle is not None
    assert found.cycle.max() == 6
    assert agreement(found, replace(moved, cycle=np.where(moved.cycle == 7, -1, moved.cycle))) > 0.97


def test_cycles_without_a_crosshead() -> None:
    moved = bench_record.motion(4)
    whole = record(moved)
    found = find_cycles(Dataset("force only", {key: whole.channels[key] for key in ("time", "tension")}))
    assert found.cycle is not None
    for number in range(4):
        taut = (moved.cycle == number) & (moved.shortening > bench_record.SLACK + 1e-3)
        assert np.all(found.cycle[taut] == number)


def test_floor_above_the_lower_force_limit() -> None:
    moved = bench_record.motion(3)
    whole = record(moved)
    raised = find_cycles(whole.with_channels(find_cycles(whole).provenance[-1], tension=whole.values("tension") + 5.0))
    assert agreement(raised, moved) > 0.97


@pytest.mark.parametrize("n", [100, 1000])
def test_no_cycle_in_a_single_pull(n: int) -> None:
    pull = Dataset(
        "pull", {"shortening": Channel(np.linspace(0, 1, n), "m"), "tension": Channel(np.linspace(0, 9, n), "N")}
    )
    with pytest.raises(DatasetError, match=r"no whole load-unload cycle.*0 N to 9 N"):
        find_cycles(pull)


def test_first_preconditioning_and_stable() -> None:
    found = classify_cycles(find_cycles(record(bench_record.motion())))
    classes = found.provenance[-1].settings["classes"]
    assert classes == {"0": "first", "1": "preconditioning", **{str(k): "stable" for k in range(2, 8)}}
    assert "stable: 2 to 7" in found.provenance[-1].outcome
    stable = select_cycles(found)
    assert sorted(set(stable.cycle)) == [2, 3, 4, 5, 6, 7]
    assert set(select_cycles(found, "first").cycle) == {0}
    assert set(select_cycles(found, [1, 5]).cycle) == {1, 5}
    assert set(select_cycles(found, "all").cycle) == set(range(8))


def test_a_tighter_threshold_leaves_fewer_stable() -> None:
    found = classify_cycles(find_cycles(record(bench_record.motion(), noise=0.0, drift=0.0)), threshold=0.004)
    assert "stable: 4 to 7" in found.provenance[-1].outcome


def test_selection_that_cannot_be() -> None:
    found = find_cycles(record(bench_record.motion(2)))
    with pytest.raises(DatasetError, match="classify_cycles before"):
        select_cycles(found)
    with pytest.raises(DatasetError, match=r"no cycle is of the kind 'stable'.*none is stable"):
        select_cycles(classify_cycles(found))
    with pytest.raises(DatasetError, match=r"got 9; allowed: 0, 1"):
        select_cycles(found, [0, 9])
    with pytest.raises(DatasetError, match="find_cycles before"):
        select_cycles(record(bench_record.motion(2)), "all")


def test_branches_differ_by_the_hysteresis() -> None:
    found = find_cycles(record(bench_record.motion(3), noise=0.0, drift=0.0))
    last = select_cycles(found, [2])
    curves = {branch: take_branch(last, branch) for branch in ("loading", "unloading", "mean")}
    for curve in curves.values():
        assert np.all(np.diff(curve.values("shortening")) > 0)
        assert "time" not in curve.channels
        assert curve.cycle is None
    at = 15e-3
    loading, unloading, mean = (np.interp(at, c.values("shortening"), c.values("tension")) for c in curves.values())
    true = bench_record.STIFFNESS * (at - bench_record.SLACK) * bench_record.SOFTENING[2]
    assert_allclose(loading, bench_record.FLOOR + true, rtol=2e-3)
    assert_allclose(loading - unloading, bench_record.HYSTERESIS * true, rtol=0.02)
    assert_allclose(mean, 0.5 * (loading + unloading), rtol=1e-3)


def test_relaxation_at_the_top_belongs_to_no_branch() -> None:
    moved = bench_record.motion(1, top_dwell=3.0)
    whole = find_cycles(record(moved, noise=0.0, drift=0.0))
    top = np.flatnonzero((moved.direction == 0) & (moved.cycle == 0))
    tension = whole.values("tension").copy()
    tension[top] *= np.linspace(1.0, 1.0 - bench_record.HYSTERESIS, len(top))
    relaxed = whole.with_channels(whole.provenance[-1], tension=tension)
    for branch in ("loading", "unloading"):
        force = take_branch(relaxed, branch, n_samples=100).values("tension")
        assert_allclose(np.diff(force)[-3:], np.diff(force)[-10], rtol=0.2)


def test_average_over_cycles_has_their_scatter_as_sigma() -> None:
    moved = bench_record.motion(6)
    whole = find_cycles(record(moved, noise=0.0, drift=0.0))
    assert whole.cycle is not None
    offsets = np.array([0.3, -0.3, 0.1, -0.1, 0.2, -0.2])
    number = whole.cycle.astype(int)
    pitch = 10.0 * moved.shortening + np.where(number >= 0, offsets[number], 0.0)
    whole = replace(whole, channels={**whole.channels, "pitch": Channel(pitch, "rad")})
    loading = take_branch(whole, "loading")
    assert_allclose(loading.channels["pitch"].sigma, np.std(offsets, ddof=1), rtol=5e-3)
    assert_allclose(loading.values("pitch"), 10.0 * loading.values("shortening"), atol=1e-4)
    assert take_branch(whole, "loading", n_samples=37).n_samples == 37


def test_a_pull_has_no_unloading() -> None:
    pull = Dataset(
        "pull", {"shortening": Channel(np.linspace(0, 1, 50), "m"), "tension": Channel(np.linspace(0, 9, 50), "N")}
    )
    assert_allclose(take_branch(pull).values("tension"), 9 * take_branch(pull).values("shortening"), rtol=1e-12)
    with pytest.raises(DatasetError, match="unloading branch is missing"):
        take_branch(pull, "unloading")


def test_drift_is_found_at_the_returns() -> None:
    found = find_cycles(record(bench_record.motion(), noise=0.005, drift=0.01))
    level = detrend(found, "tension")
    assert_allclose(level.values("tension") - found.values("tension"), -0.01 * found.values("time"), atol=0.02)


def test_the_clock_has_no_drift_to_take_off() -> None:
    with pytest.raises(DatasetError, match=r"bench: the time has no drift over itself; got channel time"):
        detrend(record(bench_record.motion()), "time", at="ends")


def test_loop_energy_and_softening() -> None:
    found = find_cycles(record(bench_record.motion(), noise=0.01, drift=0.0))
    travel = bench_record.TRAVEL - bench_record.SLACK
    for loop, factor in zip(loops(found), bench_record.SOFTENING, strict=True):
        energy = 0.5 * bench_record.STIFFNESS * factor * travel**2
        assert_allclose(loop.loading_energy, energy + bench_record.FLOOR * bench_record.TRAVEL, rtol=0.01)
        assert_allclose(loop.lost_energy, bench_record.HYSTERESIS * energy, rtol=0.05)
        assert_allclose(loop.hysteresis, loop.lost_energy / loop.loading_energy)


@given(force=st.sampled_from([1e-3, 1.0, 1e3]), length=st.sampled_from([1e-2, 1.0, 10.0]))
@settings(max_examples=9, deadline=None)
def test_hysteresis_and_cycles_do_not_depend_on_scale(force: float, length: float) -> None:
    whole = record(bench_record.motion(2))
    scaled = whole.with_channels(
        find_cycles(whole).provenance[-1],
        tension=whole.values("tension") * force,
        shortening=whole.values("shortening") * length,
    )
    reference = find_cycles(whole)
    found = find_cycles(scaled, 0.1 * force)
    assert np.array_equal(found.cycle, reference.cycle)
    assert_allclose([x.hysteresis for x in loops(found)], [x.hysteresis for x in loops(reference)], rtol=1e-9)


def test_the_whole_of_paper_a(tmp_path: Path) -> None:
    """Two files on two clocks -> stable loading branch: slack, stiffness and pitch slope are the bench's own."""
    moved = bench_record.motion()
    utm_file = bench_record.write_instron(tmp_path / "utm.csv", moved, bench_record.force(moved))
    imu_file = bench_record.write_imu(tmp_path / "imu.txt", moved)
    utm = read_table(
        utm_file, {"time": ColumnSpec("Time"), "shortening": ColumnSpec("Extension"), "tension": ColumnSpec("Load")}
    )
    imu = read_table(imu_file, {"time": ColumnSpec("time"), "pitch": ColumnSpec("Pitch"), "roll": ColumnSpec("Roll")})
    prepared = prepare(
        synchronise(utm, imu),
        [
            {"correct_pulley_friction": {"n_pulleys": 2, "friction_coefficient": 0.1, "wrap_angle": "180 deg"}},
            {"find_cycles": {"lower_force_limit": "0.1 N"}},
            {"detrend": "tension"},
            {"detrend": {"channel": "pitch"}},
            "classify_cycles",
            {"select_cycles": "stable"},
            {"take_branch": "loading"},
            {"remove_slack": {"subtract_floor": True}},
            {"zero": {"channel": "pitch", "by": "first"}},
            {"resample": {"step": "0.5 mm"}},
        ],
    )
    names = "read_table read_table synchronise correct_pulley_friction find_cycles detrend detrend classify_cycles"
    names += " select_cycles take_branch remove_slack zero resample"
    assert [step.name for step in prepared.provenance] == names.split()
    shortening = prepared.values("shortening")
    at_neck = bench_record.STIFFNESS * np.exp(-0.2 * np.pi) * shortening
    assert_allclose(prepared.values("tension"), at_neck, atol=0.03)
    assert_allclose(prepared.values("pitch"), bench_record.PITCH_SLOPE * shortening, atol=2.5e-3)
    assert_allclose(prepared.provenance[10].settings["slack"], bench_record.SLACK, atol=1e-4)
    assert prepared.channels["tension"].sigma < 0.03
