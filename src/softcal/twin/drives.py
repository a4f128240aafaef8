"""The samples of a protocol, read from the path of equilibria: driven by a coordinate, or by an effort."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.node import Node, node_at
from softcal.mechanics.path import Path, go_on_from, interpolated, neighbours
from softcal.mechanics.path_watch import part_of_series
from softcal.twin.equilibrium_path import SAME, EquilibriumPath
from softcal.twin.start import slack_line
from softcal.units import format_quantity


@dataclass(frozen=True)
class Samples:
    """The samples up to the first one that was not reached.

    Attributes
    ----------
    path
        The path that they are read from.
    c, commands
        Shortening on the path, and command, of each sample (n,) [m; m or N].
    values, slopes, by_parameter
        Channels (n, n_channels), their derivatives by the command, and by the parameters (n, n_channels, k).
    status
        How it ended, a sentence.
    succeeded
        Whether every sample was reached.
    end
        Shortening up to which crossings on the path count [m].
    """

    path: Path
    c: Floats
    commands: Floats
    values: Floats
    slopes: Floats
    by_parameter: Floats
    status: str
    succeeded: bool
    end: float = np.inf


def by_coordinate(along: EquilibriumPath, start: Node, d: Floats, *, ends_there: bool = False) -> Samples:
    """The samples of a coordinate's commands, such as shortenings.

    Parameters
    ----------
    along
        The path of the driven actuator.
    start
        Its first node.
    d
        The commands (n,) [SI].
    ends_there
        Whether the path ends at the last sample, and not beyond.
    """
    (coordinate, effort), end = along.channels, float(d.max())
    nodes = along.lowered(start, to=float(d.min()))
    start = nodes[0]
    taut = d > start.c if along.only_pulls else d >= start.c
    # Solved first, with the factors of the start: the same tangent.
    still = None if taut.all() else along.curve((along.slack_node(start),))
    path = Path(nodes, True, names=along.names)
    if end > nodes[-1].c + SAME * along.length:
        leg = along.towards(nodes[-1], end)
        path = replace(leg, nodes=(*nodes[:-1], *leg.nodes))
    is_curve = not path.snaps
    if is_curve:
        try:
            path, _ = along.refined(path, d[taut & (d <= path.nodes[-1].c)])
        except SimulationError:  # a long step has passed over a part of the path that is none
            is_curve = False
    # Beyond a snap-through the curve is neither smooth nor reached from both sides.
    is_curve = (is_curve and not path.snaps) or path.stopped_by is not None
    if not is_curve:
        path, places = Path((start,), True, names=along.names), np.unique(d[taut])
        for i, c in enumerate(places.tolist()):
            with part_of_series(i, len(places)):
                leg = along.follow(path.nodes[-1], c)
            path = replace(leg, nodes=(*path.nodes, *leg.nodes[1:]))
            if not leg.reached:
                break
    reached = path.nodes[-1].c
    n = len(d) if path.reached else int(np.argmax(np.append(d, np.inf) > reached))
    if along.tolerance <= 0.0 and is_curve and path.stopped_by is None:
        path = along.with_nodes(path, along.missing(path, d[:n][taut[:n]]))
    c = np.maximum(d[:n], start.c)
    values, slopes, by_parameter = along.curve(path.nodes).at(c)
    if ends_there and path.stopped_by is None:
        path = _within(along, path, start.c, float(c.max(initial=start.c)))
    slack = ~taut[:n]
    if still is not None:
        values[slack], slopes[slack], by_parameter[slack] = still.values, still.slopes, still.by_parameter
    # A slack cable's shortening is the command, not the shortening that would make it taut.
    values[:, along.column(coordinate)] = d[:n]
    slopes[:, along.column(coordinate)] = 1.0
    by_parameter[:, along.column(coordinate)] = 0.0
    status, succeeded = along.sentence(path, n, len(d)), path.reached
    tension = values[:, along.column(effort)]
    if along.only_pulls and path.reached and np.any(tension < 0.0):
        low = float(d[:n][np.argmin(tension)])
        status = f"Cable {along.actuator} would have to push at {1e3 * low:.4g} mm: the robot snaps through there."
        n, c, values, slopes, by_parameter = 0, c[:0], values[:0], slopes[:0], by_parameter[:0]
        succeeded = False
    return Samples(
        path=path,
        c=c,
        commands=d[:n],
        values=values,
        slopes=slopes,
        by_parameter=by_parameter,
        status=status,
        succeeded=succeeded,
    )


def by_effort(along: EquilibriumPath, start: Node, T: Floats, *, ends_there: bool) -> Samples:
    """The samples of an effort's commands, such as tensions.

    Parameters
    ----------
    along
        The path of the driven actuator.
    start
        Its first node.
    T
        The commands (n,) [SI].
    ends_there
        Whether the path ends at the last sample, and not beyond.
    """
    coordinate, effort = along.channels
    i_tension, largest = along.column(effort), float(T.max())
    nodes = along.lowered(start, until=float(T.min()))
    start, path = nodes[0], Path(nodes, True, names=along.names)
    if largest > 0.0:
        leg = along.follow(nodes[-1], along.furthest(largest), until=largest)
        path = replace(leg, nodes=(*nodes[:-1], *leg.nodes))
    path, curve = along.refined(path, T, of_tension=True)
    if len(path.nodes) == 1:
        at = np.full(len(T), start.c)
        values, slopes, by_parameter = curve.at(at)
        return Samples(
            path=path,
            c=at,
            commands=np.zeros(len(T)),
            values=values,
            slopes=slopes,
            by_parameter=by_parameter,
            status=f"Solved: no {effort.name}.",
            succeeded=True,
            end=start.c,
        )
    at_end = path.reached and path.nodes[-1].c >= along.furthest(largest) * (1.0 - 1e-9)
    is_wound = at_end and along.only_pulls  # a state, in which any tension is in equilibrium
    c = along.passages(curve, T)
    if along.tolerance <= 0.0 and path.stopped_by is None:
        # A node at each tension whose shortening is about c: to solve at c and read the tension again takes two solves.
        about = dict(zip(c.tolist(), T.tolist(), strict=True))
        missing = along.missing(path, c[np.isfinite(c)]).tolist()
        extra = [_at_tension(along, path, value, about[value]) for value in missing]
        found = [*path.nodes, *(node for node in extra if node is not None)]
        path = replace(path, nodes=tuple(sorted(found, key=lambda node: node.c)))
        curve = along.curve(path.nodes)
        c = along.passages(curve, T)
    # The rest: tensions that the solved curve reaches at another shortening than the interpolated one.
    exact = along.tolerance <= 0.0 and path.stopped_by is None
    while exact and len(missing := along.missing(path, c[np.isfinite(c)])):
        path = along.with_nodes(path, missing)
        curve = along.curve(path.nodes)
        c = along.passages(curve, T)
    beyond = ~np.isfinite(c)
    n = len(T) if is_wound or not beyond.any() else int(np.argmax(beyond))
    at = np.where(beyond, curve.c[-1], c)[:n]
    values, by_c, by_parameter = curve.at(at)
    slopes = by_c / by_c[:, i_tension][:, None]
    by_parameter = by_parameter - slopes[:, :, None] * by_parameter[:, i_tension, None, :]
    values[:, i_tension] = T[:n]
    slopes[beyond[:n]] = 0.0
    by_parameter[beyond[:n]] = 0.0
    slopes[:, i_tension], by_parameter[:, i_tension] = 1.0, 0.0
    status = along.sentence(path, n, len(T))
    most = float(curve.values[:, i_tension].max())
    if is_wound and beyond.any():
        status += f" Cable {along.actuator} is wound up to zero length from {most:.4g} N on."
    elif at_end and beyond.any():
        limit, end = format_quantity(most, effort.unit), along.place(path.nodes[-1].c)
        status = (
            f"No equilibrium beyond {limit} of {effort.name} of {along.actuator} ({n} of {len(T)} samples reached): it "
            f"is the largest up to {end}. Command the {coordinate.name} to go beyond."
        )
    last = float(at.max(initial=start.c))
    if ends_there and path.stopped_by is None:
        path = _within(along, path, float(at.min(initial=nodes[-1].c)), last)
    # Where the path ends early, crossings up to its end may be the cause.
    reached = n == len(T)
    return Samples(
        path=path,
        c=at,
        commands=T[:n],
        values=values,
        slopes=slopes,
        by_parameter=by_parameter,
        status=status,
        succeeded=reached,
        end=last if reached or (at_end and not is_wound) else np.inf,
    )


def _at_tension(along: EquilibriumPath, path: Path, c: float, T: float) -> Node | None:
    """The node at a tension between the two nodes around c; None where no stable equilibrium was found there."""
    before, after = neighbours(path, c)
    system, statics = along.twin.system, along.statics
    guess = interpolated(system.layout, before, after, c)
    if after.is_snapped or system.free_way(before.state, guess) < 1.0:
        return None
    held = slack_line(along.twin).at(0.0)
    held = replace(held, effort=np.where(np.arange(len(held.effort)) == along.number, T, 0.0))
    go_on_from(statics, before)
    solved = statics.equilibrium(guess, held)
    if not solved.converged:
        return None
    c = along.shortening(solved.state)
    node = node_at(statics, along.line, c, solved.state, along.names) if before.c < c < after.c else None
    return node if node is not None and node.is_stable else None


def _within(along: EquilibriumPath, path: Path, low: float, high: float) -> Path:
    """The path from one c to another, with nodes there: a path to a tension ends beyond it."""
    path, nearly = along.with_nodes(path, along.missing(path, np.array([low, high]))), SAME * along.length
    return replace(path, nodes=tuple(node for node in path.nodes if low - nearly <= node.c <= high + nearly))
