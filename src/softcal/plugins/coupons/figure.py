"""Charts of coupon tests: nominal stresses as measured, and as laws give them, over the strain and over the time."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.fitted_material import PredictedCoupon
from softcal.plugins.coupons.kind import KINDS
from softcal.report.format import Scale, scale_of
from softcal.report.style import MEASURED, SERIES, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "os^Dv<>p"
_BAND = "95 % band"
_MARKS = 60  # of a test along its way


def draw_coupons(laws: Mapping[str, Sequence[PredictedCoupon]]) -> Figure:
    """A column for each stress of each kind of test, over the strain, and below it over the time where one is known.

    laws: name -> what it says of the tests, which are the same for each. Points are measured, curves are the laws'; of
    one law alone the 95 % band of a further test is drawn. Of a biaxial test both stresses are over the second stretch.
    """
    tests = [one.coupon for one in next(iter(laws.values()))]
    panels = [(test, k) for test in dict.fromkeys(c.test for c in tests) for k in range(len(KINDS[test].axes))]
    n_rows = 2 if any(c.time is not None for c in tests) else 1
    every = itertools.chain(
        *([np.nan_to_num(c.stress)] for c in tests), *([p.stress for p in s] for s in laws.values())
    )
    scale = scale_of("Pa", max(float(np.abs(stress).max()) for stress in every))
    with house_style():
        figure = new_figure(1.0 + (3.6 if n_rows == 1 else 5.2) * len(panels), 3.8 if n_rows == 1 else 6.4)
        grid = figure.subplots(n_rows, len(panels), squeeze=False)
        shown: dict[str, Artist] = {}
        for column, (test, k) in enumerate(panels):
            own = {name: [p for p in said if p.coupon.test == test] for name, said in laws.items()}
            n_axes = len(KINDS[test].axes)
            grid[0, column].set_title(test if n_axes == 1 else f"{test}, axis {k + 1}")
            strain = "amount of shear" if test == "shear" else "stretch" if n_axes == 1 else "stretch 2"
            _draw(grid[0, column], own, k, scale, in_time=False)
            grid[0, column].set_xlabel(strain)
            artists, labels = grid[0, column].get_legend_handles_labels()
            handles = dict(zip(labels, artists, strict=True))  # each label once
            if n_rows == 1:
                grid[0, column].legend(list(handles.values()), list(handles))
                continue
            shown |= handles
            timed = {name: [p for p in said if p.coupon.time is not None] for name, said in own.items()}
            if not any(timed.values()):
                grid[1, column].set_axis_off()
                continue
            _draw(grid[1, column], timed, k, scale, in_time=True)
            grid[1, column].set_xlabel("time [s]")
        if n_rows > 1:  # as many curves as tests leave no room in a panel
            order = sorted(shown, key=lambda label: (not label.endswith("measured"), label != _BAND))
            figure.legend([shown[label] for label in order], order, loc="outside lower center", ncols=2)
        return figure


def _draw(axes: Axes, laws: Mapping[str, Sequence[PredictedCoupon]], k: int, scale: Scale, *, in_time: bool) -> None:
    """The tests of a kind in one panel; k: which stress. Of one law in several tests in time each has its colour."""
    tests = [one.coupon for one in next(iter(laws.values()))]
    alone, by_test = len(laws) == 1, len(laws) == 1 and len(tests) > 1 and all(c.time is not None for c in tests)
    for i, (coupon, marker) in enumerate(zip(tests, itertools.cycle(_MARKERS), strict=False)):
        seen = np.flatnonzero(coupon.measured[:, k])
        seen = seen[:: max(1, len(seen) // _MARKS)] if coupon.time is not None else seen
        colour = SERIES[i % len(SERIES)] if by_test else MEASURED
        label = f"{coupon.name}, measured" if len(tests) > 1 else "measured"
        if len(seen):
            points = _across(coupon, in_time=in_time)[seen], coupon.stress[seen, k] / scale.factor
            axes.plot(*points, marker, color=colour, markersize=3.5, markerfacecolor="none", label=label)
    for number, (name, said) in enumerate(laws.items()):
        for i, one in enumerate(said):
            colour = SERIES[(i if by_test else number) % len(SERIES)]
            label = f"{one.coupon.name}, {name}" if by_test else name
            across = _across(one.coupon, in_time=in_time)
            stress, half = one.stress[:, k] / scale.factor, one.half[:, k] / scale.factor
            # A line for each value of the first of two stretches.
            strain = one.coupon.strain
            cuts = [] if in_time else np.flatnonzero(np.any(np.diff(strain[:, :-1], axis=0) != 0.0, axis=1)) + 1
            for rows in np.split(np.arange(len(strain)), cuts):
                axes.plot(across[rows], stress[rows], color=colour, label=label, linewidth=1.2 if in_time else None)
                if alone and np.isfinite(half[rows]).all():
                    ends = (stress - half)[rows], (stress + half)[rows]
                    axes.fill_between(across[rows], *ends, color=colour, alpha=0.18, linewidth=0, label=_BAND)
    axes.set_ylabel(scale.axis("nominal stress"))


def _across(coupon: Coupon, *, in_time: bool) -> Floats:
    return coupon.time if in_time and coupon.time is not None else coupon.strain[:, -1]
