"""From the project's `uncertain` section to parameters that are neither fitted nor exactly known."""

from __future__ import annotations

from collections.abc import Mapping

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.uncertain import UncertainParameter, free_and_uncertain, sd_fault, uncertain_parameters
from softcal.errors import ParameterError
from softcal.project.calibration_schema import UncertainSection
from softcal.project.document import Findings
from softcal.project.search import named
from softcal.twin.parameters import ParameterInfo
from softcal.units import parse_quantity


def build_uncertain(
    sections: Mapping[str, UncertainSection],
    known: Mapping[str, ParameterInfo] | None,
    experiments: Mapping[str, Mapping[str, float]],
    set_ups: Mapping[str, str],
    space: SearchSpace | None,
    findings: Findings,
) -> tuple[UncertainParameter, ...]:
    """Uncertain parameters, each expanded; those with a fault, which goes to `findings`, are left out.

    Without `known`, names are not checked, but standard deviations are.

    Parameters
    ----------
    sections
        Section of each uncertain parameter.
    known
        Parameters of robot and rig by name; None if unknown, since the robot or an experiment has faults.
    experiments
        Values [SI] of the rig's parameters, by experiment.
    set_ups
        Set-up of each experiment, "" without one.
    space
        Search space of the free parameters; None without one.
    findings
        Collects the faults and warnings.

    Raises
    ------
    ParameterError
        Never past this function: `findings` keeps it among the faults of the file.
    """
    given: list[UncertainParameter] = []
    for name, section in sections.items():
        path = ("uncertain", name)
        targets, kind = named("uncertain", name, section, known, findings)
        if kind is None:
            continue
        with findings.at((*path, "sd")):
            sd = parse_quantity(section.sd, kind.unit)
            if fault := sd_fault(sd, kind.unit):
                raise ParameterError(fault)
            with findings.at(path):
                one = UncertainParameter(
                    name,
                    kind.unit,
                    sd,
                    of=tuple(section.of or ()),
                    per_experiment=section.per == "experiment",
                    per_set_up=section.per == "set_up",
                )
                if targets and known is not None:
                    uncertain_parameters([one], list(experiments), known, experiments, set_ups)
                    given.append(one)
    if known is None:
        return ()
    with findings.at(("uncertain",)):
        found = uncertain_parameters(given, list(experiments), known, experiments, set_ups)
        free = {name: space.free_in(name) if space is not None else set[str]() for name in experiments}
        if faults := free_and_uncertain(found, experiments, free):
            raise ParameterError(faults)
        return found
    return ()
