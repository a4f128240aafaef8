"""The site: it is built without a warning, reads well on wide and narrow screens, and its search and links work."""

from __future__ import annotations

import functools
import json
import re
import shutil
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import pytest
from browser.conftest import Seen

import softcal
from scripts.reference import FAMILIES, FILE, OUTSIDE, linked
from softcal.cli.command import COMMANDS

ROOT = Path(__file__).parents[2]
WIDE, NARROW = 1400, 390
SCRIPT = "gallery/2-calibration/plot_calibrate"
AS_WRITTEN = ("code", "pre", "script", "style", "textarea")
PAGES = ["index", "start", "faq", "mechanics", "reference/keys", "reference/commands", "gallery/index", SCRIPT]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site: that of `make docs` where nothing has changed since, else of a copy of what it is built from."""
    built, sources = ROOT / "docs" / "_build", ("docs", "examples", "gallery", "src", "scripts", "pyproject.toml")
    last = built / "searchindex.js"  # written at the end
    listed = subprocess.run(["git", "ls-files", *sources], cwd=ROOT, capture_output=True, text=True, check=False)
    files = [ROOT / name for name in listed.stdout.splitlines()]
    if files and last.is_file() and all(one.is_file() and one.stat().st_mtime < last.stat().st_mtime for one in files):
        return built
    folder = tmp_path_factory.mktemp("site") / "copy"
    left_out = (".git", ".venv", "__pycache__", "_build", "reference", "run", "runs", ".*_cache", ".hypothesis")
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns(*left_out))
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "docs/_build"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "docs" / "_build"


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_a_page_fits_its_screen_without_a_complaint(
    site: Path, look: Callable[..., Seen], page: str, width: int
) -> None:
    seen = look((site / f"{page}.html").as_uri(), width=width)
    assert seen.complaints == []
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= width
    assert all(urlsplit(address).scheme in ("file", "data") for address in seen.requests), "it needs no network"


class Files(SimpleHTTPRequestHandler):
    """Files of a folder that a browser may keep: what the pages share is loaded and compiled once."""

    protocol_version = "HTTP/1.1"

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "max-age=3600")
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


# Each page is in a frame until the next one has loaded, so that its scripts have the time to complain. It is laid out,
# and not drawn.
FRAME = """
(address) => new Promise((loaded) => {
  const [frame, before] = [document.createElement("iframe"), document.querySelector("iframe")]
  frame.onload = () => { before?.remove(); loaded() }
  frame.style.visibility = "hidden"
  frame.src = address
  document.body.append(frame)
})
"""


@pytest.mark.slow
def test_no_page_complains_or_needs_the_network(site: Path, look: Callable[..., Seen], tmp_path: Path) -> None:
    """All pages, in frames of one page of one server: a third of the time of as many visits."""
    (tmp_path / "index.html").write_text('<!doctype html><link rel="icon" href="data:,"><body></body>')
    (tmp_path / "site").symlink_to(site)
    pages = sorted(str(page.relative_to(site)) for page in site.rglob("*.html") if "_static" not in page.parts)
    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Files, directory=str(tmp_path))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        base = f"http://127.0.0.1:{server.server_port}/"
        seen, complaints = look(base), dict[str, list[str]]()
        for page in [*pages, "search.html?q=slack"]:
            seen.page.evaluate(FRAME, f"{base}site/{page}")
            if seen.complaints:
                complaints[page] = seen.complaints.copy()  # or of the page before it, after it has loaded
                seen.complaints.clear()
        server.shutdown()
    assert len(pages) > 250
    assert complaints == {}
    outside = [address for address in seen.requests if not address.startswith((base, "data:", "blob:"))]
    assert outside == []


@pytest.mark.slow
def test_a_page_is_dark_where_the_system_is(site: Path, look: Callable[..., Seen]) -> None:
    seen = look((site / "start.html").as_uri())

    def colour(what: str, of: str) -> list[int]:
        found = f"getComputedStyle(document.querySelector('{of}')).{what}.match(/\\d+/g).slice(0, 3).map(Number)"
        return seen.page.evaluate(found)

    seen.page.emulate_media(color_scheme="light")
    assert min(colour("backgroundColor", "body")) > 192 > 64 > max(colour("color", "article p"))
    seen.page.emulate_media(color_scheme="dark")
    seen.wait_for(lambda: max(colour("backgroundColor", "body")) < 64, "it stays light")
    assert min(colour("color", "article p")) > 192


@pytest.mark.slow
def test_the_neck_of_the_first_page_follows_its_slider(site: Path, look: Callable[..., Seen]) -> None:
    seen = look((site / "index.html").as_uri())
    inside = seen.page.frame_locator("iframe.twin")
    before = inside.locator("canvas").screenshot()
    inside.locator("input[type=range]").press("PageDown")
    assert inside.locator("canvas").screenshot() != before


@pytest.mark.slow
def test_the_search_finds_a_word(site: Path, look: Callable[..., Seen]) -> None:
    seen = look((site / "search.html").as_uri() + "?q=slack")
    seen.wait_for(lambda: "What the intervals mean" in seen.page.inner_text("#search-results"), "the page is not there")


class Places(HTMLParser):
    """The links and the ids of a page, and the text of its article in which marks of a link or of code are left."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links, self.ids, self.raw = list[str](), set[str](), list[str]()
        self._depth = dict.fromkeys(("article", *AS_WRITTEN), 0)
        self.feed(page.read_text(encoding="utf-8"))

    def handle_data(self, data: str) -> None:
        is_prose = self._depth["article"] and not any(self._depth[tag] for tag in AS_WRITTEN)
        if is_prose and ("](" in data or "`" in data):
            self.raw.append(data.strip())

    def handle_endtag(self, tag: str) -> None:
        if tag in self._depth:
            self._depth[tag] -= 1

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = dict(attrs)
        if tag in self._depth:
            self._depth[tag] += 1
        self.ids |= {told.get("id") or "", (told.get("name") or "") if tag == "a" else ""}
        if tag == "a" and told.get("href"):
            self.links.append(told["href"] or "")


