"""softcal: from bench measurements of a cable-driven soft robot to a calibrated finite-element twin.

    project = softcal.load("neck/project.yaml")
    response = softcal.simulate(project, experiment="pull_20mm")
    found = softcal.calibrate(project, out="run")
    softcal.write_report("run")

The public names below are imported when they are first used, so that the package itself loads at once.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softcal.calibration.result import CalibrationResult
    from softcal.experiments.dataset import Dataset
    from softcal.project.calibration import Calibrations, calibrate
    from softcal.project.checking import check
    from softcal.project.project import Project, load
    from softcal.project.reporting import write_report
    from softcal.project.run_folder import load_run
    from softcal.project.simulation import pull, simulate
    from softcal.twin.protocol import Command, Protocol
    from softcal.twin.response import Response
    from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint

_HOMES = {
    "load": "softcal.project.project",
    "Project": "softcal.project.project",
    "check": "softcal.project.checking",
    "simulate": "softcal.project.simulation",
    "pull": "softcal.project.simulation",
    "calibrate": "softcal.project.calibration",
    "Calibrations": "softcal.project.calibration",
    "CalibrationResult": "softcal.calibration.result",
    "write_report": "softcal.project.reporting",
    "load_run": "softcal.project.run_folder",
    "Robot": "softcal.twin.robot",
    "Body": "softcal.twin.robot",
    "Plate": "softcal.twin.robot",
    "Cable": "softcal.twin.robot",
    "ViaPoint": "softcal.twin.robot",
    "Protocol": "softcal.twin.protocol",
    "Command": "softcal.twin.protocol",
    "Response": "softcal.twin.response",
    "Dataset": "softcal.experiments.dataset",
}

__all__ = [
    "Body",
    "Cable",
    "CalibrationResult",
    "Calibrations",
    "Command",
    "Dataset",
    "Plate",
    "Project",
    "Protocol",
    "Response",
    "Robot",
    "ViaPoint",
    "calibrate",
    "check",
    "load",
    "load_run",
    "pull",
    "simulate",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'softcal' has no attribute '{name}'")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
