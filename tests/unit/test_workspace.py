"""`softcal workspace`: its options, files, picture and section of the report, and what it refuses."""

from __future__ import annotations

import csv
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import run
from project_case import write_project
from scipy.spatial import ConvexHull
from soft_robots import TENTACLE

import softcal
from softcal.analysis.workspace import (
    Workspace,
    WorkspaceState,
    alpha_shape,
    outward_normals,
    simplex_sizes,
    workspace_sentences,
)
from softcal.report.figures.workspace import draw_workspace, workspace_caption
from softcal.workflows.workspace import WORKSPACE


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_project(tmp_path_factory.mktemp("bar"))


def test_a_shape_has_its_bays_and_all_places() -> None:
    random = np.random.default_rng(2)
    angles, radii = random.random(1500) * np.pi, 1.0 + random.random(1500)
    crescent = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    simplices = alpha_shape(crescent)
    assert len(np.unique(simplices)) == len(crescent)
    assert simplex_sizes(crescent[simplices]).sum() == pytest.approx(1.5 * np.pi, rel=0.07)
    normals = outward_normals(crescent)
    for k, normal in normals.items():
        if 0.3 < angles[k] < np.pi - 0.3 and abs(radii[k] - 1.5) > 0.4:
            assert normal @ crescent[k] * np.sign(radii[k] - 1.5) > 0.0
    assert sorted(outward_normals(crescent[:, :1])) == sorted(
        [int(crescent[:, 0].argmin()), int(crescent[:, 0].argmax())]
    )
    cube = random.random((400, 3))  # flat tetrahedra at its sides are no part of it
    assert simplex_sizes(cube[alpha_shape(cube)]).sum() == pytest.approx(ConvexHull(cube).volume, rel=0.12)


