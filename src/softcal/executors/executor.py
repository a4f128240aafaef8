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
        """What is known of each worker."""

    @property
    @abstractmethod
    def told(self) -> str:
        """What it is, for people: "2 processes of this machine"."""

    @property
    def here(self) -> bool:
        """Whether its workers are processes of this machine that cost time to start."""
        return False

    @property
    def alone(self) -> bool:
        """Whether it is one process of this machine, so that calls may as well be made in this one."""
        return self.here and self.count == 1

    def share(self, what: object) -> object:
        """What stands for a large object among the arguments of `call`: it is sent to each worker once.

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
        """What `share` gives for an object that was not shared just before.

        Raises
        ------
        CalibrationError
            Where it cannot be pickled.
        """

    @abstractmethod
    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        """As in `concurrent.futures`."""


@dataclass(frozen=True)
class Patience:
    """How long a call may take before it counts as hanging.

    Attributes
    ----------
    fixed
        Seconds, whatever others take; None: by the longest so far.
    shortest
        Seconds that every call may take where it goes by the longest.
    """

    fixed: float | None = None
    shortest: float = 600.0

    def after(self, longest: float) -> float:
        """Seconds that a call may take, given the longest so far [s], 0 before the first has ended."""
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
