"""calibrate(problem): run a search to its end, then build the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from softcal.calibration.problem.fingerprint import fingerprints
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_files import write_result
from softcal.calibration.search.hold_out import fitted_part, predicted
from softcal.calibration.search.optimiser import OPTIMISERS
from softcal.calibration.search.outcome import conclude
from softcal.calibration.search.search import Observer, Search, searched
from softcal.calibration.search.settings import SearchSettings
from softcal.calibration.search.shared_search import Sharing, require_shareable, searched_together
from softcal.calibration.statistics.estimate import Remark
from softcal.calibration.statistics.mesh_error import with_mesh_error
from softcal.declare import checked_arguments
from softcal.executors.each import Workers


@checked_arguments
def calibrate(  # noqa: PLR0913 (what is searched, where, and by whom)
    problem: Problem,
    settings: SearchSettings | None = None,
    *,
    workers: Workers = 1,
    store: str | Path | None = None,
    resume: bool = False,
    hashes: Mapping[str, str] | None = None,
    files: Mapping[str, str] | None = None,
    progress: Observer | None = None,
    sharing: Sharing | None = None,
    **changes: Any,
) -> CalibrationResult:
    """Find the free parameters of a problem, all its experiments jointly.

    Ctrl-C ends the search (as other signals do, see `interrupts`); the result is then the best of the trials so far,
    and its status says so. With more than one worker a script must guard its own start with `if __name__ ==
    "__main__":`.

    Parameters
    ----------
    problem
        The robot, the experiments, the free parameters and the loss.
    settings
        Settings of the search; `SearchSettings()` when None.
    workers
        An executor, or a number of processes. Every method gives the same result for any number, up to the last
        digits, in which the linear solver's threads (cores over workers) round differently. `tpe` asks for four trials
        at a time, so more than four workers do not help it; a resumed run keeps the number that it began with.
    store
        Run folder: every trial is stored there at once, and the result at the end. None stores nothing.
    resume
        Resume the run in `store`, exactly as if it had not stopped.
    hashes, files
        What else identifies the run (a resume with another is refused), and texts to store with it.
    progress
        Called after every trial, and before a long computation after the search (its `stage` names that).
    sharing
        The study in which several processes, on one machine or many, do the trials of one search by `tpe` together;
        each calls this with a `store` of its own. Its result depends on the order in which trials end.
    changes
        Settings by their names, such as `method="tpe", trials=100`, in the place of those in `settings`.

    Raises
    ------
    ParameterError
        For a setting that does not exist or makes no sense, or an experiment that cannot be held out.
    StorageError
        Where the folder cannot be used, or holds a run of something else.
    CalibrationError
        Where no trial could be simulated, or there are no workers any more. The trials are stored.
    """
    given = (settings or SearchSettings()).changed(**changes)
    search, complete = _search(problem, given, hashes)
    part = search.problem
    course = searched if sharing is None else partial(searched_together, sharing=sharing)
    folder = None if store is None else Path(store)
    with course(search, workers=workers, store=folder, resume=resume, files=files, progress=progress) as found:
        account = found.account
        conclusion = partial(conclude, CalibrationResult, part, converged=account.converged)
        if given.mesh_error and account.converged is not False:
            found.announce("one simulation on a finer mesh")
            seen = with_mesh_error(part, found.best)
            account = replace(account, n_solves=account.n_solves + seen.n_solves)
            result = conclusion(seen.best, found.trials, account, uncertain=seen.uncertain)
            if seen.unknown:
                own = part.simulate is None  # the twin of another engine has no finer mesh
                remark = Remark(seen.unknown, "warning" if own else "note")
                result = replace(result, notes=(*result.notes, remark))
        else:
            result = conclusion(found.best, found.trials, account)
        if complete.hold_out:
            found.announce(f"prediction of {', '.join(complete.hold_out)}")
            theta = {name: estimate.value for name, estimate in result.parameters.items()}
            held_out, notes = predicted(problem, theta, complete.hold_out, found.best)
            result = replace(result, held_out=held_out, notes=(*result.notes, *notes))
        if found.folder is not None:
            write_result(result, found.folder)
        return result


def require_joinable(
    problem: Problem, settings: SearchSettings, sharing: Sharing, hashes: Mapping[str, str] | None = None
) -> None:
    """Raise unless `calibrate` with the same arguments could take part in a shared study; nothing is made.

    Parameters
    ----------
    problem, settings, hashes
        See `calibrate`.
    sharing
        The shared study.

    Raises
    ------
    InputError
        See `calibrate`.
    """
    require_shareable(_search(problem, settings, hashes)[0], sharing)


def _search(problem: Problem, given: SearchSettings, hashes: Mapping[str, str] | None) -> tuple[Search, SearchSettings]:
    """The search that the settings ask for, and the settings made complete."""
    optimiser = OPTIMISERS.named(given.method)
    complete = optimiser.settled(given)
    part = fitted_part(problem, complete.hold_out)
    search = Search(
        part,
        optimiser,
        lambda batch: optimiser.begin(part, replace(complete, batch=batch)),
        complete.record(),
        {**fingerprints(problem), **(hashes or {})},
        derives=True,
    )
    return search, complete
