"""The page of a run: what was read, drawn and kept up to date in every browser that looks at it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from softcal.plugins.watch.charts import fleet_chart, loss_chart, parameter_chart
from softcal.plugins.watch.report_figures import DrawnFigure
from softcal.plugins.watch.twin import FitPicture
from softcal.plugins.watch.twin_panel import TwinPanel, fit_text
from softcal.plugins.watch.watched import Course, WatchedSearch
from softcal.plugins.watch.words import (
    STATES,
    best_rows,
    failed_rows,
    fleet_text,
    fleet_time_left,
    run_state,
    score_rows,
    search_rows,
    search_time_left,
    share_done,
    share_finished,
    state_sentence,
    time_text,
    trials_text,
    worker_rows,
)

if TYPE_CHECKING:
    from softcal.plugins.watch.watch import Watch

EVERY = 1.0  # [s]
PAGE = 15  # rows of a table
_HIDDEN = "sc-hidden"


@dataclass
class _Table:
    """A card with a title and a table, hidden while there is no row."""

    card: Any
    title: Any
    table: Any

    def show(self, rows: list[dict[str, Any]], title: str = "") -> None:
        if title:
            self.title.set_text(title)
        few = len(rows) <= PAGE
        self.table.props("hide-bottom" if few else "", remove="" if few else "hide-bottom")
        if self.table.rows != rows:
            self.table.rows[:] = rows
            self.table.update()
        _show(self.card, bool(rows))


class RunPage:
    """The elements of one browser's page, and what they show."""

    def __init__(self, watch: Watch) -> None:
        from nicegui import ui

        self._watch = watch
        self._chosen: str | None = None
        self._drawn: object = None
        self._specimens: object = None
        with ui.element("main").classes("sc-page"):
            with ui.element("header").classes("sc-head"):
                self._name = ui.label().classes("sc-name").mark("name")
                self._state = ui.label("Reading").classes("sc-state").mark("state")
                self._stage = ui.label().classes("sc-stage").mark("stage")
                self._report = ui.link("Open the report", "report", new_tab=True).classes(f"sc-report {_HIDDEN}")
            self._faults = ui.label().classes(f"sc-12 sc-note sc-warn {_HIDDEN}")
            with ui.element("div").classes("sc-bar") as self._bar:
                self._fill = ui.element("div").classes("sc-fill")
            with _card("sc-12") as self._fleet:
                ui.label("The specimens' first parameter, with 95 % intervals").classes("sc-title")
                self._fleet_chart = ui.echart({"series": []}).classes("sc-chart")
            self._searches = _table(
                "Calibrations",
                {"label": "name", "state": "state", "trials": "trials", "best": "best loss", "failed": "failed"},
                key="place",
            )
            self._searches.table.on("rowClick", self._choose)
            with ui.element("div").classes("sc-facts") as facts:
                self._trials, self._method = _fact("Trials", "trials")
                self._best, self._best_note = _fact("Best loss", "best")
                self._failed, _ = _fact("Failed", "failed")
                self._time, self._time_left = _fact("Time", "time")
            with _card("sc-7") as losses:
                ui.label("Loss against trials").classes("sc-title")
                self._losses = ui.echart({"series": []}).classes("sc-chart")
            with _card("sc-5") as twin:
                self._twin = TwinPanel()
            with _card(f"sc-12 {_HIDDEN}") as fits:
                self._fits = FigurePanel(fits, "Measured and simulated at the best trial")
            with _card("sc-7") as parameters:
                ui.label("Parameters of the trials").classes("sc-title")
                self._parameters = ui.echart({"series": []}).classes("sc-chart")
            with ui.element("div").classes("sc-5 sc-stack"):
                self._values = _table("Values", {"name": "parameter", "value": "value", "range": "range"})
                with self._values.card:
                    self._notes = ui.label().classes(f"sc-note {_HIDDEN}")
                self._workers = _table("Workers", {"name": "worker", "state": "state", "done": "trials done"})
            self._failures = _table("Failed trials", {"trial": "trial", "reason": "reason", "at": "parameters"})
            self._scores = _table(
                "Scores",
                {name: name for name in ("case", "method", "split", "of", "rms", "mean", "largest")},
                key="key",
            )
            with _card(f"sc-12 {_HIDDEN}") as figures:
                self._figures = FigurePanel(figures, "Figures of the report")
        self._of_search = (facts, losses, twin, parameters)
        ui.timer(EVERY, self.refresh)

    async def refresh(self) -> None:
        """Read what is new, and show it."""
        run = await self._watch.now()
        now = datetime.now(UTC)
        chosen = next((search for search in run.searches if search.label == self._chosen), None)
        search = chosen if chosen is not None or run.kind == "fleet" else run.now_at(now)
        search = None if search is None else await self._watch.whole(search)
        self._name.set_text(run.name)
        _show(self._report, bool(run.report))
        self._faults.set_text("\n".join([*run.unreadable, *(() if search is None else search.unreadable)]))
        _show(self._faults, bool(self._faults.text))
        several = len(run.searches) > 1
        told = ", ".join(part for part in (fleet_text(run, now), fleet_time_left(run, now)) if part)
        self._searches.show(search_rows(run, now) if several else [], told if several else "")
        self._figures.show(of_report(run.figures))
        _show(self._fleet, run.kind == "fleet" and any(s.result and not s.is_open for s in run.searches))
        if run.kind == "fleet" and run.searches != self._specimens:
            self._specimens = run.searches
            _draw(self._fleet_chart, fleet_chart(run))
        self._scores.show(score_rows(run))
        for element in self._of_search:
            _show(element, search is not None)
        _show(self._bar, bool(run.searches))
        if search is not None:
            self._show_search(search, now)
            return
        self._fits.show([])
        for table in (self._values, self._failures, self._workers):
            table.show([])
        course, sentence = run_state(run, now)
        self._say(course, sentence, share_finished(run, now))

    def _say(self, course: Course, sentence: str, share: float) -> None:
        self._state.set_text(STATES[course])
        self._state.classes(replace=f"sc-state {course}")
        self._stage.set_text(sentence)
        self._fill.style(f"width: {100 * share:.1f}%")

    def _show_search(self, search: WatchedSearch, now: datetime) -> None:
        course = search.course(now)
        named = f"{search.label}: " if search.label == self._chosen else ""
        self._say(course, f"{named}{state_sentence(search, now)}", share_done(search, now))
        best = search.best
        self._trials.set_text(trials_text(search))
        self._best.set_text("–" if best is None or best.loss is None else f"{best.loss:.6g}")
        self._best_note.set_text("" if best is None else f"trial {best.number}")
        self._failed.set_text(str(len(search.failed)))
        self._time.set_text(time_text(search, now))
        self._time_left.set_text(search_time_left(search, now))
        self._method.set_text(
            ", ".join(part for part in (search.method, search.live.executor if search.live else "") if part)
        )
        keeper = self._watch.twins
        keeper.want(search, ended=course == "ended")
        facts = keeper.facts(search)
        shape = keeper.shape(search)
        self._twin.show(search, shape, busy=keeper.is_busy)
        self._fits.show(of_fits(shape.fits) if shape else [], fit_text(shape) if shape else "")
        drawn = (search.place, search.trials[-1:], len(search.trials), search.result, facts)
        if drawn == self._drawn:
            self._workers.show(worker_rows(search))
            return
        self._drawn = drawn
        _draw(self._losses, loss_chart(search))
        _draw(self._parameters, parameter_chart(search, facts))
        result = search.result
        title = "Values of the best trial, and bounds" if result is None else "Result: values, and 95 % intervals"
        self._values.table.columns[2]["label"] = "bounds" if result is None else "95 % interval"
        self._values.show(best_rows(search, facts), title)
        self._notes.set_text("" if result is None else "\n".join(result.notes))
        _show(self._notes, bool(self._notes.text))
        self._failures.show(failed_rows(search, facts), f"Failed trials: {len(search.failed)}")
        self._workers.show(worker_rows(search))

    def _choose(self, event: Any) -> None:
        self._chosen = event.args[1].get("label")


