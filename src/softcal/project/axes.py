"""The axes of a sweep in text form: values and ranges start:stop:step, every number with its unit."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from softcal.calibration.problem.parameters import FreeParameter
from softcal.errors import Fault, InputError, ParameterError
from softcal.limits import LIMITS
from softcal.twin.parameters import ParameterInfo, out_of_range, unknown_name
from softcal.units import format_quantity, parse_quantity

# More values than anyone can wait for come from a step in the wrong unit.
_DIGITS = 12  # of a value: 0.5 - 3 * 0.05 is 0.35
# The nearest ratio to an incompressible material's that is computed with.
_NEAREST_RATIO = 0.4999


@dataclass(frozen=True)
class Axis:
    """A swept parameter: its name in the sweep, the parameters it sets, its unit, and its values [unit, SI]
    in order.
    """

    name: str
    targets: tuple[str, ...]
    unit: str
    values: tuple[float, ...]

    @property
    def parameter(self) -> FreeParameter:
        """The axis as a parameter of the grid's search space."""
        of = () if self.targets == (self.name,) else self.targets
        return FreeParameter(self.name, self.unit, min(self.values), max(self.values), of=of)


def parse_axis(
    name: str,
    written: Sequence[str | float],
    known: Mapping[str, ParameterInfo],
    tied: Mapping[str, Sequence[str]],
) -> Axis:
    """Axis of a parameter, of parameters that are tied under a name, or of all that match a pattern.

    Parameters
    ----------
    name
        Name or pattern of the parameter.
    written
        Numbers in SI, or as text values (`0.45`, `2.3 MPa`) and ranges (`10 GPa:1 GPa:1 GPa`; the stop is the last
        value where a step reaches it), one to an entry or several with commas between. A step is the difference of
        values; without a sign it goes from the start towards the stop.
    known
        Parameters by name.
    tied
        Names or patterns of tied parameters, by the name that ties them.

    Raises
    ------
    ParameterError
        For a name that does not exist, a range or step that makes no sense, or a value that the parameter may not have
        (such as a Poisson's ratio of 0.5), with the nearest that it may.
    UnitError
        For a unit that is missing or wrong.
    """
    # Brackets mark the owner of a value in results, so a pattern must not contain a class of characters.
    wanted = tied.get(name, [] if "[" in name else [name])
    targets = tuple(target for target in known if any(fnmatchcase(target, one) for one in wanted))
    if not targets:
        raise ParameterError(unknown_name(name, {**known, **dict.fromkeys(tied)}))
    info = known[targets[0]]
    entries = (entry if isinstance(entry, str) else f"{entry} {info.unit}" for entry in written)
    terms = [part.strip() for entry in entries for part in entry.split(",")]
    faults: list[Fault] = []
    values: list[float] = []
    for term in terms:
        try:
            values += _range(term, info.unit, name) if ":" in term else [_number(term, info.unit, name)]
        except InputError as error:
            faults += error.faults
    faults = faults or _value_faults(name, values, terms, [known[target] for target in targets])
    if faults:
        raise ParameterError(faults)
    return Axis(name, targets, info.unit, tuple(values))


def shown_configurations(
    show: Mapping[str, Mapping[str, str | float]],
    known: Mapping[str, ParameterInfo],
    tied: Mapping[str, Sequence[str]],
) -> dict[str, dict[str, float]]:
    """The configurations that a sweep shows, as values [SI] by parameter.

    Parameters
    ----------
    show
        Values as written, by configuration and parameter.
    known
        Parameters by name.
    tied
        Names or patterns of tied parameters, by the name that ties them.

    Raises
    ------
    ParameterError
        For a name that does not exist, or a value that the parameter may not have; all faults at once.
    """
    found: dict[str, dict[str, float]] = {name: {} for name in show}
    faults: list[Fault] = []
    for configuration, key, written in ((c, key, written) for c in show for key, written in show[c].items()):
        wanted = tied.get(key, [key])
        targets = [known[target] for target in known if any(fnmatchcase(target, one) for one in wanted)]
        if not targets:
            faults.append(unknown_name(key, {**known, **dict.fromkeys(tied)}))
            continue
        try:
            value = _number(str(written), targets[0].unit, f"{configuration}, {key}")
        except InputError as error:
            faults += error.faults
            continue
        faults += [fault for info in targets[:1] if (fault := out_of_range(info, value))]
        found[configuration][key] = value
    if faults:
        raise ParameterError(faults)
    return found


