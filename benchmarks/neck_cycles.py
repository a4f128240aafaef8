"""The published neck's curves, loops and peaks by one set of constants: writes docs/neck-cycles.md and its figure.

python -m benchmarks.neck_cycles            fits anew, some two hours, and keeps neck_cycles.json
python -m benchmarks.neck_cycles --kept     the page of the constants that are kept, ten minutes
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.mesh_table import DOCS
from benchmarks.neck_cycles_twin import (
    CURVES_AT,
    SLACK,
    SPEEDS,
    TARGETS,
    Compared,
    curve,
    part_of_contact,
    predict,
    way,
)
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.checks import Floats
from softcal.units import format_quantity

HERE = Path(__file__).resolve().parent
PAGE, KEPT = HERE.parent / "docs" / "neck-cycles.md", HERE / "neck_cycles.json"
# What is fitted [SI]: where the search starts, and how far it may go.
START = {
    "youngs_modulus": (1.9e6, 2e5, 2e7), "relaxing_share1": (0.14, 1e-3, 0.5), "relaxation_time1": (0.84, 0.05, 20.0),
    "relaxing_share2": (0.12, 1e-3, 0.5), "relaxation_time2": (7.0, 1.0, 200.0), "softening_amount": (20.0, 1.05, 50.0),
    "softening_energy": (2.4e3, 50.0, 1e6), "flow_modulus": (2.9e5, 1e3, 3e6), "flow_threshold": (4.2e4, 1e2, 1e6),
}  # fmt: skip
SLACKS = (1.3e-3, -5e-3, 8e-3)  # [m]
UNITS = {"youngs_modulus": "Pa", "softening_energy": "Pa", "flow_modulus": "Pa", "flow_threshold": "Pa", SLACK: "m"}
UNITS |= {"relaxation_time1": "s", "relaxation_time2": "s"}
EVALUATIONS = 20
GAIN = 1e-4  # of the sum of squares, by which an evaluation must reduce it


def fit() -> dict[str, float]:
    """The constants and the slack [SI] of least squares to three digits, with exact derivatives; moduli, shares and
    times by their logarithms.
    """
    from scipy.optimize import least_squares

    names = (*START, SLACK)
    seen: dict[bytes, tuple[Floats, Floats]] = {}

    def values(x: Floats) -> dict[str, float]:
        return {**{name: float(np.exp(v)) for name, v in zip(START, x, strict=False)}, SLACK: 1e-3 * float(x[-1])}

    def both(x: Floats) -> tuple[Floats, Floats]:
        if x.tobytes() not in seen:
            at = values(x)
            found, _ = predict(at, names)
            off = np.concatenate([(one.predicted - one.measured) * one.weight for one in found])
            slopes = np.concatenate([one.by * one.weight[:, None] for one in found])
            scale = np.array([*(at[name] for name in START), 1e-3])
            seen[x.tobytes()] = off, slopes * scale
            print(f"{len(seen)}: {off @ off:.1f}", {name: float(f"{v:.3g}") for name, v in at.items()}, flush=True)
        return seen[x.tobytes()]

    bounds = [np.array([*(np.log(one[k]) for one in START.values()), 1e3 * SLACKS[k]]) for k in range(3)]
    solved = least_squares(
        lambda x: both(x)[0], bounds[0], lambda x: both(x)[1], (bounds[1], bounds[2]), ftol=GAIN, max_nfev=EVALUATIONS
    )
    return {name: float(f"{value:.3g}") for name, value in values(solved.x).items()}


def checks(values: Mapping[str, float]) -> dict[str, str]:
    """What contact does at the constants, and by how much the compared values are off with more cycles or rows, by the
    marks of the page.
    """
    closes, bears = part_of_contact(values)
    told = {"closes": f"{1e3 * closes:.0f} mm", "bears": f"{100 * bears:.0f} %"}
    for name, found in (("cycles", predict(values, (), n_cycles=4)[0]), ("rows", predict(values, (), finer=2)[0])):
        curves = [f"{100 * one.off:.1f}" for one in _of(found, "curve")]
        told[name] = f"{', '.join(curves[:-1])} and {curves[-1]} %"
        told[f"loops {name}"] = f"{100 * max(one.off for one in _of(found, 'loop')):.0f} %"
    return told


def page(values: Mapping[str, float], checked: Mapping[str, str], found: list[Compared]) -> str:
    """docs/neck-cycles.md."""
    told = {"constants": _constants(values), "curves": _curves(found), "loops": _loops(found), "peaks": _peaks(found)}
    told["n"] = [str(sum(len(one.at) for one in found))]
    return written_page(PAGE, {**{name: "\n".join(part) for name, part in told.items()}, **checked})


def _constants(values: Mapping[str, float]) -> list[str]:
    rows = [[f"`{name}`", format_quantity(value, UNITS.get(name, "1"), digits=3)] for name, value in values.items()]
    return table(["constant", "found"], rows)


def _of(found: list[Compared], what: str) -> list[Compared]:
    return [one for one in found if one.what == what]


def _curves(found: list[Compared]) -> list[str]:
    rows = [
        [
            f"{1e3 * one.target.pull:.0f} mm",
            f"{np.mean(np.abs(one.predicted - one.measured)):.2f} N",
            f"{100 * one.off:.1f} %",
            f"{100 * np.max(np.abs(one.predicted / one.measured - 1.0)):.1f} %",
        ]
        for one in _of(found, "curve")
    ]
    return table(["mean curve at 15 mm/s", "mean error", "mean error over the force", "largest"], rows)


def _loops(found: list[Compared]) -> list[str]:
    rows = []
    for target in TARGETS:
        held = {float(one.at[0]): one for one in _of(found, "loop") if one.target is target}
        cells = [_pair(held[speed], 100.0, "%") for speed in SPEEDS]
        rows.append([f"{1e3 * target.pull:.0f} mm", *cells])
    return table(["energy lost, measured and twin", *(f"{1e3 * speed:g} mm/s" for speed in SPEEDS)], rows)


def _peaks(found: list[Compared]) -> list[str]:
    rows = [[f"{1e3 * one.target.pull:.0f} mm", _pair(one, 1.0, "N")] for one in _of(found, "peak")]
    return table(["first peak at 15 mm/s", "measured and twin"], rows)


def _pair(one: Compared, factor: float, unit: str) -> str:
    measured, twin = factor * float(one.measured[0]), factor * float(one.predicted[0])
    return f"{measured:.3g} and {twin:.3g} {unit} ({100 * (twin / measured - 1.0):+.0f} %)"


def draw(found: list[Compared], force: Floats, to: Path) -> None:
    """The mean curves, and the twin's last loops at 15 mm/s; the loops' energies by speed."""
    from softcal.report.style import MEASURED, SERIES, SIMULATED, encode, house_style, new_figure

    d, cycles = way()
    with house_style():
        figure = new_figure(8.4, 3.6)
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        for k, (one, held) in enumerate(zip(_of(found, "curve"), cycles.values(), strict=True)):
            for side in held[-1]:
                left.plot(1e3 * d[side], force[side], color=SIMULATED, linewidth=0.9, alpha=0.6)
            at, measured = curve(one.target)
            named = k == 0
            left.plot(
                1e3 * at, measured, color=MEASURED, linewidth=3.0, alpha=0.4, label="measured mean" if named else None
            )
            left.plot(
                1e3 * at, one.predicted, color=SIMULATED, label="mean of the twin, and its loop" if named else None
            )
        left.set(xlabel="Displacement [mm]", ylabel="Force [N]")
        left.set_title("Three targets at 15 mm/s")
        left.legend(loc="upper left")
        for colour, target in zip(SERIES, TARGETS, strict=False):
            held = [one for one in _of(found, "loop") if one.target is target]
            speeds = [1e3 * float(one.at[0]) for one in held]
            shares = [(100 * float(one.measured[0]), 100 * float(one.predicted[0])) for one in held]
            right.plot(speeds, [m for m, _ in shares], "o", markerfacecolor="none", color=colour)
            right.plot(speeds, [s for _, s in shares], color=colour, label=f"{1e3 * target.pull:.0f} mm")
        right.set(xlabel="Speed [mm/s]", ylabel="Energy lost in a loop [%]", ylim=(0.0, None))
        right.set_title("Measured (points) and twin")
        right.legend(loc="lower right", ncols=3)
        to.write_bytes(encode(figure)[1])


def main() -> None:
    """Read the arguments and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kept", action="store_true", help="the constants of neck_cycles.json")
    parser.add_argument("--out", type=Path, default=DOCS, metavar="DIR", help="where to write")
    told = parser.parse_args()
    values = json.loads(KEPT.read_text(encoding="utf-8"))["constants"] if told.kept else fit()
    checked = checks(values)
    KEPT.write_text(json.dumps({"constants": values, "checks": checked}, indent=2) + "\n", encoding="utf-8")
    found, forces = predict(values, ())
    told.out.mkdir(parents=True, exist_ok=True)
    draw(found, forces[CURVES_AT], told.out / "neck-cycles.svg")
    (told.out / "neck-cycles.md").write_text(page(values, checked, found), encoding="utf-8")


if __name__ == "__main__":
    main()
