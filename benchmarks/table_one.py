"""Paper A's Table I explained: writes docs/table-one.md and its figure.

python -m benchmarks.table_one [--out FOLDER]     six minutes
python -m benchmarks.table_one --truth            first the finer curve of table_one.csv: another ten, and 4 GB
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.mesh_table import DOCS
from benchmarks.section import table
from benchmarks.table_one_fits import (
    CURVE,
    FINE,
    LINE,
    OFFSET,
    SHOWN,
    SLACK,
    TESTS,
    TRUE,
    Fits,
    fitted,
    read_curve,
    solved,
    value,
    write_curve,
)
from benchmarks.table_twins import NU, E
from benchmarks.written_page import written_page
from softcal.calibration.results.digits import interval_text
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.statistics.estimate import Estimate
from softcal.checks import Floats
from softcal.cli.calibration_table import value_text
from softcal.report.agreement import spread_sentences
from softcal.units import format_quantity

PAGE = Path(__file__).resolve().parents[1] / "docs" / "table-one.md"
# The paper's Table II: detrended RMSE of force [N] and pitch [rad].
PAPERS_ERRORS = ((0.1588, 0.0135), (0.2814, 0.0136), (0.1404, 0.0136), (0.1425, 0.0136))
ELEMENTS = ("P1", "P2P1")


def page(found: Fits) -> str:
    """docs/table-one.md."""
    values = {
        "tests": _tests(found),
        "line": line_table(found.lines),
        "causes": _causes(found),
        "draws": _draws(found),
        "joint": _joint(found),
        "sentences": _sentences(found),
        **_figures(found),
    }
    return written_page(PAGE, values)


def _tests(found: Fits) -> str:
    header = [
        "test",
        "paper: E, ν, importance of ν",
        "P1, the paper's procedure: E, ν",
        "P1, 1000 trials of TPE: E, ν, importance of ν",
        "P2P1, the same procedure: E, ν",
        "P2P1, slack and zero free: E (95 %), ν (95 %)",
    ]
    rows = [
        [
            f"{1e3 * test.reach:.0f} mm, {speed}",
            f"{1e-6 * test.modulus:.1f}, {test.ratio:.3f}, {test.importance:g}",
            _pair(found.linear[test.name]),
            f"{_pair(found.trials[test.name])}, {found.trials[test.name].importance[NU]:.3f}",
            _pair(found.default[test.name]),
            f"{_pair(found.freed[test.name])} ({_interval(found.freed[test.name], E)}; "
            f"{_interval(found.freed[test.name], NU)})",
        ]
        for test, speed in zip(TESTS, ("2 mm/s", "5 mm/s") * 2, strict=True)
    ]
    spreads = [
        _spread([test.modulus for test in TESTS]),
        *(
            _spread([value(one, E) for one in fits.values()])
            for fits in (found.linear, found.trials, found.default, found.freed)
        ),
    ]
    return "\n".join(table(header, [*rows, ["largest E over smallest", *(f"{one:.2f}" for one in spreads)]]))


def line_table(lines: Mapping[str, tuple[Sequence[CalibrationResult], Sequence[CalibrationResult]]]) -> str:
    """The best fits at the ratios `SHOWN`, as `Fits.lines` has them."""
    header = ["ν", "E in Table I", "P1: E", "loss", "Table I over P1", "P2P1: E", "loss"]
    papers = {test.ratio: test.modulus for test in TESTS}
    rows: list[list[str]] = []
    for nu, linear, default in zip(SHOWN, *(lines[element][0] for element in ELEMENTS), strict=True):
        modulus = papers.get(nu)
        rows.append(
            [
                f"{nu:g}",
                "" if modulus is None else f"{1e-6 * modulus:.1f} MPa",
                _modulus(linear),
                f"{linear.loss:.4f}",
                "" if modulus is None else f"{modulus / value(linear, E):.2f}",
                _modulus(default),
                f"{default.loss:.4f}",
            ]
        )
    return "\n".join(table(header, rows))


def _causes(found: Fits) -> str:
    header = ["wrong in the test", *(f"{element}, {mm} mm" for element in ELEMENTS for mm in (20, 35))]
    rows = [[name, *(_pair(one) for element in ELEMENTS for one in by[element])] for name, by in found.causes.items()]
    return "\n".join(table(header, rows))


def _draws(found: Fits) -> str:
    header = ["", "E, 5 to 95 % of the fits", "ν, 5 to 95 %", "largest over smallest E of four tests: 5, 50, 95 %"]
    rows: list[list[str]] = []
    for element in ELEMENTS:
        moduli, ratios = found.repeats[element][..., 0], found.repeats[element][..., 1]
        low, high = np.quantile(1e-6 * moduli, [0.05, 0.95])
        least, most = np.quantile(ratios, [0.05, 0.95])
        of_four = np.quantile(_spreads(found, element), [0.05, 0.5, 0.95])
        rows.append(
            [
                element,
                f"{low:.2f} to {high:.2f} MPa",
                f"{least:.3f} to {most:.3f}",
                ", ".join(f"{x:.2f}" for x in of_four),
            ]
        )
    return "\n".join(table(header, rows))


def _joint(found: Fits) -> str:
    header = ["", "true", "found", "95 % interval", "contains it", "with the mesh's error", "contains it"]
    rows: list[list[str]] = []
    for name, true in TRUE.items():
        without, with_mesh = found.joint.parameters[name], found.with_mesh.parameters[name]
        rows.append(
            [
                name,
                format_quantity(true, without.unit),
                value_text(without),
                interval_text(without),
                _holds(without, true),
                interval_text(with_mesh),
                _holds(with_mesh, true),
            ]
        )
    zeros = _zeros(found)
    rows.append(
        [f"{len(zeros)} slacks and zeros", "", "", "", _held(found.joint, zeros), "", _held(found.with_mesh, zeros)]
    )
    return "\n".join(table(header, rows))


def _zeros(found: Fits) -> dict[str, float]:
    """The true slack and zero of each test."""
    slack = {f"{SLACK}[{test.name}]": one for test, one in zip(TESTS, found.bench.slack, strict=True)}
    return slack | {f"{OFFSET}[{test.name}]": one for test, one in zip(TESTS, found.bench.zero, strict=True)}


def _holds(estimate: Estimate, true: float) -> str:
    return "yes" if _is_inside(estimate, true) else "**no**"


def _held(result: CalibrationResult, true: dict[str, float]) -> str:
    inside = sum(_is_inside(result.parameters[name], one) for name, one in true.items())
    return f"{inside} of {len(true)}"


def _is_inside(estimate: Estimate, true: float) -> bool:
    return estimate.interval is not None and estimate.interval[0] <= true <= estimate.interval[1]


def _sentences(found: Fits) -> str:
    spread, notes = spread_sentences(found.with_mesh), found.with_mesh.notes
    told = [
        *(remark.text for remark in spread),
        *(f"{'Warning: ' * (note.tone == 'warning')}{note.text}" for note in notes),
    ]
    return "\n>\n".join(f"> {sentence}" for sentence in told)


def _figures(found: Fits) -> dict[str, str]:
    """The numbers in the text."""
    moduli = {element: [value(one, E) for one in found.lines[element][0]] for element in ELEMENTS}
    losses = [one.loss for one in found.lines["P1"][0]]
    over = {
        element: [test.modulus / held[SHOWN.index(test.ratio)] for test in TESTS] for element, held in moduli.items()
    }
    bad = [0.3 * force + pitch for force, pitch in PAPERS_ERRORS]
    missed = max(found.trials[test.name].loss / found.linear[test.name].loss - 1.0 for test in TESTS)
    others = [(value(one, E), value(one, NU), one.loss) for one in found.seeds]
    least = found.linear[TESTS[0].name].loss
    between = (found.repeats["P1"][..., 1] > 0.41) & (found.repeats["P1"][..., 1] < 0.495)
    freed, freed_ratios = ([value(one, name) for one in found.linear_freed.values()] for name in (E, NU))
    importances = [one.importance[NU] for one in found.trials.values()]
    return {
        "fine": f"{found.tets['truth']:,}",
        "force halved": f"{100 * found.halving[0]:.1f}",
        "pitch halved": f"{100 * abs(found.halving[1]):.2f}",
        "linear tets": f"{found.tets['P1']:,}",
        "default tets": f"{found.tets['P2P1']:,}",
        "linear factor": f"{_spread(moduli['P1']):.1f}",
        "linear rise": f"{max(losses) - min(losses):.4f}",
        "papers losses": f"{min(bad):.3f} to {max(bad):.3f}",
        "default change": f"{100 * (_spread(moduli['P2P1']) - 1):.0f}",
        "papers factor": f"{_spread(over['P1']):.2f}",
        "papers spread": f"{_spread([test.modulus for test in TESTS]):.2f}",
        "repeats": str(len(found.repeats["P1"])),
        "trials off": f"{100 * missed:.0f}",
        "papers factor default": f"{_spread(over['P2P1']):.2f}",
        "default agree": f"{100 * (np.quantile(_spreads(found, 'P2P1'), 0.95) - 1):.0f}",
        "between": f"{100 * np.mean(between):.0f}",
        "seeds": str(len(others)),
        "one seed": f"{_spread([value(one, E) for one in found.one_seed]):.2f}",
        "seeds E": f"{1e-6 * min(others)[0]:.2f} to {1e-6 * max(others)[0]:.2f}",
        "seeds nu": f"{min(one[1] for one in others):.3f} to {max(one[1] for one in others):.3f}",
        "seeds off": f"{100 * (max(one[2] for one in others) / least - 1):.1f}",
        "control E": f"{value_text(found.control.parameters[E])} ({_interval(found.control, E)})",
        "control nu": f"{value_text(found.control.parameters[NU])} ({_interval(found.control, NU)})",
        "control p": f"{found.control.spreads[E].chance:.2g}",
        "papers over": f"{min(over['P1']):.2f} to {max(over['P1']):.2f}",
        "linear freed": f"{1e-6 * min(freed):.2f} to {1e-6 * max(freed):.2f}",
        "linear freed nu": f"{min(freed_ratios):.3f} to {max(freed_ratios):.3f}",
        "importances": f"{min(importances):.3f} to {max(importances):.3f}",
        "spreads": " to ".join(f"{x:.2f}" for x in np.quantile(_spreads(found, "P1"), [0.05, 0.95])),
        "linear low": f"{100 * (1 - np.mean(freed) / TRUE[E]):.0f}",
    }


def _spreads(found: Fits, element: str) -> Floats:
    """Largest over smallest E of the four tests in every draw."""
    moduli = found.repeats[element][..., 0]
    return moduli.max(axis=1) / moduli.min(axis=1)


def _spread(values: list[float]) -> float:
    return max(values) / min(values)


def _modulus(result: CalibrationResult) -> str:
    return f"{1e-6 * value(result, E):.2f} MPa"


def _pair(result: CalibrationResult) -> str:
    return f"{1e-6 * value(result, E):.2f}, {value(result, NU):.4g}"


def _interval(result: CalibrationResult, name: str) -> str:
    return interval_text(result.parameters[name]).removesuffix(", within the bounds")


def draw(found: Fits, path: Path) -> None:
    """E over ν: both lines, Table I, the four tests, and the repeats."""
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "softcal"
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for colour, element in zip(("C0", "C1"), ELEMENTS, strict=True):
        repeats = found.repeats[element].reshape(-1, 2)
        axes.plot(0.5 - repeats[:, 1], 1e-6 * repeats[:, 0], ".", color=colour, markersize=3, alpha=0.35)
        fits = found.lines[element][1]
        axes.plot(
            0.5 - LINE, [1e-6 * value(one, E) for one in fits], color=colour, label=f"{element}: line of equal loss"
        )
        tests = (found.linear if element == "P1" else found.default).values()
        axes.plot(
            [0.5 - value(one, NU) for one in tests], [1e-6 * value(one, E) for one in tests], "o", color=colour,
            label=f"{element}: the four tests (dots: {len(found.repeats[element])} other draws)",
        )  # fmt: skip
    axes.plot([0.5 - test.ratio for test in TESTS], [1e-6 * test.modulus for test in TESTS], "k^", label="Table I")
    axes.plot(0.5 - TRUE[NU], 1e-6 * TRUE[E], "k*", markersize=10, label="truth")
    places = (0.4, 0.45, 0.48, 0.49, 0.495, 0.499, 0.4999)
    axes.set(xscale="log", yscale="log", xlabel="ν", ylabel="E [MPa]")
    axes.set_xticks([0.5 - nu for nu in places], [f"{nu:g}" for nu in places])
    axes.set_xticks([], minor=True)
    axes.set_yticks([0.2, 0.5, 1, 2, 3], ["0.2", "0.5", "1", "2", "3"])
    axes.set_yticks([], minor=True)
    axes.invert_xaxis()
    axes.grid(visible=True, linewidth=0.4)
    axes.legend(fontsize="small", loc="lower left")
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", action="store_true", help=f"first solve the finer twin and write {CURVE.name}")
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of table-one.md")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.truth:
        write_curve(solved(FINE))
    found = fitted(read_curve())
    draw(found, arguments.out / "table-one.svg")
    (arguments.out / "table-one.md").write_text(page(found), encoding="utf-8")
    print(f"Written: {arguments.out / 'table-one.md'}")


if __name__ == "__main__":
    main()
