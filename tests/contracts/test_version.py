"""The version is that of the tag, in whatever form the source is built; and one for Python, terminal and package."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.version import Version

import softcal

ROOT = Path(__file__).parents[2]


def git(source: Path, *arguments: str) -> None:
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    subprocess.run(["git", *who, *arguments], cwd=source, check=True, capture_output=True)


def built(source: Path, target: str = "wheel") -> str:
    """The version of what is built of a source tree."""
    pytest.importorskip("hatch_vcs")
    command = [sys.executable, "-W", "ignore", "-m", "hatchling", "build", "-t", target, "-d", str(source / "dist")]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (path,) = (source / "dist").iterdir()
    return path.name.removesuffix(".tar.gz").split("-")[1]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A source tree with the files that tell a version, in a repository of one commit without a tag."""
    folder = tmp_path / "source"
    for place in ("src/softcal", "scripts"):
        (folder / place).mkdir(parents=True)
    copied = (".git_archival.txt", ".gitattributes", "LICENSE", "NOTICE", "README.md")
    for name in (*copied, "scripts/readme_hook.py", "src/softcal/__init__.py"):
        shutil.copy(ROOT / name, folder / name)
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    (folder / "pyproject.toml").write_text(re.sub(r'(?m)^"examples/.*\n', "", text), encoding="utf-8")
    (folder / ".gitignore").write_text("dist/\n")
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-qm", "first")
    return folder


def test_python_and_the_metadata_say_one_version() -> None:
    assert softcal.__version__ == metadata.version("softcal") == str(Version(softcal.__version__))


def test_a_source_tree_that_is_not_installed_has_a_version_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", absent)
    assert softcal.__version__ == "0.0"


def test_a_tag_is_the_version_and_what_follows_comes_after_it(source: Path) -> None:
    git(source, "tag", "v1.2.3")
    assert built(source) == "1.2.3"
    shutil.rmtree(source / "dist")
    git(source, "commit", "-qm", "second", "--allow-empty")
    later = Version(built(source))
    assert Version("1.2.3") < later < Version("1.2.4")
    assert re.fullmatch(r"g[0-9a-f]+", later.local or "")


def test_without_a_tag_it_is_before_every_release_and_names_the_commit(source: Path) -> None:
    version = Version(built(source))
    assert version < Version("0.1")
    assert re.fullmatch(r"g[0-9a-f]+", version.local or "")


def test_an_sdist_keeps_its_version(source: Path, tmp_path: Path) -> None:
    git(source, "tag", "v1.2.3")
    assert built(source, "sdist") == "1.2.3"
    with tarfile.open(source / "dist" / "softcal-1.2.3.tar.gz") as packed:
        packed.extractall(tmp_path, filter="data")
    assert built(tmp_path / "softcal-1.2.3") == "1.2.3"


def test_an_archive_that_git_made_keeps_its_version(source: Path, tmp_path: Path) -> None:
    git(source, "tag", "v1.2.3")
    git(source, "archive", "--prefix=plain/", "-o", str(tmp_path / "plain.tar"), "HEAD")
    with tarfile.open(tmp_path / "plain.tar") as packed:
        packed.extractall(tmp_path, filter="data")
    assert built(tmp_path / "plain") == "1.2.3"


def test_a_folder_without_git_has_the_version_of_no_release(source: Path) -> None:
    shutil.rmtree(source / ".git")
    assert built(source) == "0.0"
