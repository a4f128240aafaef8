"""Residual and tangent side by side with FElupe, NGSolve and scikit-fem, each checked before it is timed."""

from __future__ import annotations

from importlib import metadata

import numpy as np
import scipy.sparse.linalg

from benchmarks.neck_case import P1_TETS, P2P1_TETS, POISSONS_RATIO, YOUNGS_MODULUS
from benchmarks.peers import PEERS, Assembler, Common, Task
from benchmarks.section import Section, run_alone
from benchmarks.timing import interleaved, milliseconds
from softcal.geometry.neck import Neck
from softcal.geometry.quadratic import to_quadratic

AGREEMENT = 1e-8


def task(order: int) -> Task:
    """The neck bent and stretched by a smooth field."""
    mesh = Neck(tets=P1_TETS, order=1).mesh() if order == 1 else to_quadratic(Neck(tets=P2P1_TETS, order=1).mesh())
    x, y, z = mesh.points.T
    u = np.column_stack([4.0 * z**2 + 0.1 * y * z, 0.05 * x - 2.0 * x * z, -8.0 * x * z + 0.5 * z**2])
    mu = YOUNGS_MODULUS / (2.0 * (1.0 + POISSONS_RATIO))
    lmbda = 2.0 * mu * POISSONS_RATIO / (1.0 - 2.0 * POISSONS_RATIO)
    return Task(mesh, u, mu, lmbda)


def measure(quick: bool) -> Section:
    header = ["element", "tets", "library", "version", "disagreement", "ms", "over softcal"]
    rows: list[list[str]] = []
    notes = [
        "Compressible neo-Hookean residual and tangent of every node of the neck, at the same quadrature points, "
        "called in turn, medians; *disagreement*: the larger one of residual and tangent with softcal's, relative; "
        f"above {AGREEMENT:g} nothing is timed. softcal fills the upper triangle in place, its peers make the full "
        "matrix. softcal, FElupe and scikit-fem on one thread as they come; NGSolve without its task manager. Energies "
        "in NGSolve are differentiated symbolically and compiled by itself, without a C++ compiler."
    ]
    for order in (1, 2):
        case = task(order)
        ready: dict[str, Assembler] = {}
        differs: dict[str, float] = {}
        reference: Common | None = None
        for name, build in PEERS.items():
            try:
                assembler = build(case)
            except ImportError as error:
                rows.append([f"P{order}", f"{len(case.mesh.tets):,}", name, "–", "–", "skipped", f"{error}"])
                continue
            found = assembler.common(assembler.assemble())
            reference = reference or found
            differs[name] = difference(found, reference)
            if differs[name] <= AGREEMENT:
                ready[name] = assembler
        times = interleaved(
            {name: assembler.assemble for name, assembler in ready.items()}, repeats=5 if quick else 50, seconds=20.0
        )
        medians = {name: float(np.median(seconds)) for name, seconds in times.items()}
        for name, disagreement in differs.items():
            cells = ["not timed", "–"]
            if name in medians:
                cells = [milliseconds(medians[name]), f"{medians[name] / medians['softcal']:.1f}"]
            rows.append(
                [f"P{order}", f"{len(case.mesh.tets):,}", name, metadata.version(name), f"{disagreement:.0e}", *cells]
            )
    return Section("Assembly beside other libraries", header, rows, [], notes)


def difference(found: Common, reference: Common) -> float:
    (r, K), (r_0, K_0) = found, reference
    residual = float(np.linalg.norm(r - r_0) / np.linalg.norm(r_0))
    return max(residual, float(scipy.sparse.linalg.norm(K - K_0) / scipy.sparse.linalg.norm(K_0)))


if __name__ == "__main__":
    run_alone(measure)
