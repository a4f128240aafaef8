"""The specimens of a fleet, their populations and the means by factor, as tables."""

from __future__ import annotations

from collections.abc import Sequence

from softcal.calibration.results.digits import estimate_text, interval_text
from softcal.plugins.fleet.specimen import Specimen
from softcal.plugins.fleet.statement import FleetStatement
from softcal.plugins.fleet.verdict import chance_text, ends_text, level_text, spread_of, spread_text, value_text
from softcal.report.tables import Cell, Column, ReportTable
from softcal.twin.parameter_name import parameter_name
from softcal.units import plain


def fleet_tables(specimens: Sequence[Specimen], found: FleetStatement, most: int = 40) -> list[ReportTable]:
    """The tables of a fleet.

    Parameters
    ----------
    specimens
        The fleet's specimens.
    found
        What they say together.
    most
        Number of specimens that are listed at most.
    """
    return [populations_table(found), effects_table(found), laws_table(found), specimens_table(specimens, most)]


def populations_table(found: FleetStatement) -> ReportTable:
    """A row for each parameter."""
    rows: list[tuple[Cell, ...]] = []
    for one in found.populations:
        rows.append(
            (
                one.label,
                one.n,
                value_text(one.mean, one.interval, one.unit),
                ends_text(one.interval, one.unit, one.mean),
                *spread_of(one),
                chance_text(one.chance),
                "" if one.further is None else ends_text(one.further, one.unit, one.mean),
            )
        )
    labels = ("parameter", "specimens", "mean", "95 % interval", "spread", "its interval", "chance", "a further one")
    note = (
        "Spread: standard deviation between specimens beyond their own errors; of parameters on a logarithmic scale "
        "that of the logarithm, whose mean is the geometric one. Chance: that specimens without any difference differ "
        "as much."
    )
    return ReportTable("fleet", "The specimens together", tuple(map(Column, labels)), tuple(rows), note if rows else "")


def effects_table(found: FleetStatement) -> ReportTable:
    """A row for each group of each factor and parameter."""
    units = {one.label: one.unit for one in found.populations}
    rows: list[tuple[Cell, ...]] = []
    for one in found.effects:
        for k, group in enumerate(one.groups):
            last = (
                ("", "")
                if k
                else (chance_text(one.chance), "" if one.explained is None else f"{plain(100 * one.explained, 2)} %")
            )
            unit = units[one.label]
            mean = value_text(group.mean, group.interval, unit), ends_text(group.interval, unit, group.mean)
            rows.append(
                (one.label if not k else " ", one.factor, level_text(group.level, one.factor), group.n, *mean, *last)
            )
    labels = ("parameter", "by", "group", "specimens", "mean", "95 % interval", "chance", "of the variance")
    note = (
        "Each factor by itself, not adjusted for the others but, where the law against the infill is fitted, for the "
        "infill. Chance: that groups which do not differ show as much, times the number of these comparisons. Of the "
        "variance: what of the variance between specimens is one between groups."
    )
    return ReportTable("factors", "By factor", tuple(map(Column, labels)), tuple(rows), note if rows else "")


def laws_table(found: FleetStatement) -> ReportTable:
    """A row for each modulus against the infill."""
    rows = tuple(
        (
            one.label,
            value_text(one.exponent, one.exponent_interval, "1"),
            ends_text(one.exponent_interval, "1", one.exponent),
            value_text(one.bulk, one.bulk_interval, one.unit),
            ends_text(one.bulk_interval, one.unit, one.bulk),
            spread_text(one.spread, "log", one.unit, one.bulk),
            "" if one.misfit is None else chance_text(one.misfit),
        )
        for one in found.laws
    )
    labels = (
        "parameter",
        "exponent",
        "95 % interval",
        "at φ = 1",
        "95 % interval, φ = 1",
        "spread about it",
        "chance of misfit",
    )
    return ReportTable("infill", "Against the infill", tuple(map(Column, labels)), rows)


def specimens_table(specimens: Sequence[Specimen], most: int) -> ReportTable:
    """A row for each specimen, `most` at most; failed specimens first."""
    labels = list(dict.fromkeys(label for one in specimens for label in one.parameters))
    factors = list(dict.fromkeys(name for one in specimens for name in one.factors))
    order = sorted(specimens, key=lambda one: one.state == "DONE")
    rows: list[tuple[Cell, ...]] = []
    for one in order[:most]:
        values = [one.factors.get(name) for name in factors]
        told = [None if value is None else level_text(value, name) for name, value in zip(factors, values, strict=True)]
        held: list[Cell] = []
        for label in labels:
            e = one.parameters.get(label)
            held += [None, None] if e is None else [estimate_text(e), "at a bound" if e.at_bound else interval_text(e)]
        rows.append((one.name, *told, *held, one.loss, one.reason or "done"))
    columns = [Column("specimen"), *map(Column, factors)]
    for label in labels:
        columns += [Column(label), Column(f"interval of {parameter_name(label).kind}")]
    note = f"{most} of {len(order)} specimens; fleet.csv has all." if len(order) > most else ""
    return ReportTable("specimens", "Each specimen", (*columns, Column("loss"), Column("state")), tuple(rows), note)
