"""Figures of a fleet: every specimen's estimate with its interval, and the modulus against the infill."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from softcal.plugins.fleet.infill_law import INFILL, InfillLaw
from softcal.plugins.fleet.population import Population
from softcal.plugins.fleet.specimen import Specimen
from softcal.plugins.fleet.statement import FleetStatement
from softcal.plugins.fleet.verdict import level_text
from softcal.report.format import scale_of
from softcal.report.style import FAINT, INK, MUTED, SERIES, house_style, new_figure, plain_log_ticks

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMED = 40  # specimens whose names have room
_LOG = 3.0  # ratio of values from which on their axis is logarithmic
_SHIFT = 0.012  # of the logarithm of the infill, between specimens of one infill


def draw_specimens(one: Population, specimens: Sequence[Specimen], found: FleetStatement) -> Figure:
    """The estimates of a parameter with their 95 % intervals, in order, with mean and spread of the population.

    Parameters
    ----------
    one
        Mean and spread of the parameter.
    specimens
        The fleet's specimens.
    found
        What they say together.
    """
    held = [s for s in specimens if one.label in s.parameters]
    held.sort(key=lambda s: s.parameters[one.label].value)
    scale = scale_of(one.unit, one.mean)
    by = colour_factor(one.label, found)
    colours = _colours(by, held)
    is_named = len(held) <= _NAMED
    with house_style():
        figure = new_figure(6.4, 1.3 + 0.2 * len(held) if is_named else 4.2)
        axes = figure.subplots()
        low, high = one.mean - one.spread, one.mean + one.spread
        if one.scale == "log":
            low, high = one.mean * math.exp(-one.spread), one.mean * math.exp(one.spread)
        span, line = (axes.axvspan, axes.axvline) if is_named else (axes.axhspan, axes.axhline)
        if one.spread > 0.0:
            band = low / scale.factor, high / scale.factor
            span(*band, color=FAINT, alpha=0.35, linewidth=0, label="mean ± spread")
        band = one.interval[0] / scale.factor, one.interval[1] / scale.factor
        span(*band, color=MUTED, alpha=0.35, linewidth=0, label="95 % interval of the mean")
        line(one.mean / scale.factor, color=INK, linewidth=1.0, label="mean")
        shown: set[str] = set()
        for row, specimen in enumerate(held):
            e = specimen.parameters[one.label]
            level = _level(specimen, by)
            label = f"{by} {level}" if level and level not in shown else None
            shown.add(level)
            low, high = e.interval or (e.value, e.value)
            place, ends = e.value / scale.factor, [[(e.value - low) / scale.factor], [(high - e.value) / scale.factor]]
            style: dict[str, Any] = {
                "fmt": "o",
                "markersize": 4.0 if is_named else 2.0,
                "linewidth": 1.0 if is_named else 0.5,
                "color": colours[level],
                "markerfacecolor": "none" if e.at_bound else colours[level],
                "label": label,
            }
            if is_named:
                axes.errorbar(place, row, xerr=ends, **style)
            else:
                axes.errorbar(row, place, yerr=ends, **style)
        values = np.array([s.parameters[one.label].value for s in held]) / scale.factor
        is_log = one.scale == "log" and values.max() > _LOG * values.min()
        if is_log:
            (axes.set_xscale if is_named else axes.set_yscale)("log")
        if is_named:
            axes.set_xlabel(scale.axis(one.label))
            axes.set_yticks(range(len(held)), [s.name for s in held])
            axes.set_ylim(-0.8, len(held) - 0.2)
            axes.grid(visible=False, axis="y")
        else:
            axes.set_ylabel(scale.axis(one.label))
            axes.set_xlabel("specimens, in the order of their values")
        if is_log:
            plain_log_ticks(axes.xaxis if is_named else axes.yaxis, *(axes.get_xlim() if is_named else axes.get_ylim()))
        figure.legend(loc="outside upper center", ncols=3)
        return figure


def draw_infill(law: InfillLaw, specimens: Sequence[Specimen], found: FleetStatement) -> Figure:
    """The estimates of a modulus against the infill, and the law with its 95 % band.

    Parameters
    ----------
    law
        The law of the modulus against the infill.
    specimens
        The fleet's specimens.
    found
        What they say together.
    """
    held = [s for s in specimens if law.label in s.parameters and isinstance(s.factors.get(INFILL), float)]
    scale = scale_of(law.unit, law.bulk)
    by = next((e.factor for e in found.effects if e.factor != INFILL and e.label == law.label), "")
    colours = _colours(by, held)
    with house_style():
        figure = new_figure(5.6, 4.0)
        axes = figure.subplots()
        phi, middle, low, high = (np.array(row) for row in law.line)
        gamma = f"E = E_bulk φ^γ, γ = {law.exponent:.3g}"
        axes.fill_between(
            100 * phi,
            low / scale.factor,
            high / scale.factor,
            color=FAINT,
            alpha=0.5,
            linewidth=0,
            label="95 % band of the law",
        )
        axes.plot(100 * phi, middle / scale.factor, color=INK, label=gamma)
        shown: set[str] = set()
        for k, specimen in enumerate(held):
            e, value = specimen.parameters[law.label], specimen.factors[INFILL]
            level = _level(specimen, by)
            at = 100 * float(value or 0.0) * math.exp(_SHIFT * (k % 5 - 2))
            label = f"{by} {level}" if level and level not in shown else None
            shown.add(level)
            low_end, high_end = e.interval or (e.value, e.value)
            error = [[(e.value - low_end) / scale.factor], [(high_end - e.value) / scale.factor]]
            axes.errorbar(
                at,
                e.value / scale.factor,
                error,
                fmt="o",
                markersize=3.5,
                linewidth=0.8,
                color=colours[level],
                label=label,
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        plain_log_ticks(axes.xaxis, *axes.get_xlim())
        plain_log_ticks(axes.yaxis, *axes.get_ylim())
        axes.set_xlabel("infill φ [%]")
        axes.set_ylabel(scale.axis(law.label))
        axes.legend()
        return figure


def colour_factor(label: str, found: FleetStatement) -> str:
    """The factor whose groups have colours: one by which the parameter differs, or the first with few groups."""
    effects = [e for e in found.effects if e.label == label and len(e.groups) <= len(SERIES)]
    return next((e.factor for e in sorted(effects, key=lambda e: e.chance)), "")


def _colours(by: str, held: Sequence[Specimen]) -> dict[str, str]:
    values = {s.factors.get(by) for s in held} - {None}
    order = sorted(values, key=lambda value: (isinstance(value, str), value))  # type: ignore[arg-type,return-value]
    named = {level_text(value, by): SERIES[k % len(SERIES)] for k, value in enumerate(order) if value is not None}
    return {"": MUTED if named else SERIES[0], **named}


def _level(specimen: Specimen, by: str) -> str:
    value = specimen.factors.get(by) if by else None
    return "" if value is None else level_text(value, by)
