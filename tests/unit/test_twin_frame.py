"""The twin along its pull, for a frame of the report."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from project_case import bar_robot

from softcal.export.reduced import evaluator_of
from softcal.report.twin_view import TwinFrame
from softcal.sensing.sensors.pose import angles
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.simulate import simulate
from softcal.workflows import twin_frame as module
from softcal.workflows.simulation import twin_view
from softcal.workflows.twin_frame import twin_frame


def pulled(control: str, end: float) -> Response:
    values = np.linspace(0.0, end, 9)
    return simulate(bar_robot(), Protocol({"front": Command(control, values)}), snapshots=True)  # type: ignore[arg-type]


def frame_of(response: Response) -> TwinFrame | None:
    view = twin_view(bar_robot(), response)
    assert view is not None
    return twin_frame(view, response)


def data_of(frame: TwinFrame | None) -> dict[str, Any]:
    assert frame is not None
    return json.loads(re.search(r'id="twin-data">(.*?)</script>', frame.page, re.DOTALL)[1])  # type: ignore[index]


@pytest.mark.parametrize(("control", "end"), [("shortening", 12e-3), ("tension", 2.0)])
def test_it_has_the_equilibria_of_the_load_path_and_says_how_far_what_is_between_is_from_the_twin(
    control: str, end: float
) -> None:
    response = pulled(control, end)
    frame = frame_of(response)
    data = data_of(frame)
    (driven,) = data["model"]["inputs"]
    assert (driven["name"], driven["control"]) == ("front", control)
    assert [driven["least"], driven["most"]] == [response.snapshots[k].drive for k in (0, -1)]
    read = evaluator_of({**data["model"], "rows": [], "error": {}})
    largest = response.snapshots[-1].efforts["front"]
    for one in response.snapshots:
        shown = read.state({"front": one.drive})["coordinates"]
        assert shown["front.tension"] == pytest.approx(one.efforts["front"], abs=1e-5 * largest)
        at, turned = one.plates["plate"]
        assert [shown[f"plate.{axis}"] for axis in "xyz"] == pytest.approx(at, abs=1e-7)
        assert shown["plate.pitch"] == pytest.approx(angles(turned)[0], abs=1e-5)
    assert frame is not None
    assert frame.n_measures == len(data["measures"])
    assert set(data["measures"]) >= {"front.tension", f"front.{control}", "plate.x", "plate.pitch"}
    assert data["first"] == "plate.pitch"
    size, share = re.search(r"within ([\d.e-]+) mm of the twin(?:, .* within ([\d.e-]+) %|)", frame.caption).groups()  # type: ignore[union-attr]
    assert 0.0 <= float(size) < 0.5
    assert 0.0 < float(share) < 2.0 if control == "shortening" else share is None


def test_to_and_fro_it_goes_by_steps_and_without_a_pull_or_of_a_large_body_there_is_none(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there = pulled("shortening", 12e-3)
    back = replace(there, snapshots=(*there.snapshots, *there.snapshots[-2::-1]))
    frame = frame_of(back)
    (driven,) = data_of(frame)["model"]["inputs"]
    assert (driven["name"], driven["control"]) == ("step of the test", "")
    assert [driven["least"], driven["most"]] == [1.0, float(len(back.snapshots))]
    assert frame is not None
    assert "samples" not in frame.caption
    many = replace(there, snapshots=there.snapshots * 20)
    assert data_of(frame_of(many))["model"]["inputs"][0]["most"] == module.MOST_SHAPES
    assert frame_of(replace(there, snapshots=tuple(replace(one, controls={}) for one in there.snapshots))) is None
    monkeypatch.setattr(module, "MOST_LETTERS", 1000)
    assert frame_of(there) is None
