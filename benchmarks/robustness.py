"""Draws over the papers' bounds, each simulated to 40 mm of shortening and to 8 N of tension: which are solved?

    python -m benchmarks.robustness [--draws 200] [--tets 900] [--out benchmarks/ROBUSTNESS.md]

E is drawn evenly in its logarithm from 0.1 to 40 MPa, nu evenly from 0.4 to 0.4999 (paper A's bounds), by a scrambled
Sobol sequence of fixed seed. 8 N folds the softest necks and winds their cable up; that is a state, not a failure.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.neck_case import neck_robot
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

ELEMENTS: tuple[str, ...] = ("P1", "P2P1")
PROTOCOLS = {
    "40 mm by shortening": Protocol({"front": Command("shortening", np.linspace(0.002, 0.04, 20))}),
    "8 N by tension": Protocol({"front": Command("tension", np.linspace(0.4, 8.0, 20))}),
}


@dataclass(frozen=True)
class Outcome:
    """What came of one draw: E [Pa], nu [-], and the response's status, samples reached, cost and faults."""

    youngs_modulus: float
    poissons_ratio: float
    succeeded: bool
    status: str
    n_samples: int
    is_finite: bool
    n_factorisations: int
    seconds: float

    @property
    def is_wound_up(self) -> bool:
        return "wound up" in self.status


def parameter_draws(n: int, seed: int = 1) -> list[tuple[float, float]]:
    """n pairs (E [Pa], nu [-]) over the papers' bounds."""
    from scipy.stats import qmc

    unit = qmc.Sobol(2, seed=seed).random(2 ** int(np.ceil(np.log2(n))))[:n]
    E = 0.1e6 * (40.0 / 0.1) ** unit[:, 0]
    nu = 0.4 + 0.0999 * unit[:, 1]
    return list(zip(E.tolist(), nu.tolist(), strict=True))


def outcomes(mesh: TetMesh, element: str, protocol: Protocol, draws: Iterable[tuple[float, float]]) -> list[Outcome]:
    """Simulate every draw."""
    found: list[Outcome] = []
    for E, nu in draws:
        start = time.perf_counter()
        response = simulate(neck_robot(mesh, element, E, nu), protocol)
        found.append(
            Outcome(
                E,
                nu,
                response.succeeded,
                response.status,
                min(len(values) for values in response.channels.values()),
                all(bool(np.all(np.isfinite(values))) for values in response.channels.values()),
                response.n_factorisations,
                time.perf_counter() - start,
            )
        )
    return found


def table(results: dict[tuple[str, str], list[Outcome]]) -> str:
    """The outcomes as a Markdown table, and the sentence of every failure."""
    lines = [
        "| element | drive | solved | of them wound up | factorisations, median | time, median |",
        "|---|---|---|---|---|---|",
    ]
    failures: list[str] = []
    for (element, drive), rows in results.items():
        n_solved = sum(o.succeeded for o in rows)
        n_wound = sum(o.succeeded and o.is_wound_up for o in rows)
        n_factorisations = int(np.median([o.n_factorisations for o in rows]))
        seconds = float(np.median([o.seconds for o in rows]))
        share = f"{n_solved} of {len(rows)} ({100 * n_solved / len(rows):.1f} %)"
        lines.append(f"| {element} | {drive} | {share} | {n_wound} | {n_factorisations} | {seconds:.2f} s |")
        failures += [
            f"- {element}, {drive}, E {1e-6 * o.youngs_modulus:.4g} MPa, nu {o.poissons_ratio:.4f}: {o.status}"
            for o in rows
            if not o.succeeded
        ]
    return "\n".join([*lines, "", *(["Not solved:", "", *failures] if failures else ["None failed."]), ""])


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--tets", type=int, default=900)
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("ROBUSTNESS.md"))
    options = parser.parse_args(arguments)
    mesh = Neck(tets=options.tets, order=1).mesh()
    draws = parameter_draws(options.draws)
    results = {}
    for element in ELEMENTS:
        for drive, protocol in PROTOCOLS.items():
            results[element, drive] = outcomes(mesh, element, protocol, draws)
            print(element, drive, Counter(o.succeeded for o in results[element, drive]), flush=True)
    head = (
        f"# Robustness\n\n{options.draws} draws of E (0.1 to 40 MPa, logarithmic) and nu (0.4 to 0.4999) on the neck, "
        f"{mesh.n_tets} tets; written by `python -m benchmarks.robustness`.\n\n"
    )
    options.out.write_text(head + table(results), encoding="utf-8")
    print(table(results))


if __name__ == "__main__":
    main()
