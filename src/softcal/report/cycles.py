"""Inelastic behaviour, cycle by cycle: energy lost in the loop, softening and set, measured and of the twin."""

from __future__ import annotations

from collections.abc import Iterator

from softcal.calibration.results.fit import has_cycles
from softcal.calibration.results.result import CycleFit, ExperimentFit, SearchResult
from softcal.experiments.driven import DrivenChannels, driven_whole
from softcal.experiments.hysteresis import Loop, loops
from softcal.report.content import ReportContent
from softcal.report.format import channel_scale, number
from softcal.report.tables import Cell, Column, ReportTable
from softcal.sensing.channel import in_a_word
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import TENSION

_OF_RECORD = "The twin was fitted to chosen samples of these records; the table has what was measured."


def cycles_tables(content: ReportContent) -> Iterator[ReportTable]:
    """Energy loss and peak of every cycle of the whole records, by the kind of actuator."""
    records = {name: comparison.record for by_name in content.records.values() for name, comparison in by_name.items()}
    rows: dict[tuple[ChannelKind, ChannelKind], list[tuple[Cell, ...]]] = {}
    for name, record in records.items():
        if has_cycles(record) and (of := driven_whole(record)) is not None:
            rows.setdefault(of.kinds, []).extend((name, *row) for row in _rows(loops(record), of))
    for kinds, own in rows.items():
        columns = (Column("Experiment"), Column("Cycle"), *(Column(*of) for of in _columns(kinds)))
        yield ReportTable(_stem("cycles", kinds[1]), "Cycles of the whole records", columns, tuple(own), _OF_RECORD)


def loops_tables(content: ReportContent) -> Iterator[ReportTable]:
    """Every cycle that was fitted, measured and simulated, by the kind of actuator."""
    rows: dict[tuple[ChannelKind, ChannelKind], list[tuple[Cell, ...]]] = {}
    for label, result in content.results.items():
        for name, fit in result.experiments.items():
            if not fit.cycles or fit.driven is None:
                continue
            for row, twin in zip(*(_rows(tuple(side), fit.driven) for side in _both(fit.cycles)), strict=True):
                both = (cell for k in (1, 3, 4, 5, 6) for cell in (row[k], twin[k]))
                rows.setdefault(fit.driven.kinds, []).append((label, name, row[0], *both))
    for kinds, own in rows.items():
        named = [of[:2] for k, of in enumerate(_columns(kinds)) if k != 1]
        both = (Column(f"{what}{of}", unit) for what, unit in named for of in ("", ", twin"))
        columns = (Column("Calibration"), Column("Experiment"), Column("Cycle"), *both)
        word = in_a_word(kinds[1].name)
        note = f"Lost: over the work of loading. The {word} vanishes at the travel of slack and permanent set together."
        yield ReportTable(_stem("loops", kinds[1]), "Cycles, measured and simulated", columns, tuple(own), note)


def _stem(name: str, effort: ChannelKind) -> str:
    """The file of a table: with the word for the effort where it is not that of a cable."""
    return name if effort == TENSION else f"{name}-{in_a_word(effort.name)}"


def _columns(kinds: tuple[ChannelKind, ChannelKind]) -> tuple[tuple[str, str, int], ...]:
    """Heading, unit and digits of each column of the table of cycles; see `_rows`."""
    word, (coordinate, effort) = in_a_word(kinds[1].name), (channel_scale(kind.unit).unit for kind in kinds)
    return (
        (f"Peak {word}", effort, 3),
        ("Peak below the first cycle's", "%", 2),
        ("Work of loading", "mJ", 3),
        ("Lost in the loop", "mJ", 3),
        ("Lost", "%", 2),
        (f"{word.capitalize()} vanishes at", coordinate, 3),
    )


def cycle_sentences(result: SearchResult) -> list[str]:
    """For each experiment with whole cycles: energy lost, softening of the first cycle and set, measured and of the
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
    at, of_twin = (side[-1].vanishes_at for side in _both(cycles))
    if at is not None and of_twin is not None and fit.driven is not None:
        scale = channel_scale(fit.driven.units[0])
        at, of_twin = (f"{number(value / scale.factor)} {scale.unit}" for value in (at, of_twin))
        text += f" In the last cycle the {in_a_word(fit.driven.effort)} vanishes at {at}; the twin's, at {of_twin}."
    return text


def _both(cycles: tuple[CycleFit, ...]) -> tuple[list[Loop], list[Loop]]:
    return [cycle.measured for cycle in cycles], [cycle.simulated for cycle in cycles]


def _rows(cycles: tuple[Loop, ...], of: DrivenChannels) -> list[tuple[Cell, ...]]:
    """The number of each cycle, and what `_columns` names."""
    first, (coordinate, effort) = cycles[0].peak_effort, map(channel_scale, of.units)
    return [
        (
            loop.number + 1,
            loop.peak_effort / effort.factor,
            100 * (first - loop.peak_effort) / first if first != 0.0 else None,
            1e3 * loop.loading_energy,
            1e3 * loop.lost_energy,
            100 * loop.hysteresis,
            None if loop.vanishes_at is None else loop.vanishes_at / coordinate.factor,
        )
        for loop in cycles
    ]
