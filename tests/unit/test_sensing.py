"""Channels: their names, and what is known of their kinds."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from softcal.calibration.results.result import Distance, ExperimentFit
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.plausibility import check_plausible
from softcal.sensing.channel import ChannelName, carriers, channel_name, channel_unit, kinds, positions
from softcal.sensing.sensors.actuators import TENSION
from softcal.sensing.sensors.pose import PITCH


@pytest.mark.parametrize(
    ("name", "carrier", "kind", "unit"),
    [
        ("tension", "", "tension", "N"),
        ("front.tension", "front", "tension", "N"),
        ("m4.x_sd", "m4", "x", "m"),
        ("time", "", "time", "s"),
        ("front.time", "front", "time", None),
        ("time_sd", "", "time", None),
        ("a.b.x", "a.b", "x", None),
        (".x", "", ".x", None),
        ("front.mass", "front", "mass", None),
        ("stress", "", "stress", None),
    ],
)
def test_a_name_is_taken_apart_and_put_together_again(name: str, carrier: str, kind: str, unit: str | None) -> None:
    found = channel_name(name)
    assert (found.carrier, found.kind.name) == (carrier, kind)
    assert str(found) == name
    assert channel_unit(name) == unit
    assert found.is_known == (unit is not None)


def test_a_channel_knows_what_it_is() -> None:
    pitch = channel_name("top.pitch")
    assert pitch == ChannelName(PITCH, "top")
    assert (pitch.point, pitch.offset, str(pitch.deviation)) == ("", "top.pitch_offset", "top.pitch_sd")
    assert channel_name("m4.y").point == "m4"
    assert [str(part) for part in positions("m4")] == ["m4.x", "m4.y", "m4.z"]
    assert (channel_name("tension").label, channel_name("front.tension").label) == ("Cable force", "front.tension")
    assert carriers(TENSION) == ("cables",)
    assert carriers(kinds()["x"]) == ("markers", "plates")
    # In the order in which their modules were imported, which is that of the tests before.
    assert sorted(kinds()) == [
        "angle", "flow", "pitch", "pressure", "roll", "shortening", "tension", "time", "torque", "volume",
        "x", "y", "yaw", "z"
    ]  # fmt: skip


def test_an_unlikely_size_is_warned_of_in_a_channel_of_a_named_part() -> None:
    values = np.linspace(0.0, 8e3, 5)
    values[1] = np.nan
    dataset = Dataset("pull", {"front.tension": Channel(values, "N"), "m1.x": Channel(values, "m")})
    assert check_plausible(dataset) == (
        "pull: front.tension reaches 8e+03 N, above 5000 N: N read as kN?",
        "pull: m1.x reaches 8e+03 m, above 10 m: mm read as m?",
    )


def test_an_angle_has_an_error_of_its_own_beside_the_distance_of_its_plate() -> None:
    rmse = dict.fromkeys(("top.x", "top.y", "top.z", "top.pitch", "x"), 1.0)
    fit = ExperimentFit(rmse, {}, {}, {}, {}, distances={"top": Distance(1.0, 1.0, 1.0, 1)})
    assert fit.alone == ("top.pitch", "x")


def test_names_of_channels_and_parameters_are_taken_apart_in_one_file_each(repository: Path) -> None:
    cut = re.compile(r"""\.r?(partition|split)\(["']\.["']""")
    home = repository / "src" / "softcal"
    found = {str(path.relative_to(home)) for path in home.rglob("*.py") if cut.search(path.read_text(encoding="utf-8"))}
    names = {"sensing/channel.py", "twin/parameter_name.py"}
    # Words of names that do not exist, keys of faults in a file, titles of stored columns, what runs without softcal.
    others = {
        "calibration/results/result_reading.py", "declare.py", "errors.py", "plugins/sofa/sofa_files/robot/pulling.py",
        "plugins/fleet/table.py", "project/bench_plan.py", "project/law_schema.py", "project/robot_bodies.py",
    }  # fmt: skip
    assert found == names | others
