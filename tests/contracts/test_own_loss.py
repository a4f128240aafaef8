"""A loss in one file of the user's own: registered, it works from the project file as softcal's losses do."""

from __future__ import annotations

import json
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest
from loss_checks import CHECKS, loss_of
from own_module import imported
from project_case import MODULUS, SLACK, write_project

from softcal import CalibrationError, Loss, calibrate, load, quantity, register_loss, sweep
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.problem.option import Option
from softcal.errors import InputError, ParameterError, ProjectFileError
from softcal.workflows.run_folder import load_run

RELATIVE = '''
from dataclasses import dataclass

import numpy as np

from softcal import Loss, Option, quantity, register_loss


@register_loss
@dataclass(frozen=True)
class RelativeLoss(Loss):
    """The root mean square error in per cent of each value; values near zero are replaced by a share of the largest."""

    name = "relative"
    rooted, degree, unit = True, 1, "%"
    options = (Option("least_share", quantity("share"), 0.1),)

    least_share: float = 0.1

    def block_value(self, block, residual):
        return float(residual**2 @ self.square_weights(block, residual))

    def square_weights(self, block, residual):
        size = np.abs(block.measured)
        return (100.0 / np.maximum(size, self.least_share * size.max())) ** 2

    def share(self, blocks):
        return 1.0 / sum(len(block.residual) for block in blocks)

    def faults(self, experiments):
        return []
'''
NAMED = ("starts: 1}", "starts: 1, loss: relative, least_share: 0.2}")


@pytest.fixture
def relative(tmp_path: Path) -> Generator[ModuleType]:
    """The loss, as a module of the user's registers it."""
    yield imported(tmp_path / "relative_loss.py", RELATIVE)
    LOSSES.remove("relative")


def test_it_calibrates_from_a_project_file(relative: ModuleType, tmp_path: Path) -> None:
    project = load(write_project(tmp_path, NAMED))
    assert project.calibration.options == {
        "alpha": 0.3, "beta": 1.0, "least_share": 0.2, "starts": 1, "startup_trials": 10
    }  # fmt: skip
    result = calibrate(project, out=tmp_path / "run").headline
    assert result.loss_name == "relative"
    assert "Converged" in result.status
    assert result.parameters["bar.youngs_modulus"].value == pytest.approx(MODULUS, rel=1e-4)
    assert result.parameters["front.slack[pull]"].value == pytest.approx(SLACK, rel=1e-3)
    kept = load_run(tmp_path / "run")
    assert kept.results["pull"].loss == result.loss
    assert kept.settings.options["least_share"] == 0.2
    recorded = json.loads((tmp_path / "run" / "run.json").read_text(encoding="utf-8"))["settings"]
    assert (recorded["loss"], recorded["least_share"]) == ("relative", 0.2)
    assert "options" not in recorded


def test_a_sweep_tells_it_in_its_unit(relative: ModuleType, tmp_path: Path) -> None:
    project = load(write_project(tmp_path, NAMED))
    swept = sweep(project, over={"bar.youngs_modulus": ["1 MPa", "1.3 MPa"]}, out=tmp_path / "grid")
    assert swept.best[0].section.unit == "%"
    assert "loss relative [%]" in (tmp_path / "grid" / "sweep.csv").read_text(encoding="utf-8").splitlines()[0]


def test_it_keeps_every_promise(relative: ModuleType) -> None:
    for check in CHECKS:
        check(loss_of(relative.RelativeLoss))


def test_workers_that_cannot_import_it_are_not_begun(relative: ModuleType, tmp_path: Path) -> None:
    project = load(write_project(tmp_path, NAMED))
    with pytest.raises(CalibrationError, match=r"cannot be handed to other processes.*relative_loss"):
        calibrate(project, method="grid", trials=9, workers=2)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("least_share: 0.2", "least_share: 2"), r"calibration\.least_share: the share is out of range; got 2"),
        (("least_share: 0.2", "least_shar: 2"), r"calibration\.least_shar: unknown key; .* Try: 'least_share'"),
        (("loss: relative", "loss: relativ"), r"calibration\.loss: there is no such loss; got 'relativ'; .*'relative'"),
    ],
)
def test_faults_of_its_options_are_those_of_any_key(
    relative: ModuleType, tmp_path: Path, change: tuple[str, str], told: str
) -> None:
    with pytest.raises(ProjectFileError, match=told) as error:
        load(write_project(tmp_path, NAMED, change))
    assert len(error.value.faults) == 1


def test_a_run_of_a_loss_that_is_gone_is_refused(tmp_path: Path) -> None:
    path, run = tmp_path / "relative_loss.py", tmp_path / "run"
    imported(path, RELATIVE)
    try:
        calibrate(load(write_project(tmp_path, NAMED)), out=run, method="grid", trials=4)
    finally:
        LOSSES.remove("relative")
    with pytest.raises(InputError, match="there is no such loss"):
        load_run(run)


def test_what_is_no_loss_is_refused(relative: ModuleType) -> None:
    @dataclass(frozen=True)
    class Other(relative.RelativeLoss):
        name = "other"
        options = (Option("starts", quantity("share"), 0.1), Option("seed", quantity("share"), 0.1))

    with pytest.raises(ParameterError) as error:
        register_loss(Other)
    assert "another loss or method has an option of this name" in str(error.value)
    assert "the name is taken by another setting of the calibration; got seed" in str(error.value)
    with pytest.raises(ParameterError, match="'block_value' must be there"):
        register_loss(type("Half", (Loss,), {"name": "half"}))
    with pytest.raises(ParameterError, match="this is not a loss; got 3"):
        register_loss(3)  # type: ignore[arg-type]
    assert "other" not in LOSSES
