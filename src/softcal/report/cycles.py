"""Table of the cycles of the records: what the elastic twin lacks, energy lost in the loop and softening."""

from __future__ import annotations

from softcal.experiments.dataset import Dataset
from softcal.experiments.hysteresis import Loop, loops
from softcal.report.content import ReportContent
from softcal.report.tables import Cell, Column, ReportTable


def cycles_table(content: ReportContent) -> ReportTable:
    """Energy loss and peak of every cycle of the whole records; empty where no record has force, travel and cycles."""
    records = {name: found.record for held in content.records.values() for name, found in held.items()}
    rows = [row for name, record in records.items() if _has_cycles(record) for row in _rows(name, loops(record))]
    columns = (
        Column("Experiment"),
        Column("Cycle"),
        Column("Peak force", "N"),
        Column("Peak below the first cycle's", "%", 2),
        Column("Work of loading", "mJ"),
        Column("Lost in the loop", "mJ"),
        Column("Lost", "%", 2),
    )
    note = "The twin is elastic: it loses no energy, and all its cycles are the same."
    return ReportTable("cycles", "Cycles of the whole records", columns, tuple(rows), note)


def _has_cycles(record: Dataset) -> bool:
    return (
        record.cycle is not None and bool((record.cycle >= 0).any()) and {"shortening", "tension"} <= {*record.channels}
    )


def _rows(name: str, cycles: tuple[Loop, ...]) -> list[tuple[Cell, ...]]:
    first = cycles[0].peak_tension
    return [
        (
            name,
            one.number + 1,
            one.peak_tension,
            100 * (first - one.peak_tension) / first if first > 0.0 else None,
            1e3 * one.loading_energy,
            1e3 * one.lost_energy,
            100 * one.hysteresis,
        )
        for one in cycles
    ]
