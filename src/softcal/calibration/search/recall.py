"""A trial of an earlier session, passed again to a resumed search: unchanged, or refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.results.payload import decode
from softcal.calibration.results.stored import contradiction, read_bytes
from softcal.calibration.results.trial_journal import StoredTrial
from softcal.calibration.search.optimiser import Proposal
from softcal.errors import Fault, StorageError

_SAME = 1e-9  # relative; of a loss that is computed again from the same numbers


def recalled(problem: Problem, proposal: Proposal, stored: StoredTrial, journal: Path) -> Evaluation:
    """The evaluation of a proposal, from the trial that is kept under its number in the journal of a run.

    Raises
    ------
    StorageError
        Where the trial is another one, or its arrays are damaged or give another loss.
    """
    trial = stored.trial
    if dict(trial.theta) != dict(proposal.theta):
        raise StorageError(
            Fault(
                f"trial {proposal.number} on disk is not the one that this search would ask for",
                where=str(journal),
                got=str(dict(trial.theta)),
                allowed=str(dict(proposal.theta)),
                attempt="the versions that run.json names, or a new folder",
            )
        )
    if (path := stored.arrays) is None:
        return Evaluation(
            trial.theta,
            trial.loss,
            trial.reason,
            (),
            {},
            trial.experiment_losses,
            None,
            stored.n_solves,
            trial.n_factorisations,
            trial.seconds,
            trial.errors,
        )
    what = f"trial {trial.number} of the run"
    observations = decode(read_bytes(path, what), path, what)
    try:
        for experiment in problem.experiments:
            seen = observations[experiment.name]
            columns = [values for channel in seen.derivatives.values() for values in channel.values()]
            for values in (*seen.predicted.values(), *columns):
                if values.shape != (experiment.dataset.n_samples,):
                    raise ValueError(f"{values.shape} values for {experiment.dataset.n_samples} samples")
            for values in (*seen.predicted.values(), *columns, *seen.response.values()):
                if not np.isfinite(values).all():
                    raise ValueError("values that are not finite")
        again = problem.judge(trial.theta, observations, stored.n_solves, trial.n_factorisations, trial.seconds)
    except (KeyError, ValueError) as error:
        raise contradiction(path, what, f"its arrays are not those of this problem ({error})") from error
    if trial.loss is None or again.loss is None or not math.isclose(again.loss, trial.loss, rel_tol=_SAME):
        raise contradiction(path, what, f"its arrays give the loss {again.loss}, and not {trial.loss}")
    return again