@pytest.mark.slow
def test_every_link_of_the_site_leads_to_a_place_that_is_there(site: Path) -> None:
    pages = {page: Places(page) for page in sorted(site.rglob("*.html"))}
    dead, n = list[str](), 0
    for page, places in pages.items():
        for address in places.links:
            at = urlsplit(urljoin(page.as_uri(), address))
            if at.scheme == "file":
                n += 1
                file = Path(unquote(at.path))
                if not file.is_file() or (file in pages and unquote(at.fragment) not in pages[file].ids):
                    dead.append(f"{page.relative_to(site)}: {address}")
    assert n > 1000
    assert dead == []
    assert {str(page.relative_to(site)): places.raw for page, places in pages.items() if places.raw} == {}
    own = {path.stem for path in (ROOT / "docs").glob("*.md")}
    assert own.isdisjoint({"search", "genindex", "py-modindex"}), "pages that the site makes itself"


@pytest.mark.slow
def test_the_reference_has_every_name_command_section_and_family(site: Path) -> None:
    def words(page: str) -> str:
        return (site / "reference" / page).read_text(encoding="utf-8")

    assert all((site / "reference" / "generated" / f"softcal.{name}.html").is_file() for name in dir(softcal))
    assert all(f"softcal {name}" in words("commands.html") for name in COMMANDS)
    assert all(path in words("keys.html") for path in FILE)
    assert "above 0, to 100 m" in words("keys.html")
    assert "gallery/1-robots/plot_two_materials.html" in words("generated/softcal.Material.html"), "where it is used"
    assert all(f">{name}<" in words("families.html") for catalogue, _ in FAMILIES.values() for name in catalogue)


@pytest.mark.slow
def test_every_example_opens_in_colab_from_the_branch_that_has_its_notebook(site: Path) -> None:
    address = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Repository"]
    branch = address.replace("https://github.com/", "https://colab.research.google.com/github/") + "/blob/notebooks/"
    pages = sorted(site.glob("gallery/*/plot_*.html"))
    assert len(pages) == len(list(ROOT.glob("gallery/*/plot_*.py"))) >= 25
    for page in pages:
        (link,) = re.findall(r'href="(https://colab[^"]*)"', page.read_text(encoding="utf-8"))
        path = str(page.relative_to(site).with_suffix(".ipynb"))
        assert link == branch + path
        # Where the workflow takes it, to lay it into gallery/, whose folders have the same names.
        cells = json.loads((site.parent / path).read_text(encoding="utf-8"))["cells"]
        first = "".join(cells[0]["source"])
        assert f"git clone -q --depth 1 --branch notebooks {address} /content/softcal\n" in first
        assert (ROOT / path).with_suffix(".py").is_file()


def test_links_to_files_of_the_repository_lead_to_their_pages() -> None:
    source, page = ROOT / "docs" / "start.md", ROOT / "docs" / "start.md"
    others = "[b](python.md) [c](https://softcal.example) [d](../LICENSE) [e](no.md)"
    assert linked(f"# A\n[a](../README.md#start) {others}", source, page) == (
        f"# A\n[a](reference/readme.md#start) {others}"
    )
    source = ROOT / "examples" / "neck" / "README.md"
    assert linked("# A\n[b](../finger)", source, OUTSIDE[source]) == "# A\n[b](example-finger.md)"
    assert linked("softcal is", ROOT / "VISION.md", OUTSIDE[ROOT / "VISION.md"]).startswith("# Scope\n")
