"""The authors' mesh study with softcal's linear and locking-free tets: writes docs/mesh-table.md and its figure.

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
from softcal.geometry.neck import Neck
from softcal.twin.build import build_twin
from softcal.twin.simulate import simulate

DOCS = Path(__file__).resolve().parents[1] / "docs"
SOURCE = "https://albertorodriguezsanz.github.io/SOFA_MOR_Force-Based_Trajectory"
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
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of mesh-table.md")
    arguments = parser.parse_args()
    most = QUICK if arguments.quick else np.inf
    solved(LINEAR, 1000)  # compiles
    linear = [_said(solved(LINEAR, n)) for n, _, _ in AUTHORS if n < most]
    families = [[_said(solved(kind, n)) for n in (*COARSE, FINEST) if n < most] for kind in KINDS]
    if not arguments.quick:
        draw(linear, families, arguments.out / "mesh-table.svg")
        (arguments.out / "mesh-table.md").write_text(page(linear, families), encoding="utf-8")
        print(f"Written: {arguments.out / 'mesh-table.md'}")


def _said(row: Row) -> Row:
    print(
        f"{row.kind.name}: {row.n_tets} tets, {row.tension:.3f} N, {row.pitch:.3f} deg, {row.seconds:.1f} s", flush=True
    )
    return row


def page(linear: Sequence[Row], families: Sequence[Sequence[Row]]) -> str:
    """The whole page."""
    best = min((family[-1] for family in families), key=lambda row: row.tension)
    parts = [_intro(), _linear(linear), _locking_free(families, best), _meaning(linear, families, best)]
    return "\n".join([*parts, "## Machine", "", *table(["", ""], [*machine(), ["load at the end", load()]]), ""])


def _intro() -> str:
    return """# The mesh table

Written by `make mesh-table`. The published neck, outer diameter 38 mm, E 2.3 MPa, ν 0.43, no gravity; its cable, 50 mm
off the axis and straight down from the plate, is pulled in by 40 mm. There is no contact, as in the authors' scene;
[with it](contact.md) the force of the mesh of `examples/neck` is 11 % higher there.
"""


def _linear(linear: Sequence[Row]) -> str:
    fall = 100.0 * (1.0 - linear[-1].tension / linear[0].tension)
    spread = 100.0 * float(np.ptp([row.pitch for row in linear])) / linear[-1].pitch
    theirs = 100.0 * (1.0 - AUTHORS[-1][1] / AUTHORS[0][1])
    header = ["tets, authors", "force", "pitch", "tets, softcal P1", "force", "pitch", "s per curve"]
    rows = [
        [f"{n:,}", f"{force:.2f} N", f"{pitch:.2f}°", f"{row.n_tets:,}", f"{row.tension:.2f} N", f"{row.pitch:.2f}°",
         f"{row.seconds:.2f}"]
        for (n, force, pitch), row in zip(AUTHORS, linear, strict=True)
    ]  # fmt: skip
    lines = "\n".join(table(header, rows))
    return f"""## Linear tets, as the authors used

{lines}

The authors' numbers are those of the table on [their project page]({SOURCE}),
computed with SOFA. The page states neither displacement nor diameter, so single forces and pitches are compared on
[a page of their own](neck-shape.md), and here the influence of the mesh.
From the coarsest mesh to the finest the force decreases by {theirs:.0f} % in their
table and by {fall:.0f} % in softcal's, and softcal's pitch changes by {spread:.2f} %: the tilt of the plate depends on
the length of the cable, but the force depends on the mesh.
"""


def _locking_free(families: Sequence[Sequence[Row]], best: Row) -> str:
    header = ["element", "tets", "unknowns", "force", "over its own finest", "over the best", "pitch", "s per curve"]
    rows = [
        [row.kind.name, f"{row.n_tets:,}", f"{row.n_unknowns:,}", f"{row.tension:.3f} N",
         f"{_percent(row, family[-1]):+.1f} %", f"{_percent(row, best):+.1f} %", f"{row.pitch:.2f}°",
         f"{row.seconds:.1f}"]
        for family in families
        for row in family
    ]  # fmt: skip
    lines = "\n".join(table(header, rows))
    kinds = ", ".join(
        f"*{family[0].kind.name}* `Neck(waist_refinement={family[0].kind.waist_refinement:g}"
        + (", sectors={})`, the finest with {}".format(*family[0].kind.sectors) if family[0].kind.sectors else ")`")
        for family in families[1:]
    )
    return f"""## Locking-free tets

{lines}

![Force over the number of tets](mesh-table.svg)

Quadratic tets with linear pressure (P2P1), curved on the surface: {kinds}.
*The best* is the lowest force of the table: for every kind of mesh, finer meshes have lower forces.

{verdict(families)}

Even these meshes converge slowly because of the shape. Where the dome of a bell meets the waist under the flat
underside of the next bell, the gap closes at an angle of some 26°, and the stress at its tip is singular, almost as at
a crack. The error depends on the size of the elements there, across the tip and not along it. So grading is effective,
sweeping more so, and uniform refinement least.
"""


def _meaning(linear: Sequence[Row], families: Sequence[Sequence[Row]], best: Row) -> str:
    header = ["mesh", "tets", "too stiff by", "E found for a neck of 2.30 MPa, in MPa"]
    rows = [
        [
            row.kind.name,
            f"{row.n_tets:,}",
            f"{_percent(row, best):.0f} %",
            f"{2.3 * best.tension / row.tension:.2f}",
        ]
        for row in (*linear, *(family[i] for family in families for i in (1, -2)))
    ]
    lines = "\n".join(table(header, rows))
    return f"""## What it means

At a given shortening and without weight, force is proportional to E. So a mesh that is too stiff by some factor makes
the calibrated E too small by the same factor:

{lines}

The reference is the best of the table, {best.kind.name} with {best.n_tets:,} tets, which is still above the limit.
An E that was found with linear tets is a property of their mesh and not of the material: it may be used with that mesh
only, and two such values may be compared only if their meshes are the same. The pitch does not show the error: it is
nearly right on every mesh.
"""


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
