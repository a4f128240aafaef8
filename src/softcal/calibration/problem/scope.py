"""The scope of free and uncertain parameters of the robot and the rig: the experiments in which they have one value."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import TypeVar

from softcal.declare import Checked
from softcal.errors import Fault
from softcal.twin.parameters import ParameterInfo, unknown_name

P = TypeVar("P", bound="ScopedParameter")


@dataclass(frozen=True)
class ScopedParameter(Checked):
    """One value that parameters of the robot or the rig have, in all experiments or in one.

    Attributes
    ----------
    name
        Dotted name of the parameter, or of the common value of tied ones.
    unit
        Its SI unit.
    per_experiment, per_set_up
        Whether it is a nuisance with a value of its own in every experiment, or in every set-up.
    experiment
        After expansion, the experiment or set-up whose value it is; "" when shared.
    of
        Parameters tied to this value; empty for the one that `name` names.
    members
        Experiments of the set-up whose value it is.
    """

    name: str
    unit: str
    per_experiment: bool = field(default=False, kw_only=True)
    per_set_up: bool = field(default=False, kw_only=True)
    experiment: str = field(default="", kw_only=True)
    of: tuple[str, ...] = field(default=(), kw_only=True)
    members: tuple[str, ...] = field(default=(), kw_only=True)

    def _where(self, name: str) -> str:
        return f"{self.name}.{name}"

    def serves(self, *experiments: str) -> bool:
        """Whether it is a parameter of any of these experiments."""
        return not self.experiment or any(e in (self.members or (self.experiment,)) for e in experiments)

    @property
    def targets(self) -> tuple[str, ...]:
        """The parameters of the robot or the rig that have this value."""
        return self.of or (self.name,)

    @property
    def label(self) -> str:
        """The name in results: `front.slack`, or `front.slack[20mm]` for one experiment's or set-up's own."""
        return f"{self.name}[{self.experiment}]" if self.experiment else self.name


def resolved(parameter: P, known: Mapping[str, ParameterInfo]) -> tuple[P, list[Fault]]:
    """The parameter with the patterns among its targets written out, and what no parameter goes by."""
    if not parameter.of:
        return parameter, [] if parameter.name in known else [unknown_name(parameter.name, known)]
    faults: list[Fault] = []
    targets: dict[str, None] = {}
    for wanted in parameter.of:
        matches = [name for name in known if fnmatchcase(name, wanted)]
        if not matches:
            faults.append(unknown_name(wanted, known))
        targets.update(dict.fromkeys(matches))
    if parameter.name in known and parameter.name not in targets:
        faults.append(Fault("the name is that of another parameter", parameter.label, attempt="a name of its own"))
    return replace(parameter, of=tuple(targets) or parameter.of), faults


def expanded(
    parameter: P,
    experiments: Sequence[str],
    own: Mapping[str, Mapping[str, float]] | None = None,
    set_ups: Mapping[str, str] | None = None,
) -> list[P]:
    """The parameter, or that of every experiment or set-up that has one of its own.

    Parameters
    ----------
    parameter, experiments
        The parameter, and the names of the experiments.
    own
        Experiment -> name -> value [SI]; a parameter for each experiment is made for those that have it.
    set_ups
        Experiment -> the set-up it was done in; one that has none, or "", is a set-up by itself.
    """
    if not (parameter.per_experiment or parameter.per_set_up) or parameter.experiment:
        return [parameter]
    target = parameter.targets[0]
    of_rig = own is not None and any(target in held for held in own.values())
    owners: dict[str, tuple[str, ...]] = {}
    for experiment in experiments:
        if not of_rig or target in (own or {}).get(experiment, {}):
            owner = ((set_ups or {}).get(experiment) or experiment) if parameter.per_set_up else experiment
            owners[owner] = (*owners.get(owner, ()), experiment)
    return [
        replace(parameter, experiment=owner, members=() if members == (owner,) else members)
        for owner, members in owners.items()
    ]


def doubled(parameters: Iterable[ScopedParameter], what: str) -> list[Fault]:
    """The faults of values that parameters have twice, alone or tied to others, in all experiments or in one; what: is
    wrong with these.
    """
    holders: dict[str, list[ScopedParameter]] = {}
    for p in parameters:
        for target in p.targets:
            holders.setdefault(target, []).append(p)
    faults: dict[str, Fault] = {}
    for target, found in holders.items():
        scopes = [p.experiment for p in found]
        if len(set(scopes)) == len(scopes) and ("" not in scopes or len(scopes) == 1):
            continue
        labels = [p.label for p in found]
        one = labels[0] if len(set(labels)) == 1 else target
        faults[one] = Fault(what, one, got="" if one in labels else " and ".join(labels))
    return list(faults.values())
