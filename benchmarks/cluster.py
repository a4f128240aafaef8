"""What a Dask cluster costs, measured on two workers here, and its efficiency with more; writes docs/cluster.md.

python -m benchmarks.cluster [--calls 400] [--out FILE]

Measured: the time of a call that does nothing, by which the client and the scheduler, who see every call, limit how
many there are in a second; what a call costs a worker beside its work; the first call of a worker, which opens the
problem and loads the kernels; and the simulations of two necks. Simulated, event by event: the same with 2 to 1024
workers.
"""

from __future__ import annotations

import argparse
import heapq
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import load as machine_load
from benchmarks.neck_case import neck_robot, pull
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.executors.each import results
from softcal.executors.executor import Executor
from softcal.geometry.neck import Neck
from softcal.plugins.cluster.dask_executor import DaskExecutor
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "cluster.md"
WORKERS, CALLS_EACH, CALLS, SLEEP = (2, 16, 128, 1024), 20, 400, 0.02
SOFA_TRIAL = 27.0  # [s]: 1000 trials of the neck through SOFA take 7.6 h
GOAL = 5e-3  # [s] of a call on two workers


@dataclass(frozen=True)
class Costs:
    """What calls cost [s]: of the client and the scheduler, for each; of a worker, for each and for its first."""

    scheduler: float
    worker: float
    first: float


@dataclass(frozen=True)
class Pulled:
    """A robot and how it is pulled."""

    robot: Robot
    protocol: Protocol


def nothing(shared: object, number: int) -> int:
    """A call that does nothing."""
    return number


def rested(shared: object, seconds: float) -> float:
    """A call that does nothing for so long [s]."""
    time.sleep(seconds)
    return seconds


def pulled(shared: Pulled, theta: dict[str, float]) -> float:
    """The time [s] of one simulation."""
    began = time.perf_counter()
    simulate(shared.robot, shared.protocol, theta)
    return time.perf_counter() - began


def simulated(workers: int, durations: Sequence[float], costs: Costs) -> float:
    """The share of the workers' time that goes into the calls' own work, all calls being asked for at once.

    One server, the client and the scheduler, gives out one call after the other, to the worker that is free first. That
    a worker of Dask's has its next call beside it is left out, which makes the share smaller.

    Parameters
    ----------
    workers
        Their number.
    durations
        Of each call's own work [s].
    costs
        What a call costs beside its work.
    """
    free = [(0.0, True)] * workers  # when, and whether it has never worked
    heapq.heapify(free)
    server, end = 0.0, 0.0
    for seconds in durations:
        ready, fresh = heapq.heappop(free)
        server = max(server, ready) + costs.scheduler
        ended = server + costs.worker + seconds + costs.first * fresh
        end = max(end, ended)
        heapq.heappush(free, (ended, False))
    return float(np.sum(durations)) / (workers * end)


def timed(executor: Executor, function: Any, shared: object, calls: Sequence[tuple[Any, ...]]) -> float:
    """The time [s] of all calls together."""
    began = time.perf_counter()
    list(results(executor, function, shared, calls))
    return time.perf_counter() - began


def necks() -> dict[str, Pulled]:
    """What is simulated: the published neck in linear and in locking-free tets."""
    mesh = Neck(tets=1500).mesh()
    protocol = pull(np.linspace(0.0, 0.04, 21))
    return {element: Pulled(neck_robot(mesh, element), protocol) for element in ("P1", "P2P1")}


def measured(calls: int) -> tuple[Costs, dict[str, list[float]]]:
    """The costs on two workers of this machine, and the times [s] of simulations there by element."""
    from distributed import LocalCluster

    chance = np.random.default_rng(1)
    thetas = [({"neck.youngs_modulus": value},) for value in np.geomspace(0.5e6, 4e6, 24)[chance.permutation(24)]]
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        DaskExecutor(cluster.scheduler_address) as executor,
    ):
        cases = necks()
        first = timed(executor, pulled, cases["P1"], thetas[:2])
        timed(executor, nothing, None, [(k,) for k in range(20)])
        scheduler = timed(executor, nothing, None, [(k,) for k in range(calls)]) / calls
        beside = 2 * timed(executor, rested, None, [(SLEEP,)] * calls) / calls - SLEEP
        times = {name: list(results(executor, pulled, case, thetas)) for name, case in cases.items()}
    return Costs(scheduler, beside, max(0.0, first - float(np.mean(times["P1"])))), times


def page(calls: int) -> str:
    """The page, its figures measured now."""
    costs, times = measured(calls)
    chance = np.random.default_rng(2)
    spread = np.array(times["P2P1"]) / np.mean(times["P2P1"])
    kinds = {
        "neck in linear tets": np.array(times["P1"]),
        "neck in P2P1": np.array(times["P2P1"]),
        "neck through SOFA": SOFA_TRIAL * spread,
    }
    rows = [
        [
            name,
            f"{np.mean(held):.3g} s",
            *(f"{100 * simulated(n, chance.choice(held, CALLS_EACH * n), costs):.0f} %" for n in WORKERS),
        ]
        for name, held in kinds.items()
    ]
    header = ["simulation", "takes", *(f"{n} workers" for n in WORKERS)]
    verdict = "below" if costs.worker < GOAL else "above"
    numbers = {
        "overhead": f"{1e3 * costs.worker:.1f}",
        "verdict": f"{verdict} the goal of {1e3 * GOAL:.0f} ms",
        "serial": f"{1e3 * costs.scheduler:.1f}",
        "per_second": f"{1 / costs.scheduler:.0f}",
        "first": f"{costs.first:.1f}",
        "each": str(CALLS_EACH),
        "sofa": f"{SOFA_TRIAL:.0f}",
        "table": "\n".join(table(header, rows)),
        "load": machine_load(),
    }
    return written_page(PAGE, numbers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=CALLS, help=f"of each kind; {CALLS} by default")
    parser.add_argument("--out", type=Path, default=PAGE, help="where the page goes; docs/cluster.md by default")
    arguments = parser.parse_args()
    arguments.out.write_text(page(arguments.calls), encoding="utf-8")


if __name__ == "__main__":
    from benchmarks.cluster import main as importable  # workers import what they are asked to call by this name

    importable()
