"""From the project's `parameters` section to a SearchSpace, and from values given from outside to fixed parameters."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace, search_space
from softcal.errors import Fault, InputError, ParameterError
from softcal.materials.catalogue import LAWS, constants_of
from softcal.project.calibration_schema import ParameterSection, UncertainSection
from softcal.project.document import Findings, KeyPath
from softcal.quantities import QUANTITIES, Quantity
from softcal.sensing.channel import readings
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import ParameterInfo, kind_by_name, kinds_of_quantity, unknown_name
from softcal.units import parse_quantity

OF_RIG = ("frame", "pulleys")
"""Owners of the rig's parameters; all other owners are parts of the robot."""


def build_search(
    sections: Mapping[str, ParameterSection],
    known: Mapping[str, ParameterInfo] | None,
    experiments: Mapping[str, Mapping[str, float]],
    set_ups: Mapping[str, str],
    held: Collection[str],
    findings: Findings,
) -> SearchSpace | None:
    """Search space of the free parameters that are not fixed; None if there are none, or with a fault. Fixing one of
    several tied parameters unties it.

    Without `known`, names are not checked, but bounds are.

    Parameters
    ----------
    sections
        Section of each free parameter.
    known
        Parameters of robot and rig by name; None if unknown, since the robot or an experiment has faults.
    experiments
        Values [SI] of the rig's parameters, by experiment.
    set_ups
        Set-up of each experiment, "" without one.
    held
        Names of fixed parameters.
    findings
        Collects the faults and warnings.

    Raises
    ------
    ParameterError
        Never past this function: `findings` keeps it among the faults of the file.
    """
    n_faults = len(findings.faults)
    free: list[FreeParameter] = []
    for name, section in sections.items():
        path = ("parameters", name)
        targets, kind = named("parameters", name, section, known, findings)
        parameter = None if kind is None else _free(name, section, kind.unit, path, findings)
        left = tuple(target for target in targets if target not in held)
        if parameter is None or name in held or (targets and not left):
            continue
        with findings.at((*path, "of") if section.of else path):
            if known is None:
                quantity = quantity_of((parameter.of or (name,))[0])
                search_space(
                    [replace(parameter, of=(), per_experiment=False, per_set_up=False)],
                    list(experiments),
                    {name: ParameterInfo(name, quantity or QUANTITIES["ratio"], parameter.lower)},
                    experiments,
                )
            else:
                search_space([parameter], list(experiments), known, experiments, set_ups)
            free.append(replace(parameter, of=left) if section.of else parameter)
    if len(findings.faults) > n_faults or known is None or not free:
        return None
    with findings.at(("parameters",)):
        return search_space(free, list(experiments), known, experiments, set_ups)
    return None


Wanted = Mapping[KeyPath, Iterable[str]]
"""Names and patterns of parameters, by their place in the file."""


def wanted_by(key: str, sections: Mapping[str, ParameterSection] | Mapping[str, UncertainSection]) -> Wanted:
    """Names and patterns of the parameters of sections, by their place in the file; `key`: that of the sections."""
    return {(key, name, "of") if one.of else (key, name): one.of or [name] for name, one in sections.items()}


def check_owners(wanted: Wanted, parts: Mapping[str, Iterable[str]] | None, findings: Findings) -> None:
    """Record parameters whose owner is neither a part of the robot nor the rig.

    Parameters
    ----------
    wanted
        Names and patterns of parameters, by their place in the file.
    parts
        Names of the robot's parts by kind, such as "cables"; None if unknown, since the robot has faults.
    findings
        Collects the faults and warnings.
    """
    if parts is None:
        return
    owners = _owners(parts)
    for path, names in wanted.items():
        for name in names:
            owner, is_known = _owner(name, owners)
            if not is_known:
                findings.unknown(path, "part of the robot or the rig", owner, owners)


def check_kinds(wanted: Wanted, parts: Mapping[str, Iterable[str]] | None, findings: Findings) -> None:
    """Record parameters of an existing owner whose last part is no parameter of any kind of part.

    Parameters
    ----------
    wanted
        Names and patterns of parameters, by their place in the file.
    parts
        Names of the robot's parts by kind, such as "cables"; None if unknown, since the robot has faults.
    findings
        Collects the faults and warnings.
    """
    known = (*constants_of(LAWS), *kinds_of_quantity(), *readings(), *(parameter_name(one).kind for one in FRAME))
    for path, names in wanted.items():
        for name in names:
            key, has_owner = parameter_name(name).kind, parts is None or _owner(name, _owners(parts))[1]
            if has_owner and key not in known and not any(mark in key for mark in "*?["):
                findings.unknown(path, "parameter", key, known)