def _card(width: str) -> Any:
    from nicegui import ui

    return ui.element("section").classes(f"sc-card {width}")


def _fact(title: str, mark: str) -> tuple[Any, Any]:
    """A card with one value and a note."""
    from nicegui import ui

    with ui.element("section").classes("sc-card"):
        ui.label(title).classes("sc-title")
        value = ui.label("–").classes("sc-value").props(f'data-fact="{mark}"')
        return value, ui.label().classes("sc-note").props(f'data-fact="{mark}-note"')


def _table(title: str, columns: Mapping[str, str], *, key: str = "") -> _Table:
    """A table with columns (key of the row -> title)."""
    from nicegui import ui

    heads = [{"name": name, "label": label, "field": name, "align": "left"} for name, label in columns.items()]
    with _card(f"sc-12 {_HIDDEN}") as card:
        head = ui.label(title).classes("sc-title")
        table = ui.table(columns=heads, rows=[], row_key=key or next(iter(columns)), pagination=PAGE).props(
            "flat dense hide-bottom"
        )
    return _Table(card, head, table)


def _draw(chart: Any, options: dict[str, Any]) -> None:
    chart.options.clear()
    chart.options.update(options)
    chart.update()


def _show(element: Any, shown: bool) -> None:
    if shown:
        element.classes(remove=_HIDDEN)
    else:
        element.classes(add=_HIDDEN)


@dataclass(frozen=True)
class ShownFigure:
    """A figure by its address on the page, and what is said of it."""

    address: str
    caption: str


class FigurePanel:
    """The elements in the card: every figure with its caption, and a link to it alone; a note beneath."""

    def __init__(self, card: Any, title: str) -> None:
        from nicegui import ui

        self._card, self._shown = card, list[ShownFigure]()
        ui.label(title).classes("sc-title")
        self._figures = ui.element("div").classes("sc-figures")
        self._note = ui.label().classes("sc-note")

    def show(self, figures: Sequence[ShownFigure], note: str = "") -> None:
        """Show these figures and the note; nothing is loaded again that is shown already."""
        from nicegui import ui

        self._note.set_text(note)
        self._card.classes(**{"remove" if figures or note else "add": "sc-hidden"})
        if list(figures) == self._shown:
            return
        self._shown = list(figures)
        self._figures.clear()
        with self._figures:
            for one in figures:
                with ui.element("a") as link, ui.element("figure"):
                    link.props["href"], link.props["target"] = one.address, "_blank"
                    picture = ui.element("img")
                    picture.props["src"], picture.props["alt"], picture.props["loading"] = (
                        one.address,
                        one.caption,
                        "lazy",
                    )
                    with ui.element("figcaption"):
                        ui.label(one.caption)


def of_report(figures: Sequence[DrawnFigure]) -> list[ShownFigure]:
    """The figures that a report has drawn; with the time of each, so that one that was drawn anew is loaded again."""
    return [ShownFigure(f"figures/{quote(one.name, safe='')}?drawn={one.changed}", one.title) for one in figures]


def of_fits(pictures: Sequence[FitPicture]) -> list[ShownFigure]:
    """The figures of the fit at the best trial."""
    return [ShownFigure(f"fit/{one.name}.png", one.caption) for one in pictures]