def doubled(axes: Sequence[Axis], held: Collection[str]) -> list[Fault]:
    """Faults of parameters that are swept twice, or both swept and fixed."""
    faults: list[Fault] = []
    seen: dict[str, str] = {}
    for axis in axes:
        if held_here := [target for target in axis.targets if target in held]:
            faults.append(Fault("the parameter is fixed and swept at once", axis.name, ", ".join(held_here)))
        both = dict.fromkeys(seen[target] for target in axis.targets if target in seen)
        faults += [Fault("the parameter is swept twice", axis.name, f"also by {other}") for other in both]
        seen |= dict.fromkeys(axis.targets, axis.name)
    return faults


def cells_fault(axes: Sequence[Axis]) -> Fault | None:
    """Fault of a grid with more cells than allowed; None otherwise."""
    return LIMITS["cells of a grid"].fault(math.prod(len(axis.values) for axis in axes))


def _number(text: str, unit: str, name: str) -> float:
    return float(f"{parse_quantity(text, unit, where=name):.{_DIGITS}g}")


def _range(text: str, unit: str, name: str) -> list[float]:
    parts = text.split(":")
    if len(parts) != 3:
        raise ParameterError(Fault("a range has a start, a stop and a step", name, f"'{text}'", "start:stop:step"))
    start, stop, step = (_number(part, unit, name) for part in parts)
    if start == stop:
        raise ParameterError(Fault("the range is empty: start and stop are equal", name, f"'{text}'"))
    if step == 0:
        raise ParameterError(Fault("the step is zero", name, f"'{text}'", "a distance between values"))
    span = stop - start
    if step < 0 < span:
        raise ParameterError(
            Fault("the step leads away from the stop", name, f"'{text}'", "a step of the other sign, or without one")
        )
    LIMITS["values on an axis"].check(1 + abs(span / step), where=name)
    n = int(abs(span / step) + 1e-6) + 1
    signed = abs(step) if span > 0 else -abs(step)
    return [float(f"{start + k * signed:.{_DIGITS}g}") for k in range(n)]


def _value_faults(
    name: str, values: Sequence[float], terms: Sequence[str], infos: Sequence[ParameterInfo]
) -> list[Fault]:
    faults: list[Fault] = []
    unit = infos[0].unit
    twice = next((value for value in values if values.count(value) > 1), None)
    if not values:
        faults.append(Fault("the axis has no values", name, attempt="a range, such as 1MPa:4MPa:0.5MPa"))
    elif twice is not None:
        faults.append(Fault("a value appears twice", name, format_quantity(twice, unit)))
    elif len(values) < 2:
        got = format_quantity(values[0], unit)
        attempt = f"--set {name}={got} fixes it there"
        faults.append(Fault("a sweep needs two values or more", name, got, attempt=attempt))
    for value in values:
        fault = next((found for info in infos if (found := out_of_range(info, value)) is not None), None)
        if fault is None:
            continue
        if unit == "1" and name.endswith("poissons_ratio") and value >= 0.5:
            what = (
                "Poisson's ratio must stay below 0.5: there the volume cannot change and the bulk modulus has no limit"
            )
            allowed = f"-1 < ratio < 0.5, the nearest being {_NEAREST_RATIO}"
            kept: list[str] = []  # the nearest ratio in the place of those that are not allowed
            for term in terms:
                ratios = _range(term, "1", "") if ":" in term else [_number(term, "1", "")]
                below = [ratio for ratio in ratios if ratio < 0.5]
                kept += [f"{_NEAREST_RATIO}"] * (len(below) < len(ratios))
                if len(below) > 2 and ":" in term:
                    kept.append(f"{below[0]:g}:{below[-1]:g}:{term.split(':')[2].strip()}")
                else:
                    kept += [f"{ratio:g}" for ratio in below]
            attempt = f"{name}={','.join(dict.fromkeys(kept))}"
            return [*faults, Fault(what, name, f"{value:g}", allowed, attempt)]
        return [*faults, Fault(fault.what, name, fault.got, fault.allowed)]
    return faults
