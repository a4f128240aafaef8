"""A figure of the report: its name, its section of the page, and the function that draws it from the content."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeVar

from softcal.catalogue import Catalogue, FunctionMember
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, unknown
from softcal.report.content import ReportContent
from softcal.report.format import file_stem
from softcal.report.section import LAST, OVERVIEW, SECTIONS
from softcal.report.style import encode

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@displayed
@dataclass(frozen=True)
class Drawing:
    """One drawing of a figure of the report, with its caption.

    Attributes
    ----------
    figure : matplotlib.figure.Figure
        The drawing.
    caption : str
        Sentences beneath it.
    of : str
        Where there are several drawings: what this one is of, such as a calibration; it ends the file's name.
    shown : {"svg", "png"}
        The format in the page; a rendered scene is a PNG.
    note : str
        An emphasised remark on how it was drawn, or "".
    section : str or None
        Its section of the page, if not that of its figure.
    title : str
        What it shows, in a few words, for lists of figures; by default that of its first axes.
    """

    figure: Figure
    caption: str
    of: str = ""
    shown: Literal["png", "svg"] = "svg"
    note: str = ""
    section: str | None = None
    title: str = ""

    @property
    def heading(self) -> str:
        """Its title in one line; "" where its axes have none either."""
        own = [axes.get_title(loc) for axes in self.figure.axes[:1] for loc in ("left", "center")]
        return " ".join(next((text for text in (self.title, *own) if text), "").split())


@dataclass(frozen=True)
class Picture:
    """A drawing as files: file stem, section of the page, caption, bytes as PNG and SVG; see `Drawing`."""

    name: str
    section: str
    caption: str
    png: bytes
    svg: bytes
    shown: Literal["png", "svg"] = "svg"
    note: str = ""


@dataclass(frozen=True)
class ReportFigure(FunctionMember):
    """A figure that a report can have.

    Attributes
    ----------
    name : str
        That of the function, with hyphens.
    function : callable
        From the report's content to drawings; none where the content lacks what the figure needs.
    section : str
        Its section of the page.
    place : int
        Its place among the figures of its section, from the lowest to the highest.
    """

    section: str
    place: int = LAST

    def pictures(self, content: ReportContent) -> Iterator[Picture]:
        """Every drawing, as files."""
        for one in self.function(content):
            stem = f"{self.name}-{file_stem(one.of)}" if one.of else self.name
            files = encode(one.figure, one.heading)
            yield Picture(stem, one.section or self.section, one.caption, *files, one.shown, one.note)


def _faults(figure: ReportFigure, _: Mapping[str, ReportFigure]) -> list[Fault]:
    """Faults of a figure that is to be registered."""
    if not isinstance(figure, ReportFigure):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        allowed = "what softcal.register_figure returns for a function"
        return [Fault("this is not a figure", "figure", repr(figure)[:60], allowed)]
    where, sections = f"figure {figure.name}", (OVERVIEW, *SECTIONS)
    faults = [] if figure.summary else [Fault("the figure has no description", where, attempt="a docstring")]
    if figure.section not in sections:
        faults.append(unknown("the report has no such section", where, figure.section, sections))
    return faults


FIGURES: Catalogue[ReportFigure] = Catalogue(
    "figure",
    "softcal.figures",
    _faults,
    home="softcal.report.figures",
)

F = TypeVar("F", bound=Callable[[ReportContent], Iterable[Drawing]])


@checked_arguments
def register_figure(section: str, place: int = LAST) -> Callable[[F], F]:
    """Add a figure: reports and `softcal report --figures` then accept its name.

    A package does the same for every process by an entry point of the group `softcal.figures` that names the function.

    Parameters
    ----------
    section
        Its section of the page: overview, compared, twin, fit, record, bench, parameters, mesh, search, or one that
        `softcal.register_section` added.
    place
        Its place among the figures of the section, from the lowest to the highest; softcal's own have 1 to 3.

    Returns
    -------
    callable
        The decorator of the function, which stays as it is: from a `ReportContent` to any number of `Drawing`, none
        where the content lacks what it needs. Its name, with hyphens, is the figure's; its docstring says what it
        shows.

    Raises
    ------
    InputError
        Where it is written without its brackets.
    ParameterError
        Where another figure has the name, there is no such section, or the function says nowhere what it shows.
    """
    return FIGURES.decorator(
        lambda function: ReportFigure(function.__name__.replace("_", "-"), function, section, place)
    )


def named_figures(names: Collection[str]) -> list[ReportFigure]:
    """The figures of these names, or all of them where there are none, in the order of the page.

    Raises
    ------
    ParameterError
        For names without a figure; all at once.
    """
    faults = [FIGURES.unknown(name, "figures") for name in names if name not in FIGURES]
    if faults:
        raise ParameterError(faults)
    return sorted((FIGURES[name] for name in FIGURES if name in names or not names), key=lambda figure: figure.place)


def report_pictures(
    content: ReportContent,
    figures: Collection[str] = (),
    begin: Callable[[str, int], None] = lambda name, done: None,
) -> list[Picture]:
    """Draw the figures for which the content has data.

    Parameters
    ----------
    content
        What the report shows.
    figures
        Names of the figures; by default all.
    begin
        Called before each figure with its name and its number, from 0.
    """
    pictures: list[Picture] = []
    for done, figure in enumerate(named_figures(figures)):
        begin(figure.name, done)
        pictures += figure.pictures(content)
    return pictures
