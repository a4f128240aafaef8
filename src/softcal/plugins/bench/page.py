"""The page of the benchmark: a picture of each robot, and a row for every method."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softcal.calibration.results.stored import as_record, contradiction, read_bytes
from softcal.declare import shown
from softcal.errors import Fault, StorageError
from softcal.html_text import markdown
from softcal.plugins.bench.case import CASES, BenchmarkCase, Published
from softcal.plugins.bench.predictions import read_predictions
from softcal.plugins.bench.record import FIT, PREDICT, CaseRecord
from softcal.plugins.bench.run import PREDICTIONS, SCORE
from softcal.plugins.bench.score import Score, SplitScore, distances_of
from softcal.report.check_figures import robot_scenes
from softcal.report.scene_figure import draw_side_by_side
from softcal.report.scene_render import render_scenes
from softcal.report.style import BLUE, MUTED, encode, house_style, new_figure
from softcal.report.write import write_files
from softcal.units import format_quantity, parse_quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEAD = (
    "| method | fit: all points / tip | predict: all points / tip | of the length | in the band | evaluations | time | "
    "notes |\n|---|---|---|---|---|---|---|---|\n"
)
MOST_BYTES = 2**24  # of a score
FEW = 12  # samples that have a bar each

INTRODUCTION = """# The benchmark

<!-- Written by `softcal bench page`: run the cases again to change it. -->