def _owners(parts: Mapping[str, Iterable[str]]) -> list[str]:
    return [*(name for names in parts.values() for name in names), *OF_RIG]


def _owner(wanted: str, owners: Iterable[str]) -> tuple[str, bool]:
    """Owner of a parameter or pattern, as far as it is written out, and whether it exists."""
    literal = re.split(r"[*?[]", wanted)[0]
    begun = parameter_name(literal)
    owner, is_whole = begun.part or begun.kind, bool(begun.part) or literal == wanted
    return owner, any(one == owner if is_whole else one.startswith(owner) for one in owners)


def named(
    key: str,
    name: str,
    section: ParameterSection | UncertainSection,
    known: Mapping[str, ParameterInfo] | None,
    findings: Findings,
) -> tuple[list[str], Quantity | None]:
    """Parameters that an entry of the file names, by its key or by `of`, and their kind of quantity: None, with a
    fault, if no parameter matches. Without `known`, the kind follows from the name alone.

    Parameters
    ----------
    key
        Key of the section in the file, such as "parameters".
    name
        Key of the entry.
    section
        The entry.
    known
        Parameters of robot and rig by name; None if unknown, since the robot or an experiment has faults.
    findings
        Collects the faults and warnings.
    """
    wanted = section.of or [name]
    if known is None:
        return [], quantity_of(wanted[0])
    targets = [target for target in known if any(fnmatchcase(target, one) for one in wanted)]
    if targets:
        return targets, known[targets[0]].quantity
    findings.take((key, name, "of") if section.of else (key, name), [unknown_name(one, known) for one in wanted])
    return [], None


def untied(given: Mapping[str, str | float], sections: Mapping[str, ParameterSection]) -> dict[str, str | float]:
    """Fixed values, with a tied parameter's value set for each parameter or pattern that it ties."""
    found: dict[str, str | float] = {}
    for name, value in given.items():
        section = sections.get(name)
        found.update(dict.fromkeys(section.of, value) if section is not None and section.of else {name: value})
    return found


def held_values(given: Mapping[str, str | float], known: Mapping[str, ParameterInfo]) -> dict[str, float]:
    """Fixed values [SI] of parameters, from text with a unit (`2.3 MPa`) or a number in SI.

    A name may be a pattern, such as `spring*.youngs_modulus`.

    Raises
    ------
    ParameterError
        For names that do not exist, units that do not fit, values outside what is allowed; all faults at once.
    """
    faults: list[Fault] = []
    held: dict[str, float] = {}
    written = [(n, value) for name, value in given.items() for n in names_held([name], known)]
    for name, value in written:
        if name not in known:
            faults.append(unknown_name(name, known))
            continue
        try:
            held[name] = _number(known[name].quantity, name, value)
        except InputError as error:
            faults.extend(error.faults)
    if faults:
        raise ParameterError(faults)
    return held


def names_held(given: Iterable[str], known: Iterable[str]) -> list[str]:
    """The parameters that match names and patterns; a name without a match is kept as it is."""
    there = list(known)
    return [name for wanted in given for name in [n for n in there if fnmatchcase(n, wanted)] or [wanted]]


def rig_value(name: str, value: str | float) -> float:
    """A rig value [SI], from text with a unit or a number in SI.

    Raises
    ------
    UnitError
        Where the unit does not fit.
    ParameterError
        Where the number is outside its range.
    """
    return _number(rig_kind(name) or QUANTITIES["ratio"], name, value)


def _number(kind: Quantity, name: str, value: str | float) -> float:
    """The number [SI] in the range of its kind, from text with a unit or a number in SI."""
    return kind.read(value, where=name) if isinstance(value, str) else kind.checked(float(value), where=name)


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
    with findings.at(path):
        return FreeParameter(
            name,
            unit,
            numbers["bounds.0"],
            numbers["bounds.1"],
            section.scale,
            numbers.get("start"),
            per_experiment=section.per == "experiment",
            prior_mean=numbers.get("prior.mean"),
            prior_sd=numbers.get("prior.sd"),
            of=tuple(section.of or ()),
            per_set_up=section.per == "set_up",
        )
    return None


def quantity_of(name: str) -> Quantity | None:
    """The kind of quantity of a parameter by its name alone; None if the name is ambiguous."""
    return kind_by_name(name) or rig_kind(name)
