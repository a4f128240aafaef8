"""softcal: from bench measurements of a cable-driven or pressurised soft robot to a calibrated finite-element twin.

    project = softcal.load("neck/project.yaml")
    response = softcal.simulate(project, experiment="pull_20mm")
    found = softcal.calibrate(project, out="run")
    softcal.write_report("run")

The public names below are imported when they are first used, so that the package itself loads at once. A package adds
names, as softcal's plugins do, by entry points of the group `softcal.names`.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    __version__: str
    from softcal.analysis.candidate import Candidate as Candidate
    from softcal.analysis.record import RecordFit as RecordFit
    from softcal.calibration.problem.experiment import Experiment as Experiment
    from softcal.calibration.problem.loss import Loss as Loss
    from softcal.calibration.problem.loss import register_loss as register_loss
    from softcal.calibration.problem.option import Option as Option
    from softcal.calibration.problem.parameters import FreeParameter as FreeParameter
    from softcal.calibration.problem.problem import make_problem as make_problem
    from softcal.calibration.problem.uncertain import UncertainParameter as UncertainParameter
    from softcal.calibration.results.result import CalibrationResult as CalibrationResult
    from softcal.calibration.results.result import SweepResult as SweepResult
    from softcal.calibration.search.optimiser import Optimiser as Optimiser
    from softcal.calibration.search.optimiser import Proposal as Proposal
    from softcal.calibration.search.optimiser import register_optimiser as register_optimiser
    from softcal.calibration.search.settings import SearchSettings as SearchSettings
    from softcal.calibration.statistics.estimate import Remark as Remark
    from softcal.cli.command import register_command as register_command
    from softcal.errors import CalibrationError as CalibrationError
    from softcal.errors import DatasetError as DatasetError
    from softcal.errors import Fault as Fault
    from softcal.errors import InputError as InputError
    from softcal.errors import MeshError as MeshError
    from softcal.errors import ParameterError as ParameterError
    from softcal.errors import ProjectFileError as ProjectFileError
    from softcal.errors import SimulationError as SimulationError
    from softcal.errors import SoftcalError as SoftcalError
    from softcal.errors import StorageError as StorageError
    from softcal.errors import UnitError as UnitError
    from softcal.executors.each import executor_on as executor_on
    from softcal.executors.executor import Executor as Executor
    from softcal.executors.executor import register_executor as register_executor
    from softcal.experiments.dataset import Channel as Channel
    from softcal.experiments.dataset import Dataset as Dataset
    from softcal.experiments.step import Setting as Setting
    from softcal.experiments.step import register_step as register_step
    from softcal.export.engine import Engine as Engine
    from softcal.export.engine import register_engine as register_engine
    from softcal.export.vtk import shape_grid as shape_grid
    from softcal.geometry.centreline import helix as helix
    from softcal.geometry.centreline import straight as straight
    from softcal.geometry.mesh import TetMesh as TetMesh
    from softcal.geometry.obstacle import BoxObstacle as BoxObstacle
    from softcal.geometry.obstacle import HalfSpace as HalfSpace
    from softcal.geometry.obstacle import SphereObstacle as SphereObstacle
    from softcal.geometry.primitives import box_mesh as box_mesh
    from softcal.geometry.read import read_mesh as read_mesh
    from softcal.geometry.section import GivenSection as GivenSection
    from softcal.geometry.section import RectangularBar as RectangularBar
    from softcal.geometry.section import RoundBar as RoundBar
    from softcal.geometry.shape import DrawnShape as DrawnShape
    from softcal.geometry.shape import PrimitiveShape as PrimitiveShape
    from softcal.geometry.varied_section import VariedSection as VariedSection
    from softcal.limits import Limit as Limit
    from softcal.materials.catalogue import register_law as register_law
    from softcal.materials.law import Law as Law
    from softcal.materials.parameter import Parameter as Parameter
    from softcal.mechanics.actuator import ActuatorLimits as ActuatorLimits
    from softcal.mechanics.actuator import ActuatorTerm as ActuatorTerm
    from softcal.mechanics.path_limits import PathLimits as PathLimits
    from softcal.mechanics.term import Connectivity as Connectivity
    from softcal.project.project import Project as Project
    from softcal.project.project import load as load
    from softcal.quantities import Quantity as Quantity
    from softcal.quantities import quantity as quantity
    from softcal.report.content import ReportContent as ReportContent
    from softcal.report.figure import Drawing as Drawing
    from softcal.report.figure import register_figure as register_figure
    from softcal.report.section import Gallery as Gallery
    from softcal.report.section import Small as Small
    from softcal.report.section import register_section as register_section
    from softcal.report.style import paper_style as paper_style
    from softcal.report.tables import Column as Column
    from softcal.report.tables import ReportTable as ReportTable
    from softcal.sensing.kind import ChannelKind as ChannelKind
    from softcal.sensing.sensor import ActuatorSensor as ActuatorSensor
    from softcal.sensing.sensor import NamedSensor as NamedSensor
    from softcal.sensing.sensor import Sensor as Sensor
    from softcal.sensing.sensor import register_sensor as register_sensor
    from softcal.twin.actuated import Actuator as Actuator
    from softcal.twin.actuated import NamedActuator as NamedActuator
    from softcal.twin.actuated import register_actuator as register_actuator
    from softcal.twin.actuators.chamber import Chamber as Chamber
    from softcal.twin.actuators.drive import Drive as Drive
    from softcal.twin.barrier import Contact as Contact
    from softcal.twin.cables import CableLine as CableLine
    from softcal.twin.cables import RoutingAxis as RoutingAxis
    from softcal.twin.clamp import Clamp as Clamp
    from softcal.twin.in_time import simulate_in_time as simulate_in_time
    from softcal.twin.linear_system import LinearSystem as LinearSystem
    from softcal.twin.live import Jacobian as Jacobian
    from softcal.twin.live import LiveState as LiveState
    from softcal.twin.live import LiveTwin as LiveTwin
    from softcal.twin.manipulator import Manipulator as Manipulator
    from softcal.twin.manipulator import Springs as Springs
    from softcal.twin.manipulator import manipulator as manipulator
    from softcal.twin.material import Material as Material
    from softcal.twin.material import Winding as Winding
    from softcal.twin.parameters import robot_parameters as robot_parameters
    from softcal.twin.parameters import with_parameters as with_parameters
    from softcal.twin.protocol import Command as Command
    from softcal.twin.protocol import Protocol as Protocol
    from softcal.twin.response import Response as Response
    from softcal.twin.robot import Body as Body
    from softcal.twin.robot import Cable as Cable
    from softcal.twin.robot import Disc as Disc
    from softcal.twin.robot import Marker as Marker
    from softcal.twin.robot import Moment as Moment
    from softcal.twin.robot import Plate as Plate
    from softcal.twin.robot import PointLoad as PointLoad
    from softcal.twin.robot import Robot as Robot
    from softcal.twin.robot import Rod as Rod
    from softcal.twin.robot import SurfaceLoad as SurfaceLoad
    from softcal.twin.robot import Tie as Tie
    from softcal.twin.robot import ViaPoint as ViaPoint
    from softcal.twin.schedule import Schedule as Schedule
    from softcal.twin.schedule import ramp as ramp
    from softcal.twin.time_settings import Settling as Settling
    from softcal.twin.time_settings import TimeSettings as TimeSettings
    from softcal.workflows.calibration import Calibrations as Calibrations
    from softcal.workflows.calibration import calibrate as calibrate
    from softcal.workflows.checking import check as check
    from softcal.workflows.export import ExportOption as ExportOption
    from softcal.workflows.export import ExportRequest as ExportRequest
    from softcal.workflows.export import register_export as register_export
    from softcal.workflows.export import write_export as write_export
    from softcal.workflows.importance import importance as importance
    from softcal.workflows.intervals import intervals as intervals
    from softcal.workflows.linearise import linearise as linearise
    from softcal.workflows.mesh_study import mesh_study as mesh_study
    from softcal.workflows.next_test import next_test as next_test
    from softcal.workflows.reach import reach as reach
    from softcal.workflows.reporting import write_report as write_report
    from softcal.workflows.run_folder import load_run as load_run
    from softcal.workflows.simulation import pull as pull
    from softcal.workflows.simulation import simulate as simulate
    from softcal.workflows.study_source import load_calibrated as load_calibrated
    from softcal.workflows.sweep import Swept as Swept
    from softcal.workflows.sweep import sweep as sweep
    from softcal.workflows.validation import validate as validate
    from softcal.workflows.watching import WatchedPage as WatchedPage
    from softcal.workflows.watching import watch_run as watch_run
    from softcal.workflows.whole_record import compare_records as compare_records
    from softcal.workflows.workspace import workspace as workspace

_HOMES = {
    "Actuator": "softcal.twin.actuated",
    "ActuatorLimits": "softcal.mechanics.actuator",
    "ActuatorSensor": "softcal.sensing.sensor",
    "ActuatorTerm": "softcal.mechanics.actuator",
    "Body": "softcal.twin.robot",
    "BoxObstacle": "softcal.geometry.obstacle",
    "Cable": "softcal.twin.robot",
    "CableLine": "softcal.twin.cables",
    "CalibrationError": "softcal.errors",
    "CalibrationResult": "softcal.calibration.results.result",
    "Calibrations": "softcal.workflows.calibration",
    "Candidate": "softcal.analysis.candidate",
    "Chamber": "softcal.twin.actuators.chamber",
    "Channel": "softcal.experiments.dataset",
    "ChannelKind": "softcal.sensing.kind",
    "Clamp": "softcal.twin.clamp",
    "Column": "softcal.report.tables",
    "Command": "softcal.twin.protocol",
    "Connectivity": "softcal.mechanics.term",
    "Contact": "softcal.twin.barrier",
    "Dataset": "softcal.experiments.dataset",
    "DatasetError": "softcal.errors",
    "Disc": "softcal.twin.robot",
    "Drawing": "softcal.report.figure",
    "DrawnShape": "softcal.geometry.shape",
    "Drive": "softcal.twin.actuators.drive",
    "Engine": "softcal.export.engine",
    "Executor": "softcal.executors.executor",
    "Experiment": "softcal.calibration.problem.experiment",
    "ExportOption": "softcal.workflows.export",
    "ExportRequest": "softcal.workflows.export",
    "Fault": "softcal.errors",
    "FreeParameter": "softcal.calibration.problem.parameters",
    "Gallery": "softcal.report.section",
    "GivenSection": "softcal.geometry.section",
    "HalfSpace": "softcal.geometry.obstacle",
    "InputError": "softcal.errors",
    "Jacobian": "softcal.twin.live",
    "Law": "softcal.materials.law",
    "Limit": "softcal.limits",
    "LinearSystem": "softcal.twin.linear_system",
    "LiveState": "softcal.twin.live",
    "LiveTwin": "softcal.twin.live",
    "Loss": "softcal.calibration.problem.loss",
    "Manipulator": "softcal.twin.manipulator",
    "Marker": "softcal.twin.robot",
    "Material": "softcal.twin.material",
    "MeshError": "softcal.errors",
    "Moment": "softcal.twin.robot",
    "NamedActuator": "softcal.twin.actuated",
    "NamedSensor": "softcal.sensing.sensor",
    "Optimiser": "softcal.calibration.search.optimiser",
    "Option": "softcal.calibration.problem.option",
    "Parameter": "softcal.materials.parameter",
    "ParameterError": "softcal.errors",
    "PathLimits": "softcal.mechanics.path_limits",
    "Plate": "softcal.twin.robot",
    "PointLoad": "softcal.twin.robot",
    "PrimitiveShape": "softcal.geometry.shape",
    "Project": "softcal.project.project",
    "ProjectFileError": "softcal.errors",
    "Proposal": "softcal.calibration.search.optimiser",
    "Protocol": "softcal.twin.protocol",
    "Quantity": "softcal.quantities",
    "RecordFit": "softcal.analysis.record",
    "RectangularBar": "softcal.geometry.section",
    "Remark": "softcal.calibration.statistics.estimate",
    "ReportContent": "softcal.report.content",
    "ReportTable": "softcal.report.tables",
    "Response": "softcal.twin.response",
    "Robot": "softcal.twin.robot",
    "Rod": "softcal.twin.robot",
    "RoundBar": "softcal.geometry.section",
    "RoutingAxis": "softcal.twin.cables",
    "Schedule": "softcal.twin.schedule",
    "SearchSettings": "softcal.calibration.search.settings",
    "Sensor": "softcal.sensing.sensor",
    "Setting": "softcal.experiments.step",
    "Settling": "softcal.twin.time_settings",
    "SimulationError": "softcal.errors",
    "Small": "softcal.report.section",
    "SoftcalError": "softcal.errors",
    "SphereObstacle": "softcal.geometry.obstacle",
    "Springs": "softcal.twin.manipulator",
    "StorageError": "softcal.errors",
    "SurfaceLoad": "softcal.twin.robot",
    "SweepResult": "softcal.calibration.results.result",
    "Swept": "softcal.workflows.sweep",
    "TetMesh": "softcal.geometry.mesh",
    "Tie": "softcal.twin.robot",
    "TimeSettings": "softcal.twin.time_settings",
    "UncertainParameter": "softcal.calibration.problem.uncertain",
    "UnitError": "softcal.errors",
    "VariedSection": "softcal.geometry.varied_section",
    "ViaPoint": "softcal.twin.robot",
    "WatchedPage": "softcal.workflows.watching",
    "Winding": "softcal.twin.material",
    "box_mesh": "softcal.geometry.primitives",
    "calibrate": "softcal.workflows.calibration",
    "check": "softcal.workflows.checking",
    "compare_records": "softcal.workflows.whole_record",
    "executor_on": "softcal.executors.each",
    "helix": "softcal.geometry.centreline",
    "importance": "softcal.workflows.importance",
    "intervals": "softcal.workflows.intervals",
    "linearise": "softcal.workflows.linearise",
    "load": "softcal.project.project",
    "load_calibrated": "softcal.workflows.study_source",
    "load_run": "softcal.workflows.run_folder",
    "make_problem": "softcal.calibration.problem.problem",
    "manipulator": "softcal.twin.manipulator",
    "mesh_study": "softcal.workflows.mesh_study",
    "next_test": "softcal.workflows.next_test",
    "paper_style": "softcal.report.style",
    "pull": "softcal.workflows.simulation",
    "quantity": "softcal.quantities",
    "ramp": "softcal.twin.schedule",
    "reach": "softcal.workflows.reach",
    "read_mesh": "softcal.geometry.read",
    "register_actuator": "softcal.twin.actuated",
    "register_command": "softcal.cli.command",
    "register_engine": "softcal.export.engine",
    "register_executor": "softcal.executors.executor",
    "register_export": "softcal.workflows.export",
    "register_figure": "softcal.report.figure",
    "register_law": "softcal.materials.catalogue",
    "register_loss": "softcal.calibration.problem.loss",
    "register_optimiser": "softcal.calibration.search.optimiser",
    "register_section": "softcal.report.section",
    "register_sensor": "softcal.sensing.sensor",
    "register_step": "softcal.experiments.step",
    "robot_parameters": "softcal.twin.parameters",
    "shape_grid": "softcal.export.vtk",
    "simulate": "softcal.workflows.simulation",
    "simulate_in_time": "softcal.twin.in_time",
    "straight": "softcal.geometry.centreline",
    "sweep": "softcal.workflows.sweep",
    "validate": "softcal.workflows.validation",
    "watch_run": "softcal.workflows.watching",
    "with_parameters": "softcal.twin.parameters",
    "workspace": "softcal.workflows.workspace",
    "write_export": "softcal.workflows.export",
    "write_report": "softcal.workflows.reporting",
}

__all__ = [
    "Actuator",
    "ActuatorLimits",
    "ActuatorSensor",
    "ActuatorTerm",
    "Body",
    "BoxObstacle",
    "Cable",
    "CableLine",
    "CalibrationError",
    "CalibrationResult",
    "Calibrations",
    "Candidate",
    "Chamber",
    "Channel",
    "ChannelKind",
    "Clamp",
    "Column",
    "Command",
    "Connectivity",
    "Contact",
    "Dataset",
    "DatasetError",
    "Disc",
    "Drawing",
    "DrawnShape",
    "Drive",
    "Engine",
    "Executor",
    "Experiment",
    "ExportOption",
    "ExportRequest",
    "Fault",
    "FreeParameter",
    "Gallery",
    "GivenSection",
    "HalfSpace",
    "InputError",
    "Jacobian",
    "Law",
    "Limit",
    "LinearSystem",
    "LiveState",
    "LiveTwin",
    "Loss",
    "Manipulator",
    "Marker",
    "Material",
    "MeshError",
    "Moment",
    "NamedActuator",
    "NamedSensor",
    "Optimiser",
    "Option",
    "Parameter",
    "ParameterError",
    "PathLimits",
    "Plate",
    "PointLoad",
    "PrimitiveShape",
    "Project",
    "ProjectFileError",
    "Proposal",
    "Protocol",
    "Quantity",
    "RecordFit",
    "RectangularBar",
    "Remark",
    "ReportContent",
    "ReportTable",
    "Response",
    "Robot",
    "Rod",
    "RoundBar",
    "RoutingAxis",
    "Schedule",
    "SearchSettings",
    "Sensor",
    "Setting",
    "Settling",
    "SimulationError",
    "Small",
    "SoftcalError",
    "SphereObstacle",
    "Springs",
    "StorageError",
    "SurfaceLoad",
    "SweepResult",
    "Swept",
    "TetMesh",
    "Tie",
    "TimeSettings",
    "UncertainParameter",
    "UnitError",
    "VariedSection",
    "ViaPoint",
    "WatchedPage",
    "Winding",
    "box_mesh",
    "calibrate",
    "check",
    "compare_records",
    "executor_on",
    "helix",
    "importance",
    "intervals",
    "linearise",
    "load",
    "load_calibrated",
    "load_run",
    "make_problem",
    "manipulator",
    "mesh_study",
    "next_test",
    "paper_style",
    "pull",
    "quantity",
    "ramp",
    "reach",
    "read_mesh",
    "register_actuator",
    "register_command",
    "register_engine",
    "register_executor",
    "register_export",
    "register_figure",
    "register_law",
    "register_loss",
    "register_optimiser",
    "register_section",
    "register_sensor",
    "register_step",
    "robot_parameters",
    "shape_grid",
    "simulate",
    "simulate_in_time",
    "straight",
    "sweep",
    "validate",
    "watch_run",
    "with_parameters",
    "workspace",
    "write_export",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("softcal")
        except PackageNotFoundError:  # the source tree alone: as a build of it without git
            return "0.0"
    if name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    elif name in (brought := {} if name.startswith("_") else _brought()):
        value = brought[name].load()
    else:
        raise AttributeError(f"module 'softcal' has no attribute '{name}'")
    globals()[name] = value
    return value


def _brought() -> dict[str, EntryPoint]:
    """The names that plugins and other packages add."""
    from softcal.catalogue import plugin_points

    return {point.name: point for point in plugin_points("softcal.names")}


def __dir__() -> list[str]:
    return sorted({*__all__, *_brought()})
