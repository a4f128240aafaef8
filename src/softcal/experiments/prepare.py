"""Preparation steps: their names in a project, settings with units, and application in order.

In a project each step is a name alone (`find_cycles`), a name with its first setting (`take_branch: loading`), or a
name with settings (`zero: {channel: tension, by: min}`).
"""

from __future__ import annotations

import inspect
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from softcal.errors import DatasetError, Fault, InputError, unknown
from softcal.experiments.dataset import Dataset
from softcal.experiments.driven import actuator_of, driven_among
from softcal.experiments.step import STEPS, PreparationStep
from softcal.limits import LIMITS
from softcal.quantities import QUANTITIES
from softcal.sensing.channel import channel_name, channel_unit, kinds
from softcal.units import parse_quantity

_WRONG = "the setting does not fit"


@dataclass(frozen=True)
class PlannedStep:
    """A step with its settings in SI."""

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def apply(self, dataset: Dataset) -> Dataset:
        """The dataset after this step.

        Raises
        ------
        DatasetError
            If the data do not allow the step.
        """
        of = self.settings.get("channel")
        gaps = [name for name in dataset.incomplete if of in (None, name)]  # a step of one channel leaves the others
        if gaps and not STEPS[self.name].keeps_gaps:
            raise DatasetError(
                Fault(
                    f"{self.name} cannot be applied to missing values",
                    where=dataset.name,
                    got=", ".join(gaps),
                    allowed=", ".join(sorted(name for name, step in STEPS.items() if step.keeps_gaps)),
                    attempt="a file without the rows in which they are missing",
                )
            )
        return STEPS[self.name].function(dataset, **self.settings)


def prepare(dataset: Dataset, steps: Sequence[PlannedStep | Mapping[str, Any] | str]) -> Dataset:
    """The dataset after all steps in order.

    Raises
    ------
    DatasetError
        If a step or setting is unknown (all are reported before any step is applied), or the data do not allow it.
    """
    channels = tuple(dataset.channels)
    planned = parse_steps([step for step in steps if not isinstance(step, PlannedStep)], channels=channels)
    waiting = iter(planned)
    for step in steps:
        dataset = (step if isinstance(step, PlannedStep) else next(waiting)).apply(dataset)
    return dataset


@dataclass(frozen=True)
class _Record:
    """The channels of a record as far as they are known, and those of them that drive the test."""

    channels: Collection[str]
    drives: Collection[str]

    def meant(self, drives: str) -> str:
        """The coordinate or the effort of the driven actuator, as a setting means it that is left out.

        Raises
        ------
        DatasetError
            If there are several actuators, of which none is meant.
        """
        of = driven_among([name for name in self.drives if channel_name(name).kind.drives] or self.channels)
        return of.effort if drives == "effort" else of.along(self.channels)

    @property
    def is_told_by_its_drive(self) -> bool:
        """Whether the record has several actuators, of which one drives the test."""
        there, driving = (
            {actuator_of(name) for name in map(channel_name, names) if name.kind.drives}
            for names in (self.channels, self.drives)
        )
        return len(there) > 1 and len(driving) == 1


def parse_steps(
    steps: Sequence[Mapping[str, Any] | str],
    *,
    where: str = "prepare",
    channels: Collection[str] = (),
    drives: Collection[str] = (),
) -> tuple[PlannedStep, ...]:
    """Steps as a project lists them, with every quantity in SI.

    Parameters
    ----------
    steps
        As a project lists them.
    where
        The key of the list; a fault is located at `where[i].step.setting`.
    channels
        Channels of the record, of whose actuator the units of some settings are; none: those of a cable.
    drives
        Those of them that drive the test.

    Raises
    ------
    DatasetError
        All unknown steps and settings (with the nearest known one), missing ones, and unreadable quantities.
    """
    faults: list[Fault] = []
    record = _Record(channels, drives)
    planned = [_parse_step(step, record, f"{where}[{i}]", faults) for i, step in enumerate(steps)]
    if faults:
        raise DatasetError(faults)
    return tuple(step for step in planned if step is not None)


