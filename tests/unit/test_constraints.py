"""The tested versions of constraints.txt, and what the audit of them says."""

from __future__ import annotations

import json
import re
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts import check_vulnerabilities
from scripts.check_licences import needed_by
from scripts.check_vulnerabilities import look_up
from scripts.write_constraints import CONSTRAINTS, constraints, roots

LINES = [line for line in CONSTRAINTS.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
TESTED = {canonicalize_name(one.name): one for one in map(Requirement, LINES)}


def test_every_line_is_one_version_for_one_python() -> None:
    (python,) = {str(one.marker) for one in TESTED.values()}
    assert re.fullmatch(r'python_version == "3\.\d+"', python)
    assert all([str(one.operator) for one in requirement.specifier] == ["=="] for requirement in TESTED.values())
    assert LINES == sorted(LINES, key=lambda line: line.partition("==")[0])
    assert "softcal" not in TESTED


@pytest.mark.parametrize("root", roots())
def test_all_that_is_needed_is_constrained(root: str) -> None:
    requirement = Requirement(root)
    try:
        tree = needed_by(root)
    except PackageNotFoundError:  # a tool that is new, until `make lint` has installed it
        tree = {canonicalize_name(requirement.name): None}
    assert set(tree) - set(TESTED) <= {"softcal"}
    if requirement.name != "softcal":
        (version,) = TESTED[canonicalize_name(requirement.name)].specifier
        assert requirement.specifier.contains(version.version)


def test_a_file_is_written_as_it_is_read() -> None:
    text = constraints([("numpy", "2.4.6")], "3.11")
    assert text.splitlines()[1:] == ['numpy==2.4.6 ; python_version == "3.11"']


def audit(tmp_path: Path, script: str) -> tuple[list[str], str]:
    report = tmp_path / "report.json"
    return look_up([sys.executable, "-c", script, str(report)], report)


def test_a_database_that_does_not_answer_is_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert audit(tmp_path, "raise OSError('no route to host')") == ([], "OSError: no route to host")
    monkeypatch.setattr(check_vulnerabilities, "LONGEST", 0.2)
    assert audit(tmp_path, "import time; time.sleep(20)") == ([], "no answer within 0.2 s")


def test_a_vulnerability_is_told_but_for_one_that_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    holes = [{"id": "GHSA-1", "fix_versions": ["2.0"]}, {"id": "GHSA-2", "fix_versions": []}]
    report = {"dependencies": [{"name": "a", "version": "1.0", "vulns": holes}, {"name": "b", "skip_reason": "none"}]}
    script = f"import pathlib, sys; pathlib.Path(sys.argv[1]).write_text({json.dumps(report)!r}); sys.exit(1)"
    found = ["a 1.0: GHSA-1, mended in 2.0", "a 1.0: GHSA-2, mended in none"]
    assert audit(tmp_path, script) == (found, "")
    monkeypatch.setitem(check_vulnerabilities.ACCEPTED, "GHSA-2", "it concerns another system")
    assert audit(tmp_path, script) == (found[:1], "")