Robots that others measured, or computed, with a fixed split of the samples: a method may fit the first ones, and
predicts the others. Errors are distances of the measured points, as root mean squares over samples and points [mm];
the tip is also by itself, and the predicted error of all points is given in per cent of the robot's length. *In the
band*: the share of all values to predict that lie in the method's own 95 % bands. Rows of others are what they
published, or what their own code, models or stored arrays give on these samples, as the row says; a dash is what is
not known of them. Take part with a table of predictions, by any program: `softcal bench score CASE predictions.csv`
([how](bench-cases.md)).
"""


def write_page(runs: Path, out: Path) -> list[Path]:
    """Write the page, Markdown with pictures beside it, of all scores below a folder of runs; returns the files.

    Raises
    ------
    StorageError
        Where there is no score, one cannot be read, or the page cannot be written.
    """
    scores = read_scores(runs)
    files: dict[Path, bytes] = {}
    text = [INTRODUCTION]
    for name, case in CASES.items():
        found = [one for one in scores if one[1].case == name]
        if not found:
            continue
        pictures = _pictures(case, found)
        for stem, picture in pictures.items():
            files[out.parent / f"bench-{name}-{stem}.png"] = picture
        text.append(_section(case, [score for _, score in found], list(pictures)))
    files[out] = "\n".join(text).encode()
    write_files(files)
    return list(files)


def read_scores(runs: Path) -> list[tuple[Path, Score]]:
    """Every score below a folder, with its own folder.

    Raises
    ------
    StorageError
        Where there is none, or one cannot be read.
    """
    what = "the score"
    paths = sorted(runs.rglob(SCORE))
    scores = {path: as_record(Score, read_bytes(path, what, MOST_BYTES), path, what) for path in paths}
    if not scores:
        raise StorageError(Fault(f"there is no {SCORE} below the folder", str(runs), attempt="softcal bench run CASE"))
    for path, score in scores.items():
        channels = {name for split in score.splits.values() for name in split.channels}
        if channels and score.case in CASES and (strange := channels - set(CASES[score.case].record().others)):
            raise contradiction(path, what, f"its case has no channel {shown(min(strange))}")
    return [(path.parent, score) for path, score in scores.items()]


def _section(case: BenchmarkCase, scores: Sequence[Score], pictures: Sequence[str]) -> str:
    n = scores[0].splits
    told = ", ".join(f"{one.n_samples} to {split}" for split, one in n.items())
    lines = [f"## {case.name}: {case.title}\n", f"![{case.title}](bench-{case.name}-robot.png)\n"]
    lines.append(f"Samples: {told}. Length {format_quantity(case.length, 'm')}. Data: {case.source} ({case.licence}).")
    if case.aligned:
        lines.append("One translation per split is taken off, since the frame of the cameras is not known.")
    if case.goal:
        lines.append(f"Goal: {case.goal}.")
    rows = [_row(case, score) for score in scores] + [_published(case, one) for one in case.published]
    lines += ["", HEAD + "\n".join(rows), ""]
    for score in scores:
        if found := "; ".join(f"{name} {value}" for name, value in (score.parameters or {}).items() if "[" not in name):
            lines += [f"{markdown(score.method)} found: {markdown(found)}.", ""]
    if case.remarks:
        lines += [case.remarks, ""]
    lines += [
        f"![Errors of the predicted samples](bench-{case.name}-errors.png)\n" for one in pictures if one == "errors"
    ]
    return "\n".join(lines)


def _row(case: BenchmarkCase, score: Score) -> str:
    predicted = score.splits.get(PREDICT)
    share = "–"
    if predicted is not None and predicted.all_points is not None:
        share = f"{100 * predicted.all_points.rms / case.length:.2g} %"
    band = "–" if predicted is None or predicted.coverage is None else f"{100 * predicted.coverage:.0f} %"
    wall = "–" if score.wall_s is None else format_quantity(score.wall_s, "s", digits=2)
    note = f"predicts {markdown(score.data)}" if score.data else ""
    if not score.parameters and predicted is not None and case.tip in predicted.points:
        tip = predicted.points[case.tip]
        mean, most, largest = (f"{100 * x / case.length:.2g} %" for x in (tip.mean, tip.most_95, tip.largest))
        told = f"tip: mean {mean}, 95 % below {most}, largest {largest} of the length"
        note = f"{told}; {note}" if note else told
    cells = [
        f"**{markdown(score.method)}**",
        _errors(case, score.splits.get(FIT)),
        _errors(case, predicted),
        share,
        band,
        "–" if score.evaluations is None else markdown(score.evaluations),
        wall,
        note or "–",
    ]
    return _line(cells)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _errors(case: BenchmarkCase, split: SplitScore | None) -> str:
    if split is None:
        return "–"
    told = [] if split.all_points is None else [f"{1e3 * split.all_points.rms:.3g}"]
    told += [f"{1e3 * split.points[case.tip].rms:.3g}"] if case.tip in split.points else []
    units = case.record().units
    others = [f"{name} {format_quantity(one.rms, units[name], digits=2)}" for name, one in split.channels.items()]
    return "; ".join([*([" / ".join(told)] if told else []), *others]) or "–"


def _published(case: BenchmarkCase, row: Published) -> str:
    pairs = [
        "–" if pair == (None, None) else " / ".join("–" if x is None else f"{1e3 * x:.3g}" for x in pair)
        for pair in (row.fit, row.predict)
    ]
    whole = row.predict[0] if row.predict[0] is not None else row.predict[1]
    share = "–" if whole is None else f"{100 * whole / case.length:.2g} %"
    note = f"{row.note} ({row.source})" if row.note else row.source
    return _line([row.method, *pairs, share, "–", "–", "–", note])


def _pictures(case: BenchmarkCase, found: Sequence[tuple[Path, Score]]) -> dict[str, bytes]:
    """The robot, and the errors of softcal's or the first method's predicted samples."""
    scenes, cameras = robot_scenes(case.robot())
    drawn = draw_side_by_side(scenes, cameras, render_scenes(scenes, cameras))
    pictures = {"robot": encode(drawn.figure)[0]}
    record = case.record()
    tables = [(s, folder / PREDICTIONS) for folder, s in found if (folder / PREDICTIONS).is_file() and not s.data]
    if tables:
        pictures["errors"] = encode(_error_figure(case, record, tables))[0]
    return pictures


def _error_figure(case: BenchmarkCase, record: CaseRecord, tables: Sequence[tuple[Score, Path]]) -> Figure:
    """Each method's errors of the predicted samples, in their order: the tip's, or of all points together, or of each
    other channel; bars with names where the samples are few.
    """
    names = np.array(record.samples)[record.of(PREDICT)].tolist()
    of = [case.tip or "all points"] if record.points else list(record.others)
    with house_style():
        figure = new_figure(6.4, 0.6 + 1.8 * len(of))
        for place, one in enumerate(of):
            axes = figure.add_subplot(len(of), 1, place + 1)
            unit = "m" if record.points else record.units[one]
            shown = {"m": "mm", "rad": "deg"}.get(unit, unit)
            for k, (score, path) in enumerate(tables):
                errors = _per_sample(case, record, path, one) / parse_quantity(f"1 {shown}", unit)
                colour = BLUE if k == 0 else MUTED
                if len(names) <= FEW:
                    width = 0.8 / len(tables)
                    left = np.arange(len(names)) + (k - 0.5 * (len(tables) - 1)) * width
                    axes.bar(left, errors, width=width, color=colour, label=score.method)
                else:
                    axes.plot(errors, ".-", color=colour, ms=3, lw=0.6, label=score.method)
            if len(names) <= FEW:
                axes.set_xticks(np.arange(len(names)), names)
            axes.set_ylabel(f"error of {one} [{shown}]")
            axes.set_ylim(bottom=0.0)
            if place == 0:
                figure.legend(*axes.get_legend_handles_labels(), loc="outside upper right", ncols=4)
        figure.axes[-1].set_xlabel("predicted sample" + ("" if len(names) <= FEW else ", in the order of the record"))
    return figure


def _per_sample(case: BenchmarkCase, record: CaseRecord, path: Path, of: str) -> np.ndarray:
    """The errors [SI] of the predicted samples: of a point, of all of them, or of another channel."""
    predictions, chosen = read_predictions(path, record, aligned=case.aligned), record.of(PREDICT)
    if of in record.others:
        rows = predictions.rows(np.array(record.samples)[chosen])
        return np.abs(predictions.channels[of][rows] - record.channels[of][chosen])
    distances, _ = distances_of(record, predictions, chosen, aligned=case.aligned)
    wanted = [distances[of]] if of in distances else list(distances.values())
    return np.sqrt(np.nanmean(np.square(wanted), axis=0))
