"""Pages of the site that are read from elsewhere: from the code (public names, commands, keys of the project file,
families), and those of the repository that are not in docs.

python -m scripts.reference FOLDER
"""

from __future__ import annotations

import collections.abc
import functools
import inspect
import json
import os
import re
import sys
import types
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from ruamel.yaml import YAML
from typer.testing import CliRunner

import softcal
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.problem.rig import CommonRig
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.catalogue import Catalogue
from softcal.cli import app
from softcal.cli.command import COMMANDS, PARTS
from softcal.executors.executor import EXECUTORS
from softcal.experiments.step import STEPS
from softcal.export.engine import ENGINES
from softcal.geometry.primitives import Primitive
from softcal.geometry.shape import DrawnShape
from softcal.materials.catalogue import LAWS
from softcal.materials.infill import PrintInfill
from softcal.materials.law import Law
from softcal.project.bench_schema import ExperimentSection
from softcal.project.calibration_schema import CalibrationSection, ParameterSection, SweepSection, UncertainSection
from softcal.project.candidate_schema import CandidateSection
from softcal.project.constants import ConstantsSection
from softcal.project.law_schema import OwnLawSection
from softcal.project.mesh_schema import PRIMITIVES
from softcal.project.robot_schema import RobotSection
from softcal.project.section import Section
from softcal.quantities import Quantity
from softcal.report.figure import FIGURES
from softcal.report.section import SECTIONS
from softcal.sensing.sensor import SENSORS
from softcal.twin.actuated import ACTUATORS, Actuator
from softcal.twin.time_settings import TimeSettings
from softcal.workflows.export import EXPORTS

NEW = "Written by `make docs` from the code: change it there."
# Section of the file -> what describes one entry of it.
FILE: Mapping[str, type] = {
    "laws.NAME": OwnLawSection,
    "robot": RobotSection,
    "rig": CommonRig,
    "experiments.NAME": ExperimentSection,
    "parameters.NAME": ParameterSection,
    "uncertain.NAME": UncertainSection,
    "calibration": CalibrationSection,
    "candidates.NAME": CandidateSection,
    "sweep": SweepSection,
    "dynamics": TimeSettings,
    **{f"engines.{name}": engine.settings for name, engine in sorted(ENGINES.items()) if engine.settings is not None},
    "print": PrintInfill,
}
FAMILIES: Mapping[str, tuple[Catalogue[Any], str]] = {
    "Elastic laws": (LAWS, "`law:` of a body or rod; `softcal.register_law`."),
    "Losses": (LOSSES, "`calibration.loss`; `softcal.register_loss`."),
    "Methods of the search": (OPTIMISERS, "`calibration.method`; `softcal.register_optimiser`."),
    "Actuators": (ACTUATORS, "`robot.actuators`; `softcal.register_actuator`."),
    "Sensors": (SENSORS, "`robot.sensors`; `softcal.register_sensor`."),
    "Preparation of data": (STEPS, "`experiments.NAME.prepare`; `softcal.register_step`."),
    "Engines": (ENGINES, "`--engine`; `softcal.register_engine`."),
    "Exports": (EXPORTS, "`softcal export KIND`; `softcal.register_export`."),
    "Executors": (EXECUTORS, "`--on`; `softcal.register_executor`."),
    "Figures of the report": (FIGURES, "`softcal.register_figure`."),
    "Sections of the report": (SECTIONS, "`softcal.register_section`."),
}
KEYS = Path(__file__).with_name("keys.yaml")  # examples of the keys that no example of softcal has
MEANINGS = Path(__file__).with_name("meanings.yaml")  # of the keys that no docstring describes
# Field -> section that has no such key in the file, but one for each name in it.
BY_NAME: Mapping[str, type] = {"constants": ConstantsSection, "options": CalibrationSection}
ROOT = Path(__file__).resolve().parents[1]
DOCS, GALLERY = ROOT / "docs", ROOT / "gallery"
EXAMPLES = ("beam", "bellows", "finger", "fleet", "manipulator", "neck", "neck-bench", "pneumatic-arm", "pneunet")
# File of the repository -> its page of the site.
OUTSIDE: Mapping[Path, Path] = {
    ROOT / "README.md": DOCS / "reference" / "readme.md",
    ROOT / "CHANGELOG.md": DOCS / "reference" / "changes.md",
    ROOT / "CONTRIBUTING.md": DOCS / "reference" / "contributing.md",
    ROOT / "SECURITY.md": DOCS / "reference" / "reports-of-holes.md",
    ROOT / "VISION.md": DOCS / "reference" / "scope.md",
    ROOT / "benchmarks" / "RESULTS.md": DOCS / "reference" / "times.md",
    ROOT / "benchmarks" / "ROBUSTNESS.md": DOCS / "reference" / "robustness.md",
    ROOT / "benchmarks" / "SOFA.md": DOCS / "reference" / "sofa-times.md",
    **{ROOT / "examples" / name / "README.md": DOCS / "reference" / f"example-{name}.md" for name in EXAMPLES},
}


