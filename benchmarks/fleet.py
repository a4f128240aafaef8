"""A fleet of synthetic specimens, calibrated, stopped on the way and resumed; writes docs/fleet.md.

python -m benchmarks.fleet [--specimens 1000] [--workers 2] [--out FILE]

Every specimen is the published neck in linear tets with a modulus, a Poisson's ratio and a slack of its own, drawn from
known populations; its bench data are the twin's own answers with noise (`benchmarks.table_twins`).
"""

from __future__ import annotations

import argparse
import csv
import json
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import load as machine_load
from benchmarks.neck_case import neck_robot, pull
from benchmarks.section import table
from benchmarks.table_twins import NU, E, NeckTable, neck_table
from benchmarks.written_page import written_page
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.geometry.write import write_mesh
from softcal.twin.parameters import with_parameters
from softcal.units import format_quantity

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "fleet.md"
SPECIMENS, TETS, SEED = 1000, 1500, 2026
SLACK = "front.slack"
MEANS = {E: 2.3e6, NU: 0.455, SLACK: 2e-3}
SPREADS = {E: 0.08, NU: 0.006, SLACK: 4e-4}
"""Standard deviations: of ln E, of nu, of the slack [m]."""
NOISE_N, NOISE_DEG, SAMPLES, REACH = 0.01, 0.02, 201, 40e-3
KILLED_AT, STOPPED_AT = 0.2, 0.5  # of the specimens

PROJECT = """\
softcal: 1
name: Printed necks
robot:
  bodies:
    neck:
      mesh: {file: neck.vtu, unit: m}
      element: P1
      youngs_modulus: 2 MPa
      poissons_ratio: 0.44
      fixed: socket
  plates:
    plate: {body: neck, region: collar, reference: [0 mm, 0 mm, 106.704 mm]}
  cables:
    front:
      via:
        - {on: plate, at: [50 mm, 0 mm, 106.704 mm]}
        - {at: [50 mm, 0 mm, 14.06 mm]}
experiments:
  pull:
    cable: front
    plate: plate
    drive: shortening
    files:
      - path: data/p0001.csv
        columns:
          shortening: {name: "displacement [mm]"}
          tension: {name: "force [N]"}
          pitch: {name: "pitch [deg]"}
    noise: {tension: 0.01 N, pitch: 0.02 deg}
    slack: 1.5 mm
parameters:
  neck.youngs_modulus: {bounds: [0.1 MPa, 40 MPa], scale: log}
  neck.poissons_ratio: {bounds: [0.3, 0.4999]}
  front.slack: {bounds: [-3 mm, 12 mm]}
calibration: {method: least-squares, loss: likelihood, starts: 1, seed: 1}
"""


@dataclass(frozen=True)
class Run:
    """A run of a fleet: wall time [s], processor time [s], exit code, and specimens that were finished at its end."""

    wall: float
    processor: float
    code: int
    finished: int


def neck_mesh(tets: int = TETS) -> TetMesh:
    """The neck in linear tets."""
    return Neck(tets=tets, order=1).mesh()


def neck_twin(mesh: TetMesh) -> NeckTable:
    """The table of its answers over what the specimens need."""
    return neck_table(neck_robot(mesh, "P1"), REACH + 5e-4, (0.38, 0.4995), (16, 12), locks=True)


