"""Names of channels in project files: a marker's three coordinates, patterns, and never what is noise of a channel."""

from __future__ import annotations

from pathlib import Path

import pytest
from project_case import bench_csv, write_project

from softcal.project.bench_names import channels_named, noise_of
from softcal.project.document import Document, Findings
from softcal.project.project import load

CHANNELS = ("front.tension", "tip1.x", "tip1.y", "tip1.x_sd", "tip2.x", "tip2.x_sd")


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("*", ["tip1.x", "tip1.y", "tip2.x"]),
        ("tip1", ["tip1.x", "tip1.y"]),
        ("front.tension", ["front.tension"]),
        ("tip1.x_sd", ["tip1.x_sd"]),
        ("tip3", []),
        ("*.tension", ["front.tension"]),
        ("tip?.x", ["tip1.x", "tip2.x"]),
        ("*.pitch", []),
    ],
)
def test_a_name_means_itself_the_coordinates_of_markers_or_what_a_pattern_matches(name: str, named: list[str]) -> None:
    assert channels_named(name, CHANNELS) == named


def noted(given: dict[str, str]) -> tuple[dict[str, tuple[str, float]], list[str]]:
    findings = Findings(Document("project.yaml", {}, {}))
    found = noise_of(given, CHANNELS, ("noise",), findings)
    return found, [str(fault) for fault in findings.faults]


def test_a_pattern_gives_the_noise_of_all_that_it_matches() -> None:
    found, faults = noted({"*.tension": "0.1 N", "tip*": "1 mm", "tip2.x": "2 mm"})
    one = ("tip*", 1e-3)
    assert found == {"front.tension": ("*.tension", 0.1), "tip1.x": one, "tip1.y": one, "tip2.x": ("tip2.x", 2e-3)}
    assert not faults


def test_the_noise_of_a_pattern_has_the_unit_of_each_channel() -> None:
    _, (fault,) = noted({"*.*": "1 mm"})
    assert fault.startswith(
        "project.yaml:1: noise.*.*: the unit does not fit; got 'mm'; allowed: a unit that converts to N"
    )


def test_a_hanging_mass_is_named_as_the_tension_that_its_weight_is(tmp_path: Path) -> None:
    compared = 'compare: ["*.tension", pitch]\n    noise: {"*.tension": 0.05 N}'
    changes = (
        ("  cables:\n", "  gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]\n  cables:\n"),
        ("tension: {name: Force, unit: N}", "front.mass: {name: Force, unit: g}"),
        ("noise: {tension: 0.05 N, pitch: 0.2 deg}", compared),
    )
    data = bench_csv().replace("Force [N]", "Force [g]")
    experiment = load(write_project(tmp_path, *changes, data=data)).experiments["pull"]
    assert set(experiment.compared) == {"front.tension", "pitch"}
    assert float(experiment.dataset.channels["front.tension"].sigma) == 0.05
