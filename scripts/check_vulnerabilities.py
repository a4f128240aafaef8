"""Look up the versions of constraints.txt in the OSV database by pip-audit; exit 1 where one has a known vulnerability.

Where the database does not answer, nothing is known and nothing fails: the reason is printed.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

CONSTRAINTS = Path(__file__).parents[1] / "constraints.txt"
LONGEST = 60.0  # [s] for all of them
ANSWER = 5  # [s] for one

# Identifier -> why it does not concern softcal.
ACCEPTED: dict[str, str] = {}


def command(report: Path) -> list[str]:
    """The audit of the constraints as they stand; nothing is resolved or installed."""
    options = ["--no-deps", "--disable-pip", "--vulnerability-service", "osv", "--timeout", str(ANSWER)]
    options += ["--progress-spinner", "off", "--format", "json", "--output", str(report)]
    return [sys.executable, "-m", "pip_audit", "--requirement", str(CONSTRAINTS), *options]


def look_up(audit: Sequence[str], report: Path) -> tuple[list[str], str]:
    """A line for each vulnerability; or why there was no answer, else ""."""
    try:
        done = subprocess.run(audit, check=False, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return [], f"no answer within {LONGEST:g} s"
    if not report.is_file():
        return [], (done.stderr.strip() or "no report").splitlines()[-1][:200]
    return [
        f"{package['name']} {package['version']}: {one['id']}, mended in {', '.join(one['fix_versions']) or 'none'}"
        for package in json.loads(report.read_text(encoding="utf-8"))["dependencies"]
        for one in package.get("vulns", ())
        if one["id"] not in ACCEPTED
    ], ""


def main() -> int:
    if importlib.util.find_spec("pip_audit") is None:
        sys.stderr.write("pip-audit is not installed; run: make lint\n")
        return 2
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        found, unanswered = look_up(command(report), report)
    if unanswered:
        sys.stdout.write(f"skipped: vulnerabilities are not looked up: {unanswered}\n")
        return 0
    sys.stdout.write("\n".join(found or ["no known vulnerabilities"]) + "\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
