"""The authors' mesh study with softcal's linear and locking-free tets: writes the numbers of docs/mesh-table.md
and its figure.

python -m benchmarks.mesh_table [--quick] [--out FOLDER]

Takes ten minutes and some 4 GB.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.machine import load, machine
from benchmarks.neck_case import PITCH, PULL, TENSION, neck_robot, pull
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.geometry.neck import Neck
from softcal.twin.build import build_twin
from softcal.twin.simulate import simulate

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "mesh-table.md"
# Tets, force [N], pitch [deg]: the authors' table, by SOFA with linear tets.
AUTHORS = ((2363, 14.01, 45.803), (9676, 11.15, 45.813), (17633, 10.80, 45.788), (37308, 10.18, 45.791))
FINEST = 37000
COARSE = (1000, 1500, 2500, 4550)
WITHIN, TIMES_SMALLER = 0.03, 8.0
QUICK = 5000


@dataclass(frozen=True)
class Kind:
    """A kind of mesh: its name in the tables, element, and the settings of the mesher besides the count.

    sectors: around the axis, of the coarse meshes and of the finest, whose elements are half as long.
    """

    name: str
    element: str
    waist_refinement: float = 1.0
    sectors: tuple[int, int] | None = None


@dataclass(frozen=True)
class Row:
    """One mesh and what came of it; tension [N], pitch [deg], seconds of the curve."""

    kind: Kind
    n_tets: int
    n_unknowns: int
    tension: float
    pitch: float
    seconds: float
    n_factorisations: int


LINEAR = Kind("P1", "P1")
KINDS = (
    Kind("P2P1, even", "P2P1"),
    Kind("P2P1, graded at the waists", "P2P1", waist_refinement=4.0),
    Kind("P2P1, graded and swept", "P2P1", waist_refinement=16.0, sectors=(6, 12)),
)


def solved(kind: Kind, count: int) -> Row:
    order = 1 if kind.element == "P1" else 2
    sectors = None if kind.sectors is None else kind.sectors[count == FINEST]
    mesh = Neck(tets=count, order=order, waist_refinement=kind.waist_refinement, sectors=sectors).mesh()
    robot = neck_robot(mesh, kind.element)
    n_unknowns = build_twin(robot).system.layout.n_unknowns
    start = time.perf_counter()
    found = simulate(robot, pull(np.linspace(0.0, PULL, 41)), curve_tolerance=1e-3)
    seconds = time.perf_counter() - start
    if not found.succeeded:
        raise RuntimeError(f"{kind.name}, {mesh.n_tets} tets: {found.status}")
    return Row(
        kind,
        mesh.n_tets,
        n_unknowns,
        float(found.channels[TENSION][-1]),
        float(np.degrees(found.channels[PITCH][-1])),
        seconds,
        found.n_factorisations,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"only meshes below {QUICK} tets; printed, not written")
    parser.add_argument("--out", type=Path, default=PAGE.parent, help="folder of mesh-table.md")
    arguments = parser.parse_args()
    most = QUICK if arguments.quick else np.inf
    solved(LINEAR, 1000)  # compiles
    linear = [_said(solved(LINEAR, n)) for n, _, _ in AUTHORS if n < most]
    families = [[_said(solved(kind, n)) for n in (*COARSE, FINEST) if n < most] for kind in KINDS]
    if not arguments.quick:
        draw(linear, families, arguments.out / "mesh-table.svg")
        ran_on = table(["", ""], [*machine(), ["load at the end", load()]])
        written = {**values(linear, families), "machine": "\n".join(ran_on)}
        (arguments.out / PAGE.name).write_text(written_page(PAGE, written), encoding="utf-8")
        print(f"Written: {arguments.out / PAGE.name}")


def _said(row: Row) -> Row:
    print(
        f"{row.kind.name}: {row.n_tets} tets, {row.tension:.3f} N, {row.pitch:.3f} deg, {row.seconds:.1f} s", flush=True
    )
    return row


def values(linear: Sequence[Row], families: Sequence[Sequence[Row]]) -> dict[str, str]:
    """What the page has of the meshes, by the names of its marks."""
    best = min((family[-1] for family in families), key=lambda row: row.tension)
    parts = {
        "linear": _linear(linear),
        "locking-free": _locking_free(families, best),
        "meaning": _meaning(linear, families, best),
    }
    return {
        **{name: "\n".join(lines) for name, lines in parts.items()},
        "fall of theirs": f"{100.0 * (1.0 - AUTHORS[-1][1] / AUTHORS[0][1]):.0f} %",
        "fall": f"{100.0 * (1.0 - linear[-1].tension / linear[0].tension):.0f} %",
        "pitch": f"{100.0 * float(np.ptp([row.pitch for row in linear])) / linear[-1].pitch:.2f} %",
        "verdict": verdict(families),
        "best": f"{best.kind.name} with {best.n_tets:,} tets",
    }


def _linear(linear: Sequence[Row]) -> list[str]:
    header = ["tets, authors", "force", "pitch", "tets, softcal P1", "force", "pitch", "s per curve"]
    rows = [
        [f"{n:,}", f"{force:.2f} N", f"{pitch:.2f}°", f"{row.n_tets:,}", f"{row.tension:.2f} N", f"{row.pitch:.2f}°",
         f"{row.seconds:.2f}"]
        for (n, force, pitch), row in zip(AUTHORS, linear, strict=True)
    ]  # fmt: skip
    return table(header, rows)


def _locking_free(families: Sequence[Sequence[Row]], best: Row) -> list[str]:
    header = ["element", "tets", "unknowns", "force", "over its own finest", "over the best", "pitch", "s per curve"]
    rows = [
        [row.kind.name, f"{row.n_tets:,}", f"{row.n_unknowns:,}", f"{row.tension:.3f} N",
         f"{_percent(row, family[-1]):+.1f} %", f"{_percent(row, best):+.1f} %", f"{row.pitch:.2f}°",
         f"{row.seconds:.1f}"]
        for family in families
        for row in family
    ]  # fmt: skip
    return table(header, rows)


def _meaning(linear: Sequence[Row], families: Sequence[Sequence[Row]], best: Row) -> list[str]:
    header = ["mesh", "tets", "too stiff by", "E found for a neck of 2.30 MPa, in MPa"]
    rows = [
        [row.kind.name, f"{row.n_tets:,}", f"{_percent(row, best):.0f} %", f"{2.3 * best.tension / row.tension:.2f}"]
        for row in (*linear, *(family[i] for family in families for i in (1, -2)))
    ]
    return table(header, rows)


def _percent(row: Row, reference: Row) -> float:
    return 100.0 * (row.tension / reference.tension - 1.0)


def verdict(families: Sequence[Sequence[Row]]) -> str:
    """Whether each P2P1 37k value is reached within 3 % on a mesh eight times smaller."""
    sentences: list[str] = []
    for reference in (family[-1] for family in families):
        small = [row for family in families for row in family if row.n_tets * TIMES_SMALLER <= reference.n_tets * 1.001]
        close = [row for row in small if abs(row.tension / reference.tension - 1.0) <= WITHIN]
        best = min(close or small, key=lambda row: row.n_tets if close else abs(row.tension - reference.tension))
        off = _percent(best, reference)
        times = reference.n_tets / best.n_tets
        head = f"The value of {reference.kind.name} on {reference.n_tets:,} tets, {reference.tension:.2f} N, "
        how = f"{best.kind.name} on {best.n_tets:,} tets, {times:.1f} times fewer ({off:+.1f} %)"
        sentences.append(
            head
            + (f"is reached within 3 % by {how}." if close else f"is **not** reached within 3 %; nearest is {how}.")
        )
    return "\n".join(f"- {sentence}" for sentence in sentences)


def draw(linear: Sequence[Row], families: Sequence[Sequence[Row]], path: Path) -> None:
    """Force over the number of tets."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "softcal"
    figure, axes = plt.subplots(figsize=(6.0, 3.8), layout="constrained")
    for family in (linear, *families):
        axes.plot([r.n_tets for r in family], [r.tension for r in family], "o-", label=family[0].kind.name)
    tets, forces, _ = zip(*AUTHORS, strict=True)
    axes.plot(tets, forces, "k^--", label="the authors, linear tets", linewidth=0.8)
    axes.set(xscale="log", xlabel="tets", ylabel="force at 40 mm [N]")
    axes.grid(visible=True, which="major", linewidth=0.4)
    axes.legend()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    main()
