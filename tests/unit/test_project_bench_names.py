"""Names of channels in project files: a marker's three coordinates, patterns, and never what is noise of a channel."""

from __future__ import annotations

import pytest

from softcal.project.bench_names import channels_named

CHANNELS = ("front.tension", "tip1.x", "tip1.y", "tip1.x_sd", "tip2.x", "tip2.x_sd")


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("*", ["tip1.x", "tip1.y", "tip2.x"]),
        ("tip1", ["tip1.x", "tip1.y"]),
        ("front.tension", ["front.tension"]),
        ("tip1.x_sd", ["tip1.x_sd"]),
        ("tip3", []),
    ],
)
def test_a_name_means_itself_or_the_coordinates_of_markers(name: str, named: list[str]) -> None:
    assert channels_named(name, CHANNELS) == named
