"""What is inelastic, cycle by cycle: energy lost in the loop, softening and set, measured and of the twin."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from softcal.calibration.results.fit import has_cycles
from softcal.calibration.results.result import CycleFit, ExperimentFit, SearchResult
from softcal.experiments.driven import CABLE
from softcal.experiments.hysteresis import Loop, loops
from softcal.report.content import ReportContent
from softcal.report.format import channel_scale, number
from softcal.report.tables import Cell, Column, ReportTable

_OF_RECORD = "The twin was fitted to chosen samples of these records; the table has what was measured."


def cycles_table(content: ReportContent) -> ReportTable:
    """Energy loss and peak of every cycle of the whole records; empty where no record has force, travel and cycles."""
    records = {name: comparison.record for by_name in content.records.values() for name, comparison in by_name.items()}
    found = {name: loops(record) for name, record in records.items() if has_cycles(record)}
    of_cables = _of_cables(found.values())
    rows = [(name, *row) for name, cycles in found.items() for row in _rows(cycles, of_cables)]
    peak, end = _PEAK_AND_END[of_cables]
    columns = (
        Column("Experiment"),
        Column("Cycle"),
        Column(*peak),
        Column("Peak below the first cycle's", "%", 2),
        Column("Work of loading", "mJ"),
        Column("Lost in the loop", "mJ"),
        Column("Lost", "%", 2),
        Column(*end),
    )
    return ReportTable("cycles", "Cycles of the whole records", columns, tuple(rows), _OF_RECORD)


def loops_table(content: ReportContent) -> ReportTable:
    """Every cycle that was fitted, measured and simulated; empty where the samples go one way."""
    rows: list[tuple[Cell, ...]] = []
    fits = [fit for result in content.results.values() for fit in result.experiments.values()]
    of_cables = _of_cables(_both(fit.cycles)[0] for fit in fits)
    peak, end = _PEAK_AND_END[of_cables]
    for label, result in content.results.items():
        for name, fit in result.experiments.items():
            measured, simulated = (_rows(tuple(side), of_cables) if side else [] for side in _both(fit.cycles))
            for row, twin in zip(measured, simulated, strict=True):
                rows.append((label, name, row[0], *(cell for k in (1, 3, 4, 5, 6) for cell in (row[k], twin[k]))))
    columns = (
        Column("Calibration"),
        Column("Experiment"),
        Column("Cycle"),
        *(
            Column(f"{what}{of}", unit)
            for what, unit in (
                peak,
                ("Work of loading", "mJ"),
                ("Lost in the loop", "mJ"),
                ("Lost", "%"),
                end,
            )
            for of in ("", ", twin")
        ),
    )
    note = "Lost: over the work of loading. The force vanishes at the travel of slack and permanent set together."
    return ReportTable("loops", "Cycles, measured and simulated", columns, tuple(rows), note)


def cycle_sentences(result: SearchResult) -> list[str]:
    """Of each experiment with whole cycles: energy lost, softening of the first cycle and set, measured and of the
    twin.
    """
    return [cycle_sentence(name, fit) for name, fit in result.experiments.items() if fit.cycles]


def cycle_sentence(experiment: str, fit: ExperimentFit) -> str:
    """See `cycle_sentences`."""
    cycles = fit.cycles
    lost: list[str] = []
    for side in _both(cycles):
        energy, work = sum(loop.lost_energy for loop in side), sum(loop.loading_energy for loop in side)
        share = energy / work if work > 0.0 else 0.0
        lost.append(f"{number(1e3 * energy)} mJ, {number(100 * share)} % of the work of loading")
    many = f"{len(cycles)} cycles lose" if len(cycles) > 1 else "The cycle loses"
    text = f"{experiment}: {many} {lost[0]}; the twin's, {lost[1]}."
    if len(cycles) > 1 and all(side[-1].peak_effort != 0.0 for side in _both(cycles)):
        first, of_twin = (number(side[0].peak_effort / side[-1].peak_effort) for side in _both(cycles))
        text += f" The first peak is {first} times the last; the twin's, {of_twin} times."
    last, of_twin = (side[-1] for side in _both(cycles))
    if last.vanishes_at is not None and of_twin.vanishes_at is not None:
        scale = channel_scale(last.units[0])
        places = [f"{number(at / scale.factor)} {scale.unit}" for at in (last.vanishes_at, of_twin.vanishes_at)]
        word = "force" if _of_cables([[last]]) else "effort"
        text += f" In the last cycle the {word} vanishes at {places[0]}; the twin's, at {places[1]}."
    return text


def _both(cycles: tuple[CycleFit, ...]) -> tuple[list[Loop], list[Loop]]:
    return [cycle.measured for cycle in cycles], [cycle.simulated for cycle in cycles]


def _of_cables(found: Iterable[Sequence[Loop]]) -> bool:
    """Whether all loops are of travel and force."""
    return all(loop.units == CABLE.units for cycles in found for loop in cycles)


# Titles and units of the columns of the peak and of where the effort vanishes; of actuators of several kinds each value
# has its own unit. By whether all are cables.
_PEAK_AND_END = {
    True: (("Peak force", "N"), ("Force vanishes at", "mm")),
    False: (("Peak effort", ""), ("Effort vanishes at", "")),
}


def _rows(cycles: tuple[Loop, ...], of_cables: bool) -> list[tuple[Cell, ...]]:
    first = cycles[0].peak_effort

    def shown(value: float, unit: str) -> Cell:
        scale = channel_scale(unit)
        return value / scale.factor if of_cables else f"{number(value / scale.factor)} {scale.unit}"

    return [
        (
            loop.number + 1,
            shown(loop.peak_effort, loop.units[1]),
            100 * (first - loop.peak_effort) / first if first != 0.0 else None,
            1e3 * loop.loading_energy,
            1e3 * loop.lost_energy,
            100 * loop.hysteresis,
            None if loop.vanishes_at is None else shown(loop.vanishes_at, loop.units[0]),
        )
        for loop in cycles
    ]
