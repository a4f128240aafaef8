"""Fleets whose populations are known: the example's, and the small one of `benchmarks.fleet`, killed and resumed."""

from __future__ import annotations

import csv
import json
import signal
from pathlib import Path

import pytest

from benchmarks.fleet import NU, E, neck_mesh, neck_twin, rows_of_populations, run_until, write_fleet
from softcal.plugins.fleet.workflow import fleet

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "fleet"


@pytest.mark.slow
def test_the_example_finds_its_law_and_its_filaments(tmp_path: Path) -> None:
    found = fleet(EXAMPLE, out=tmp_path / "out")
    with (EXAMPLE / "truth.csv").open(encoding="utf-8") as file:
        truth = {row["specimen"]: row for row in csv.DictReader(file)}
    inside = 0
    for one in found.specimens:
        true = 1e6 * float(truth[one.name]["youngs_modulus [MPa]"])
        assert one.parameters[E].value == pytest.approx(true, rel=0.01)
        low, high = one.parameters[E].interval or (0.0, 0.0)
        inside += low <= true <= high
    assert inside >= 10  # of 12
    (law,) = found.statement.laws
    assert law.exponent_interval[0] <= 1.4 <= law.exponent_interval[1]
    assert law.bulk_interval[0] <= 9e6 * 1.25**0.5 <= law.bulk_interval[1]
    filament, printer = (
        next(e for e in found.statement.effects if (e.label, e.factor) == (E, factor))
        for factor in ("filament", "printer")
    )
    assert filament.differs
    assert filament.groups[1].mean / filament.groups[0].mean == pytest.approx(1.25, abs=0.05)
    assert not printer.differs


@pytest.mark.long
def test_a_fleet_that_is_killed_and_stopped_is_resumed_to_the_same_end(tmp_path: Path) -> None:
    mesh = neck_mesh()
    write_fleet(tmp_path / "fleet", 12, mesh, neck_twin(mesh))
    out = tmp_path / "out"
    killed = run_until(tmp_path / "fleet", out, 2, 3, signal.SIGKILL, resume=False)
    assert killed.code == -signal.SIGKILL
    stopped = run_until(tmp_path / "fleet", out, 2, 7, signal.SIGINT, resume=True)
    assert stopped.code in (130, 0)
    last = run_until(tmp_path / "fleet", out, 2, 12, None, resume=True)
    assert (last.code, last.finished) == (0, 12)
    record = json.loads((out / "fleet.json").read_text(encoding="utf-8"))
    rows = {row[0]: row for row in rows_of_populations(record["statement"])}
    assert {E, NU} <= set(rows)
    assert [row[-1] for row in rows.values()] == ["yes"] * len(rows)
    assert (out / "report.html").is_file()
    alone = fleet(tmp_path / "fleet", out=tmp_path / "alone")
    for one in alone.specimens:
        kept = json.loads((out / "specimens" / f"{one.name}.json").read_text(encoding="utf-8"))
        assert kept["parameters"][E]["value"] == pytest.approx(one.parameters[E].value, rel=1e-9)
