"""The door of the package: what it names exists, is documented, and says what it raises."""

from __future__ import annotations

import ast
import inspect
from importlib.metadata import EntryPoint, version
from pathlib import Path

import pytest

import softcal
from softcal import errors

SOURCE = Path(softcal.__file__).parent
ERROR_NAMES = {name for name, value in vars(errors).items() if inspect.isclass(value) and issubclass(value, Exception)}


def public_functions() -> list[tuple[str, ast.FunctionDef]]:
    """Every public function and method in src, with a name that tells where it stands."""
    found = []
    for path in sorted(
        set(SOURCE.rglob("*.py"))
        - set((SOURCE / "cli").rglob("*.py"))
        - set((SOURCE / "plugins").glob("*/command*.py"))
    ):  # a command's docstring is its help
        place = path.relative_to(SOURCE).as_posix()
        scopes: list[tuple[str, ast.Module | ast.ClassDef]] = [(place, ast.parse(path.read_text(encoding="utf-8")))]
        for where, scope in scopes:
            for node in scope.body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    scopes.append((f"{where}:{node.name}", node))
                elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    found.append((f"{where}:{node.name}", node))
    return found


def raised_here(function: ast.FunctionDef) -> set[str]:
    """Names of softcal's errors that the body raises itself."""
    raised = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            raised.add(node.exc.func.id)
    return raised & ERROR_NAMES


def test_the_names_are_sorted_and_there():
    assert list(softcal.__all__) == sorted(softcal._HOMES)
    for name in dir(softcal):
        assert getattr(softcal, name).__name__ == name
    assert set(softcal.__all__) < set(dir(softcal))


def test_type_checkers_see_the_same_names():
    tree = ast.parse((SOURCE / "__init__.py").read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: node.module for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    seen.pop("EntryPoint")
    assert seen == softcal._HOMES


def test_a_package_adds_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "grip.py").write_text("def grip():\n    return 3\n\nBody = None\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    points = [EntryPoint(name, f"grip:{name}", "softcal.names") for name in ("grip", "Body")]
    monkeypatch.setattr("softcal.catalogue.entry_points", lambda group: [p for p in points if p.group == group])
    try:
        assert softcal.grip() == 3
    finally:
        vars(softcal).pop("grip", None)
    assert "grip" in dir(softcal)
    assert inspect.isclass(softcal.Body)  # softcal's own stays


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'softcal' has no attribute 'nonsense'"):
        softcal.nonsense  # noqa: B018


@pytest.mark.parametrize("name", dir(softcal))
def test_everything_public_has_a_docstring(name):
    assert inspect.getdoc(getattr(softcal, name))


def test_what_is_raised_is_documented():
    silent = []
    for where, function in public_functions():
        docstring = ast.get_docstring(function) or ""
        _, _, raises = docstring.partition("Raises\n------\n")
        silent += [f"{where} raises {name}" for name in sorted(raised_here(function)) if name not in raises]
    assert not silent


def test_no_file_hides_its_purpose():
    vague = {"utils.py", "util.py", "helpers.py", "common.py", "misc.py", "manager.py", "tools.py"}
    assert not [path for path in SOURCE.rglob("*.py") if path.name in vague]


def test_no_class_name_stands_for_two_things():
    of: dict[str, list[str]] = {}
    for path in SOURCE.rglob("*.py"):
        if "sofa_files" not in path.parts:  # runs in SOFA's Python, beside its own names
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef):
                    of.setdefault(node.name, []).append(path.name)
    assert {name: files for name, files in of.items() if len(files) > 1} == {}


def test_the_version_is_that_of_the_installed_package():
    assert softcal.__version__ == version("softcal")
