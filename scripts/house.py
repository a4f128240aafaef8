"""The size of the house: a table of its rooms, and the figures that tests/contracts/test_house.py holds.

python -m scripts.house [-v] [--draw docs/rooms.png]

`--draw` draws the rooms, upper layers above those that they import, each as wide as it has lines.
"""

from __future__ import annotations

import ast
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "softcal"
PLUGINS = "plugins"
SMALL = 60  # lines
# The picture: lines per inch, least width for each letter of a name and height of a room [in], colours of folders.
LINES_PER_INCH, PER_LETTER, HEIGHT = 1800.0, 0.07, 0.42
COLOURS = {f"{PLUGINS}/": "#fde68a", "calibration/": "#bfdbfe", "mechanics": "#bbf7d0", "twin": "#bbf7d0"}
ARGUMENTS = 3  # from so many on, a public function has a section `Parameters`; a command has its help by argument
COMMANDS = ("register_command", "exit_on_error")  # the decorators of commands


@dataclass(frozen=True)
class Module:
    """A file, parsed."""

    path: Path
    tree: ast.Module = field(repr=False)
    n_lines: int

    @property
    def room(self) -> str:
        """The folder below the package, of plugins with the plugin's own; "" at the root."""
        *folders, _ = self.path.relative_to(SOURCE).parts
        return "/".join(folders[: 2 if folders[:1] == [PLUGINS] else 1])

    @cached_property
    def nodes(self) -> Sequence[ast.AST]:
        return list(ast.walk(self.tree))

    @property
    def n_imports(self) -> int:
        """Lines of import statements, continued ones with all their lines."""
        nodes = (one for one in self.nodes if isinstance(one, (ast.Import, ast.ImportFrom)))
        return sum((one.end_lineno or one.lineno) - one.lineno + 1 for one in nodes)

    @cached_property
    def n_docstrings(self) -> int:
        """Lines of docstrings."""
        kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        bodies = (one.body[0] for one in self.nodes if isinstance(one, kinds) and ast.get_docstring(one))
        return sum((one.end_lineno or one.lineno) - one.lineno + 1 for one in bodies)

    @cached_property
    def n_code(self) -> int:
        """Lines that are neither blank nor comments alone, docstrings or imports."""
        beside = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
        lines: set[int] = set()
        with self.path.open("rb") as file:
            for token in tokenize.tokenize(file.readline):
                if token.type not in beside and token.type != tokenize.ENCODING:
                    lines.update(range(token.start[0], token.end[0] + 1))
        return len(lines) - self.n_imports - self.n_docstrings

    @cached_property
    def called_once(self) -> list[str]:
        """Private functions and methods without decorators that their own file names at one place alone."""
        helpers = [
            one.name
            for one in self.nodes
            if isinstance(one, (ast.FunctionDef, ast.AsyncFunctionDef))
            and one.name.startswith("_")
            and not one.name.endswith("__")
            and not one.decorator_list
        ]
        uses = Counter(
            one.id if isinstance(one, ast.Name) else one.attr
            for one in self.nodes
            if isinstance(one, (ast.Name, ast.Attribute))
        )
        return [name for name in helpers if uses[name] == 1]

    @cached_property
    def without_parameters(self) -> list[str]:
        """Public functions of public names with three arguments or more and no section `Parameters`, nor the same
        method of a base class one.
        """
        return [
            f"{self.path.relative_to(SOURCE)}: {name}"
            for name, one in _public(self.tree)
            if _is_short(one) and one.name not in _documented(name.rpartition(".")[0].rpartition(".")[2])
        ]


@cache
def _classes() -> dict[str, ast.ClassDef]:
    nodes = (one for module in house().modules for one in module.nodes)
    return {one.name: one for one in nodes if isinstance(one, ast.ClassDef)}


@cache
def _documented(name: str) -> frozenset[str]:
    """Methods of a class and of its bases that have a section `Parameters`."""
    if name not in _classes():
        return frozenset()
    one = _classes()[name]
    methods = (part for part in one.body if isinstance(part, ast.FunctionDef))
    own = {part.name for part in methods if "Parameters\n" in (ast.get_docstring(part) or "")}
    bases = (base.value if isinstance(base, ast.Subscript) else base for base in one.bases)
    return frozenset(own).union(*(_documented(base.id) for base in bases if isinstance(base, ast.Name)))


