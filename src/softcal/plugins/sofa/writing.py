"""Export of a robot as a SOFA scene: files, parameters, a schedule of its pull, and a README."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.errors import InputError
from softcal.export.engine import not_exported
from softcal.html_text import markdown
from softcal.plugins.sofa.identify import Identified, identify
from softcal.plugins.sofa.install import CONDA, ROOT
from softcal.plugins.sofa.robot import command_faults_of_sofa, linear_robot, scene_commands
from softcal.plugins.sofa.rods import SEGMENTS
from softcal.plugins.sofa.scene import (
    ASSUMED_DENSITY,
    PARAMETERS,
    SCHEDULE,
    package_name,
    scene_parameters,
    schedule_csv,
    write_scene,
)
from softcal.plugins.sofa.settings import SofaSettings
from softcal.plugins.sofa.visual import visual_parameters, write_surfaces
from softcal.twin.protocol import Protocol, command_faults
from softcal.twin.robot import Robot
from softcal.twin.time_settings import TimeSettings
from softcal.units import format_quantity

README = "README.md"
PLACE = "the scene"
_AS_THEY_ARE = "- The bodies are those of the project, element by element."


def write_sofa(
    robot: Robot,
    protocol: Protocol,
    folder: Path,
    name: str,
    *,
    experiment: str = "",
    slack: Mapping[str, float] | None = None,
    motion: TimeSettings | None = None,
    settings: SofaSettings | None = None,
) -> list[Path]:
    """Write the robot's scene, with a schedule that drives its actuators as the protocol does, into an existing folder.

    Bodies that SOFA does not support become linear tets with re-identified parameters; see `identify`. Contact is left
    out, and the notes say so.

    Parameters
    ----------
    robot, protocol
        The robot, and its commands.
    folder
        Existing one to write into.
    name
        Name of the project.
    experiment
        Name of the protocol's experiment, if selected among several; for the README.
    slack
        Cable -> travel on the bench minus shortening [m]; for the README.
    motion, settings
        See `scene_parameters`.

    Raises
    ------
    InputError
        For features that a scene cannot represent: friction and stretch of cables; for a pull that no cable can follow,
        or that does not determine the parameters.
    SimulationError
        If parameters are to be identified, and the protocol has no solution.
    """
    if faults := command_faults(robot, protocol) + command_faults_of_sofa(protocol):
        raise InputError(faults)
    found = identify(replace(robot, contact=None), linear_robot(robot), protocol)
    contact = not_exported(robot, PLACE)
    parameters = {
        "name": name,
        **scene_parameters(found.linear, protocol, motion, settings),
        "visual": visual_parameters(found.linear),
        "re_identified": {key: {"twin": old, "scene": new} for key, (old, new) in found.values.items()},
        "differences_left": {
            key: {"largest_difference": value, "of": largest, "unit": unit}
            for key, (value, unit, largest) in found.differences.items()
        },
        "notes": [*contact, *found.sentences],
    }
    package = package_name(name)
    written = [*write_scene(found.linear, parameters, folder, package)]
    written += write_surfaces(found.linear, folder / package)
    if protocol.commands:
        path = folder / package / SCHEDULE
        path.write_text(schedule_csv(scene_commands(robot, protocol)), encoding="utf-8")
        written.append(path)
    path = folder / README
    path.write_text(_readme(name, package, found, protocol, experiment, slack or {}, contact), encoding="utf-8")
    return [*written, path]


def furthest(protocols: Mapping[str, Protocol]) -> str:
    """Name of the protocol with the largest pull, for the scene's only schedule.

    It has the largest shortening; if no protocol prescribes shortenings, the largest angle, else tension, else
    pressure.
    """
    controls = ("shortening", "angle", "tension", "pressure")
    sizes: dict[str, dict[str, float]] = {name: dict.fromkeys(controls, 0.0) for name in protocols}
    for name, protocol in protocols.items():
        for command in protocol.commands.values():
            largest = float(np.abs(command.values).max(initial=0.0))
            sizes[name][command.control] = max(sizes[name].get(command.control, 0.0), largest)
    return max(protocols, key=lambda name: tuple(sizes[name][control] for control in controls))


def _readme(
    name: str,
    package: str,
    found: Identified,
    protocol: Protocol,
    experiment: str,
    slack: Mapping[str, float],
    contact: Sequence[str],
) -> str:
    robot = found.linear.robot
    pulled = ", ".join(f"{cable} by {command.control}" for cable, command in protocol.commands.items())
    if experiment:
        pulled += f", as in experiment `{experiment}` (the one with the largest pull)"
    taken_off = [f"{format_quantity(value, 'm')} of {cable}" for cable, value in slack.items() if value]
    if taken_off:
        pulled += f"; the slack of the bench is subtracted, {', '.join(taken_off)}"
    notes = [f"- {sentence}" for sentence in found.sentences]
    notes += [
        f"- {part.name} has no density in the project; {ASSUMED_DENSITY:g} kg/m^3 gives it inertia"
        + (" and a force balances its weight." if robot.gravity.any() else ".")
        for part in (*robot.bodies, *robot.rods)
        if part.density <= 0.0
    ]
    if robot.rods:
        names = ", ".join(rod.name for rod in robot.rods)
        notes.append(
            f"- {names}: {SEGMENTS} beams for each element of a rod, in the scene twice, from either end, with half of "
            "softcal's stiffness (`rods.py`)."
        )
    keys = (
        ", ".join(f"{i} {part.name}" for i, part in enumerate((*robot.cables, *found.linear.chambers)[:9], start=1))
        or "there are none"
    )
    return _TEXT.format(
        name=markdown(name),
        conda=CONDA,
        root=ROOT,
        package=package,
        parameters=PARAMETERS,
        schedule=f"`{package}/{SCHEDULE}` pulls {pulled}, until a key takes over" if pulled else "There is no schedule",
        keys=keys,
        notes="\n".join([*(f"- {sentence}" for sentence in contact), *(notes or [_AS_THEY_ARE])]),
    )


_TEXT = """# {name}

