"""docs/python.md runs as it stands, and lists the public names with the first sentence of each docstring."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

import softcal
from softcal.calibration.loss import LOSSES
from softcal.calibration.optimiser import OPTIMISERS
from softcal.experiments.step import STEPS
from softcal.materials.catalogue import LAWS
from softcal.report.figure import FIGURES
from softcal.sensing.sensor import SENSORS
from softcal.workflows.export import EXPORTS


def test_the_blocks_run_in_their_order(
    repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    page = (repository / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert len(blocks) > 6
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    families = (EXPORTS, FIGURES, LAWS, LOSSES, OPTIMISERS, SENSORS, STEPS)
    before = [set(family) for family in families]
    try:
        for block in blocks:
            exec(compile(block, "docs/python.md", "exec"), names)
    finally:  # other tests of this process register their own
        for family, known in zip(families, before, strict=True):
            for name in set(family) - known:
                family.remove(name)
    assert abs(names["miss"]) < 1e-9
    assert names["jacobian"].shape == (3, 2)
    low, high = names["estimate"].interval
    assert low < 0.9e6 < high
    assert "the robot has no such cable  'middle' left, right" in capsys.readouterr().out
    assert names["motion"].succeeded


def first_sentence(name: str) -> str:
    text = " ".join((inspect.getdoc(getattr(softcal, name)) or "").split("\n\n")[0].split())
    return re.split(r"(?<=\.)\s", text)[0].removesuffix(".").replace("|", r"\|")


def test_the_names_are_listed_with_what_they_are(repository: Path) -> None:
    page = (repository / "docs" / "python.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `(\w+)` \| (.*) \|$", page, re.MULTILINE)
    assert listed == [(name, first_sentence(name)) for name in softcal.__all__]
    assert all(told for _, told in listed)