def test_it_is_printed_written_drawn_and_replayed(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, picture = tmp_path / "workspace", tmp_path / "workspace.png"
    options = ("--of", "plate.pitch", "--limit", "tension=0N..5N", "--states", "16")
    code, told, _ = run(capsys, "workspace", project, *options, "--out", out, "--picture", picture)
    assert code == 0
    for end in ("upper limit 5 N (1)", "lower limit 0 N (1)"):
        assert f"front.tension at its {end}" in " ".join(told.split())
    assert picture.read_bytes().startswith(b"\x89PNG")
    stored = WORKSPACE.read(out)
    assert stored is not None
    assert json.loads((out / "workspace.json").read_text())["sentences"] == workspace_sentences(stored.study)
    same = softcal.workspace(project, ["plate.pitch"], limits={"tension": (0.0, 5.0)}, states=16)
    assert replace(stored.study, wall_s=0.0) == replace(same, wall_s=0.0)
    with (out / "states.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["place"] for row in rows].count("border") == 2
    live = softcal.LiveTwin(softcal.load(project), "tension")
    for row in rows[::5]:
        state = live.at({"front": float(row["front.tension [N]"])})
        assert state.channels["plate.pitch"] == pytest.approx(float(row["plate.pitch [rad]"]), abs=1e-9)
    code, _, told = run(capsys, "workspace", project, *options, "--picture", picture)
    assert code == 2
    assert "nothing is overwritten" in told


@pytest.mark.slow
def test_a_run_shows_it_in_its_report_while_it_is_at_its_values(
    project: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert run(capsys, "calibrate", project, "--out", folder, "--no-report")[0] == 0
    options = ("--of", "plate.x,plate.pitch", "--limit", "tension=0N..5N")
    code, _, told = run(capsys, "workspace", folder, *options)
    assert code == 2
    assert "there are more channels than commands; got 2 channels and 1 command" in told
    code, told, _ = run(capsys, "workspace", folder, "--of", "plate.pitch", "--limit", "tension=0N..5N")
    assert code == 0
    assert f"Add it to the report with: softcal report {folder}" in told
    stored = WORKSPACE.read(folder / "workspace")
    assert stored is not None
    estimates = softcal.load_run(folder).headline.parameters
    assert stored.study.values == {label: estimate.value for label, estimate in estimates.items()}
    softcal.write_report(folder)
    page = (folder / "report.html").read_text()
    assert "Where the robot reaches" in page
    assert workspace_sentences(stored.study)[0].split(";")[0] in page
    shutil.rmtree(folder / "workspace")
    elsewhere = replace(stored.study, values={label: 2.0 * value for label, value in stored.study.values.items()})
    WORKSPACE.write(elsewhere, softcal.load(project), stored.calibration, folder / "workspace")
    softcal.write_report(folder)
    page = (folder / "report.html").read_text()
    assert "is not at the calibrated values: delete it and repeat it." in page
    assert workspace_sentences(stored.study)[0].split(";")[0] not in page


FAULTS = {
    "an unknown channel": (["--of", "plate.pich"], "the robot has no such channel; got 'plate.pich'.*plate.pitch"),
    "one channel twice": (["--of", "plate.x,plate.x"], "this is no workspace"),
    "four channels": (["--of", "plate.x,plate.y,plate.z,plate.pitch"], "this is no workspace.*1 to 3 channels"),
    "a tension": (["--of", "front.tension"], "this is neither a place nor an angle; got front.tension"),
    "no end": (["--of", "plate.x", "--limit", "tension=1N.."], "the range of the command has no end"),
    "limits the wrong way round": (
        ["--of", "plate.x", "--limit", "tension=5N..1N"],
        "the limits contradict each other",
    ),
    "too few states": (["--of", "plate.x", "--states", "0"], "states"),
    "no picture": (["--of", "plate.x", "--picture", "a.pdf"], "this is no image file"),
    "an unknown limit": (["--of", "plate.x", "--limit", "tensions=1N..2N"], "the robot has no such channel"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_answered(fault: str, project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options, answer = FAULTS[fault]
    limits = [] if "--limit" in options else ["--limit", "tension=0N..5N"]
    code, _, told = run(capsys, "workspace", project, *options, *limits)
    assert code == 2
    assert re.search(answer, " ".join(told.split())), told


def test_limits_that_leave_no_state_are_answered(project: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ("--of", "plate.pitch", "--limit", "tension=0N..5N", "--limit", "plate.z=10m..11m")
    code, _, told = run(capsys, "workspace", project, *options)
    assert code in (1, 2)
    assert "Only 0 of 34 commands have a state within the limits" in told or "plausible" in told


def test_what_leaves_no_workspace_is_answered() -> None:
    limits = {"tension": (0.0, 1.0)}
    with pytest.raises(softcal.SimulationError, match=r"Only 1 of 1 command .* 3 are needed\. Try more states"):
        softcal.workspace(TENTACLE, ["tip.x"], limits=limits, states=1)
    with pytest.raises(softcal.SimulationError, match=r"The same at all commands: tip\.x\."):
        softcal.workspace(TENTACLE, ["tip.x"], limits={"tension": (1.0, 1.0)}, states=8)
    front, *others = TENTACLE.cables
    twins = replace(TENTACLE, cables=(front, replace(front, name="twin"), *others))
    by = {"front": "tension", "twin": "tension"}
    with pytest.raises(softcal.SimulationError, match=r"tip\.x, tip\.z depend on each other.* no area"):
        softcal.workspace(twins, ["tip.x", "tip.z"], controls=by, limits=limits, states=8)


@pytest.mark.slow
def test_a_command_may_be_fixed() -> None:
    limits = {"front.tension": (1.0, 1.0), "left.tension": (0.0, 1.0), "right.tension": (0.0, 1.0)}
    found = softcal.workspace(TENTACLE, ["tip.x", "tip.y"], limits=limits, states=16)
    assert {state.commands["front.tension"] for state in found.states} == {1.0}
    assert np.isfinite(found.size)
    assert found.size > 0.0


def test_a_large_mobility_near_buckling_makes_no_other_pose_singular() -> None:
    states = tuple(WorkspaceState({"a.tension": x}, {"tip.x": x}, (mobility,), {}) for x, mobility in
                   ((0.0, 0.05), (0.01, 0.06), (0.02, 5e4)))  # fmt: skip
    units, ranges = {"tip.x": "m", "a.tension": "N"}, {"a.tension": (0.0, 0.02)}
    found = Workspace(("tip.x",), units, ranges, states, (0, 2), ((0, 1), (1, 2)), (), states[0], {}, 0, "", {}, 0.2, 1)
    assert found.lost == pytest.approx(2e-4)
    assert "the mobility in the worst direction is 0.05 at least, at a.tension 0 N." in workspace_sentences(found)[-1]


@pytest.mark.parametrize("k", [1, 2, 3])
def test_its_figure_says_what_it_shows(k: int) -> None:
    random, names = np.random.default_rng(5), ("tip.x", "tip.z", "tip.pitch")[:k]
    places = random.random((60, k)) * [0.1, 0.05, 0.4][:k]
    states = tuple(
        WorkspaceState(
            {"front.tension": 1.0}, dict(zip(names, place.tolist(), strict=True)), (0.5,) * k, {names[0]: 0.002}
        )
        for place in places
    )
    simplices = tuple(tuple(each) for each in alpha_shape(places / np.ptp(places, axis=0)).tolist())
    units = dict(zip(("tip.x", "tip.z", "tip.pitch"), ("m", "m", "rad"), strict=True)) | {"front.tension": "N"}
    ranges = {"front.tension": (0.0, 2.0)}
    found = Workspace(names, units, ranges, states, (0, 1), simplices, states[:1], states[0], {}, 0, "", {}, 1.0, 1.0)
    figure = draw_workspace(found)
    assert len([axes for axes in figure.axes if axes.get_xlabel()]) == {1: 2, 2: 2, 3: 3}[k]
    caption = workspace_caption(found)
    assert "front.tension 0 to 2 N" in caption
    assert ("Diamonds" in caption) == bool(found.singular)
    assert "[mm]" in figure.axes[0].get_xlabel()
    assert found.size_unit == {1: "m", 2: "m^2", 3: "m^2 rad"}[k]