def write_reference(folder: Path) -> None:
    """Write the pages into a folder, which is made; a page that would not change is not touched."""
    folder.mkdir(exist_ok=True)
    pages = {"names.rst": names(), "commands.md": commands(), "keys.md": keys(), "families.md": families()}
    pages |= {page.name: linked(path.read_text(encoding="utf-8"), path, page) for path, page in OUTSIDE.items()}
    for name, text in pages.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def linked(text: str, source: Path, page: Path) -> str:
    """The text of a file as that of a page elsewhere, its links to other files of the repository with it."""

    def moved(match: re.Match[str]) -> str:
        at, anchor = match[2], match[3] or ""
        if re.match(r"[a-z]+:", at) or not (path := (source.parent / at).resolve()).exists():
            return match[0]
        if path.is_relative_to(GALLERY):
            path = DOCS / "gallery" / path.relative_to(GALLERY) / ("index.rst" if path.is_dir() else "")
            path = path.with_suffix(".rst")
        path = OUTSIDE.get(path / "README.md" if path.is_dir() else path, path)
        return f"{match[1]}{os.path.relpath(path, page.parent)}{anchor})"

    title = "" if re.search(r"^# ", text, re.MULTILINE) else f"# {page.stem.capitalize()}\n\n"
    return title + re.sub(r"(\]\()([^)#\s]+)(#[^)\s]*)?\)", moved, text)


def names() -> str:
    """All public names, each with a page of its docstring."""
    rows = "\n".join(f"   {name}" for name in dir(softcal))
    head = f".. {NEW}\n\nPublic names\n============\n\nAll are imported from ``softcal``.\n\n"
    return head + f".. currentmodule:: softcal\n\n.. autosummary::\n   :toctree: generated\n\n{rows}\n"


def commands() -> str:
    """Every command with its arguments and options, as its help has them."""
    parts = [f"<!-- {NEW} -->\n# Commands\n"]
    for part in PARTS:
        parts.append(f"## {part.capitalize()}\n")
        for name in sorted(name for name, one in COMMANDS.items() if one.part == part):
            parts += _help(name, COMMANDS[name].built())
    return "\n".join(parts)


def _help(path: str, command: Any) -> Iterator[str]:
    """The help of a command, or of each command of a group."""
    inner = getattr(command, "commands", {})
    if not inner:
        told = CliRunner(env={"COLUMNS": "110", "TERMINAL_WIDTH": "110"}).invoke(app, [*path.split(), "--help"])
        yield f"### `softcal {path}`\n\n```text\n{told.output.strip()}\n```\n"
    for name in sorted(inner):
        yield from _help(f"{path} {name}", inner[name])


def keys() -> str:
    """Every key of the project file by its section: its kind, its range, its default and its meaning."""
    parts = [
        f"<!-- {NEW} -->\n# Keys of the project file\n",
        "At the top of the file are `softcal: 1`, the version of the format, `name: …`, a title, and these sections.",
        "How the sections work together, with examples, is in [the project file](../project-file.md).",
        "`NAME` is a name of your own. A number has its unit, `2.3 MPa`; the unit of a range is that in the table.\n",
    ]
    done: set[type] = set()
    for path, kind in FILE.items():
        parts += [f"## `{path}`\n", *_mapping(path, kind, done)]
    return "\n".join(parts)


