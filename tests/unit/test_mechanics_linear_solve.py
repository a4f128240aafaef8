"""Both factorisations solve symmetric indefinite systems given by their upper triangle, again and again."""

import numpy as np
import pytest
import scipy.sparse as sp

from softcal.errors import SimulationError
from softcal.mechanics import linear_solve
from softcal.mechanics.linear_solve import Pardiso, SuperLU, factorisation

KINDS = [SuperLU]
if linear_solve._mkl_pardiso() is not None:
    KINDS.append(Pardiso)


def saddle(n=60, m=15, seed=0):
    """A sparse quasi-definite matrix [A B; B^T -C], dense."""
    rng = np.random.default_rng(seed)
    A = sp.random(n, n, 0.1, random_state=rng).toarray()
    A = A @ A.T + n * np.eye(n)
    B = sp.random(n, m, 0.2, random_state=rng).toarray()
    return np.block([[A, B], [B.T, -0.1 * np.eye(m)]])


def upper(matrix):
    triangle = sp.csr_matrix(np.triu(matrix))
    triangle.sort_indices()
    return triangle


@pytest.mark.parametrize("kind", KINDS)
def test_solves_for_one_and_for_many_right_hand_sides(kind):
    K = saddle()
    triangle = upper(K)
    factors = kind(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    factors.factorise(triangle.data)
    b = np.random.default_rng(1).normal(size=(len(K), 3))
    np.testing.assert_allclose(K @ factors.solve(b), b, atol=1e-10)
    np.testing.assert_allclose(K @ factors.solve(b[:, 0]), b[:, 0], atol=1e-10)
    factors.release()
    factors.release()  # twice does no harm


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_counts_the_negative_eigenvalues(kind, seed):
    K = saddle(seed=seed)
    triangle = upper(K)
    factors = kind(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    lowest = np.linalg.eigvalsh(K)
    between = 0.5 * (lowest[1:] + lowest[:-1])
    for shift in (0.0, 2.0 * lowest[0], *between[[0, 3, 40, -1]], 2.0 * lowest[-1]):
        moved = upper(K - shift * np.eye(len(K)))
        assert np.array_equal(moved.indices, triangle.indices)
        factors.factorise(moved.data)
        assert factors.n_negative == np.count_nonzero(lowest < shift)


@pytest.mark.parametrize("kind", KINDS)
def test_new_values_on_the_same_pattern(kind):
    K = saddle()
    triangle = upper(K)
    factors = kind(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    b = np.ones(len(K))
    for scale in (1.0, 3.0, 1e-6):
        factors.factorise(scale * triangle.data)
        np.testing.assert_allclose(scale * (K @ factors.solve(b)), b, atol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_two_factorisations_do_not_disturb_each_other(kind):
    matrices = [saddle(seed=0), saddle(40, 8, seed=1)]
    triangles = [upper(K) for K in matrices]
    both = [kind(t.indptr.astype(np.int64), t.indices.astype(np.int64)) for t in triangles]
    for factors, t in zip(both, triangles, strict=True):
        factors.factorise(t.data)
    both.reverse()
    matrices.reverse()
    for factors, K in zip(both, matrices, strict=True):
        np.testing.assert_allclose(K @ factors.solve(np.ones(len(K))), 1.0, atol=1e-10)
        factors.release()


def test_super_lu_says_that_a_matrix_is_singular():
    triangle = upper(np.diag([1.0, 0.0, 2.0]) + np.diag([1e-300, 1e-300], 1))
    factors = SuperLU(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    with pytest.raises(SimulationError, match="could not be factorised"):
        factors.factorise(np.zeros(len(triangle.data)))


def test_super_lu_stands_in_where_mkl_is_absent(monkeypatch):
    monkeypatch.setattr(linear_solve, "_mkl_pardiso", lambda: None)
    assert isinstance(factorisation(np.array([0, 1]), np.array([0])), SuperLU)


@pytest.mark.skipif(Pardiso not in KINDS, reason="MKL is not installed")
def test_the_twin_gives_the_same_with_either(monkeypatch):
    from mechanics_cases import column_robot, pulled

    from softcal.twin.simulate import simulate

    robot, protocol = column_robot("P2P1", divisions=(1, 1, 4)), pulled(0.01, 0.04)
    fast = simulate(robot, protocol, sensitivities=("neck.poissons_ratio",), curve_tolerance=0.0)
    monkeypatch.setattr(linear_solve, "_mkl_pardiso", lambda: None)
    slow = simulate(robot, protocol, sensitivities=("neck.poissons_ratio",), curve_tolerance=0.0)
    for name in ("front.tension", "plate.pitch"):
        np.testing.assert_allclose(slow.channels[name], fast.channels[name], rtol=1e-7)
        np.testing.assert_allclose(
            slow.sensitivities[name]["neck.poissons_ratio"],
            fast.sensitivities[name]["neck.poissons_ratio"],
            rtol=1e-5,
            atol=1e-7,
        )
