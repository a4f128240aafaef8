"""Print the licences of everything softcal needs at run time; exit 1 where one is not permitted.

Walks `[project.dependencies]`, the extras for pictures, markers and importance, and what those need in turn. Gmsh
(GPL), which the extra `mesh` brings, is run in a process of its own, and so never part of this tree.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

# MPL-2.0 and LGPL reach their own files or library only, so a program that merely uses them stays Apache-2.0.
PERMITTED = frozenset(
    "0BSD Apache-2.0 BSD-2-Clause BSD-3-Clause BSD CC0-1.0 HPND ISC LGPL MIT MIT-CMU MPL-2.0 PSF-2.0 Unlicense "
    "Zlib".split()
)
PERMITTED_EXCEPTIONS = frozenset(["LLVM-exception"])

# Not open source, but free to use and redistribute; each with the reason why it is here.
INTEL = "redistributable Intel run time of pypardiso; SuperLU takes its place where it is not installed"
ACCEPTED = {name: INTEL for name in ("mkl", "tbb", "tcmlib", "intel-openmp", "intel-cmplr-lib-ur", "umf")}

# For packages whose metadata says it in free text: what to read there, and the identifier it stands for.
SPELLINGS = (
    (r"\bAGPL|Affero", "AGPL"),
    (r"\bLGPL|Lesser General Public|Library General Public", "LGPL"),
    (r"\bGPL|GNU General Public", "GPL"),
    (r"Apache", "Apache-2.0"),
    (r"\bMPL|Mozilla Public", "MPL-2.0"),
    (r"\bISC\b", "ISC"),
    (r"\bMIT\b", "MIT"),
    (r"BSD", "BSD"),
    (r"Python Software Foundation|\bPSF", "PSF-2.0"),
    (r"HPND|Historical Permission", "HPND"),
    (r"Unlicense", "Unlicense"),
)

SOFTCAL = "softcal[pictures,markers,importance]"


@dataclass(frozen=True)
class Verdict:
    """What one package says of itself, and whether softcal may need it at run time."""

    name: str
    version: str
    licence: str
    permitted: bool
    reason: str = ""


def runtime_tree(root: str) -> dict[str, Distribution]:
    """As `needed_by`, without `root` itself."""
    found = needed_by(root)
    del found[canonicalize_name(Requirement(root).name)]
    return found


def needed_by(*roots: str) -> dict[str, Distribution]:
    """Installed distributions that requirements name and need, by canonical name; of extras those that they name.

    Raises
    ------
    PackageNotFoundError
        Where a needed package is not installed: what cannot be read cannot be checked.
    """
    found: dict[str, Distribution] = {}
    seen: set[tuple[str, str]] = set()
    waiting = [*map(Requirement, roots)]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        package = distribution(requirement.name)
        found[name] = package
        for extra in ("", *requirement.extras):
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            for needed in map(Requirement, package.requires or ()):
                if needed.marker is None or needed.marker.evaluate({"extra": extra}):
                    waiting.append(needed)
    return dict(sorted(found.items()))


def licence_of(package: Distribution) -> str:
    """An SPDX expression as far as the metadata goes: its expression, else its classifiers, else its free text, else
    the title of the licence file that it ships.
    """
    metadata = package.metadata
    if expression := metadata.get("License-Expression"):
        return expression
    classifiers = [
        line.removeprefix("License ::")
        for line in metadata.get_all("Classifier") or ()
        if line.startswith("License ::")
    ]
    open_source = [line for line in classifiers if "OSI Approved ::" in line]
    if open_source:
        # Several classifiers may mean "and" as well as "or": read the stricter.
        return " AND ".join(sorted({_identifier(line) for line in open_source}))
    text = (metadata.get("License") or "").strip()
    if is_expression(text):
        return text
    told = text.split("\n", 1)[0] if text else "; ".join(classifiers).replace("License ::", "")
    return _identifier(told or _title_of_file(package))


def _title_of_file(package: Distribution) -> str:
    files = [file for file in package.files or () if ".dist-info/licenses/" in str(file)]
    lines = [line.strip() for file in files for line in file.read_text().splitlines()[:3]]
    return next((line for line in lines if line), "")


def is_expression(text: str) -> bool:
    """Whether text consists of licence identifiers that are known, joined by AND, OR and WITH."""
    words = re.findall(r"[\w.+-]+", text)
    known = PERMITTED | PERMITTED_EXCEPTIONS | {"AND", "OR", "WITH"}
    return bool(words) and all(word in known for word in words)


def is_permitted(expression: str) -> bool:
    """Whether a licence expression leaves a permitted choice: of OR one side, of AND all sides."""
    tokens = re.findall(r"\(|\)|[\w.+-]+|\S", expression)
    position = 0

    def peek() -> str:
        return tokens[position].upper() if position < len(tokens) else ""

    def take() -> str:
        nonlocal position
        position += 1
        return tokens[position - 1] if position <= len(tokens) else ""

    def choice() -> bool:
        value = conjunction()
        while peek() == "OR":
            take()
            value = conjunction() or value
        return value

    def conjunction() -> bool:
        value = single()
        while peek() == "AND":
            take()
            value = single() and value
        return value

    def single() -> bool:
        if peek() == "(":
            take()
            value = choice()
            return take() == ")" and value
        token = take()
        # Every version of the LGPL is taken alike.
        value = token in PERMITTED or re.fullmatch(r"LGPL-[\d.]+(-only|-or-later|\+)?", token) is not None
        if peek() == "WITH":
            take()
            value = (take() in PERMITTED_EXCEPTIONS) and value
        return value

    value = choice()
    return value and position == len(tokens)


def judge(package: Distribution) -> Verdict:
    """The verdict on one package; a licence that cannot be told is refused until someone has looked at it."""
    name, licence = canonicalize_name(package.name), licence_of(package)
    if is_permitted(licence):
        return Verdict(name, package.version, licence, True)
    return Verdict(name, package.version, licence, name in ACCEPTED, ACCEPTED.get(name, "not permitted"))


def main() -> int:
    try:
        tree = runtime_tree(SOFTCAL)
    except PackageNotFoundError as error:
        sys.stderr.write(f"{error.name} is needed at run time but not installed\n")
        return 2
    verdicts = [judge(package) for package in tree.values()]
    widths = [
        max(len(text) for text in column) for column in zip(*((v.name, v.version) for v in verdicts), strict=True)
    ]
    for v in verdicts:
        line = f"{'ok  ' if v.permitted else 'FAIL'} {v.name:<{widths[0]}}  {v.version:<{widths[1]}}  {v.licence}"
        sys.stdout.write(line + (f"  ({v.reason})" if v.reason else "") + "\n")
    refused = [v.name for v in verdicts if not v.permitted]
    if refused:
        sys.stderr.write(f"not permitted at run time: {', '.join(refused)}\n")
    return int(bool(refused))


def _identifier(text: str) -> str:
    for pattern, identifier in SPELLINGS:
        if re.search(pattern, text, re.IGNORECASE):
            return identifier
    return re.sub(r"\s+", " ", text).strip(" :") or "unknown"


if __name__ == "__main__":
    sys.exit(main())
