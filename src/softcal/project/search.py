"""From the project's `parameters` section to a SearchSpace, and values given from outside to parameters held."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from softcal.calibration.parameters import FreeParameter, SearchSpace, search_space
from softcal.errors import Fault, ParameterError, UnitError
from softcal.project.calibration_schema import ParameterSection
from softcal.project.document import Findings, KeyPath
from softcal.twin.parameters import KINDS, ParameterInfo, out_of_range, unknown_name
from softcal.units import parse_quantity

# The units of rig parameters, by the last part of the dotted name; those of the robot stand in `KINDS`.
RIG_UNITS = {"slack": "m", "tension_offset": "N", "pitch_offset": "rad", "roll_offset": "rad", "yaw_offset": "rad"}


def build_search(
    sections: Mapping[str, ParameterSection],
    known: Mapping[str, ParameterInfo] | None,
    experiments: Sequence[str],
    held: Mapping[str, object],
    findings: Findings,
) -> SearchSpace | None:
    """The search space of the free parameters that are not held, or None where there is none or a fault.

    known: the parameters there are; None where the robot or an experiment has faults of its own, so that names cannot
    be checked, but bounds still are.

    Raises
    ------
    ParameterError
        Never past this function: `findings` keeps it among the faults of the file.
    """
    n_faults = len(findings.faults)
    free: list[FreeParameter] = []
    for name, section in sections.items():
        path = ("parameters", name)
        if known is not None and name not in known:
            with findings.at(path):
                raise ParameterError(unknown_name(name, known))
            continue
        unit = known[name].unit if known is not None else _unit_by_name(name)
        parameter = None if unit is None else _free(name, section, unit, path, findings)
        if parameter is None or name in held:
            continue
        with findings.at(path):
            search_space([parameter], list(experiments), known or {name: _guess(name, parameter)})
            free.append(parameter)
    if len(findings.faults) > n_faults or known is None or not free:
        return None
    with findings.at(("parameters",)):
        return search_space(free, list(experiments), known)
    return None


def held_values(given: Mapping[str, str | float], known: Mapping[str, ParameterInfo]) -> dict[str, float]:
    """Values [SI] of parameters given as text with a unit (`2.3 MPa`) or as a number in SI.

    Raises
    ------
    ParameterError
        For names that do not exist, units that do not fit, values outside what is allowed; all faults at once.
    """
    faults: list[Fault] = []
    held: dict[str, float] = {}
    for name, value in given.items():
        if name not in known:
            faults.append(unknown_name(name, known))
            continue
        try:
            held[name] = parse_quantity(value, known[name].unit, where=name) if isinstance(value, str) else float(value)
        except UnitError as error:
            faults.extend(error.faults)
            continue
        if fault := out_of_range(known[name], held[name]):
            faults.append(fault)
    if faults:
        raise ParameterError(faults)
    return held


def rig_value(name: str, value: str | float) -> float:
    """A rig value [SI] given as text with a unit or as a number in SI.

    Raises
    ------
    UnitError
        Where the unit does not fit.
    """
    unit = RIG_UNITS.get(name.rsplit(".", 1)[-1], "1")
    return parse_quantity(value, unit, where=name) if isinstance(value, str) else float(value)


def _free(name: str, section: ParameterSection, unit: str, path: KeyPath, findings: Findings) -> FreeParameter | None:
    numbers: dict[str, float] = {}
    given = {("bounds", 0): section.bounds[0], ("bounds", 1): section.bounds[1]}
    optional = {("start",): section.start}
    if section.prior is not None:
        optional |= {("prior", "mean"): section.prior.mean, ("prior", "sd"): section.prior.sd}
    for key, value in {**given, **{k: v for k, v in optional.items() if v is not None}}.items():
        with findings.at((*path, *key)):
            numbers[".".join(map(str, key))] = parse_quantity(value, unit)
    if len(numbers) < len(given) + sum(value is not None for value in optional.values()):
        return None
    return FreeParameter(
        name,
        unit,
        numbers["bounds.0"],
        numbers["bounds.1"],
        section.scale,
        numbers.get("start"),
        section.per == "experiment",
        numbers.get("prior.mean"),
        numbers.get("prior.sd"),
    )


def _unit_by_name(name: str) -> str | None:
    kind = name.rsplit(".", 1)[-1]
    return KINDS[kind][0] if kind in KINDS else RIG_UNITS.get(kind)


def _guess(name: str, parameter: FreeParameter) -> ParameterInfo:
    kind = name.rsplit(".", 1)[-1]
    unit, lower, upper = KINDS.get(kind, (parameter.unit, -math.inf, math.inf))
    return ParameterInfo(name, unit, parameter.lower, lower, upper)
