"""Optuna's storage of one study, whose trials are read when softcal asks for it and not whenever Optuna looks at them.

Optuna reads them again to find a waiting one, and for its sampler; from a database each time by seven statements.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    import optuna


class StudyStorage:
    """The trials of a study by their numbers.

    Parameters
    ----------
    storage
        Optuna's.
    """

    def __init__(self, storage: optuna.storages.BaseStorage) -> None:
        import optuna

        self._storage = optuna.storages.get_storage(storage)
        self._study: int | None = None
        self.trials: list[optuna.trial.FrozenTrial] = []

    @property
    def as_optunas(self) -> optuna.storages.BaseStorage:
        """The same, for Optuna, which has the rest of what a storage does from its own."""
        return cast("optuna.storages.BaseStorage", self)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._storage, name)

    def choose(self, study: str) -> None:
        """Say by its name which study it is of, and read its trials."""
        self._study = self._storage.get_study_id_from_name(study)
        self.read()

    def read(self) -> list[optuna.trial.FrozenTrial]:
        """The trials, as they are now; `trials` until the next reading."""
        self.trials = self._storage.get_all_trials(self._chosen, deepcopy=False)
        return self.trials

    def get_all_trials(
        self, study_id: int, deepcopy: bool = True, states: Container[optuna.trial.TrialState] | None = None
    ) -> list[optuna.trial.FrozenTrial]:
        """For Optuna: the trials as they were read last.

        Parameters
        ----------
        study_id, deepcopy
            Optuna's, without effect.
        states
            Those of the trials that are wanted; None for all.
        """
        if study_id != self._study:
            return self._storage.get_all_trials(study_id, deepcopy, states)
        return [trial for trial in self.trials if states is None or trial.state in states]

    def trial(self, number: int) -> optuna.trial.FrozenTrial:
        """One trial, as it is now."""
        return self._storage.get_trial(self._id(number))

    def say(self, number: int, key: str, value: Any) -> None:
        """Set an attribute of a trial.

        Parameters
        ----------
        number
            The trial's.
        key, value
            The attribute.

        Raises
        ------
        UpdateFinishedTrialError
            Optuna's, where it has ended.
        """
        self._storage.set_trial_user_attr(self._id(number), key, value)

    def end(self, number: int, state: str, values: Sequence[float] | None = None) -> None:
        """End a trial.

        Parameters
        ----------
        number, state
            The trial's number, and the name of its last state.
        values
            Its loss, where it has one.

        Raises
        ------
        UpdateFinishedTrialError
            Optuna's, where it has ended already.
        """
        import optuna

        self._storage.set_trial_state_values(self._id(number), optuna.trial.TrialState[state], values)

    def _id(self, number: int) -> int:
        return self._storage.get_trial_id_from_study_id_trial_number(self._chosen, number)

    @property
    def _chosen(self) -> int:
        if self._study is None:
            raise RuntimeError("no study has been chosen")
        return self._study