A SOFA scene written by softcal: SofaPython3 and SoftRobots, SOFA v23.12 to v26.06. Units: m, kg, s, N, Pa.

    {conda}
    runSofa -l SofaPython3 scene.py

{schedule}. Keys (with Ctrl in runSofa's window): a digit chooses a cable or chamber
({keys}), + and - pull and release it, P prints its positions.
Among runSofa's display flags, Visual Models are the surfaces, Interaction Force Fields the cables, and Force Fields,
hidden at first, the tets and beams. Without Sofa.GL there are no surfaces.

Without a window, the robot with slack cables and then every row of the schedule run to rest, into `response.csv`:

    export {root}=/where/SOFA/is       # conda and pixi set it
    python run.py                         # the Python that SOFA's bindings are for

## In your own scene

The folder `{package}` is a Python package with the robot. Copy it, or put this folder on `sys.path`:

    from {package} import add_robot

    def createScene(root):
        root.gravity = [...]                     # and root.dt, a FreeMotionAnimationLoop and a constraint solver
        robot = add_robot(root, "{package}")
        robot.pull({{"CABLE": 0.01}}, root.dt.value)     # m, or N for a cable pulled by force, Pa for a chamber

Gravity, loop and constraint solver are those of the scene; softcal was compared with those in `scene.py`. Several
robots, each from its own package, can be in one scene.

## Files

| file | content |
|---|---|
| `scene.py` | `createScene`: gravity, loop, constraint solver, and the robot |
| `run.py` | runs without a window |
| `{package}/robot.py`, `parts.py`, `rods.py` | `add_robot`: bodies, rods, plates, cables, chambers, loads |
| `{package}/visuals.py`, `*.obj` | the visual model: surfaces, colours, the camera |
| `{package}/{parameters}` | all numbers; the scene reads them each time it is loaded |
| `{package}/*.vtk` | the bodies' meshes |
| `{package}/pulling.py` | keys and schedule |
| `{package}/robot_state.py` | tensions, shortenings, pressures, volumes, poses and markers |

## Remarks

{notes}
- A cable pulled by force has impulses, force times time step, as inputs and outputs in SOFA. The scene multiplies
  and divides; `tension` and `shortening` in `{parameters}` are N and m. So it is with the pressure of a chamber, in Pa.
- `ParameterSet` is mu and Lame's lambda, from `youngs_modulus` and `poissons_ratio` in `{parameters}`.
- The time step and damping in `time` are the project's `dynamics`, by default those of the soft neck's paper. Stiffness
  damping increases the tension while cables are pulled: as if they were pulled `rayleigh_stiffness` seconds longer
  (0.2 s at 2 mm/s: 0.4 mm). Compare with the twin at rest. Stiffness damping also adds energy to a robot that is pulled
  beyond the buckling load without its cable: it then never settles. `run.py` uses `rest` (the project's `engines`, by
  default without such damping). A state that does not settle is repeated with the next of its `time_steps`;
  `--time-step` sets another one.
"""
