"""The interface of every executor, and the errors of its calls."""

from __future__ import annotations

import concurrent.futures
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from softcal.catalogue import Catalogue
from softcal.display import displayed
from softcal.errors import CalibrationError, Fault

TRIES = 3
"""How often a call is made whose worker ends, hangs or cannot do it."""
_LONGER, _UNKNOWN = 20.0, 6 * 3600.0  # times the longest, [s]


class WorkerLost(CalibrationError):
    """A call that ended its worker each time that it was made; the message is a sentence."""


class ExecutorLost(CalibrationError):
    """No more calls can be made, such as where a cluster's scheduler no longer answers; the message is a sentence."""


@dataclass(frozen=True)
class WorkerState:
    """A worker: its name, what it does, and how many calls it has finished."""

    name: str
    state: Literal["busy", "idle", "lost"]
    done: int


@displayed
class Executor(concurrent.futures.Executor, ABC):
    """Makes calls in workers. To be closed, best by `with`.

    `submit(function, *args)` is that of `concurrent.futures.Executor`. The function is one that the workers can import.
    A worker that ends, hangs or cannot do a call costs that call alone: it is made again elsewhere, and raises
    WorkerLost in the end.

    Attributes
    ----------
    name
        By which `--on` knows it.
    summary
        What it is, in a phrase.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    _shared: tuple[object, object] | None = None  # the object that was shared last, and what `sent` gave for it

    @classmethod
    @abstractmethod
    def at(cls, address: str, workers: int | None) -> Executor:
        """The executor at an address, the text behind `NAME:` ("" where there is none).

        Raises
        ------
        InputError
            Where there is no such executor, it does not answer, or `workers` is not for it to choose.
        """

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of its workers at present, at least 1."""

    @property
    @abstractmethod
    def workers(self) -> Sequence[WorkerState]:
        """The state of each worker."""

    @property
    @abstractmethod
    def told(self) -> str:
        """Description for messages: "2 processes of this machine"."""

    @property
    def here(self) -> bool:
        """Whether the workers are processes of this machine, which take time to start."""
        return False

    @property
    def alone(self) -> bool:
        """Whether there is one worker, a process of this machine: the calling process can then do its calls as well."""
        return self.here and self.count == 1

    def share(self, what: object) -> object:
        """A placeholder for a large object in the arguments of `call`; the object is sent to each worker once.

        An object that is shared again, as by every generation of a search, is not packed again.

        Raises
        ------
        CalibrationError
            Where it cannot be pickled.
        """
        if self._shared is None or self._shared[0] is not what:
            self._shared = (what, self.sent(what))
        return self._shared[1]

    @abstractmethod
    def sent(self, what: object) -> object:
        """The placeholder that `share` returns for an object other than the last one.

        Raises
        ------
        CalibrationError
            Where it cannot be pickled.
        """

    @abstractmethod
    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        """See `concurrent.futures.Executor.submit`."""


@dataclass(frozen=True)
class Patience:
    """The limit of time after which a call counts as hanging.

    Attributes
    ----------
    fixed
        The limit [s]; None: a multiple of the longest call so far.
    shortest
        The least limit [s] in the latter case.
    """

    fixed: float | None = None
    shortest: float = 600.0

    def after(self, longest: float) -> float:
        """The limit [s] after the longest call so far [s], 0 before the first call has ended."""
        if self.fixed is not None:
            return self.fixed
        return max(self.shortest, _LONGER * longest) if longest else _UNKNOWN


def _faults(kind: type[Executor], known: Mapping[str, type[Executor]]) -> list[Fault]:
    if not (isinstance(kind, type) and issubclass(kind, Executor)):
        return [Fault("this is not an executor", "--on", repr(kind)[:60], "a subclass of softcal's Executor")]
    where = f"executor {kind.__name__}"
    missing = [name for name in ("name", "summary") if not hasattr(kind, name)] + sorted(kind.__abstractmethods__)
    return [Fault("the executor lacks something", where, allowed=f"'{name}' must be there") for name in missing]


EXECUTORS: Catalogue[type[Executor]] = Catalogue(
    "executor", "softcal.executors", _faults, home="softcal.executors.kinds"
)
register_executor = EXECUTORS.registrar("register_executor", "Add an executor: `--on` then accepts its name.")
