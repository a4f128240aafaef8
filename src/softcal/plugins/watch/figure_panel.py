"""Figures on the page, in a card that is hidden where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from softcal.plugins.watch.report_figures import DrawnFigure
from softcal.plugins.watch.twin import FitPicture


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