def _mapping(path: str, kind: type, done: set[type]) -> Iterator[str]:
    """The table of a mapping's keys, and those of the mappings in it that were not described before."""
    done.add(kind)
    yield f"{_summary(kind)}\n"
    inner = dict[type, str]()
    rows = ["| key | kind | default | example | meaning |\n|---|---|---|---|---|"]
    for name, annotation, default in entries(kind):
        below = mappings(annotation)
        for mapping in below:
            inner.setdefault(mapping, f"{path}.{name}{_names(annotation)}")
        links = ", ".join(f"[{_title(one)}](#{_title(one).lower()})" for one in below)
        shown = links or _cell(f"`{example(kind, name)}`")
        cells = (f"`{name}`", _cell(kind_text(annotation)), default, shown, _cell(meanings()[kind, name]))
        rows.append(f"| {' | '.join(cells)} |")
    yield "\n".join(rows) + "\n"
    if issubclass(kind, ConstantsSection):
        yield "Each constant of its law is a key, too: `youngs_modulus: 2.3 MPa` ([laws](families.md#elastic-laws)).\n"
    if kind is CalibrationSection:
        yield "Each option of a method or loss is a key, too: `starts: 5` ([families](families.md#losses)).\n"
    for mapping, at in inner.items():
        if mapping not in done:
            named = {"primitive": PRIMITIVES, "actuator": ACTUATORS}
            each = ((key, name) for key, family in named.items() for name, one in family.items() if one is mapping)
            member = next((f" with `{key}: {name}`" for key, name in each), "")
            yield f"### {_title(mapping)}\n\n`{at}`{member}\n"
            yield from _mapping(at, mapping, done)


def _title(kind: type) -> str:
    return kind.__name__.removesuffix("Section")


@functools.cache
def meanings() -> dict[tuple[type, str], str]:
    """Class of a mapping and key -> its meaning: of a docstring, or of `MEANINGS`."""
    told = {kind.__name__: attributes(kind) for kind in described()}
    for name, values in YAML(typ="safe").load(MEANINGS).items():
        told[name] = values | told[name]
    return {(kind, key): text for kind in described() for key, text in told[kind.__name__].items()}


@functools.cache
def examples() -> dict[tuple[type, str], Any]:
    """Class of a mapping and key -> a value as it is written: of the first example that has it, or of `KEYS`."""
    yaml, written = YAML(typ="safe"), dict[tuple[type, str], Any]()

    def take(annotation: Any, value: Any) -> None:
        origin, args = get_origin(annotation), get_args(annotation)
        if origin in (collections.abc.Mapping, dict) and isinstance(value, dict):
            for one in value.values():
                take(args[1], one)
        elif origin in (list, tuple, collections.abc.Sequence):
            for one in value if isinstance(value, list) else []:
                for kind in args:
                    take(kind, one)
        elif args:
            for kind in args:
                take(kind, value)
        elif isinstance(value, dict) and mappings(annotation):
            for own in mappings(annotation) if annotation is Actuator else [annotation]:
                for name, inner, _ in entries(own):
                    if name in value:
                        written.setdefault((own, name), value[name])
                        take(inner, value[name])

    for path in sorted(ROOT.glob("examples/*/*.yaml")):
        document = yaml.load(path)
        for section, kind in FILE.items():
            top, _, name = section.partition(".")
            inside = document.get(top, {})
            for key in [name] if name in inside else inside if name == "NAME" else []:
                take(kind, inside[key])
            if not name:
                take(kind, inside)
    of_class = {kind.__name__: kind for kind in described()}
    for name, values in yaml.load(KEYS).items():
        written = {(of_class[name], key): value for key, value in values.items()} | written
    return written


def described() -> list[type]:
    """The class of every mapping of the project file."""
    found: dict[type, None] = {}

    def add(kind: type) -> None:
        if kind not in found:
            found[kind] = None
            for _, annotation, _ in entries(kind):
                for inner in mappings(annotation):
                    add(inner)

    for kind in FILE.values():
        add(kind)
    return list(found)


def example(kind: type, name: str) -> str:
    """A key with a value, as a line of the file."""
    value = examples()[kind, name]
    text = json.dumps(value, ensure_ascii=False).replace('"', "") if isinstance(value, (dict, list, bool)) else value
    return f"{name}: {text}"


def entries(kind: type) -> Iterator[tuple[str, Any, str]]:
    """The keys of a mapping with their annotations and defaults."""
    hints = get_type_hints(kind, include_extras=True)
    if not is_dataclass(kind):
        for name, info in kind.model_fields.items():
            default = "" if info.is_required() else "empty" if info.default_factory else _value(info.default)
            if issubclass(kind, BY_NAME.get(name, ())):
                continue
            yield info.alias or name, hints[name], "required" if info.is_required() else default
    else:
        for one in fields(kind):
            is_required = one.default is MISSING and one.default_factory is MISSING
            default = "required" if is_required else "" if one.default is MISSING else _value(one.default)
            if one.init:
                yield one.name, hints[one.name], default


