"""Commands on a Dask cluster: what they write is what one process writes."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import pytest
from dask_cluster import DaskProcesses, dask_cluster
from fleet_case import FILE, write_fleet
from project_case import write_project
from sweep_case import write_sweep
from test_calibration_run import same
from typer.testing import CliRunner

from softcal.calibration.results.result_reading import load_result
from softcal.cli import app
from softcal.executors.each import executor_on
from softcal.plugins.fleet.workflow import fleet

pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Generator[DaskProcesses]:
    with dask_cluster(tmp_path_factory.mktemp("dask")) as made:
        yield made


def run(cluster: DaskProcesses, command: str, *arguments: object, out: Path) -> tuple[Path, Path]:
    """A command here and on the cluster; the places that they wrote to."""
    here, there = out.with_name(f"here-{out.name}"), out.with_name(f"there-{out.name}")
    for place, on in ((here, ()), (there, ("--on", f"dask:{cluster.address}"))):
        told = CliRunner().invoke(app, [command, *map(str, arguments), "--out", str(place), *on])
        assert told.exit_code == 0, told.output
        said = f"On the Dask cluster at {cluster.address}: 2 workers at present."
        assert (said in " ".join(told.output.split())) == bool(on)
    return here, there


@pytest.mark.slow
def test_calibrate(cluster: DaskProcesses, tmp_path: Path) -> None:
    project = write_project(tmp_path)
    options = ("--no-report", "--method", "tpe", "--trials", 6)
    here, there = run(cluster, "calibrate", project, *options, out=tmp_path / "run")
    first, second = (load_result(place / "calibrations" / "pull") for place in (here, there))
    same(first, second)


@pytest.mark.slow
def test_sweep(cluster: DaskProcesses, tmp_path: Path) -> None:
    here, there = run(cluster, "sweep", write_sweep(tmp_path), "--no-report", out=tmp_path / "run")
    first, second = (load_result(place / "calibrations" / "sweep") for place in (here, there))
    assert [(t.number, t.theta, t.loss) for t in first.trials] == [(t.number, t.theta, t.loss) for t in second.trials]
    assert first.experiments.keys() == second.experiments.keys()


@pytest.mark.long
def test_validate(cluster: DaskProcesses, tmp_path: Path) -> None:
    here, there = run(cluster, "validate", write_sweep(tmp_path), out=tmp_path / "table.csv")
    assert here.read_text() == there.read_text()
    assert len(here.read_text().splitlines()) > 2


@pytest.mark.long
def test_fleet(cluster: DaskProcesses, tmp_path: Path) -> None:
    table = f"specimen,{FILE}\n" + "".join(f"s{k},p{k}.csv\n" for k in (1, 2, 3))
    folder = write_fleet(tmp_path, (1.0, 1.1, 0.9), table)
    here = fleet(folder, out=folder / "here")
    with executor_on(f"dask:{cluster.address}") as executor:
        there = fleet(folder, out=folder / "there", workers=executor)
        assert sum(worker.done for worker in executor.workers) == 2 * 3  # the check of each row, and its calibration
    assert [one.state for one in there.specimens] == ["DONE"] * 3
    assert [one.parameters for one in there.specimens] == [one.parameters for one in here.specimens]
    assert there.statement == here.statement
