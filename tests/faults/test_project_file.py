"""Project files: whatever value stands at whatever key, `softcal check` refuses it in a sentence or accepts it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import pytest
import yaml
from faults.case import Case, assert_proper, parts
from project_case import PROJECT, write_project

# Values that no key, or hardly one, may have.
HOSTILE: dict[str, str] = {
    "null": "null",
    "an empty text": "''",
    "a number": "17",
    "a negative": "-1",
    "not a number": ".nan",
    "infinite": ".inf",
    "a digit too many": "9" * 5000,
    "a truth": "true",
    "a list": "[1, [2, [3]]]",
    "a section": "{a: {b: c}}",
    "another unit": "5 kg",
    "a line break": "'a\n\n  b'",
    "an unknown name": "nobody",
    "a path out": "../../../etc/passwd",
    "a device": "/dev/zero",
    "a file of the system": "/proc/version",
    "formula": "'=cmd()'",
    "a template": "'{{ 7 * 7 }} ${HOME} %s {0}'",
}


class Reader(yaml.SafeLoader):
    """As softcal reads: `on` is no truth."""

    yaml_implicit_resolvers: ClassVar = {
        first: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:bool" or first not in "oO"]
        for first, found in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


def read() -> dict[str, Any]:
    return yaml.load(PROJECT, Reader)


def places(node: object, where: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Every key and every entry of a list below a node of a file."""
    entries = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [place for key, value in entries for place in ((*where, key), *places(value, (*where, key)))]


EVERY = 5


def changed(place: tuple[str | int, ...], value: str) -> Callable[[Path], None]:
    """Writes the project with another value at a place."""

    def files(folder: Path) -> None:
        write_project(folder)
        data = read()
        node: Any = data
        for key in place[:-1]:
            node = node[key]
        node[place[-1]] = "\0value"
        text = yaml.safe_dump(data, sort_keys=False).replace('"\\0value"', value)
        (folder / "project.yaml").write_text(text, encoding="utf-8")

    return files


CASES = [
    Case(
        "project file",
        f"{what} at {'.'.join(map(str, place))}",
        ("check", "project.yaml", "--no-solve", "--no-pictures"),
        ("refused", "solved"),
        changed(place, value),
        r"project\.yaml:\d+|project\.yaml",
    )
    for k, place in enumerate(places(read()))
    for i, (what, value) in enumerate(HOSTILE.items())
    if (k + i) % EVERY == 0  # each place meets some, and each value meets all kinds of places
]


@pytest.mark.parametrize("case", parts(CASES))
def test_a_hostile_value(case: Case, tmp_path: Path) -> None:
    assert_proper(case, tmp_path)