def kind_text(annotation: Any) -> str:
    """What may stand at a key, in words."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        quantity = next((one for one in annotation.__metadata__ if isinstance(one, Quantity)), None)
        return kind_text(args[0]) if quantity is None else f"{quantity.name}, {quantity.allowed}"
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(kind_text(one) for one in args if one is not type(None)))
    if origin is Literal:
        return ", ".join(f"`{one}`" for one in args)
    if origin in (collections.abc.Mapping, dict):
        return f"by name: {kind_text(args[1])}"
    if origin in (list, tuple, collections.abc.Sequence):
        each = dict.fromkeys(kind_text(one) for one in args if one is not Ellipsis)
        n = "" if Ellipsis in args or origin is not tuple else f"{len(args)} times "
        return f"list of {n}{' or '.join(each)}"
    names_of: dict[Any, str] = {
        str: "text",
        float: "number",
        int: "whole number",
        bool: "`true` or `false`",
        object: "any",
        np.ndarray: "list of numbers",
        DrawnShape: "`drawn`",
    }
    plain = origin or annotation
    return names_of[plain] if plain in names_of else _title(plain)


def mappings(annotation: Any) -> list[type]:
    """The classes of mappings in an annotation; of primitives and actuators, those that a file can name."""
    if annotation is Primitive:
        return list(PRIMITIVES.values())
    if annotation is Actuator:
        return list(ACTUATORS.values())
    if inspect.isclass(annotation) and (issubclass(annotation, Section) or is_dataclass(annotation)):
        return [] if annotation in (Quantity, DrawnShape) else [annotation]  # a file has `drawn`, without keys
    inner = get_args(annotation)[:1] if get_origin(annotation) is Annotated else get_args(annotation)
    return [mapping for one in inner for mapping in mappings(one)]


def _names(annotation: Any) -> str:
    inner = get_args(annotation) if get_origin(annotation) is Annotated else (annotation,)
    return ".NAME" if any(get_origin(one) is collections.abc.Mapping for one in inner) else ""


def families() -> str:
    """The members of every family that can be extended."""
    parts = [
        f"<!-- {NEW} -->\n# Families\n",
        "A member is added by one decorated function or class, or by an entry point of a package of your own",
        "([how](../architecture.md)).\n",
    ]
    for title, (catalogue, use) in FAMILIES.items():
        rows = [f"| `{name}` | {_cell(_about(one))} |" for name, one in sorted(catalogue.items())]
        parts.append(f"## {title}\n\n{use}\n\n| name | meaning |\n|---|---|\n" + "\n".join(rows) + "\n")
    return "\n".join(parts)


def _about(member: Any) -> str:
    if isinstance(member, Law):
        return f"`{member.distortional}` ({member.reference})"
    told = getattr(member, "summary", None) or getattr(member, "description", None)
    return told if isinstance(told, str) else _summary(member if inspect.isclass(member) else type(member))


def _summary(kind: Any) -> str:
    """The text of a docstring before its sections."""
    text = inspect.getdoc(kind) or ""
    return re.split(r"\n\n?[A-Z][a-z]+\n-{3,}", text)[0].strip()


def attributes(kind: type) -> dict[str, str]:
    """Attribute -> what the docstrings of a class and its bases say, in words, of this one alone."""
    about: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        text = inspect.cleandoc(base.__doc__ or "").partition("Attributes\n----------\n")[2].partition("\n\n")[0]
        for name, told in re.findall(r"^(\w+)(?: : |\n {4})(.+(?:\n {4}.+)*)", text, re.MULTILINE):
            if re.search("[a-z]{3}", re.sub(r"\[.*?\]", "", told)):
                about[name] = " ".join(told.replace("None:", "without it,").split()).rstrip(".")
    return about


def _value(default: Any) -> str:
    if default is None or default == () or (hasattr(default, "__len__") and not len(default)):
        return ""
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, float):
        return f"`{default:g}`"
    return f"`{default}`" if isinstance(default, (str, int)) else ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    write_reference(Path(sys.argv[1]))
