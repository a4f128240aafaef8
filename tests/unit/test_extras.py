"""What a plain `pip install softcal` can do, and the command that installs what it lacks."""

from __future__ import annotations

import html
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
# Of the extras, as `pip install softcal` leaves them out.
LEFT_OUT = ("gmsh", "pyvista", "vtkmodules", "cv2", "SALib", "sklearn", "distributed", "dask_jobqueue", "nicegui")


def softcal_without(modules: tuple[str, ...], *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in a process in which modules are as if they were not installed."""
    hide = f"import sys; sys.modules.update(dict.fromkeys({modules!r})); from softcal.cli import main; main()"
    line = [sys.executable, "-P", "-c", hide, *arguments]
    return subprocess.run(line, check=False, capture_output=True, text=True, cwd=folder, timeout=300)


@pytest.mark.slow
def test_a_plain_install_calibrates_and_reports(tmp_path: Path):
    """Pictures and importances are missing, each with the command that brings them."""
    project, run = str(EXAMPLES / "beam" / "project.yaml"), tmp_path / "run"
    how = ("--method", "tpe", "--trials", "3", "--fit", "joint", "--no-mesh-error")
    done = softcal_without(LEFT_OUT, "calibrate", project, *how, "--out", str(run), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "The importances are missing: this needs sklearn" in (run / "result.json").read_text()
    report = html.unescape((run / "report.html").read_text())
    for extra in ("pictures", "importance"):
        assert f"pip install 'softcal[{extra}]'" in report


@pytest.mark.parametrize(
    ("command", "module", "extra"),
    [
        (("markers", "photo.png", "--camera", "camera.yaml", "--size", "20mm", "--base", "0"), "cv2", "markers"),
        (("board", "--out", "sheet.svg"), "cv2", "markers"),
        (("importance", "PROJECT", "--out", "study"), "SALib", "importance"),
        (("export", "vtk", "PROJECT", "--out", "shapes"), "pyvista", "pictures"),
        (("watch", "."), "nicegui", "watch"),
    ],
    ids=lambda part: part if isinstance(part, str) else part[0],
)
def test_a_missing_extra_is_named(command: tuple[str, ...], module: str, extra: str, tmp_path: Path):
    words = [str(EXAMPLES / "neck-bench" / "project.yaml") if word == "PROJECT" else word for word in command]
    done = softcal_without((module,), *words, folder=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert f"this needs {module}, which is not installed" in " ".join(done.stderr.split())
    assert f"pip install 'softcal[{extra}]'" in " ".join(done.stderr.split())
