"""The 40 mm curve on finer and finer meshes: time, factorisations, iterations and memory, and CalculiX's on the same.

Every mesh is solved in a process of its own, whose peak memory is its own.

python -m benchmarks.growth --calculix    CalculiX on the meshes that take it too long for a run of all benchmarks: an
                                          hour; keeps growth_calculix.json
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.neck_case import PULL, TENSION, neck_robot, pull
from benchmarks.section import Goal, Section, run_alone
from softcal.errors import SimulationError
from softcal.geometry.neck import Neck
from softcal.mechanics.bordered import BorderedTangent
from softcal.plugins.calculix.deck import calculix_deck, in_its_law
from softcal.plugins.calculix.load_path import load_path
from softcal.plugins.calculix.run import find_calculix, run_calculix
from softcal.twin.build import twin_of
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

EXPONENT, MEMORY = 1.4, 6.0  # [-], [GB]
# Tets of even meshes with about 7k, 15k, 31k, 75k, 150k and 200k unknowns.
TETS = (1_547, 3_500, 7_700, 19_500, 40_000, 54_000)
QUICK = 3  # meshes
CALCULIX_PULL = np.linspace(0.25 * PULL, PULL, 4)
CALCULIX_UNKNOWNS, CALCULIX_LIMIT = 35_000, 300.0  # largest mesh, and seconds, in a run of all benchmarks
CALCULIX_KEPT = Path(__file__).with_name("growth_calculix.json")  # CPU seconds by unknowns
CALCULIX_LONGEST = 3600.0  # [s] on one of the other meshes


def measure(quick: bool) -> Section:
    header = ["tets", "unknowns", "equilibria", "factorisations", "iterations", "CPU seconds", "tension at 40 mm",
              "peak memory", "CalculiX: CPU seconds"]  # fmt: skip
    found = [_in_own_process(tets) for tets in (TETS[:QUICK] if quick else TETS)]
    kept: dict[str, float] = json.loads(CALCULIX_KEPT.read_text(encoding="utf-8"))
    rows = [
        [
            f"{one['tets']:,}", f"{one['unknowns']:,}", one["equilibria"], str(one["factorisations"]),
            str(one["iterations"]), f"{one['seconds']:.2f}", f"{one['tension']:.4f} N", f"{one['memory']:.2f} GB",
            f"{one['ccx']:.0f}" if "ccx" in one else f"({s})" if (s := kept.get(str(one["unknowns"]))) else "–",
        ]
        for one in found
    ]  # fmt: skip
    goals = [Goal("exponent of the curve's CPU seconds in the unknowns, P2P1", _exponent(found), EXPONENT)]
    if not quick:
        goals.append(Goal(f"peak memory at {found[-1]['unknowns']:,} unknowns", found[-1]["memory"], MEMORY, "GB"))
    notes = [
        "CPU seconds of `simulate` on one thread, without building the twin; iterations of GMRES with a kept "
        "factorisation. The peak is that of the whole process, the mesher apart. CalculiX (`ccx`, where it is "
        "installed): the exported deck on the same mesh, with its own neo-Hookean law and C3D10 elements, for 40 mm in "
        "four steps; in brackets, on the larger meshes, from a run by itself, `python -m benchmarks.growth --calculix`."
    ]
    return Section("Growth of the 40 mm curve", header, rows, goals, notes)


def _exponent(found: list[dict[str, Any]]) -> float:
    """Of the time between the smallest and the largest mesh."""
    first, last = found[0], found[-1]
    return float(np.log(last["seconds"] / first["seconds"]) / np.log(last["unknowns"] / first["unknowns"]))


def _in_own_process(tets: int) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.growth", "--tets", str(tets)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


def one_mesh(tets: int) -> dict[str, Any]:
    """The curve on one mesh."""
    robot = neck_robot(Neck(tets=tets).mesh(), "P2P1")
    iterations: list[int] = []
    release = BorderedTangent.release

    def counted(self: BorderedTangent) -> None:
        iterations.append(self.n_iterations)
        release(self)

    BorderedTangent.release = counted  # type: ignore[method-assign]
    simulate(neck_robot(Neck(tets=TETS[0]).mesh(), "P2P1"), pull(np.linspace(0.0, PULL, 41)))  # compiles
    twin = twin_of(robot, {})
    start = time.process_time()
    response = simulate(robot, pull(np.linspace(0.0, PULL, 41)))
    seconds = time.process_time() - start
    if not response.succeeded:
        raise RuntimeError(response.status)
    return {
        "tets": sum(len(mesh.tets) for mesh in twin.meshes.values()),
        "unknowns": twin.system.layout.n_unknowns,
        "equilibria": response.status.split()[1],
        "factorisations": response.n_factorisations,
        "iterations": iterations[-1],
        "seconds": seconds,
        "tension": float(response.channels[TENSION][-1]),
        **(_calculix(robot) if twin.system.layout.n_unknowns < CALCULIX_UNKNOWNS else {}),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20,
    }


def _calculix(robot: Robot, limit: float = CALCULIX_LIMIT) -> dict[str, float]:
    """CPU seconds of CalculiX for the equilibria of the same path; nothing where it is not installed, or takes longer
    than a limit [s], or fails.
    """
    if find_calculix() is None:
        return {}
    robot = in_its_law(robot)
    response = simulate(robot, pull(CALCULIX_PULL), snapshots="samples")
    deck = calculix_deck(robot, load_path(robot, response.snapshots[-1]).shapes)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        try:
            run_calculix(deck, Path(folder), timeout=limit)
        except SimulationError as error:
            print(error, file=sys.stderr)
            return {}
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"ccx": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, "states": deck.n_states}


def calculix_alone() -> None:
    """Keep CalculiX's CPU seconds on the meshes that `measure` leaves out, beside those that are kept."""
    kept: dict[str, float] = json.loads(CALCULIX_KEPT.read_text(encoding="utf-8"))
    for tets in TETS:
        robot = neck_robot(Neck(tets=tets).mesh(), "P2P1")
        unknowns = twin_of(robot, {}).system.layout.n_unknowns
        if unknowns >= CALCULIX_UNKNOWNS and (took := _calculix(robot, CALCULIX_LONGEST)):
            kept[str(unknowns)] = round(took["ccx"])
            print(unknowns, kept[str(unknowns)], flush=True)
            CALCULIX_KEPT.write_text(json.dumps(kept, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if "--calculix" in sys.argv:
        calculix_alone()
    elif "--tets" in sys.argv:
        print(json.dumps(one_mesh(int(sys.argv[sys.argv.index("--tets") + 1]))))
    else:
        run_alone(measure)
