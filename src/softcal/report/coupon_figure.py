"""Charts of coupon tests: nominal stresses as measured, and as a law gives them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softcal.coupons.coupon import Coupon
from softcal.coupons.kind import KINDS
from softcal.coupons.law_fit import LawFit
from softcal.report.format import scale_of
from softcal.report.style import MEASURED, SERIES, house_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARKERS = "os^Dv<>p"


def draw_coupons(coupons: Sequence[Coupon], fits: Sequence[LawFit]) -> Figure:
    """A panel for each stress of each kind of test: measured points, the curves of the laws, and of one law alone the
    95 % band of a further test. Of a biaxial test both stresses are over the second stretch.
    """
    panels = [(test, k) for test in dict.fromkeys(c.test for c in coupons) for k in range(len(KINDS[test].axes))]
    scale = scale_of("Pa", max(float(np.abs(coupon.stress).max()) for coupon in coupons))
    with house_style():
        figure = new_figure(1.0 + 3.6 * len(panels), 3.8)
        for axes, (test, k) in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            own = [(i, coupon) for i, coupon in enumerate(coupons) if coupon.test == test]
            for (_, coupon), marker in zip(own, itertools.cycle(_MARKERS)):
                label = coupon.name if len(own) > 1 else "measured"
                points = coupon.strain[:, -1], coupon.stress[:, k] / scale.factor
                axes.plot(*points, marker, color=MEASURED, markersize=3.5, markerfacecolor="none", label=label)
            for fit, colour in zip(fits[: len(SERIES)], SERIES, strict=False):
                for i, coupon in own:
                    _draw_law(axes, coupon, fit, (i, k), colour, scale.factor, band=len(fits) == 1)
            n_axes = len(KINDS[test].axes)
            axes.set_title(test if n_axes == 1 else f"{test}, axis {k + 1}")
            axes.set_xlabel("amount of shear" if test == "shear" else "stretch" if n_axes == 1 else "stretch 2")
            axes.set_ylabel(scale.axis("nominal stress"))
            handles, labels = axes.get_legend_handles_labels()
            unique = dict(zip(labels, handles, strict=True))
            axes.legend(list(unique.values()), list(unique))
        return figure


def _draw_law(
    axes: Axes, coupon: Coupon, fit: LawFit, place: tuple[int, int], colour: str, factor: float, *, band: bool
) -> None:
    """A law in one test; place: of the test among all, and of the stress."""
    i, k = place
    strain, stress = coupon.strain, fit.predicted[i][:, k] / factor
    widths = fit.statistics.bands.get(coupon.name, {}).get(f"{coupon.test} {coupon.kind.components[k]}")
    # A line for each value of the first of two stretches.
    cuts = np.flatnonzero(np.any(np.diff(strain[:, :-1], axis=0) != 0.0, axis=1)) + 1
    for rows in np.split(np.arange(len(strain)), cuts):
        axes.plot(strain[rows, -1], stress[rows], color=colour, label=fit.law.name)
        if band and widths is not None:
            half = widths[rows] / factor
            ends = stress[rows] - half, stress[rows] + half
            axes.fill_between(strain[rows, -1], *ends, color=colour, alpha=0.18, linewidth=0, label="95 % band")
