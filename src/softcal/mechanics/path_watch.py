"""Observers of the load paths of a computation: their progress, and whether a stop keeps what is ready."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class PathProgress:
    """Progress of a load path or a series of them: share of the whole [-], and factorisations so far."""

    share: float
    n_factorisations: int

    def __str__(self) -> str:
        return f"{100.0 * self.share:.0f} %, {self.n_factorisations} factorisations"


@dataclass(frozen=True)
class PathWatch:
    """An observer of load paths.

    Attributes
    ----------
    observe
        Called after each attempted step.
    keeps
        Whether Ctrl-C, or another stop signal, ends a response with what is ready, instead of being raised.
    begin, width
        The part of the whole that the present path is [-].
    """

    observe: Callable[[PathProgress], None] = lambda progress: None
    keeps: bool = False
    begin: float = 0.0
    width: float = 1.0

    def tell(self, share: float, n_factorisations: int) -> None:
        """Pass on the progress of the present path."""
        self.observe(PathProgress(self.begin + self.width * min(max(share, 0.0), 1.0), n_factorisations))


_PRESENT: ContextVar[PathWatch] = ContextVar("path_watch", default=PathWatch())  # noqa: B039 (frozen)


def path_watch() -> PathWatch:
    """The present watch; by default it passes nothing on, and a stop is raised."""
    return _PRESENT.get()


@contextmanager
def paths_watched(observe: Callable[[PathProgress], None], *, keeps: bool = False) -> Generator[None]:
    """Observe the load paths that are followed in this block and thread."""
    with _as_present(PathWatch(observe, keeps)):
        yield


@contextmanager
def part_of_series(i: int, n: int) -> Generator[None]:
    """A block that follows the i-th of n load paths, counted from zero."""
    watch = path_watch()
    with _as_present(replace(watch, begin=watch.begin + watch.width * i / n, width=watch.width / n)):
        yield


@contextmanager
def _as_present(watch: PathWatch) -> Generator[None]:
    token = _PRESENT.set(watch)
    try:
        yield
    finally:
        _PRESENT.reset(token)
