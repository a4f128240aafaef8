"""The candidates that a calibration suggests by itself: changes of the furthest test of each actuator."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np

from softcal.analysis.candidate import Candidate, controls_of
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.problem import Problem
from softcal.sensing.channel import ChannelName, other_of, positions
from softcal.sensing.sensors.actuators import TENSION
from softcal.sensing.sensors.pose import ANGLES
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import PointLoad

FURTHER, LESS_FAR = 1.5, 0.5
BETTER = 5.0  # times less noise
HEAVIER = 2.0  # times the largest force of a load in the experiments
HANGING = 0.1  # of the largest tension


def default_candidates(problem: Problem) -> list[Candidate]:
    """Tests that the problem's bench could make next.

    The furthest test of each actuator is repeated, and driven further and less far. The furthest test of all is varied:
    by the actuator's other control, with an additional sensor of a kind that the robot's parts have, with a sensor five
    times better, or with heavier loads. Actuators without a test are driven as far as the furthest of their kind.
    """
    references = _references(problem.experiments)
    found: list[Candidate] = []
    for like in references:
        found.append(Candidate(name=f"{like.name} again", like=like.name))
        if like.reach != 0.0:
            for share in (FURTHER, LESS_FAR):
                name = f"{like.name} {share:g} times as far"
                found.append(Candidate(name=name, like=like.name, reach=share * like.reach))
    like = like_by_default(problem.experiments)
    if len(like.drives) == 1:
        driven = like.twin_channel(like.drives[0])
        other = other_of(driven.kind)
        # If the bench has measured how far that goes.
        if any(like.twin_channel(c) == ChannelName(other, driven.carrier) for c in like.dataset.channels):
            found.append(Candidate(name=f"{like.name} by {other.name}", like=like.name, control=other.name))
    # With a channel of each driven actuator, angles of each plate and positions of all markers, unless compared.
    seen = {like.twin_channel(channel) for channel in (*like.compared, *like.drives)}
    for driven in map(like.twin_channel, like.drives):
        reverse = ChannelName(other_of(driven.kind), driven.carrier)
        if reverse not in seen:
            found.append(_measured(f"{like.name} with the {reverse.kind.name}", like, [reverse]))
    for plate in problem.robot.plates:
        angles = [ChannelName(kind, plate.name) for kind in ANGLES]
        if not seen & set(angles):
            found.append(_measured(f"{like.name} with an IMU on {plate.name}", like, angles))
    markers = problem.robot.markers
    points = [part.name for part in (markers or problem.robot.plates)]
    new = [place for point in points for place in positions(point) if place not in seen]
    if new and len(new) == 3 * len(points):
        found.append(_measured(f"{like.name} with positions of {'markers' if markers else 'plates'}", like, new))
    # An instrument is that of positions, or of any other kind of channel.
    kinds: dict[str, list[str]] = {}
    for channel in like.compared:
        kind = like.twin_channel(channel).kind
        kinds.setdefault("camera" if kind.is_position else f"{kind.name} sensor", []).append(channel)
    for what, channels in kinds.items():
        name = f"{like.name} with a {BETTER:g} times better {what}"
        found.append(Candidate(name=name, like=like.name, better=dict.fromkeys(channels, BETTER)))
    found += _heavier(problem, like)
    single = [one for one in references if len(one.drives) == 1]
    before = {one.twin_channel(c).carrier for one in references for c in one.drives}
    for part in problem.robot.commandable:
        alike = [one for one in single if part.name not in before and controls_of(one) == {*part.controls}]
        for most in sorted(alike, key=_effort)[-1:]:
            found.append(Candidate(name=f"{part.name} as {most.name}", like=most.name, actuator=part.name))
    return found


def like_by_default(experiments: Sequence[Experiment], *controls: Collection[str]) -> Experiment:
    """The experiment of the largest effort, over the noise of a common instrument, whose actuator has a control of each
    group, such as those of another actuator; of all experiments where none has.
    """
    able = [one for one in experiments if all(controls_of(one) & {*group} for group in controls if any(group))]
    return max(_references(able or experiments), key=_effort)


def _references(experiments: Sequence[Experiment]) -> list[Experiment]:
    """The furthest test of each actuator or set of actuators."""
    furthest: dict[tuple[str, ...], Experiment] = {}
    for experiment in experiments:
        key = tuple(sorted(str(experiment.twin_channel(channel)) for channel in experiment.drives))
        if key not in furthest or abs(experiment.reach) > abs(furthest[key].reach):
            furthest[key] = experiment
    return list(furthest.values())


def _effort(experiment: Experiment) -> float:
    """The largest measured effort of an actuator, over the noise of a common instrument of its kind."""
    kinds = {c: experiment.twin_channel(c).kind for c in experiment.dataset.channels}
    sizes = {c: float(np.nanmax(np.abs(experiment.dataset.values(c)))) for c in kinds if kinds[c].drives == "effort"}
    return max((size / (kinds[c].noise or 1.0) for c, size in sizes.items()), default=0.0)


def _measured(name: str, like: Experiment, channels: Sequence[ChannelName]) -> Candidate:
    short = {like.twin_channel(kind): kind for kind in ("tension", "shortening", "pitch", "roll", "yaw")}
    return Candidate(name=name, like=like.name, measured=tuple(short.get(one, str(one)) for one in channels))


def _heavier(problem: Problem, like: Experiment) -> Iterable[Candidate]:
    """A test with twice the largest load of the experiments, or with a mass on the last plate, of a tenth of the
    largest tension.
    """
    free = set(problem.space.targets)
    names = [f"{load.name}.force" for load in problem.robot.loads if isinstance(load, PointLoad)]
    known = robot_parameters(problem.robot)
    most = {
        name: max((e.settings.get(name, known[name].value) for e in problem.experiments), key=abs)
        for name in names
        if name not in free
    }
    loaded = max(problem.experiments, key=lambda e: sum(abs(e.settings.get(name, 0.0)) for name in names))
    if any(most.values()):
        settings = {name: HEAVIER * force for name, force in most.items()}
        yield Candidate(name=f"{loaded.name} with {HEAVIER:g} times the load", like=loaded.name, settings=settings)
        return
    g, plates = float(np.linalg.norm(problem.robot.gravity)), problem.robot.plates
    tensions = [like.dataset.values(c) for c in like.dataset.channels if like.twin_channel(c).kind == TENSION]
    tension = max((float(np.nanmax(values)) for values in tensions), default=0.0)
    if not (g > 0.0 and plates and tension > 0.0) or f"{plates[-1].name}.mass" in free:
        return
    more = float(f"{HANGING * tension / g:.1g}")
    settings = {f"{plates[-1].name}.mass": plates[-1].mass + more}
    yield Candidate(name=f"{like.name} with {1e3 * more:g} g on {plates[-1].name}", like=like.name, settings=settings)