def _parse_step(step: Mapping[str, Any] | str, record: _Record, where: str, faults: list[Fault]) -> PlannedStep | None:
    entry = {step: None} if isinstance(step, str) else dict(step)
    if len(entry) != 1:
        got = ", ".join(str(key) for key in entry) or "nothing"
        faults.append(Fault("a step is one name with its settings", where=where, got=got))
        return None
    name, given = next(iter(entry.items()))
    if name not in STEPS:
        faults.append(STEPS.unknown(str(name), where))
        return None
    preparation = STEPS[name]
    if given is None:
        given = {}
    elif not isinstance(given, Mapping):
        given = {next(iter(preparation.settings)): given}
    where = f"{where}.{name}"
    former = {setting.former: key for key, setting in preparation.settings.items() if setting.former}
    values: dict[str, Any] = {}
    for as_given, value in given.items():
        key = former.get(str(as_given), str(as_given))
        if key not in preparation.settings:
            faults.append(unknown("unknown setting", where, key, preparation.settings))
            continue
        try:
            values[key] = _parse_setting(preparation, key, value, given, record, f"{where}.{as_given}")
        except InputError as error:
            faults.extend(error.faults)
    for key, setting in preparation.settings.items():
        if setting.kind == "channel" and setting.drives and key not in given and record.is_told_by_its_drive:
            values[key] = record.meant(setting.drives)
    missing = [key for key in preparation.required if key not in given]
    if missing:
        faults.append(Fault("a setting is missing", where=where, got="no " + ", ".join(missing)))
    return PlannedStep(str(name), values)


def _parse_setting(
    preparation: PreparationStep, key: str, value: object, given: Mapping[str, Any], record: _Record, where: str
) -> object:
    setting = preparation.settings[key]
    if setting.choices and isinstance(value, str) and value in setting.choices:
        return value
    match setting.kind:
        case "of channel":
            default = inspect.signature(preparation.function).parameters[setting.channel_from].default
            named = given.get(setting.channel_from, default)
            if named is None:
                try:
                    named = record.meant(preparation.settings[setting.channel_from].drives)
                except DatasetError as error:
                    raise DatasetError([replace(fault, where=where) for fault in error.faults]) from None
            name = channel_name(str(named))
            unit = channel_unit(str(named))
            if setting.drives and name.kind.drives:
                kind = actuator_of(name).kinds[("coordinate", "effort").index(setting.drives)]
                if kind.offset is not None:  # it is one: a slack, a floor of the effort
                    return kind.offset[1].read(value, where=where)
                unit = kind.unit
            if unit is None:
                # That setting is reported as a fault itself; the unit of this one is unknown.
                named = f"a quantity in the unit of the channel that '{setting.channel_from}' names"
                raise _wrong(where, value, named)
            try:
                return parse_quantity(value, unit, where=where)
            except InputError:
                if setting.choices and isinstance(value, str) and not any(c.isdigit() for c in value):
                    more = f", or a quantity such as '1 {unit}'"
                    fault = unknown(_WRONG, where, value, setting.choices, got=repr(value), more=more)
                    raise DatasetError(fault) from None
                raise
        case "count":
            if isinstance(value, int) and not isinstance(value, bool) and value >= 0:
                if value:
                    LIMITS[setting.of].check(value, where=where)
                return value
            raise _wrong(where, value, "a whole number, 0 or more")
        case "flag":
            if isinstance(value, bool):
                return value
            raise _wrong(where, value, "true or false")
        case "channel":
            if isinstance(value, str) and channel_unit(value) is not None:
                return value
            raise DatasetError(unknown(_WRONG, where, str(value), kinds(), got=repr(value)))
        case "cycles":
            if isinstance(value, Sequence) and not isinstance(value, str) and value:
                numbers: list[object] = list(value)
                if all(isinstance(number, int) and not isinstance(number, bool) for number in numbers):
                    return numbers
            more = ", or a list of cycle numbers"
            raise DatasetError(unknown(_WRONG, where, str(value), setting.choices, got=repr(value), more=more))
        case "choice":
            raise DatasetError(unknown(_WRONG, where, str(value), setting.choices, got=repr(value)))
        case quantity:
            return QUANTITIES[quantity].read(value, where=where)


def _wrong(where: str, value: object, allowed: str) -> DatasetError:
    return DatasetError(Fault(_WRONG, where=where, got=repr(value), allowed=allowed))
