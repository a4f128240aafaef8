"""Samples solved one by one, in their order: several driven actuators, or a robot that remembers. Which cables are
slack follows from equilibrium.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.cable import cables_of
from softcal.mechanics.crossing import Crossings
from softcal.mechanics.march import Reached, Target, by_command, reach
from softcal.mechanics.path_watch import part_of_series, path_watch
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.sensing.channel import ChannelName, kinds
from softcal.twin.build import Twin
from softcal.twin.crossings import crossed_at
from softcal.twin.drawn_out import drawn_out, drawn_out_at
from softcal.twin.protocol import Protocol, controls_at
from softcal.twin.response import Derivatives, Response, Shown, Snapshot, by_column
from softcal.twin.sensors import channel_units, sense, sense_rates
from softcal.twin.start import UNDER_LOADS, instability, loaded, slack_line, snapshot
from softcal.units import format_quantity

SENTENCES = 3  # samples without an equilibrium whose reasons are given


def simulate_many(
    twin: Twin,
    statics: Statics,
    protocol: Protocol,
    names: tuple[str, ...],
    *,
    snapshots: Shown,
    crossings: bool = True,
    commanded: Mapping[str, str],
) -> Response:
    """See `simulate`. There are no slopes, since there is no single control, but derivatives by the commands of some
    actuators.

    Parameters
    ----------
    twin
        The twin.
    statics
        The system at its parameters, with the factors of its tangent.
    protocol
        The protocol.
    names
        Parameters of the sensitivities (k,).
    snapshots
        Which shapes are kept.
    crossings
        Whether crossings of bodies are searched for.
    commanded
        Channel -> the actuator by whose command, as that channel, there are derivatives.
    """
    units, driven = channel_units(twin), tuple(commanded.values())
    labels, actuators = (*names, *commanded), [actuator.name for actuator in twin.system.actuators]
    numbers = np.array([actuators.index(name) for name in driven], dtype=np.int64)
    values: list[Floats] = []
    rates: list[Floats] = []
    shapes: list[Snapshot] = []
    instabilities, met, snaps_at = "", "", list[int]()
    # How far each sample's commands are from none (n_samples,), each command over its largest.
    sizes, furthest = np.zeros(protocol.n_samples), 0.0
    for command in protocol.commands.values():
        size = np.abs(command.values)
        sizes += (size / max(float(size.max(initial=0.0)), 1e-300)) ** 2
    far: State | None = None
    solved: list[int] = []
    failed: dict[int, str] = {}
    crossed: list[tuple[str, Crossings]] = []
    out: list[tuple[str, dict[str, float]]] = []
    stopped: KeyboardInterrupt | None = None
    try:
        loads = loaded(twin, statics, names)
        state = loads.state
        instabilities = instability(UNDER_LOADS) if loads.snaps else ""
        # A cable that is commanded in length starts at its present length.
        lengths = cables_of(twin.system).lengths(state.x)
        slack = replace(slack_line(twin).at(0.0), coordinate=twin.system.commanded(state, statics.theta))
        begun = reached = Reached(loads.state, slack, np.zeros((0, 0)), has_snapped=loads.snaps)
        for i in range(protocol.n_samples):
            target = controls_at(twin.system, protocol.commands, protocol.at(i), slack.coordinate)
            target = replace(target, elapsed=protocol.elapsed(i))
            aim = Target(target, names, protocol.rates(i, actuators, names))
            if late := statics.limits.why_late(statics.begun):
                failed[i] = f"{late}."
                continue
            if why := _beyond(protocol, i, failed, remembers=twin.system.remembers):
                failed[i] = why
                continue
            with part_of_series(i, protocol.n_samples):
                try:
                    reached = reach(statics, reached, aim)
                except SimulationError as error:
                    if twin.system.remembers:  # a sample is reached through those before it alone
                        failed[i] = str(error)
                        continue
                    # The line from the sample before may pass commands without an equilibrium.
                    try:
                        reached = reach(statics, begun, aim)
                    except SimulationError as error:
                        failed[i] = str(error)
                        continue
                path_watch().tell(1.0, statics.n_factorisations)
            solved.append(i)
            state = reached.state
            if sizes[i] >= furthest:
                furthest, far = sizes[i], state
            if reached.snaps:
                snaps_at.append(i)
            label = f"sample {i + 1}{_pulls(protocol, i)}"
            if crossings and twin.skins is not None:
                crossed.append((label, twin.skins.crossings(state.x)))
            out.append((label, drawn_out(twin.system, statics.theta, lengths, state)))
            if not met and (limit := twin.system.at_limit(state.x)):
                met = f" From sample {i + 1} on {limit}."
            values.append(sense(twin, state, statics.theta, _coordinates(protocol, i)))
            of_commands = by_command(statics, state, reached.controls, target, numbers)
            dz, by = np.hstack([reached.by_parameter, of_commands]), (*names, *("" for _ in driven))
            commanded_rates = dict[str, Floats]()  # a coordinate depends on its own command alone
            for part in _coordinates(protocol, i):
                command = protocol.commands[part]
                own = {name: float(rate[i]) for name, rate in command.by.items()}
                own[str(ChannelName(kinds()[command.control], part))] = 1.0
                commanded_rates[part] = np.array([own.get(label, 0.0) for label in labels])
            rates.append(sense_rates(twin, state, statics.theta, dz, by, commanded_rates))
            if snapshots:
                shapes.append(snapshot(twin, state, statics.theta, protocol.at(i), i + 1, ""))
    except SimulationError as error:
        failed[0] = str(error)
    except KeyboardInterrupt as stop:
        if not path_watch().keeps:
            raise
        stopped, n_ready = stop, min(len(solved), len(values), len(rates))
        solved, values, rates = solved[:n_ready], values[:n_ready], rates[:n_ready]
    status = f"Solved: {protocol.n_samples} equilibria, {statics.n_factorisations} factorisations.{met}"
    if failed:
        first, n = list(failed)[:SENTENCES], protocol.n_samples
        sentences = [f"Sample {i + 1} of {n} was not reached{_pulls(protocol, i)}: {failed[i]}" for i in first]
        others = [str(i + 1) for i in list(failed)[SENTENCES:]]
        if others:
            sentences.append(
                f"Nor was sample {others[0]}." if len(others) == 1 else f"Nor were samples {', '.join(others)}."
            )
        if solved:
            sentences.append("The other one is solved." if len(solved) == 1 else f"The other {len(solved)} are solved.")
        status = " ".join(sentences)
    if stopped is not None:
        status = f"Stopped by {str(stopped) or 'the user'}: {len(solved)} of {protocol.n_samples} samples are solved."
    if snaps_at:
        later = f" and {len(snaps_at) - 1} later ones" if len(snaps_at) > 1 else ""
        instabilities += instability(f"before sample {snaps_at[0] + 1}{_pulls(protocol, snaps_at[0])}{later}")
    overlaps, slid = crossed_at(crossed), drawn_out_at(out)
    remarks = "" if far is None else twin.system.remarks(far, statics.theta)
    table = np.array(values).reshape(len(values), len(units))
    by_parameter = np.array(rates).reshape(len(values), len(units), len(labels))
    return Response(
        channels=by_column(units, table),
        units=units,
        status=status + instabilities + overlaps + slid + remarks,
        succeeded=not failed and stopped is None,
        instabilities=instabilities.strip(),
        crossings=overlaps.strip(),
        drawn_out=slid.strip(),
        remarks=remarks.strip(),
        n_factorisations=statics.n_factorisations,
        sensitivities=Derivatives(tuple(units), tuple(labels), by_parameter),
        snapshots=tuple(shapes),
        tets=twin.tets if snapshots else {},
        walls=twin.walls if snapshots else {},
        samples=tuple(solved) if failed or stopped is not None else None,
        stopped_by=stopped,
    )


def _beyond(protocol: Protocol, i: int, failed: Collection[int], *, remembers: bool) -> str:
    """Why a sample is not tried: it lies beyond a sample without an equilibrium, on the same line from zero commands,
    or comes after one in a robot that remembers; else "".
    """
    if failed and remembers:
        return f"it comes after sample {min(failed) + 1}, whose memory is unknown."
    commands = np.array([command.values for command in protocol.commands.values()])
    for k in failed:
        size = float(np.abs(commands[:, k]).max())
        ahead = float(commands[:, i] @ commands[:, k]) >= float(commands[:, k] @ commands[:, k])
        factor = float(commands[:, i] @ commands[:, k]) / max(float(commands[:, k] @ commands[:, k]), 1e-300)
        if ahead and np.abs(commands[:, i] - factor * commands[:, k]).max() <= 1e-9 * factor * size:
            return f"it is beyond sample {k + 1} on the same load path."
    return ""


def _coordinates(protocol: Protocol, i: int) -> dict[str, float]:
    """The coordinates of the actuators that are commanded by it: a slack cable's shortening is its command too."""
    each, of = protocol.commands.items(), kinds()
    return {part: float(command.values[i]) for part, command in each if of[command.control].drives == "coordinate"}


def _pulls(protocol: Protocol, i: int) -> str:
    """The pulled cables of a sample, in brackets after a blank; "" where none is pulled."""
    commands = {name: (command.values[i], kinds()[command.control].unit) for name, command in protocol.commands.items()}
    pulled = ", ".join(f"{name} {format_quantity(float(v), unit)}" for name, (v, unit) in commands.items() if v != 0.0)
    return f" ({pulled})" if pulled else ""
