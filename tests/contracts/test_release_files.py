"""The files for a forge, a release and other installers agree with pyproject.toml and the Makefile."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from ruamel.yaml import YAML

from scripts.sizes import PYTHONS

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OTHERS = (".pre-commit-config.yaml", "CITATION.cff", "conda/recipe.yaml")
FILES = sorted([*ROOT.glob(".github/**/*.yml"), *(ROOT / one for one in OTHERS)])
WORKFLOWS = [path for path in FILES if path.parent.name == "workflows"]
TEXTS = [*FILES, ROOT / "Containerfile", ROOT / "CODE_OF_CONDUCT.md", ROOT / ".github/pull_request_template.md"]


def read(path: Path) -> Any:
    return YAML(typ="safe").load(path.read_text(encoding="utf-8"))


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", FILES, ids=name)
def test_it_is_yaml(path: Path) -> None:
    assert isinstance(read(path), dict)


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_what_it_calls_of_the_makefile_is_there(path: Path) -> None:
    targets = set(re.findall(r"(?m)^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8")))
    text = path.read_text(encoding="utf-8")
    assert set(re.findall(r"`?\bmake ([a-z]+(?:-[a-z]+)*)", text)) <= targets
    for test in re.findall(r"tests/[\w/]+(?:\.py)?", text):
        assert (ROOT / test).exists()


@pytest.mark.parametrize("path", TEXTS, ids=name)
def test_extras_and_versions_of_python_are_those_of_the_project(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for extras in re.findall(r"[.\")]\[([a-z,]+)\]", text):
        assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    for version in re.findall(r"\b3\.\d\d\b(?!\.)", text):
        assert version in PYTHONS


def test_the_versions_that_are_tested_are_those_that_the_project_takes() -> None:
    matrix = read(ROOT / ".github/workflows/tests.yml")["jobs"]["others"]["strategy"]["matrix"]
    assert tuple(matrix["python"]) == PYTHONS
    assert all(SpecifierSet(PROJECT["requires-python"]).contains(version) for version in PYTHONS)
    assert {one.partition("-")[0] for one in matrix["os"]} == {"ubuntu", "macos", "windows"}


def test_linux_on_arm_gets_every_extra_but_the_mesher() -> None:
    (line,) = [
        step["run"]
        for step in read(ROOT / ".github/workflows/tests.yml")["jobs"]["others"]["steps"]
        if "--editable" in step.get("run", "")
    ]
    (on_arm,) = re.findall(r"ubuntu-24\.04-arm' && '([a-z,]+)' \|\| 'all'", line)
    assert {"mesh", *on_arm.split(",")} == PROJECT["optional-dependencies"].keys() - {"all"}


def test_the_classifiers_are_the_versions_and_systems_of_the_workflow() -> None:
    of_runner = {"ubuntu": "POSIX :: Linux", "macos": "MacOS", "windows": "Microsoft :: Windows"}
    matrix = read(ROOT / ".github/workflows/tests.yml")["jobs"]["others"]["strategy"]["matrix"]
    systems = {f"Operating System :: {of_runner[one.partition('-')[0]]}" for one in matrix["os"]}
    versions = {f"Programming Language :: Python :: {version}" for version in PYTHONS}
    told = {one for one in PROJECT["classifiers"] if one.startswith(("Operating System", "Programming Language"))}
    assert told == systems | versions | {"Programming Language :: Python :: 3"}


def test_the_image_of_a_cluster_has_the_libraries_of_the_containerfile() -> None:
    ours, page = ((ROOT / file).read_text(encoding="utf-8") for file in ("Containerfile", "docs/cluster.md"))
    libraries = set(re.findall(r"\slib[a-z0-9-]+", ours))
    assert len(libraries) == 8
    (image,) = re.findall(r"    FROM python.*\n(?:    .*\n)+", page)
    assert set(re.findall(r"\slib[a-z0-9-]+", image)) == libraries


@pytest.mark.parametrize("path", WORKFLOWS, ids=name)
def test_a_workflow_may_only_read_unless_a_job_says_more(path: Path) -> None:
    assert read(path)["permissions"] == {"contents": "read"}


def test_every_address_of_the_project_is_one_of_the_project_file() -> None:
    urls = PROJECT["urls"]
    pages = [*ROOT.glob("*.md"), *ROOT.glob("docs/*"), *ROOT.glob("src/**/*.py"), ROOT / "pyproject.toml"]
    texts = {path: path.read_text(encoding="utf-8", errors="ignore") for path in (*TEXTS, *pages) if path.is_file()}
    found = {path: re.findall(r"https?://[\w./-]*softcal[\w./-]*", text) for path, text in texts.items()}
    for path, addresses in found.items():
        for one in addresses:
            assert one.startswith((urls["Repository"], urls["Documentation"])), path
    citation, recipe = read(ROOT / "CITATION.cff"), read(ROOT / "conda/recipe.yaml")["about"]
    assert (citation["repository-code"], citation["url"]) == (urls["Repository"], urls["Documentation"])
    assert (recipe["repository"], recipe["documentation"]) == (urls["Repository"], urls["Documentation"])
    assert len(found[ROOT / ".github/ISSUE_TEMPLATE/config.yml"]) == 2
    assert urls["Issues"] == urls["Repository"] + "/issues"
    assert urls["Changelog"].startswith(urls["Repository"] + "/blob/main/")
    assert (ROOT / urls["Changelog"].partition("/blob/main/")[2]).is_file()


def test_the_branch_of_the_notebooks_has_each_beside_its_script() -> None:
    """That the links to Colab name the branch and these paths is a test of the site."""
    jobs = read(ROOT / ".github/workflows/docs.yml")["jobs"]
    upload = next(one["with"] for one in jobs["build"]["steps"] if one.get("with", {}).get("name") == "notebooks")
    download = next(one["with"] for one in jobs["notebooks"]["steps"] if "download-artifact" in one.get("uses", ""))
    assert (upload["name"], upload["path"]) == (download["name"], "docs/gallery/*/*.ipynb")
    assert download["path"] == "gallery"
    assert jobs["notebooks"]["permissions"] == {"contents": "write"}
    assert jobs["notebooks"]["if"] == jobs["deploy"]["if"]
    assert "git push --force origin notebooks" in jobs["notebooks"]["steps"][-1]["run"]


def test_only_a_tag_publishes_and_without_a_password() -> None:
    release = read(ROOT / ".github/workflows/release.yml")
    assert release["on" if "on" in release else True] == {"push": {"tags": ["v*"]}}
    assert release["jobs"]["publish"]["permissions"] == {"id-token": "write"}
    assert "secrets." not in (ROOT / ".github/workflows/release.yml").read_text(encoding="utf-8")


def test_the_recipe_needs_what_the_project_needs() -> None:
    """But MKL, which stays a choice there; conda has Matplotlib without its windows under another name."""
    lines = [str(line) for line in read(ROOT / "conda/recipe.yaml")["requirements"]["run"]]
    recipe = {line.split()[0].removesuffix("-base"): line.partition(" ")[2] for line in lines}
    assert SpecifierSet(recipe.pop("python")) == SpecifierSet(PROJECT["requires-python"])
    needed = [one for one in map(Requirement, PROJECT["dependencies"]) if one.marker is None]
    assert {one: SpecifierSet(spec) for one, spec in recipe.items()} == {one.name: one.specifier for one in needed}


def test_the_root_has_only_the_files_that_belong_there() -> None:
    """A scratch file in the root would be in the sdist."""
    tracked = subprocess.run(
        ["git", "ls-files", "--", ":(glob)*"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if tracked.returncode:
        pytest.skip("not a clone: git lists no files here")
    pages = "CHANGELOG.md CODE_OF_CONDUCT.md CONTRIBUTING.md README.md SECURITY.md VISION.md"
    others = "CITATION.cff Containerfile LICENSE Makefile NOTICE constraints.txt pyproject.toml"
    hidden = ".git_archival.txt .gitattributes .gitignore .pre-commit-config.yaml"
    assert sorted(tracked.stdout.split()) == sorted(f"{pages} {others} {hidden}".split())
