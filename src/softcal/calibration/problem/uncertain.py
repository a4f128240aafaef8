"""Uncertain parameters: of the robot or the rig, not fitted, whose standard deviation is carried into the intervals.

An uncertain parameter c keeps its value in the search. At the minimum of the loss, the residuals change by J_c for each
of its standard deviations, and so do the estimates, by -A^-1 J^T W J_c (`statistics/estimator.py`): what is known
as a considered parameter (Tapley, Schutz and Born 2004, Statistical Orbit Determination, ch. 6). An error of one sign
in all samples, such as that of a load cell's gain, is in no residual: only what is known of it beforehand tells.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

from softcal.calibration.problem.scope import ScopedParameter, doubled, expanded, resolved
from softcal.display import displayed
from softcal.errors import Fault, ParameterError
from softcal.twin.parameters import ParameterInfo

TWICE = "the parameter is uncertain twice"
EACH = " of each experiment"
"""End of the name of a source of error that each experiment, or set-up, has by itself."""
RESERVED = ("noise", "drift", "misfit", "prior", "experiments", "set-ups", "markers", "mesh", "bounds")
"""Sources of error that an uncertain parameter of a user must not be named after."""


def sd_fault(sd: float, unit: str, where: str = "") -> Fault | None:
    """The fault of a standard deviation [unit], or None.

    Parameters
    ----------
    sd, unit
        The standard deviation [unit].
    where
        The parameter, in the message.
    """
    if 0.0 < sd < math.inf:
        return None
    got = f"{sd:.6g}" if unit == "1" else f"{sd:.6g} {unit}"
    return Fault("the standard deviation must be above zero", where, got, attempt="no entry for what is exactly known")


@displayed
@dataclass(frozen=True)
class UncertainParameter(ScopedParameter):
    """A parameter that is not fitted and not exactly known.

    Attributes
    ----------
    sd
        Its standard deviation [unit].
    written
        The name or pattern that the user gave it; "" where it is `name`. Those of one pattern err independently.
    """

    sd: float
    written: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if fault := sd_fault(self.sd, self.unit, self.label):
            raise ParameterError(fault)

    @property
    def source(self) -> str:
        """The name of its share of the variances."""
        name = self.written or self.name
        return f"{name}{EACH}" if self.per_experiment or self.per_set_up else name


MESH_ERROR = UncertainParameter("mesh", "1", sd=1.0)
"""The error of the mesh, in changes of the predictions by a finer one."""


def uncertain_parameters(
    parameters: Iterable[UncertainParameter],
    experiments: Sequence[str],
    known: Mapping[str, ParameterInfo],
    own: Mapping[str, Mapping[str, float]] | None = None,
    set_ups: Mapping[str, str] | None = None,
) -> tuple[UncertainParameter, ...]:
    """One for each value that errs by itself: names with a wildcard written out, nuisances for each experiment.

    Parameters
    ----------
    parameters, experiments
        Uncertain parameters as a user states them, and the names of the experiments.
    known
        Name -> what is known of a parameter of the robot or the rig.
    own
        Experiment -> name -> value [SI] of the rig's parameters.
    set_ups
        Experiment -> the set-up it was done in.

    Raises
    ------
    ParameterError
        For names that do not exist, a wrong unit, or a parameter that is given twice; all faults at once.
    """
    faults: list[Fault] = []
    found: list[UncertainParameter] = []
    for given in parameters:
        is_pattern = not given.of and any(mark in given.name for mark in "*?[")
        matches = [name for name in known if is_pattern and fnmatchcase(name, given.name)]
        for written in [replace(given, name=name, written=given.name) for name in matches] or [given]:
            parameter, unknown = resolved(written, known)
            faults += unknown
            if unknown:
                continue
            label = parameter.label
            faults += [
                Fault("the parameter has another unit", label, parameter.unit, known[target].unit)
                for target in parameter.targets
                if known[target].unit != parameter.unit
            ]
            if parameter.name in RESERVED:
                faults.append(Fault("the name is that of a source of error", label, attempt="another name"))
            found += expanded(parameter, experiments, own, set_ups)
    faults += doubled(found, TWICE)
    if faults:
        raise ParameterError(faults)
    return tuple(found)


def free_and_uncertain(
    uncertain: Iterable[UncertainParameter], experiments: Iterable[str], free: Mapping[str, Collection[str]]
) -> list[Fault]:
    """The faults of uncertain parameters that are free in an experiment too, or a parameter of none of them.

    Parameters
    ----------
    uncertain, experiments
        The uncertain parameters, and the names of the experiments.
    free
        Experiment -> the parameters of the robot and the rig that are free in it.
    """
    faults: list[Fault] = []
    names = list(experiments)
    for p in uncertain:
        served = [name for name in names if p.serves(name)]
        if not served:
            allowed = ", ".join(names)
            faults.append(Fault("the uncertain parameter belongs to no experiment", p.label, allowed=allowed))
        twice = dict.fromkeys(target for name in served for target in p.targets if target in free[name])
        faults += [
            Fault(
                "the parameter is uncertain and free at once",
                target,
                attempt="a prior, or one of the two",
            )
            for target in twice
        ]
    return faults
