"""A section of a report's page: its title, and what it shows in order: figures, tables, remarks, text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from softcal.calibration.statistics.estimate import Remark
from softcal.catalogue import Catalogue, FunctionMember
from softcal.declare import Checked, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault
from softcal.report.content import ReportContent
from softcal.report.tables import ReportTable, all_parameters_table, parameters_table, provenance_table
from softcal.report.twin_view import TwinFrame

OVERVIEW = "overview"  # where figures of the first screen are, which is no section
LAST = 100  # of the sections and of the figures of one: what is registered from outside


@displayed
@dataclass(frozen=True)
class Gallery(Checked):
    """The figures of the section, beneath each other where `wide`, else beside each other."""

    wide: bool = False
    kind: ClassVar[str] = "gallery"


@displayed
@dataclass(frozen=True)
class Small(Checked):
    """A paragraph of small print; alone: whether a section is shown for it, without anything else."""

    text: str
    alone: bool = False
    kind: ClassVar[str] = "small"


@dataclass(frozen=True)
class Heading:
    """The title of the section, where it depends on the content."""

    text: str
    kind: ClassVar[str] = "heading"


@dataclass(frozen=True)
class FoldedTable:
    """A table behind its title."""

    table: ReportTable
    kind: ClassVar[str] = "folded table"


@dataclass(frozen=True)
class FoldedSteps:
    """Steps behind a title: what was done, its settings, and its outcome."""

    title: str
    steps: Sequence[tuple[str, str, str]]
    kind: ClassVar[str] = "folded steps"


Block = str | Remark | ReportTable | Gallery | Small | Heading | FoldedTable | FoldedSteps | TwinFrame
Function = Callable[[ReportContent], Iterable[Block]]


@displayed
@dataclass(frozen=True)
class ReportSection(FunctionMember):
    """A section that a report can have.

    Attributes
    ----------
    name : str
        That of the function, with hyphens; figures name it.
    function : callable
        From the report's content to what it shows, in order.
    title : str
        Its heading.
    place : int
        Its place on the page, from the lowest to the highest.
    """

    title: str
    place: int = LAST

    def tables(self, content: ReportContent) -> list[ReportTable]:
        """The tables of the section."""
        blocks = (block.table if isinstance(block, FoldedTable) else block for block in self.function(content))
        return [block for block in blocks if isinstance(block, ReportTable)]


def _faults(section: ReportSection, _: Mapping[str, ReportSection]) -> list[Fault]:
    """Faults of a section that is to be registered."""
    if not isinstance(section, ReportSection):  # pyright: ignore[reportUnnecessaryIsInstance] (an entry point may be anything)
        allowed = "what softcal.register_section returns for a function"
        return [Fault("this is not a section", "section", repr(section)[:60], allowed)]
    where = f"section {section.name}"
    faults = [] if section.title.strip() else [Fault("the section has no title", where)]
    if section.name == OVERVIEW:
        faults.append(Fault("the first screen of a report is no section", where, attempt="another name"))
    return faults


SECTIONS: Catalogue[ReportSection] = Catalogue("section", "softcal.sections", _faults, home="softcal.report.sections")

F = TypeVar("F", bound=Function)


@checked_arguments
def register_section(title: str, place: int = LAST) -> Callable[[F], F]:
    """Add a section: reports then show it, with the figures that name it, where it has anything to show.

    A package does the same for every process by an entry point of the group `softcal.sections` that names the function.

    Parameters
    ----------
    title
        Its heading.
    place
        Its place on the page, from the lowest to the highest; softcal's own have 10 to 90, and the run 110.

    Returns
    -------
    callable
        The decorator of the function, which stays as it is: from a `ReportContent` to any number of paragraphs (text),
        `Small` print, `Remark`, `ReportTable` and `Gallery`. Its name, with hyphens, is the section's.

    Raises
    ------
    InputError
        Where it is written without its brackets.
    ParameterError
        Where another section has the name, or it has no title.
    """
    return SECTIONS.decorator(
        lambda function: ReportSection(function.__name__.replace("_", "-"), function, title, place)
    )


def all_tables(content: ReportContent) -> dict[str, ReportTable]:
    """Every table of the report by key."""
    tables = [table for section in SECTIONS.values() for table in section.tables(content)]
    others = (parameters_table(content), all_parameters_table(content), provenance_table(content))
    return {table.key: table for table in (*tables, *others)}


@dataclass(frozen=True)
class ShownSection:
    """A section of the page, with those blocks that show anything; remarks that follow each other are one list."""

    name: str
    title: str
    blocks: tuple[Block | list[Remark], ...]


def shown_sections(content: ReportContent, illustrated: Iterable[str]) -> list[ShownSection]:
    """The sections that have anything to show, in order.

    Parameters
    ----------
    content
        What the report shows.
    illustrated
        Names of the sections that have figures.
    """
    sections: list[ShownSection] = []
    for section in sorted(SECTIONS.values(), key=lambda one: one.place):
        title, blocks, counts = section.title, list[Block | list[Remark]](), False
        for block in section.function(content):
            if isinstance(block, Heading):
                title = block.text
                continue
            if isinstance(block, Gallery) and section.name not in illustrated:
                continue
            if isinstance(block, ReportTable) and not block.rows:
                continue
            counts = counts or not isinstance(block, Small) or block.alone
            if isinstance(block, Remark) and blocks and isinstance(blocks[-1], list):
                blocks[-1].append(block)
            else:
                blocks.append([block] if isinstance(block, Remark) else block)
        if counts:
            sections.append(ShownSection(section.name, title, tuple(blocks)))
    return sections