def write_fleet(folder: Path, n: int, mesh: TetMesh, twin: NeckTable, seed: int = SEED) -> None:
    """Write the template, the table and the bench data of n specimens."""
    (folder / "data").mkdir(parents=True)
    (folder / "project.yaml").write_text(PROJECT, encoding="utf-8")
    write_mesh(mesh, folder / "neck.vtu")
    robot, chance = neck_robot(mesh, "P1"), np.random.default_rng(seed)
    shortening = np.linspace(2e-3, REACH, SAMPLES)
    rows, truth = ["specimen,file"], [f"specimen,{E},{NU},{SLACK}"]
    for k in range(1, n + 1):
        drawn = chance.standard_normal(3)
        modulus = MEANS[E] * np.exp(SPREADS[E] * drawn[0])
        ratio, slack = MEANS[NU] + SPREADS[NU] * drawn[1], MEANS[SLACK] + SPREADS[SLACK] * drawn[2]
        seen = twin(with_parameters(robot, {E: modulus, NU: ratio}), pull(shortening - slack)).channels
        force = seen["front.tension"] + NOISE_N * chance.standard_normal(SAMPLES)
        pitch = np.degrees(seen["plate.pitch"]) + NOISE_DEG * chance.standard_normal(SAMPLES)
        lines = [f"{1e3 * d:.4f},{f:.5f},{p:.5f}" for d, f, p in zip(shortening, force, pitch, strict=True)]
        text = "\n".join(["displacement [mm],force [N],pitch [deg]", *lines]) + "\n"
        (folder / "data" / f"p{k:04}.csv").write_text(text, encoding="utf-8")
        rows.append(f"p{k:04},data/p{k:04}.csv")
        truth.append(f"p{k:04},{modulus:.9g},{ratio:.9g},{slack:.9g}")
    (folder / "fleet.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (folder / "truth.csv").write_text("\n".join(truth) + "\n", encoding="utf-8")


def finished(out: Path) -> int:
    """How many specimens of a running fleet are done or failed."""
    return len(list((out / "specimens").glob("*.json"))) if out.is_dir() else 0


def run_until(folder: Path, out: Path, workers: int, n: int, stop: signal.Signals | None, *, resume: bool) -> Run:
    """Run the command until so many specimens are finished, then send it a signal; None: to its end."""
    command = [sys.executable, "-m", "softcal", "fleet", str(folder), "--out", str(out), "--workers", str(workers)]
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command += ["--resume"] * resume
    # Ctrl-C must end it even where this script was started in the background, where it is ignored.
    answer = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    signal.signal(signal.SIGINT, answer)
    while process.poll() is None:
        if stop is not None and finished(out) >= n:
            process.send_signal(stop)
            stop = None
        time.sleep(0.2)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(time.perf_counter() - began, spent, process.returncode, finished(out))


def within(ends: Sequence[float], value: float) -> bool:
    return ends[0] <= value <= ends[1]


def sized(value: float, scale: str, unit: str) -> str:
    """A spread as text: of a logarithm in per cent."""
    return f"{100 * value:.3g} %" if scale == "log" else format_quantity(value, unit, digits=3)


def rows_of_populations(statement: Mapping[str, Any]) -> list[list[str]]:
    """A row for each parameter: the true mean and spread, and the intervals found."""
    found: list[list[str]] = []
    for one in statement["populations"]:
        label, unit = one["label"], one["unit"]
        name = SLACK if label.startswith(SLACK) else label
        mean, spread = MEANS[name], SPREADS[name]
        scale = one["scale"]
        inside = within(one["interval"], mean) and within(one["spread_interval"], spread)
        means = " to ".join(format_quantity(end, unit, digits=5) for end in one["interval"])
        spreads = " to ".join(sized(end, scale, unit) for end in one["spread_interval"])
        row = [name, format_quantity(mean, unit, digits=5), means, sized(spread, scale, unit), spreads]
        found.append([*row, str(one["n"]), "yes" if inside else "no"])
    return found


def coverage_of_specimens(folder: Path, out: Path) -> dict[str, float]:
    """Parameter -> share of the specimens whose own 95 % interval holds their own true value."""
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        truth = {row["specimen"]: row for row in csv.DictReader(file)}
    held: dict[str, list[bool]] = {}
    with (out / "fleet.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["lower"]:
                own = float(truth[row["specimen"]][row["parameter"]])
                held.setdefault(row["parameter"], []).append(float(row["lower"]) <= own <= float(row["upper"]))
    return {label: float(np.mean(one)) for label, one in held.items()}


def measured(n: int, workers: int, work: Path) -> dict[str, str]:
    """The numbers of the page by their names in its text, of a fleet that is killed at a fifth, stopped by Ctrl-C at
    half, and resumed to its end.
    """
    folder, out = work / "fleet", work / "out"
    began = time.perf_counter()
    mesh = neck_mesh()
    write_fleet(folder, n, mesh, neck_twin(mesh))
    print(f"{n} specimens written: {time.perf_counter() - began:.0f} s")
    runs: list[Run] = []
    for at, stop in ((int(KILLED_AT * n), signal.SIGKILL), (int(STOPPED_AT * n), signal.SIGINT), (n, None)):
        runs.append(run_until(folder, out, workers, at, stop, resume=bool(runs)))
        print(runs[-1])
    record = json.loads((out / "fleet.json").read_text(encoding="utf-8"))
    each = [json.loads(path.read_text(encoding="utf-8"))["seconds"] for path in (out / "specimens").glob("*.json")]
    size = sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    killed, stopped, last = runs
    head = ["Parameter", "True mean", "95 % interval", "True spread", "95 % interval", "Specimens", "Both inside"]
    covered = (f"{100 * share:.1f} % ({label})" for label, share in coverage_of_specimens(folder, out).items())
    return {
        "n": str(n),
        "tets": str(len(mesh.tets)),
        "samples": str(SAMPLES),
        "workers": str(workers),
        "killed": str(killed.finished),
        "stopped": str(stopped.finished),
        "table": "\n".join(table(head, rows_of_populations(record["statement"]))),
        "done": str(record["statement"]["done"]),
        "failed": str(record["statement"]["failed"]),
        "minutes": f"{sum(one.wall for one in runs) / 60:.1f}",
        "load": machine_load(),
        "seconds": f"{np.median(each):.2f}",
        "processor": f"{last.processor / max(1, last.finished - stopped.finished):.2f}",
        "size": f"{size / 1e6 / n:.2f}",
        "covered": ", ".join(covered),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=SPECIMENS, help=f"{SPECIMENS} by default")
    parser.add_argument("--workers", type=int, default=2, help="processes; 2 by default")
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/fleet.md by default")
    parser.add_argument("--keep", type=Path, help="a new folder for the fleet; a temporary one by default")
    arguments = parser.parse_args()
    work = arguments.keep or Path(tempfile.mkdtemp(prefix="fleet-"))
    try:
        numbers = measured(arguments.specimens, arguments.workers, work)
    finally:
        if arguments.keep is None:
            shutil.rmtree(work, ignore_errors=True)
    arguments.out.write_text(written_page(PAGE, numbers), encoding="utf-8")


if __name__ == "__main__":
    main()
