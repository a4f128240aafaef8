"""The recursions of `tensions.py` along the segments of every cable, from the pulled end to the far one and back."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.friction_level import level, level_slope

# The turning angle has a kink at zero, rounded off below this angle [rad], which the via points of a cable share: so a
# smooth way turns by as much whether it goes through ten points or a thousand.
SMOOTH = 1e-4
HELD = 1.0 - 1e-9  # of sigma: below it a via point sticks
MOST_ITERATIONS = 100
CLOSE = 1e-13  # of a logarithm of two tensions
CLOSE_ENOUGH = 1e-10  # where rounding stops the iteration


@kernel(error_model="numpy")
def turn(ptr: Ints, v: Floats, phi: Floats, by_near: Floats, by_far: Floats) -> None:
    """The turning angles at via points, rounded off at zero, see `tensions.turns`.

    Parameters
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    v
        Vectors of the segments (n_segments, 3) [m].
    phi
        Angles (n_segments,) [rad], written.
    by_near, by_far
        Their derivatives by the vectors of the segment before, and of the segment (n_segments, 3) [1/m], written.
    """
    across = np.empty(3)
    for c in range(len(ptr) - 1):
        s = SMOOTH / max(ptr[c + 1] - ptr[c] - 1, 1)
        for k in range(ptr[c] + 1, ptr[c + 1]):
            a, b = v[k - 1], v[k]
            la, lb = np.sqrt(np.sum(a * a)), np.sqrt(np.sum(b * b))
            u, w = a / la, b / lb
            cos = np.sum(u * w)
            for i in range(3):
                across[i] = u[(i + 1) % 3] * w[(i + 2) % 3] - u[(i + 2) % 3] * w[(i + 1) % 3]
            sin = np.sqrt(np.sum(across * across))
            angle = np.arctan2(sin, cos)
            smooth = np.hypot(angle, s)
            phi[k] = angle**2 / smooth
            scale = angle * (angle**2 + 2.0 * s**2) / smooth**3 / max(sin, 1e-15)
            for i in range(3):
                by_near[k, i] = -scale * (w[i] - cos * u[i]) / la
                by_far[k, i] = -scale * (u[i] - cos * w[i]) / lb


@kernel(error_model="numpy")
def solve(
    ptr: Ints,
    pull: Floats,
    preload: Floats,
    most: Floats,
    softness: Floats,
    given: Floats,
    memory: Floats,
    delta: Floats,
    drag: Floats,
    begun: Floats,
    rho: Floats,
    sigma: Floats,
    slip: Floats,
) -> int:
    """rho, sigma and slip of all segments. Returns zero, or the number, counted from one, of a cable for which Newton's
    method does not converge.

    With S_j, the stretch beyond via point j, the equations are the gradient of a strictly convex function of S,

        ln L((S_j - S_(j+1)) / c_j) - ln L((S_(j-1) - S_j) / c_(j-1)) - r_j(S_j) = 0

    solved by Newton's method, with a tridiagonal Hessian, and a line search.

    Parameters
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    pull
        Tensions at the pulled ends (n_cables,) [N].
    preload
        Preload of the friction (n_cables,) [N].
    most
        mu phi (n_segments,) [-].
    softness
        c_k (n_segments,) [m/N].
    given
        The slips' summands without the stretch (n_segments,) [m].
    memory
        Plastic slips (n_segments,) [m].
    delta
        Presliding displacements (n_cables,) [m].
    drag
        What sigma has more for each metre of slip since `begun` (n_cables,) [1/m].
    begun
        Slips at the time step's start (n_segments,) [m].
    rho, sigma, slip
        Results (n_segments,) [-; -; m], written.
    """
    n = len(rho)
    S, left, step = np.zeros(n + 1), np.zeros(n), np.zeros(n + 1)
    upper, right = np.zeros(n + 1), np.zeros(n + 1)
    for c in range(len(pull)):
        a, b = ptr[c], ptr[c + 1]
        T = max(pull[c], 0.0)
        stretches = softness[a] * T > 0.0
        S[b] = 0.0
        for k in range(b - 1, a, -1):
            S[k] = S[k + 1] + softness[k] * T
        rule = (T, preload[c], delta[c], drag[c])
        _beyond(a, b, rule, most, softness, given, memory, begun, S, rho, sigma, slip, left)
        if (delta[c] <= 0.0 and drag[c] <= 0.0) or not stretches:
            for k in range(a + 1, b):
                rho[k] = rho[k - 1] + most[k] * (sigma[k] + drag[c] * (slip[k] - begun[k]))
            continue
        best = np.inf
        for iteration in range(MOST_ITERATIONS + 1):
            worst, shortest = 0.0, np.inf
            for k in range(a + 1, b):
                worst = max(worst, abs(left[k])) if np.isfinite(left[k]) else np.inf
            if worst < CLOSE or (worst < CLOSE_ENOUGH and worst >= best):
                break
            if iteration == MOST_ITERATIONS or not np.isfinite(worst):
                return c + 1
            best = min(best, worst)
            upper[a], right[a] = 0.0, 0.0
            for k in range(a + 1, b):
                own = _stiffness(S[k] - S[k + 1], softness[k], preload[c])
                before = _stiffness(S[k - 1] - S[k], softness[k - 1], preload[c]) if k > a + 1 else 0.0
                h = most[k] * (drag[c] + (1.0 / delta[c] if abs(sigma[k]) < HELD else 0.0))
                pivot = own + before + h - before * upper[k - 1]
                upper[k] = own / pivot
                right[k] = (-left[k] + before * right[k - 1]) / pivot
            step[b] = 0.0
            slope = 0.0
            for k in range(b - 1, a, -1):
                step[k] = right[k] + upper[k] * step[k + 1]
                slope += step[k] * left[k]
                closing = step[k + 1] - step[k]
                if closing > 0.0:
                    shortest = min(shortest, (S[k] - S[k + 1]) / closing)
            part, low, high = min(1.0, 0.9 * shortest), 0.0, 0.0
            taken = 0.0
            for _ in range(30):  # the slope along the step ascends to zero at its end
                for k in range(a + 1, b):
                    S[k] += (part - taken) * step[k]
                taken = part
                _beyond(a, b, rule, most, softness, given, memory, begun, S, rho, sigma, slip, left)
                now = 0.0
                for k in range(a + 1, b):
                    now += step[k] * left[k]
                if abs(now) <= 0.9 * abs(slope):
                    break
                if now > 0.0:
                    high = part
                    part = 0.5 * (low + high)
                elif high > 0.0:
                    low = part
                    part = 0.5 * (low + high)
                else:
                    break
    return 0


@kernel(error_model="numpy")
def _stiffness(stretch: float, softness: float, preload: float) -> float:
    """d rho / d stretch of a segment [1/m]."""
    if preload <= 0.0:
        return 1.0 / stretch
    T = stretch / softness
    return level_slope(T, preload) / level(T, preload) / softness


@kernel(error_model="numpy")
def _beyond(
    a: int,
    b: int,
    rule: tuple[float, float, float, float],
    most: Floats,
    softness: Floats,
    given: Floats,
    memory: Floats,
    begun: Floats,
    S: Floats,
    rho: Floats,
    sigma: Floats,
    slip: Floats,
    left: Floats,
) -> None:
    """rho, sigma, slip, and what the equations leave, of one cable's segments at S. rule: the pull, and of the friction
    the preload, the presliding displacement and the drag.
    """
    T, preload, delta, drag = rule
    longer = 0.0
    for k in range(b - 1, a, -1):
        longer += given[k]
        slip[k] = longer - S[k]
        sigma[k] = -1.0 if delta <= 0.0 else min(max((slip[k] - memory[k]) / delta, -1.0), 1.0)
    rho[a] = 0.0
    for k in range(a + 1, b):
        if softness[k] * T > 0.0:
            rho[k] = np.log((S[k] - S[k + 1]) / (softness[k] * T))
            if preload > 0.0:
                rho[k] = np.log(level((S[k] - S[k + 1]) / softness[k], preload) / level(T, preload))
        left[k] = rho[k] - rho[k - 1] - most[k] * (sigma[k] + drag * (slip[k] - begun[k]))


@kernel(error_model="numpy")
def respond(ptr: Ints, by_slip: Floats, pulled: Floats, own: Floats) -> Floats:
    """Rates of rho (n_segments, k), see `tensions.py`.

    Parameters
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    by_slip
        d r / d slip at the via point before each segment (n_segments,) [1/m].
    pulled
        d (c_k T_k) / d rho (n_segments,) [m].
    own
        Rates of r at fixed rho (n_segments, k).
    """
    out = np.zeros_like(own)
    for c in range(len(ptr) - 1):
        first, end = ptr[c], ptr[c + 1]
        b = np.zeros(end - first + 1)
        for k in range(end - 1, first, -1):
            soft = pulled[k] + b[k + 1 - first]
            b[k - first] = soft / (1.0 + by_slip[k] * soft)
        for m in range(own.shape[1]):
            a = np.zeros(end - first + 1)
            for k in range(end - 1, first, -1):
                soft = pulled[k] + b[k + 1 - first]
                a[k - first] = soft * (own[k, m] - by_slip[k] * a[k + 1 - first]) / (1.0 + by_slip[k] * soft)
                a[k - first] += a[k + 1 - first]
            for k in range(first + 1, end):
                soft = pulled[k] + b[k + 1 - first]
                out[k, m] = (out[k - 1, m] + own[k, m] - by_slip[k] * a[k + 1 - first]) / (1.0 + by_slip[k] * soft)
    return out


@kernel(error_model="numpy")
def pull_back(ptr: Ints, by_slip: Floats, pulled: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Sums of the rates of rho, the transpose of `respond`: by the segments' lengths and by the r of their via points
    (n_segments, k).

    Parameters
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    by_slip
        d r / d slip at the via point before each segment (n_segments,) [1/m].
    pulled
        d (c_k T_k) / d rho (n_segments,) [m].
    weights
        Weights of the segments in the sums (n_segments, k).
    """
    of_lengths, of_turns = np.zeros_like(weights), np.zeros_like(weights)
    for c in range(len(ptr) - 1):
        first, end = ptr[c], ptr[c + 1]
        soft, pivot = np.zeros(end - first + 1), np.ones(end - first + 1)
        b = 0.0
        for k in range(end - 1, first, -1):
            soft[k - first] = pulled[k] + b
            pivot[k - first] = 1.0 + by_slip[k] * soft[k - first]
            b = soft[k - first] / pivot[k - first]
        for k in range(end - 1, first, -1):
            for m in range(weights.shape[1]):
                beyond = of_turns[k + 1, m] if k + 1 < end else 0.0
                of_turns[k, m] = (beyond + weights[k, m]) / pivot[k - first]
        for k in range(first + 1, end):
            for m in range(weights.shape[1]):
                of_turns[k, m] -= soft[k - first] / pivot[k - first] * of_lengths[k - 1, m]
                of_lengths[k, m] = of_lengths[k - 1, m] + by_slip[k] * of_turns[k, m]
    return of_lengths, of_turns


