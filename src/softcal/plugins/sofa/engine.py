"""SOFA: run to rest under the commands themselves, for a comparison or in the place of softcal's statics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softcal.calibration.problem.problem import Simulate
from softcal.errors import InputError
from softcal.export.engine import Engine, EngineState, Running, register_engine, state_of
from softcal.plugins.sofa.install import find_sofa
from softcal.plugins.sofa.robot import linear_robot, scene_faults
from softcal.plugins.sofa.settings import SofaSettings
from softcal.plugins.sofa.simulator import sofa_engine
from softcal.sensing.sensors.actuators import PRESSURE, VOLUME
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot


def _missing() -> str:
    try:
        find_sofa()
    except InputError as error:
        return str(error)
    return ""


def _solve(robot: Robot, protocol: Protocol, shape: Snapshot, running: Running) -> EngineState:
    """Solve with SOFA, run to rest under the protocol's commands; for that of a volume, under softcal's pressure."""
    pressures = {
        name: Command(PRESSURE.name, np.array([shape.efforts[name]]))
        for name, command in protocol.commands.items()
        if command.control == VOLUME.name
    }
    protocol = Protocol({**protocol.commands, **pressures})
    settings = running.settings if isinstance(running.settings, SofaSettings) else SofaSettings()
    engine = sofa_engine(replace(settings, timeout=running.timeout or settings.timeout))
    found = state_of(engine(robot, protocol, snapshots=True))
    given = {name: command.control for name, command in protocol.commands.items()}
    kinds = {part.name: part.channels for part in robot.actuated}

    def answers(values: Mapping[str, float], i: int) -> dict[str, float]:
        """Without what is commanded."""
        return {name: value for name, value in values.items() if given.get(name) != kinds[name][i].name}

    return replace(found, efforts=answers(found.efforts, 1), coordinates=answers(found.coordinates, 0))


def _strain_of_rods(shape: Snapshot) -> tuple[float, str]:
    """SOFA's beams neglect axial and shear strain in the balance of moments; see docs/sofa.md, Rods."""
    if not shape.rod_strains:
        return 0.0, ""
    rod = max(shape.rod_strains, key=lambda name: shape.rod_strains[name])
    strain = shape.rod_strains[rod]
    return strain, f"the strain of beam axes in the balance of moments, here {strain:.1e} in {rod}"


def _simulator(settings: SofaSettings, robot: Robot) -> Simulate:
    engine = sofa_engine(settings)
    engine.require(robot)
    return engine


def _as_it_has_it(robot: Robot) -> Robot:
    return linear_robot(robot).robot.as_clamped


engine = register_engine(
    Engine("sofa", _as_it_has_it, _missing, _solve, scene_faults, _strain_of_rods, _simulator, SofaSettings)
)
