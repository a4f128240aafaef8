"""What a benchmark found: a table, goals with what was measured, and notes; as JSON between processes, as Markdown."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Goal:
    """A goal, what was measured against it, and the limit that measured must not exceed."""

    what: str
    measured: float
    limit: float
    unit: str = ""

    @property
    def met(self) -> bool:
        return self.measured <= self.limit


@dataclass(frozen=True)
class Section:
    """One table of RESULTS.md."""

    title: str
    header: list[str]
    rows: list[list[str]]
    goals: list[Goal] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Section:
        held: dict[str, Any] = json.loads(text)
        held["goals"] = [Goal(**goal) for goal in held["goals"]]
        return cls(**held)

    def markdown(self) -> str:
        """Heading, table where anything was measured, notes."""
        lines = [f"## {self.title}", ""]
        if self.rows:
            lines += [*table(self.header, self.rows), ""]
        for note in self.notes:
            lines += [note, ""]
        return "\n".join(lines)


def table(header: list[str], rows: list[list[str]]) -> list[str]:
    """A Markdown table."""
    cells = [header, ["---"] * len(header), *rows]
    return ["| " + " | ".join(row) + " |" for row in cells]


def run_alone(measure: Callable[..., Section], **numbers: int) -> None:
    """The main of a benchmark: JSON for `benchmarks.run`, else Markdown.

    numbers: further options of whole numbers by name, with their defaults, which `measure` takes as keywords.
    """
    parser = argparse.ArgumentParser(description=sys.modules["__main__"].__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repetitions: to try it, not to quote it")
    parser.add_argument("--json", action="store_true", help="what benchmarks.run reads")
    for name, default in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    arguments = parser.parse_args()
    section = measure(arguments.quick, **{name: getattr(arguments, name) for name in numbers})
    print(section.to_json() if arguments.json else section.markdown())
    if not arguments.json:
        for goal in section.goals:
            verdict = "met" if goal.met else "MISSED"
            print(f"{goal.what}: {goal.measured:.4g} {goal.unit} (<= {goal.limit:g}) {verdict}")
