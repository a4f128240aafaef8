"""The error of the mesh in candidates, at the cost of the calibration's own finer trajectories.

A finer trajectory costs more than all the rest of a ranking. Candidates whose states lie on a load path of the
calibration are read from its finer trajectory, which goes as far as they pull. The load path of an actuator's
coordinate is that of its effort too: where the effort is prescribed instead, the finer trajectory is read at equal
effort. In any other candidate the error of the mesh is that of the parameters: of the smallest step of the parameters,
in the unit box, that has the effect of the finer mesh on the experiments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.statistics.local_model import jacobian_of
from softcal.calibration.statistics.mesh_error import on_finer_mesh, unknown
from softcal.checks import Floats
from softcal.experiments.dataset import Channel, Dataset
from softcal.sensing.channel import channel_name

_UNEXPLAINED = 0.05  # of the change on the finer mesh: as much as no step of the parameters need explain
_FURTHER = 1.5  # as far as reaches the same tension on nearly any softer mesh
_UNIFORM = 12.0  # one over the variance of a uniform distribution over the unit box


@dataclass(frozen=True)
class MeshChange:
    """Change of predictions on a finer mesh.

    Attributes
    ----------
    changes
        Experiment or candidate, and channel -> change of the predictions (n,) [SI]; of those on the calibration's own
        load paths.
    unknown
        Why there are none, a sentence, or "".
    n_solves
        Number of simulated trajectories.
    """

    changes: Mapping[tuple[str, str], Floats]
    unknown: str = ""
    n_solves: int = 0


def mesh_change(whole: Problem, theta: Mapping[str, float], found: Evaluation, candidates: Sequence[str]) -> MeshChange:
    """Change of the predictions on a finer mesh.

    Parameters
    ----------
    whole
        Problem whose experiments include the candidates.
    theta
        Values [SI] by label of the free parameters.
    found
        Its evaluation at theta.
    candidates
        Names of the candidates.
    """
    from scipy.interpolate import PchipInterpolator

    own = [e.name for e in whole.experiments if e.name not in candidates]
    plain = _on_paths_of(own, whole, theta)
    turned = {
        e.name: other
        for e in whole.experiments
        if e.name not in plain and (other := _by_other_control(e, found.observations[e.name].predicted)) is not None
    }
    mixed = replace(whole, experiments=tuple(turned.get(e.name, e) for e in whole.experiments))
    on_paths = _on_paths_of(own, mixed, theta)
    finer = on_finer_mesh(mixed.only(on_paths), theta)
    if isinstance(finer, str):
        return MeshChange({}, finer)
    if not set(own) <= set(finer.observations):
        return MeshChange({}, unknown(finer.failure), finer.n_solves)
    at_finer = {(block.experiment, block.channel): block for block in finer.blocks}
    changes = {
        key: at_finer[key].residual - block.residual
        for block in found.blocks
        if (key := (block.experiment, block.channel)) in at_finer and block.experiment not in turned
    }
    for name in set(turned) & set(finer.observations):
        test = next(e for e in whole.experiments if e.name == name)
        # At equal values of the test's drive, which is predicted for the turned test.
        driver, at_finer_mesh = test.drives[0], finer.observations[name].predicted
        along, values = at_finer_mesh[driver], test.dataset.values(driver)
        if np.all(np.diff(along) > 0.0):
            path = {**at_finer_mesh, **{c: turned[name].dataset.values(c) for c in turned[name].drives}}
            changes |= {
                (name, c): PchipInterpolator(along, path[c])(values) - found.observations[name].predicted[c]
                for c in test.compared
            }
    return MeshChange(changes, "", finer.n_solves)


def step_of_parameters(
    blocks: Sequence[Block], weights: Sequence[Floats], changes: Sequence[Floats], slopes: Floats
) -> Floats:
    """Step (size,) [SI] of the parameters by the effect of the finer mesh on the experiments.

    Parameters
    ----------
    blocks
        Blocks of the experiments, with jacobians.
    weights
        Weights (n,) of the squares in the loss, by block.
    changes
        Changes (n,) of the predictions on the finer mesh, by block.
    slopes
        d theta / dz (size,) of the parameters by the unit box.
    """
    rows = [np.sqrt(w)[:, None] * jacobian_of(block) * slopes for block, w in zip(blocks, weights, strict=True)]
    answer = np.concatenate(rows)
    wanted = np.concatenate([np.sqrt(w) * change for w, change in zip(weights, changes, strict=True)])
    bounds = _UNIFORM * _UNEXPLAINED**2 * float(wanted @ wanted) * np.eye(len(slopes))
    return slopes * np.linalg.lstsq(answer.T @ answer + bounds, answer.T @ wanted, rcond=None)[0]


def _on_paths_of(own: Sequence[str], problem: Problem, theta: Mapping[str, float]) -> list[str]:
    """The experiments on the load paths of some of them."""
    groups = [[member[0].name for member in group.members] for group in problem.trajectories(theta)]
    return [name for names in groups if set(names) & set(own) for name in names]


def _by_other_control(test: Experiment, predicted: Mapping[str, Floats]) -> Experiment | None:
    """The test by the coordinate that a prescribed effort causes, or the reverse; None if that is not unique."""
    if len(test.drives) != 1:
        return None
    driver = test.drives[0]
    carrier, values = test.twin_channel(driver).carrier, test.dataset.values(driver)
    other = next((c for c in test.compared if (n := test.twin_channel(c)).kind.drives and n.carrier == carrier), None)
    if other is None or len(values) < 2 or np.any(np.diff(values) <= 0.0) or np.any(np.diff(predicted[other]) <= 0.0):
        return None
    path = predicted[other]
    further = np.linspace(path[0], _FURTHER * path[-1], len(values))
    channels = {
        **test.dataset.channels,
        driver: Channel(np.zeros(len(values)), channel_name(driver).kind.unit, 1.0),
        other: Channel(further, channel_name(other).kind.unit),
    }
    return replace(
        test,
        dataset=Dataset(test.name, channels, test.dataset.provenance, labels=test.dataset.labels),
        drive=(other,) if isinstance(test.drive, tuple) else channel_name(other).kind.name,
        compared=tuple(driver if c == other else c for c in test.compared),
    )
