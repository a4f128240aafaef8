"""All factorisations solve symmetric indefinite systems given by their upper triangle, again and again."""

import ctypes
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from softcal.errors import SimulationError
from softcal.mechanics import linear_solve
from softcal.mechanics.linear_solve import Accelerate, Pardiso, SuperLU, factorisation

FAKE = Path(__file__).parents[1] / "fake_accelerate" / "sparse.c"
COMPILER = shutil.which("cc") or shutil.which("gcc")
KINDS = [SuperLU]
# On a Mac Apple's own library, elsewhere one with its structures that a compiler of C has laid out.
if sys.platform == "darwin" or (COMPILER is not None and sys.platform == "linux"):
    KINDS.append(Accelerate)
if linear_solve._mkl_pardiso() is not None:
    KINDS.append(Pardiso)


@pytest.fixture(scope="module")
def fake(tmp_path_factory):
    """The functions of Apple's library that softcal calls, where there is a compiler of C."""
    if Accelerate not in KINDS or sys.platform == "darwin":
        return None
    path = tmp_path_factory.mktemp("accelerate") / "sparse.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-w", "-o", str(path), str(FAKE)], check=True)
    return ctypes.CDLL(str(path))


@pytest.fixture(autouse=True)
def accelerate(fake, monkeypatch):
    if fake is not None:
        monkeypatch.setattr(linear_solve, "_accelerate", lambda: fake)


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


needs_fake = pytest.mark.skipif(sys.platform == "darwin" or Accelerate not in KINDS, reason="no fake library here")


@needs_fake
def test_accelerate_is_called_as_documented_and_frees_what_it_made(fake):
    calls = (ctypes.c_char * 100000).in_dll(fake, "calls")
    calls.value = b""
    triangle = upper(saddle())
    factors = Accelerate(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    factors.factorise(triangle.data)
    factors.factorise(2.0 * triangle.data)
    factors.solve(np.ones((75, 2)))
    assert factors.n_negative == 15
    assert factors.solves_per_factorisation == pytest.approx(linear_solve.SOLVES * 75)
    del factors
    assert calls.value.split() == [b"factor", b"refactor", b"solve", b"destroy"]


@needs_fake
def test_accelerate_says_that_a_matrix_is_singular_or_not_finite():
    triangle = upper(saddle())
    factors = Accelerate(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    with pytest.raises(SimulationError, match="75 pivots of zero"):
        factors.factorise(0.0 * triangle.data)
    with pytest.raises(SimulationError, match="not finite"):
        factors.factorise(np.nan * triangle.data)
    factors.factorise(triangle.data)
    assert factors.n_negative == 15


@needs_fake
def test_what_accelerate_refuses_is_said(monkeypatch):
    triangle = upper(saddle())
    monkeypatch.setattr(linear_solve, "_METIS", 4)
    factors = Accelerate(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
    with pytest.raises(SimulationError, match=r"Accelerate: status -4; not as documented"):
        factors.factorise(triangle.data)


@needs_fake
def test_accelerate_stands_in_for_mkl_where_it_is_there(monkeypatch):
    monkeypatch.setattr(linear_solve, "_mkl_pardiso", lambda: None)
    assert isinstance(factorisation(np.array([0, 1]), np.array([0])), Accelerate)


def test_super_lu_stands_in_where_mkl_and_accelerate_are_absent(monkeypatch):
    monkeypatch.setattr(linear_solve, "_mkl_pardiso", lambda: None)
    monkeypatch.setattr(linear_solve, "_accelerate", lambda: None)
    assert isinstance(factorisation(np.array([0, 1]), np.array([0])), SuperLU)


@pytest.mark.parametrize("kind", [one for one in KINDS if one is not Pardiso])
@pytest.mark.skipif(Pardiso not in KINDS, reason="MKL is not installed")
def test_the_twin_gives_the_same_with_each(monkeypatch, kind):
    from mechanics_cases import column_robot, pulled

    from softcal.twin.simulate import simulate

    robot, protocol = column_robot("P2P1", divisions=(1, 1, 4)), pulled(0.01, 0.04)
    fast = simulate(robot, protocol, sensitivities=("neck.poissons_ratio",), curve_tolerance=0.0)
    monkeypatch.setattr(linear_solve, "_mkl_pardiso", lambda: None)
    if kind is SuperLU:
        monkeypatch.setattr(linear_solve, "_accelerate", lambda: None)
    slow = simulate(robot, protocol, sensitivities=("neck.poissons_ratio",), curve_tolerance=0.0)
    for name in ("front.tension", "plate.pitch"):
        np.testing.assert_allclose(slow.channels[name], fast.channels[name], rtol=1e-7)
        np.testing.assert_allclose(
            slow.sensitivities[name]["neck.poissons_ratio"],
            fast.sensitivities[name]["neck.poissons_ratio"],
            rtol=1e-5,
            atol=1e-7,
        )


@pytest.mark.skipif(Pardiso not in KINDS, reason="MKL is not installed")
def test_an_mkl_with_wrong_factors_at_two_levels_factorises_at_one(monkeypatch):
    assert linear_solve.mkl_year() == int(version("mkl").partition(".")[0])
    K, levels = saddle(), []
    triangle = upper(K)
    for year in (2026, 2025):
        monkeypatch.setattr(linear_solve, "mkl_year", lambda year=year: year)
        factors = Pardiso(triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64))
        factors.factorise(triangle.data)
        np.testing.assert_allclose(K @ factors.solve(np.ones(len(K))), 1.0, atol=1e-10)
        levels.append(int(factors._handle.options[23]))
    assert levels == [1, 0]
