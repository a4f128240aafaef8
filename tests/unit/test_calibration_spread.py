"""The interval of a further test: it contains that test's value as often as it says, whatever the errors come from."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.uncertain import MESH_ERROR
from softcal.calibration.statistics.random_effects import Spread
from softcal.calibration.statistics.sensitivity import local_statistics

K, TRUE = "spring.stiffness", 1000.0  # N/m
SIGMA = 0.1  # N
PULL = np.linspace(1e-3, 30e-3, 20)  # m
STUDIES = 100


def study(tests: int, differ: float, mesh: float, chance: np.random.Generator) -> tuple[Spread | None, float]:
    """The comparison of pulls of springs that differ by a share, each with its own zero of the force, by a twin whose
    mesh is too stiff or too soft by a share of about `mesh`; and the stiffness of one more spring.
    """
    own = TRUE * (1 + differ * chance.standard_normal(tests + 1))
    zeros = [FreeParameter("zero", "N", -5.0, 5.0, experiment=f"pull{i}") for i in range(tests)]
    space = SearchSpace((FreeParameter(K, "N/m", 500.0, 2000.0), *zeros))
    stiffer = 1 + mesh * chance.standard_normal()
    measured = [one * PULL + SIGMA * chance.standard_normal(len(PULL)) for one in own[:-1]]
    jacobians = [np.column_stack([stiffer * PULL, *(np.eye(tests)[[i] * len(PULL)].T)]) for i in range(tests)]
    found = np.linalg.lstsq(np.concatenate(jacobians), np.concatenate(measured), rcond=None)[0]
    blocks = [
        Block(name, "tension", seen, J @ found - seen, SIGMA, J, systematic=mesh * (J[:, :1] * found[0]))
        for name, seen, J in zip((p.experiment for p in zeros), measured, jacobians, strict=True)
    ]
    theta = dict(zip(space.labels, found.tolist(), strict=True))
    return local_statistics(space, LikelihoodLoss(), theta, blocks, (MESH_ERROR,)).spreads.get(K), float(own[-1])


def further_tests(tests: int, differ: float, mesh: float, studies: int) -> list[tuple[float, float, float]]:
    """Ends of the interval, and the value of the further test, in studies that find the tests different."""
    found: list[tuple[float, float, float]] = []
    for seed in range(studies):
        one, further = study(tests, differ, mesh, np.random.default_rng([seed, tests]))
        if one is not None and one.differs and one.next_interval is not None:
            found.append((*one.next_interval, further))
    return found


@pytest.mark.slow
def test_only_what_the_tests_themselves_say_has_few_degrees_of_freedom() -> None:
    """Three tests give their spread two degrees of freedom, t = 4.3; the error of the mesh is known."""
    by_mesh, by_tests = (
        np.median([(high - low) / (2 * TRUE) for low, high, _ in further_tests(3, differ, mesh, 12)])
        for differ, mesh in ((0.01, 0.1), (0.1, 1e-6))
    )
    assert 1.7 * 0.1 < by_mesh < 2.3 * 0.1
    assert by_tests > 3 * 0.1


@pytest.mark.slow  # 100 studies each
@pytest.mark.parametrize(  # every two values of two of them are together once
    ("tests", "differ", "mesh"),
    [
        (3, 0.02, 1e-6),
        *(
            pytest.param(*of, marks=pytest.mark.long)
            for of in ((3, 0.06, 0.06), (4, 0.02, 0.06), (4, 0.06, 1e-6), (8, 0.02, 1e-6), (8, 0.06, 0.06))
        ),
    ],
)
def test_it_contains_the_value_of_a_further_test(tests: int, differ: float, mesh: float) -> None:
    found = further_tests(tests, differ, mesh, STUDIES)
    assert len(found) > 0.9 * STUDIES
    share = np.mean([low <= further <= high for low, high, further in found])
    assert 0.90 <= share <= 0.99, share