@kernel(error_model="numpy")
def changing(ptr: Ints, by_slip: Floats, pulled: Floats, by_angle: Floats, moves: np.ndarray) -> np.ndarray:
    """Whether a segment can move and has a rho that changes with the shape (n_segments,).

    Parameters
    ----------
    ptr
        The segments of cable c are ptr[c]:ptr[c+1] (n_cables + 1,).
    by_slip
        d r / d slip at the via point before each segment (n_segments,) [1/m].
    pulled
        d (c_k T_k) / d rho (n_segments,) [m].
    by_angle
        d r / d turning angle (n_segments,) [1/rad].
    moves
        Whether a segment can move (n_segments,).
    """
    out = np.zeros(len(moves), dtype=np.bool_)
    for c in range(len(ptr) - 1):
        first, end = ptr[c], ptr[c + 1]
        any_moves, any_stretches, any_changes = False, False, False
        for k in range(end - 1, first, -1):
            any_moves = any_moves or moves[k]
            any_stretches = any_stretches or pulled[k] > 0.0
            turns = by_angle[k] != 0.0 and (moves[k] or moves[k - 1])
            out[k] = turns or (by_slip[k] != 0.0 and any_moves)
            any_changes = any_changes or out[k]
        before = False
        for k in range(first + 1, end):
            stretches = any_changes and any_stretches and by_slip[k] != 0.0
            before = before or out[k] or stretches
            out[k] = before and moves[k]
    return out


@kernel(error_model="numpy")
def beyond(ptr: Ints, values: Floats) -> Floats:
    out = values.copy()
    for c in range(len(ptr) - 1):
        for k in range(ptr[c + 1] - 2, ptr[c] - 1, -1):
            out[k] += out[k + 1]
    return out
