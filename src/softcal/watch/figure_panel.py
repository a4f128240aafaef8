"""The figures of the report, in a card that is hidden where there are none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

from softcal.watch.report_figures import DrawnFigure


class FigurePanel:
    """The elements in the card: every figure with its title, and a link to it alone."""

    def __init__(self, card: Any) -> None:
        from nicegui import ui

        self._card, self._shown = card, ()
        ui.label("Figures of the report").classes("sc-title")
        self._figures = ui.element("div").classes("sc-figures")

    def show(self, figures: Sequence[DrawnFigure]) -> None:
        """Show these figures; nothing is done where they are shown already."""
        from nicegui import ui

        if figures == self._shown:
            return
        self._shown = figures
        self._figures.clear()
        with self._figures:
            for one in figures:
                # The time is of no use to the server; with it the browser asks again for a figure that was drawn anew.
                address = f"figures/{quote(one.name, safe='')}?drawn={one.changed}"
                with ui.element("a") as link, ui.element("figure"):
                    link.props["href"], link.props["target"] = address, "_blank"
                    picture = ui.element("img")
                    picture.props["src"], picture.props["alt"], picture.props["loading"] = address, one.title, "lazy"
                    with ui.element("figcaption"):
                        ui.label(one.title)
        self._card.classes(**{"remove" if figures else "add": "sc-hidden"})
