"""A wheel has the data of every benchmark case."""

from __future__ import annotations

import re
import subprocess
import sys
import venv
from pathlib import Path
from zipfile import ZipFile

import pytest

from scripts.readme_hook import absolute

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("hatch_vcs")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


def test_a_wheel_has_the_licence_and_the_notice(wheel: Path) -> None:
    with ZipFile(wheel) as packed:
        (place,) = {name.partition("/")[0] for name in packed.namelist() if ".dist-info/" in name}
        for name in ("LICENSE", "NOTICE"):
            assert packed.read(f"{place}/licenses/{name}") == (ROOT / name).read_bytes()


def test_links_of_the_readme_become_addresses_of_a_version() -> None:
    text = absolute("[![a](b.png)](c) [d](e.md#f) [g](https://h) [i](#j)", "R", "v1")
    assert text == "[![a](R/raw/v1/b.png)](R/blob/v1/c) [d](R/blob/v1/e.md#f) [g](https://h) [i](#j)"


def test_every_link_of_the_description_is_an_address_of_a_file_that_is_there(wheel: Path) -> None:
    with ZipFile(wheel) as packed:
        (place,) = (name for name in packed.namelist() if name.endswith(".dist-info/METADATA"))
        described = packed.read(place).decode("utf-8")
    head, _, text = described.partition("\n\n")
    repository = re.findall(r"^Project-URL: Repository, (.*)$", head, re.MULTILINE)[0]
    links = re.findall(r"(!?)\[[^]]*\]\(([^)]*)\)", text)
    assert len(links) > 20
    assert sum(bool(picture) for picture, _ in links) == 1
    for picture, address in links:
        if not address.startswith("https://") or address.startswith(repository):
            kind, _, path = address.removeprefix(f"{repository}/").partition("/")
            assert kind == ("raw" if picture else "blob"), address
            assert (ROOT / path.partition("/")[2].partition("#")[0]).exists(), address


@pytest.mark.slow  # starts a program in an environment of its own
def test_an_installed_wheel_lists_all_cases_and_scores_one(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "fresh", with_pip=False)
    (site,) = (tmp_path / "fresh").glob("lib/python*/site-packages")
    ZipFile(wheel).extractall(site)
    others = [path for path in sys.path if path.endswith("site-packages")]
    (site / "others.pth").write_text("\n".join(others))
    run = [str(tmp_path / "fresh" / "bin" / "python"), "-I", "-m", "softcal", "bench"]
    listed = subprocess.run([*run, "list"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    assert "not in this installation" not in listed
    assert str(site / "softcal" / "plugins" / "bench") in listed.replace("\n", "")
    beam = ["run", "beam", "--out", "beam"]
    ran = subprocess.run([*run, *beam], cwd=tmp_path, check=False, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert (tmp_path / "beam" / "score.json").is_file()
