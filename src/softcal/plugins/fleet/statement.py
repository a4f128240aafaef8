"""Joint statement of a fleet's specimens: populations, factors, laws against the infill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from softcal.display import displayed
from softcal.plugins.fleet.factors import FactorEffect, factor_effects, not_apart
from softcal.plugins.fleet.infill_law import InfillLaw, infill_laws, log_infill
from softcal.plugins.fleet.population import Population, comparisons, population
from softcal.plugins.fleet.specimen import Specimen


@displayed
@dataclass(frozen=True)
class FleetStatement:
    """Joint statement of a fleet's specimens.

    Attributes
    ----------
    done, failed
        Numbers of specimens.
    populations
        The statement of each parameter that two specimens or more have.
    unknown
        Parameter -> why nothing is said of it.
    effects
        The parameters by the factors.
    not_compared
        Factor -> why specimens are not compared by it.
    not_apart
        Pairs of factors of which the second tells the first.
    laws
        Moduli against the infill.
    no_law
        Modulus -> why there is none of it; "E" where there is no such modulus. Empty without an infill.
    same_data
        Specimens that were calibrated with exactly the same measured files.
    """

    done: int
    failed: int
    populations: tuple[Population, ...]
    unknown: Mapping[str, str]
    effects: tuple[FactorEffect, ...]
    not_compared: Mapping[str, str]
    not_apart: tuple[tuple[str, str], ...]
    laws: tuple[InfillLaw, ...]
    no_law: Mapping[str, str]
    same_data: tuple[tuple[str, ...], ...] = ()


def fleet_statement(
    specimens: Sequence[Specimen], factors: Sequence[str], measured: Mapping[str, Sequence[str]] | None = None
) -> FleetStatement:
    """Joint statement of a fleet's specimens.

    Parameters
    ----------
    specimens
        The fleet's specimens.
    factors
        Columns of the table by which specimens are compared.
    measured
        Data files of each specimen, by their paths in the template.
    """
    done = [one for one in specimens if one.state == "DONE"]
    found, unknown = comparisons(done)
    laws, no_law = infill_laws(found, done)
    about = {law.label: log_infill(done) for law in laws}
    effects, not_compared = factor_effects(found, done, factors, about)
    by = [factor for factor in factors if factor not in not_compared]
    same_data: dict[tuple[str, ...], list[str]] = {}
    for specimen in done:
        files = (measured or {}).get(specimen.name, ())
        if files and all(path in specimen.hashes for path in files):
            same_data.setdefault(tuple(specimen.hashes[path] for path in files), []).append(specimen.name)
    return FleetStatement(
        done=len(done),
        failed=len(specimens) - len(done),
        populations=tuple(population(one, len(found), about.get(one.label)) for one in found),
        unknown=unknown,
        effects=effects,
        not_compared=not_compared,
        not_apart=tuple(not_apart(done, by)),
        laws=laws,
        no_law=no_law,
        same_data=tuple(tuple(names) for names in same_data.values() if len(names) > 1),
    )
