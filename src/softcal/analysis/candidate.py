"""A candidate test: a bench test that could be made, like one of the calibration except for what it states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from softcal.calibration.problem.experiment import Experiment, largest_of, rig_kind
from softcal.calibration.problem.scope import P
from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.experiments.dataset import Channel, Dataset
from softcal.limits import LIMITS
from softcal.sensing.channel import ChannelName, channel_name, kinds, of_actuator, other_of
from softcal.twin.parameter_name import parameter_name

MOST_SAMPLES = replace(LIMITS["samples"], least=0)


@displayed
@dataclass(frozen=True, kw_only=True)
class Candidate(Checked):
    """A test that could be made.

    Attributes
    ----------
    name
        Name of the test.
    like
        The calibration's experiment that it is like in all that follows, and in its rig.
    actuator
        The actuator that is driven, of the kind of the one in `like`; "" for the same.
    control
        Its coordinate or its effort, by which it is driven, such as "tension"; "" for the same.
    reach
        Its largest value [SI], such as a tension's [N], or of a vacuum its lowest pressure [Pa], below zero; of several
        actuators the others in proportion. None: as far.
    samples
        Number of samples; 0 for as many.
    measured
        Channels that are compared, besides those of `like`.
    noise
        Channel -> standard deviation of its noise [SI], where that is not the one found in the calibration.
    better
        Channel -> factor by which its instrument has less noise than in the calibration [-].
    settings
        Parameter of the robot or rig -> its value [SI] in the test, such as the force of a hanging mass.
    repeats
        Number of repetitions.
    """

    name: str
    like: str
    actuator: str = ""
    control: str = ""
    reach: float | None = None
    samples: Annotated[int, MOST_SAMPLES] = 0
    measured: tuple[str, ...] = ()
    noise: Mapping[str, float] = field(default_factory=dict[str, float])
    better: Mapping[str, float] = field(default_factory=dict[str, float])
    settings: Mapping[str, float] = field(default_factory=dict[str, float])
    repeats: Annotated[int, LIMITS["repeats"]] = 1


def as_experiment(candidate: Candidate, like: Experiment) -> Experiment:
    """The test with its commands; what it would measure is zero, with a noise of one unit.

    Raises
    ------
    InputError
        Where the test cannot be stated as a change of `like`.
    """
    driven = like.drives
    if not driven and (candidate.actuator or candidate.control or candidate.reach is not None):
        what = "no actuator is driven in the experiment that this one is like"
        raise InputError(Fault(what, candidate.name, like.name))
    others = [c for c in driven if candidate.control not in ("", like.twin_channel(c).kind.name)]
    if len(driven) > 1 and (candidate.actuator or others):
        got, allowed = f"{', '.join(driven)} in {like.name}", "reach, samples, noise or settings"
        raise InputError(Fault("several actuators are driven", candidate.name, got, allowed))
    if candidate.control and candidate.control not in (controls := controls_of(like)):
        what = f"{_driven(like)} of {like.name} has no such control"
        raise InputError(unknown(what, candidate.name, candidate.control, sorted(controls)))
    drives = {_renamed(channel, candidate, like, is_drive=True): channel for channel in driven}
    values = {name: _commands(candidate, like, old, name) for name, old in drives.items()}
    largest = largest_of(values.values())
    if candidate.reach is not None and largest != 0.0:
        values = {name: one * (candidate.reach / largest) for name, one in values.items()}
    n = candidate.samples or like.dataset.n_samples
    share = np.linspace(0.0, 1.0, n)
    values = {name: np.interp(share, np.linspace(0.0, 1.0, len(old)), old) for name, old in values.items()}
    kept = [_renamed(channel, candidate, like) for channel in like.compared]
    if others:
        # The actuator's other channel is compared, in the place of the one that now drives it.
        other = _renamed(others[0], replace(candidate, control=""), like, is_drive=True)
        kept = [other if name in drives else name for name in kept]
    compared = tuple(dict.fromkeys(one for one in (*kept, *candidate.measured) if one not in drives))
    channels = {name: Channel(one, channel_name(name).kind.unit) for name, one in values.items()}
    channels |= {name: Channel(np.zeros(n), channel_name(name).kind.unit, 1.0) for name in compared}
    labels = tuple(f"{i + 1}" for i in range(n)) if like.dataset.labels else ()
    own = candidate.actuator and _driven(like) != candidate.actuator
    gone = f"{_driven(like)}." if own else "\0"
    return replace(
        like,
        name=candidate.name,
        dataset=Dataset(candidate.name, channels, like.dataset.provenance, labels=labels),
        cable=candidate.actuator if like.cable and candidate.actuator else like.cable,
        drive=tuple(values) if isinstance(like.drive, tuple) else candidate.control or like.drive,
        compared=compared,
        settings={k: v for k, v in like.settings.items() if not k.startswith(gone)} | dict(candidate.settings),
    )


def controls_of(like: Experiment) -> set[str]:
    """Coordinates and efforts by which the actuators of an experiment can be driven."""
    return {kind.name for c in like.drives for kind in of_actuator(like.twin_channel(c).kind)}


def own_parameters(candidate: Candidate, like: Experiment, known: tuple[P, ...]) -> dict[str, P]:
    """Label in the calibration -> the test's own parameter of the same kind, such as its slack or its offsets.

    The test shares all other parameters with the calibration, those of a set-up too. If it drives an actuator
    that the calibration does not, the parameters of that actuator's rig are its own.

    Parameters
    ----------
    candidate
        The candidate test.
    like
        The experiment that the candidate resembles.
    known
        Free or uncertain parameters of the calibration.
    """
    old = _driven(like)
    shared = {target for p in known if p.serves(candidate.name) for target in p.targets}
    found: dict[str, P] = {}
    for p in known:
        is_own = p.experiment == like.name and not p.members
        is_rig = bool(candidate.actuator) and all(
            parameter_name(target).owner == old and rig_kind(target) is not None for target in p.targets
        )
        if not p.serves(like.name) or not (is_own or is_rig):
            continue
        names = {t: t.replace(f"{old}.", f"{candidate.actuator}.", 1) if is_rig else t for t in p.targets}
        if is_rig and shared & set(names.values()):
            continue
        found[p.label] = replace(
            p, name=names.get(p.name, p.name), of=tuple(names.values()) if p.of else (), experiment=candidate.name
        )
    return found


def noise_like(candidate: Candidate, like: Experiment, channel: str) -> str:
    """Channel of `like` from the same instrument; "" if there is none.

    Parameters
    ----------
    candidate
        The candidate test.
    like
        The experiment that the candidate resembles.
    channel
        Channel of the candidate.
    """
    return next((old for old in like.compared if _renamed(old, candidate, like) == channel), "")


def _driven(like: Experiment) -> str:
    """The actuator that is driven; "" if none or several are."""
    carriers = {like.twin_channel(channel).carrier for channel in like.drives}
    return carriers.pop() if len(carriers) == 1 else ""


def _renamed(channel: str, candidate: Candidate, like: Experiment, *, is_drive: bool = False) -> str:
    """A channel of `like` under the name of the candidate's actuator; is_drive: and of its control."""
    name = channel_name(channel)
    if candidate.actuator and name.carrier == _driven(like) != "":
        name = replace(name, carrier=candidate.actuator)
    if is_drive and candidate.control:
        name = replace(name, kind=kinds()[candidate.control])
    return str(name)


def _commands(candidate: Candidate, like: Experiment, old: str, new: str) -> Floats:
    """Values of the control: those of `like`, or evenly spaced from zero to the largest one measured in `like`."""
    values = like.dataset.values(old)
    if channel_name(old).kind == channel_name(new).kind:
        return values
    kind = other_of(channel_name(old).kind)
    other = next((c for c in like.dataset.channels if like.twin_channel(c) == ChannelName(kind, _driven(like))), None)
    if other is not None:
        most = largest_of([like.dataset.values(other)])
    elif candidate.reach is not None:
        most = candidate.reach
    else:
        raise InputError(
            Fault(
                f"the range of the {kind.name} is unknown",
                candidate.name,
                allowed=f"such as {kind.name}: 20 {kind.unit}",
            )
        )
    return np.linspace(0.0, most, len(values) + 1)[1:]