def _public(tree: ast.Module | ast.ClassDef, before: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    for one in tree.body:
        if isinstance(one, ast.ClassDef) and not one.name.startswith("_"):
            yield from _public(one, f"{one.name}.")
        elif isinstance(one, ast.FunctionDef) and not one.name.startswith("_"):
            yield before + one.name, one


def _is_short(function: ast.FunctionDef) -> bool:
    decorators = (one.func if isinstance(one, ast.Call) else one for one in function.decorator_list)
    if any(isinstance(one, ast.Name) and one.id in COMMANDS for one in decorators):
        return False
    arguments = function.args
    names = [one.arg for one in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]
    n = len([name for name in names if name not in ("self", "cls")])
    return n >= ARGUMENTS and "Parameters\n" not in (ast.get_docstring(function) or "")


@dataclass(frozen=True)
class House:
    """All files of the package."""

    modules: Sequence[Module]

    @property
    def n_lines(self) -> int:
        return sum(one.n_lines for one in self.modules)

    @property
    def core(self) -> House:
        """Without the plugins."""
        return House([one for one in self.modules if not one.room.startswith(PLUGINS)])

    @property
    def figures(self) -> dict[str, float]:
        """What is held, in words -> its value."""
        modules = self.modules
        return {
            "lines": self.n_lines,
            "lines of the core": self.core.n_lines,
            "private helpers called once": sum(len(one.called_once) for one in modules),
            f"files below {SMALL} lines": sum(one.n_lines < SMALL for one in modules),
            "share of imports [%]": round(100 * sum(one.n_imports for one in modules) / self.n_lines, 1),
            f"public functions of {ARGUMENTS} arguments without Parameters": sum(
                len(one.without_parameters) for one in modules
            ),
        }


@cache
def house() -> House:
    """The package as it stands."""
    paths = sorted(SOURCE.rglob("*.py"))
    texts = [path.read_text(encoding="utf-8") for path in paths]
    return House([Module(p, ast.parse(text), len(text.splitlines())) for p, text in zip(paths, texts, strict=True)])


def floors(of: House) -> dict[str, list[tuple[str, int]]]:
    """The layers of the linter's contracts from the top, each as rooms (name, lines); those of the calibration are
    floors of their own, "calibration/…", and the layers of single files at the root are one.
    """
    contracts = tomllib.loads((SOURCE.parents[1] / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = {one["containers"][0]: one["layers"] for one in contracts if "containers" in one}
    lines: Counter[str] = Counter()
    for one in of.modules:
        folders = one.path.relative_to(SOURCE).with_suffix("").parts
        lines.update({"/".join(folders[:depth]): one.n_lines for depth in range(1, len(folders) + 1)})
    rows: dict[str, list[tuple[str, int]]] = {}
    root = [one for one in of.modules if not one.room]
    for layer in layers["softcal"]:
        names = [name.strip() for name in layer.split("|")]
        if names == [PLUGINS]:
            names = sorted({one.room for one in of.modules if one.room.startswith(f"{PLUGINS}/")})
        if names == ["calibration"]:
            for inner in layers["softcal.calibration"]:
                rows[f"calibration: {inner}"] = [
                    (n := f"calibration/{one.strip()}", lines[n]) for one in inner.split("|")
                ]
        elif (SOURCE / names[0]).is_dir():
            rows[layer] = [(name, lines[name]) for name in names]
    return {**rows, "root": [(f"{len(root)} files at the root", sum(one.n_lines for one in root))]}


def draw(of: House, path: str) -> None:
    """Draw the rooms."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    rows = list(floors(of).items())
    widths = [[max(n / LINES_PER_INCH, PER_LETTER * len(name)) for name, n in rooms] for _, rooms in rows]
    wide, tall = max(map(sum, widths)), HEIGHT * len(rows)
    figure = Figure((wide + 0.1, tall + 0.1), dpi=150)
    axes = figure.add_axes((0, 0, 1, 1), xlim=(-0.05, wide + 0.05), ylim=(-0.05, tall + 0.05))
    axes.set_axis_off()
    for i, ((_, rooms), across) in enumerate(zip(rows, widths, strict=True)):
        x, y = 0.0, tall - HEIGHT * (i + 1)
        for (name, n), width in zip(rooms, across, strict=True):
            colour = next((c for folder, c in COLOURS.items() if name.startswith(folder)), "#e5e7eb")
            axes.add_patch(
                Rectangle((x, y), width - 0.04, HEIGHT - 0.05, facecolor=colour, edgecolor="#1f2937", lw=0.8)
            )
            middle = x + (width - 0.04) / 2, y + (HEIGHT - 0.05) / 2
            axes.text(*middle, f"{name}\n{n:,}", ha="center", va="center", fontsize=7.5)
            x += width
    figure.savefig(path, metadata={"Software": None})


def main() -> None:
    stands = house()
    heads = ("room", "files", "lines", "code", "docstrings", "imports", "helpers called once")
    rows = []
    for room in sorted({one.room for one in stands.modules}):
        own = [one for one in stands.modules if one.room == room]
        sums = [sum(getattr(one, name) for one in own) for name in ("n_lines", "n_code", "n_docstrings", "n_imports")]
        rows.append((room or "(root)", len(own), *sums, sum(len(one.called_once) for one in own)))
    rows.append(("all", *(sum(row[k] for row in rows) for k in range(1, len(heads)))))
    widths = [max(len(str(row[k])) for row in (heads, *rows)) for k in range(len(heads))]
    lines = [
        "  ".join([f"{row[0]:{widths[0]}}", *(f"{row[k]:>{widths[k]}}" for k in range(1, len(heads)))])
        for row in (heads, *rows)
    ]
    lines += ["", *(f"{name}: {value:g}" for name, value in stands.figures.items())]
    if "--draw" in sys.argv:
        draw(stands, sys.argv[sys.argv.index("--draw") + 1])
    if "-v" in sys.argv:
        lines += ["", *(name for one in stands.modules for name in one.without_parameters)]
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
