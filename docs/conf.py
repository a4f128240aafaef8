"""The site: the pages of this folder, the examples, the gallery, which is run, and a reference that is read from the
code; `make docs`.
"""

from __future__ import annotations

import re
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from sphinx.util import logging

ROOT = Path(__file__).parents[1]
URLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
# What the docs workflow publishes: main, with each notebook beside its script.
BRANCH = "notebooks"
COLAB = URLS["Repository"].replace("https://github.com", "https://colab.research.google.com/github")
sys.path.insert(0, str(ROOT))

import softcal  # noqa: E402
from scripts import gallery_cost  # noqa: E402
from scripts.reference import linked, write_reference  # noqa: E402

logger = logging.getLogger(__name__)
project = "softcal"
author = "the maintainers of softcal"
release = version = softcal.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
# The gallery's scripts and notebooks are downloads, beside the page of each.
exclude_patterns = ["_build", "gallery/**/*.ipynb", "gallery/**/*.py"]
default_role = "code"  # of `text` in docstrings
suppress_warnings = ["ref.python"]  # an attribute `name` is one of many classes

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

autosummary_generate = ["reference/names.rst"]
autodoc_typehints = "none"  # the docstrings have them
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True  # as written, not <function <lambda>>
autodoc_default_options = {"members": True, "undoc-members": False}
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

# Every folder of the gallery is as good as the first: scripts read ../strip or ../../examples.
FIRST_CELL = f"""\
# In Colab: softcal with the extras that the gallery needs, and the files that its scripts read.
import sys

if "google.colab" in sys.modules:
    !git clone -q --depth 1 --branch {BRANCH} {URLS["Repository"]} /content/softcal
    %pip install -q "/content/softcal[importance,markers,mesh,pictures]"
    !apt-get install -qq $(python /content/softcal/scripts/system_libraries.py)
    %cd /content/softcal/gallery/1-robots
"""

# Every script of the gallery is run; one that fails ends the build.
sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": str(ROOT / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": "/plot_",
    "first_notebook_cell": FIRST_CELL,
    "abort_on_example_error": True,
    "within_subsection_order": "ExampleTitleSortKey",
    "backreferences_dir": "gallery/uses",
    "doc_module": ("softcal",),
    "reference_url": {"softcal": None},
    "inspect_global_variables": False,
    "remove_config_comments": True,
    "min_reported_time": 1,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "reset_modules": ("matplotlib", "seaborn", "scripts.gallery_cost.clock"),
    "reset_modules_order": "both",
    "capture_repr": (),
    "matplotlib_animations": False,
    "thumbnail_size": (400, 280),
}

# `make links`: every address but those of the project, which are to be created before the release.
linkcheck_ignore = [f"{re.escape(address)}.*" for address in (*URLS.values(), COLAB)]
linkcheck_anchors = False  # of pages that scripts make
linkcheck_timeout, linkcheck_workers = 20, 8

html_theme = "pydata_sphinx_theme"
html_title = "softcal"
html_baseurl = URLS["Documentation"]
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_context = {"default_mode": "auto"}  # light or dark, as the reader's system is
html_theme_options: dict[str, Any] = {
    "logo": {"text": "softcal"},
    "navbar_align": "left",
    "icon_links": [{"name": "Source", "url": URLS["Repository"], "icon": "fa-brands fa-github"}],
    "show_toc_level": 2,
    "footer_start": [],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}


def link(app: Any, name: str, source: list[str]) -> None:
    """Links of a page of this folder to files of the repository that are pages of the site; of an example to Colab."""
    path = Path(app.srcdir) / f"{name}.md"
    if path.is_file() and path.parent == Path(app.srcdir):  # those below were written with theirs
        source[0] = linked(source[0], path, path)
    elif fnmatch(name, "gallery/*/plot_*"):
        notebook = f"{COLAB}/blob/{BRANCH}/{name}.ipynb"
        download = "to download the full example code"
        source[0] = source[0].replace(f"{download}.", f"{download}, or `open it in Colab <{notebook}>`__.", 1)


def use(app: Any, what: str, name: str, _: object, options: object, lines: list[str]) -> None:
    """Beneath the docstring of a public name: the examples of the gallery that use it."""
    found = Path(app.srcdir) / sphinx_gallery_conf["backreferences_dir"] / f"{name}.examples"
    if name.count(".") == 1 and found.is_file() and found.stat().st_size:
        lines += ["", ".. rubric:: In the gallery", "", f".. minigallery:: {name}", ""]


def cost(app: Any, failed: Exception | None) -> None:
    """At the end: the CPU minutes of the gallery; a warning, which is an error, where they are too many."""
    said, is_too_much = gallery_cost.sentence(Path(app.srcdir) / "gallery", ROOT / "gallery")
    if failed is None:
        (logger.warning if is_too_much else print)(said)


def setup(app: Any) -> None:
    """Before any page is read, the pages that come from elsewhere are written."""
    app.connect("build-finished", cost)
    app.connect("builder-inited", lambda app: write_reference(Path(app.srcdir) / "reference"), priority=100)
    app.connect("source-read", link)
    app.connect("autodoc-process-docstring", use, priority=900)  # after the sections are read
