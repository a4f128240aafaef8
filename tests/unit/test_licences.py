"""No GPL at run time: the check itself, and what it says of the packages installed here."""

from __future__ import annotations

from email.message import Message
from importlib.metadata import Distribution

import pytest

from scripts.check_licences import SOFTCAL, is_permitted, judge, licence_of, runtime_tree


class Package(Distribution):
    """A distribution with the given metadata and nothing else."""

    def __init__(self, **fields: str | list[str]) -> None:
        self.message = Message()
        for key, value in {"Name": "somebody", "Version": "1.0", **fields}.items():
            for line in [value] if isinstance(value, str) else value:
                self.message[key.replace("_", "-")] = line

    @property
    def metadata(self):
        return self.message

    def read_text(self, filename):
        return None

    def locate_file(self, path):
        return path


def test_everything_needed_at_run_time_is_permitted():
    refused = {v.name: v.licence for v in map(judge, runtime_tree(SOFTCAL).values()) if not v.permitted}
    assert not refused


def test_gmsh_is_no_runtime_dependency():
    tree = runtime_tree(SOFTCAL)
    assert "numpy" in tree
    assert not {"gmsh", "felupe", "cvxopt"} & tree.keys()


def test_the_tree_is_walked_to_its_leaves():
    # softcal -> optuna -> sqlalchemy -> typing-extensions
    assert {"optuna", "sqlalchemy", "typing-extensions"} <= runtime_tree(SOFTCAL).keys()


@pytest.mark.parametrize(
    "expression",
    [
        "MIT",
        "BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0",
        "Apache-2.0 OR BSD-2-Clause",
        "BSD-2-Clause AND Apache-2.0 WITH LLVM-exception",
        "MIT OR GPL-3.0-or-later",
        "(GPL-2.0-only OR MIT) AND MPL-2.0",
        "LGPL-2.1-or-later",
    ],
)
def test_permitted_expressions(expression):
    assert is_permitted(expression)


@pytest.mark.parametrize(
    "expression",
    [
        "GPL-3.0-or-later",
        "AGPL-3.0-only",
        "MIT AND GPL-2.0-only",
        "(MIT OR Apache-2.0) AND GPL-3.0-only",
        "Apache-2.0 WITH Commons-Clause",
        "SSPL-1.0",
        "unknown",
        "",
        "(MIT",
        "MIT MIT",
    ],
)
def test_refused_expressions(expression):
    assert not is_permitted(expression)


@pytest.mark.parametrize(
    ("fields", "permitted"),
    [
        ({"License_Expression": "MIT"}, True),
        ({"License_Expression": "GPL-3.0-or-later", "License": "MIT"}, False),
        ({"License": "GPLv2+"}, False),
        ({"License": "GNU Affero General Public License v3"}, False),
        ({"License": "GNU Lesser General Public License v3 (LGPLv3)"}, True),
        ({"Classifier": ["License :: OSI Approved :: GNU General Public License v2 or later (GPLv2+)"]}, False),
        ({"Classifier": ["License :: OSI Approved :: MIT License"]}, True),
        (
            {
                "Classifier": [
                    "License :: OSI Approved :: MIT License",
                    "License :: OSI Approved :: GNU General Public License v3 (GPLv3)",
                ]
            },
            False,
        ),
        ({"Classifier": ["License :: Other/Proprietary License"]}, False),
        (
            {"Classifier": ["License :: OSI Approved :: BSD License"], "License": "Copyright (c) …\nGPL is named here"},
            True,
        ),
        ({"License": "MPL-2.0 AND MIT"}, True),
        ({"License": "Intel Simplified Software License"}, False),
        ({"License": "Apache-2.0 with LLVM exceptions"}, True),
        ({}, False),
    ],
)
def test_what_metadata_says(fields, permitted):
    package = Package(**fields)
    assert judge(package).permitted is permitted, licence_of(package)


def test_an_accepted_package_carries_its_reason():
    verdict = judge(Package(Name="mkl", License="Intel Simplified Software License"))
    assert verdict.permitted
    assert "redistributable" in verdict.reason
