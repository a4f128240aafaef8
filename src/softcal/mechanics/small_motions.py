"""Small motions about an equilibrium, in a few modes and the static responses to efforts.

    M q'' + C q' + K q = B u

K is the tangent of the statics, bordered by the actuators of prescribed coordinate: these are constraints. M is that of
the robot's inertia, zero on pressures and efforts. C is what damping adds to the tangent of a time step from the
equilibrium, times its length: there it is linear in 1 / h, however short the step is.

*Modes.* Lanczos' method on K^-1 M in the scalar product of M (`eigsh` in shift-invert), each product one solve with the
bordered factors. With x = K^-1 M y / |.| of a mode y and its value mu = 1 / omega^2, some exact value lies within
|K^-1 M x - mu x|_M / |x|_M of mu: that is the error stated.

*Basis.* The modes, then the static response to each input, orthonormal in the energy of K. So K's Galerkin form has the
exact static response to every input, at any number of modes. Last it is turned so that M = 1 and K is diagonal: the
modes stay as they are, and each static response becomes a mode of its own with what the modes leave of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, ParameterError, SimulationError
from softcal.mechanics.damping import Damping
from softcal.mechanics.free_modes import exclude_free_modes
from softcal.mechanics.inertia import Inertia, Rates
from softcal.mechanics.linearisation import Linearisation
from softcal.mechanics.march import by_command
from softcal.mechanics.state import State, moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls, Theta
from softcal.mechanics.time_step import at_rest, in_step

SHORT = 1e-6  # [s]: a step in whose tangent nothing of the damping is lost by rounding
BESIDE = 1e-5  # of the robot's extent: on either side for a derivative along a path
NEW = 1e-9  # of a static response: what the basis has of it already up to that is rounding
MASSLESS = 1e-15  # of the largest 1 / omega^2
MOST_SHARE = 4  # unknowns for each mode, at least

Product = Callable[[Floats], Floats]  # a matrix times columns (n_unknowns, k)


@dataclass(frozen=True)
class SmallMotions:
    """Small motions in a basis in which M is the unit matrix and K diagonal.

    Attributes
    ----------
    basis
        Motions of the unknowns (n_unknowns, k).
    frequencies
        Angular frequencies of the modes without damping (n_modes,) [rad/s].
    errors
        Bounds of their relative errors (n_modes,), those of the mesh apart.
    next_frequency
        That of the first mode left out [rad/s].
    damping, stiffness
        C [1/s] and K [1/s^2] (k, k).
    inputs
        B (k, n_inputs).
    wider
        The basis with its responses to its damping's forces (n_unknowns, at most 2 k): with these, damped motions are
        right to second order, and so are the derivatives of their poles.
    """

    basis: Floats
    frequencies: Floats
    errors: Floats
    next_frequency: float
    damping: Floats
    stiffness: Floats
    inputs: Floats
    wider: Floats


def small_motions(
    statics: Statics,
    inertia: Inertia,
    damping: Damping,
    state: State,
    controls: Controls,
    inputs: Ints,
    n_modes: int,
) -> SmallMotions:
    """The small motions about an equilibrium.

    Parameters
    ----------
    statics
        The system at its parameters.
    inertia
        Its mass.
    damping
        Its damping.
    state, controls
        The equilibrium.
    inputs
        Numbers of the actuators whose efforts are the inputs, each at a prescribed effort.
    n_modes
        Number of modes.

    Raises
    ------
    ParameterError
        For too many modes.
    SimulationError
        Where there is no linear form: friction, dead moments, an equilibrium that is free or unstable; where an input
        moves no mass.
    """
    system = statics.system
    n, moving = system.layout.first_effort_unknown, system.layout.first_pressure_unknown
    if MOST_SHARE * n_modes > moving:
        raise ParameterError(Fault("too many modes", "modes", str(n_modes), f"at most {moving // MOST_SHARE}"))
    at = system.linearise(state, controls, statics.theta)
    require_linear(statics, at, state)
    statics.factorise(at)
    if exclude_free_modes(statics, at).size:
        raise SimulationError("The robot moves freely, without a force to bring it back: a frequency is zero.")
    if statics.n_unstable() != 0:
        raise SimulationError("The equilibrium is not stable: small motions about it grow.")
    mass = mass_tangent(system, inertia, state)

    def times_mass(x: Floats) -> Floats:
        return system.tangent_times(mass, x)

    def stiff(x: Floats) -> Floats:
        return system.tangent_times(at, x)

    values, modes = _modes(statics, times_mass, stiff, n_modes + 1)
    modes = statics.solve(times_mass(modes))
    modes[n:][controls.is_held] = 0.0
    again = statics.solve(times_mass(modes))
    left = again - modes * values
    size = np.sqrt(np.einsum("nk,nk->k", modes, times_mass(modes)))
    errors = 0.5 * np.sqrt(np.abs(np.einsum("nk,nk->k", left, times_mass(left)))) / size / values  # of a root, half
    responses = by_command(statics, state, controls, controls, inputs)
    responses[n:][controls.is_held] = 0.0
    basis = _orthonormal(np.concatenate([modes[:, :n_modes], responses], axis=1), stiff)
    shares, turn = np.linalg.eigh(basis.T @ times_mass(basis))
    if shares[0] < MASSLESS * shares[-1]:
        raise SimulationError("An actuator moves nothing that has mass: there is no motion in time.")
    shares, turn = shares[::-1], turn[:, ::-1]
    basis = (basis @ turn) / np.sqrt(shares)
    columns = [-system.gradient_by_effort(state, i, controls, statics.theta) for i in inputs.tolist()]
    damped = damping_tangent(system, statics.theta, inertia, damping, at, state)
    forces = system.tangent_times(damped, basis)
    yielding = statics.solve(forces)
    yielding[n:][controls.is_held] = 0.0
    return SmallMotions(
        basis,
        1.0 / np.sqrt(values[:n_modes]),
        errors[:n_modes],
        float(1.0 / np.sqrt(values[n_modes])),
        basis.T @ forces + damping.mass * np.eye(len(shares)),
        np.diag(1.0 / shares),
        basis.T @ np.array(columns).T.reshape(len(basis), len(columns)),
        _orthonormal(np.concatenate([basis, yielding], axis=1), stiff),
    )


def poles_of(mass: Floats, damping: Floats, stiffness: Floats) -> tuple[Any, Any]:
    """The roots of lambda^2 M + lambda C + K (2 k,), complex [1/s], the slowest first, and their vectors (k, 2 k).

    Parameters
    ----------
    mass, damping, stiffness
        M, C and K (k, k).
    """
    k = len(mass)
    rates = np.linalg.solve(mass, np.hstack([-stiffness, -damping]))
    values, states = np.linalg.eig(np.vstack([np.eye(k, 2 * k, k), rates]))
    order = np.lexsort([np.imag(values), np.abs(values)])
    return values[order], states[:k, order]


def pole_rates(matrices: Floats, rates: Floats) -> tuple[Any, Any]:
    """The poles (2 k,) of M, C and K (3, k, k), and their derivatives (2 k, n) by those of the matrices (n, 3, k, k).

    By lambda^2 M + lambda C + K at its root's vector x, and its symmetry, of a simple root:

        d lambda = - x^T (lambda^2 dM + lambda dC + dK) x / (x^T (2 lambda M + C) x)
    """
    poles, x = poles_of(*matrices)
    powers = np.array([poles**2, poles, np.ones_like(poles)])
    change = np.einsum("im,nsij,jm,sm->mn", x, rates, x, powers, optimize=True)
    slope = np.einsum("im,sij,jm,sm->m", x, matrices[:2], x, np.array([2.0 * poles, np.ones_like(poles)]))
    return poles, -change / slope[:, None]


def galerkin(
    system: System, theta: Theta, inertia: Inertia, damping: Damping, state: State, controls: Controls, basis: Floats
) -> Floats:
    """M, C and K in a basis of the unknowns (3, k, k).

    Parameters
    ----------
    system, theta
        The discretised robot, and its parameters.
    inertia, damping
        Its mass and damping.
    state, controls
        The equilibrium.
    basis
        Motions of the unknowns (n_unknowns, k).

    Raises
    ------
    SimulationError
        Where the state is inadmissible.
    """
    own = replace(controls, effort=np.where(controls.is_held, state.effort, controls.effort))
    at = system.linearise(state, own, theta)
    each = (mass_tangent(system, inertia, state), damping_tangent(system, theta, inertia, damping, at, state), at)
    mass, damped, stiff = (basis.T @ system.tangent_times(one, basis) for one in each)
    return np.array([mass, damped + damping.mass * mass, stiff])


def rates_along(of: Callable[[State], Floats], statics: Statics, state: State, way: Floats) -> Floats:
    """The derivative of what follows from a state along a way of the unknowns, by a central difference.

    Parameters
    ----------
    of
        From a state to an array.
    statics
        The system at its parameters.
    state
        The equilibrium.
    way
        Rates of the unknowns (n_unknowns,).
    """
    if (size := statics.reach(way)) == 0.0:
        return np.zeros_like(of(state))
    step = BESIDE * statics.length / size
    before, after = (of(moved(statics.system.layout, state, sign * step * way)) for sign in (-1.0, 1.0))
    return (after - before) / (2.0 * step)


def mass_tangent(system: System, inertia: Inertia, state: State) -> Linearisation:
    """M at a state, in place of the tangent: on points [kg], and on frames by their increments [kg, kg m, kg m^2].

    Parameters
    ----------
    system
        The discretised robot.
    inertia
        Its mass.
    state
        The state.
    """
    still = Rates(np.zeros_like(state.x), np.zeros_like(state.position), np.zeros_like(state.rotation))
    data = inertia.data.copy()
    inertia.blocks.add_tangent(data, inertia.tangent(state.rotation, still, 1.0))
    none = np.zeros(3 * system.layout.n_points + system.layout.n_pressures)
    system.motion.reduce_tangent(state, none, data)
    held = Controls(np.ones(system.layout.n_actuators, dtype=bool), state.effort, np.zeros_like(state.effort))
    return Linearisation(held, (), data=data[: system.pattern.nnz])


def damping_tangent(
    system: System, theta: Theta, inertia: Inertia, damping: Damping, at: Linearisation, state: State
) -> Linearisation:
    """C of the strains' damping at a state at rest, in place of the tangent [N s/m]; damping by mass is not in it.

    Parameters
    ----------
    system, theta
        The discretised robot, and its parameters.
    inertia
        Its mass.
    damping
        The damping.
    at
        The tangent at the state.
    state
        The state.

    Raises
    ------
    SimulationError
        Where the state is inadmissible.
    """
    stepped = in_step(system, inertia, damping, SHORT, at_rest(state), theta)
    massless = replace(stepped, terms=stepped.terms[:-1])
    after = massless.linearise(state, at.controls, theta)
    if after.data is None or at.data is None:
        raise SimulationError(f"There is no tangent: {after.why_not}.")
    return Linearisation(at.controls, (), data=SHORT * (after.data - at.data))


def require_linear(statics: Statics, at: Linearisation, state: State) -> None:
    """Raise where small motions are not linear, or have no symmetric form.

    Parameters
    ----------
    statics
        The system at its parameters.
    at
        The tangent at the state.
    state
        The equilibrium.

    Raises
    ------
    SimulationError
        There, with the reason.
    """
    system, border = statics.system, at.border
    every = range(len(system.actuators))
    drives = [system.drive(state, i, statics.theta) for i in every]
    if system.remembers:
        what = "It has a memory, friction's or a material's, so that small motions about an equilibrium are not linear"
        raise SimulationError(f"{what}. Try no friction_memory, and materials without histories.")
    if any(term.swings for term in system.actuated):
        what = "The rotor of a drive has inertia, which small motions leave out"
        raise SimulationError(f"{what}. Try a drive without rotor_inertia, or motion in time.")
    if border.has_moments:
        raise SimulationError("Moments of fixed direction have no potential: the tangent is not symmetric.")
    if len(border.corner) > len(border.driven) or not all(np.allclose(one.columns, one.rows) for one in drives):
        what = "Friction along cables has no linear form: it holds small motions, and turns with them"
        raise SimulationError(f"{what}. Try friction 0.")
    if at.touch is not None and any(one.friction_coefficient > 0.0 for one in system.contacts):
        raise SimulationError("Friction of surfaces in contact has no linear form. Try a contact without friction.")


def _modes(statics: Statics, mass: Product, stiff: Product, n_modes: int) -> tuple[Floats, Floats]:
    """1 / omega^2 (n_modes,), the largest first, and the modes' motions of all unknowns (n_unknowns, n_modes)."""
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh

    n, n_unknowns = statics.system.layout.first_effort_unknown, statics.system.layout.n_unknowns

    def operator(product: Product) -> LinearOperator:
        def of(x: Floats) -> Floats:
            full = np.zeros((n_unknowns, 1))
            full[:n, 0] = x.ravel()
            return product(full)[:n, 0]

        return LinearOperator((n, n), matvec=of, dtype=np.float64)  # pyright: ignore[reportCallIssue] (its __new__)

    M, inverse = operator(mass), operator(statics.solve)
    # Without a part on what has no mass, as every later vector.
    begin = inverse @ (M @ np.random.default_rng(5).standard_normal(n))
    many = min(max(2 * n_modes + 10, 24), n - 1)
    try:
        squares, found = eigsh(operator(stiff), n_modes, M, sigma=0.0, OPinv=inverse, v0=begin, ncv=many)
    except ArpackError as error:
        raise SimulationError(f"The modes were not found: {error}.") from error
    order = np.argsort(squares)
    modes = np.zeros((n_unknowns, n_modes))
    modes[:n] = found[:, order]
    return 1.0 / squares[order], modes


def _orthonormal(columns: Floats, stiff: Product) -> Floats:
    """A basis of the columns' span, orthonormal in the energy of K; each column twice through Gram and Schmidt."""
    basis = columns[:, :0]
    for column in columns.T:
        new = column[:, None]
        size = np.sqrt(max((new.T @ stiff(new)).item(), 0.0))
        for _ in range(2):
            new = new - basis @ (basis.T @ stiff(new))
        left = np.sqrt(max((new.T @ stiff(new)).item(), 0.0))
        if left > NEW * size:
            basis = np.concatenate([basis, new / left], axis=1)
    return basis
