"""The signals that ask a program to stop: Ctrl-C (SIGINT), SIGTERM and SIGHUP, alike.

Each raises KeyboardInterrupt where the program listens to it: Python does so for Ctrl-C, `stop_signals_raised` for the
others. A signal that the caller has set to be ignored (`nohup`, `trap '' INT`) stays ignored.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from types import FrameType
from typing import NoReturn

STOP_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_Handler = Callable[[int, FrameType | None], object]


class StopSignal(KeyboardInterrupt):
    """A stop that was asked for by another signal than Ctrl-C's; its text is the signal's name."""

    def __init__(self, number: int) -> None:
        KeyboardInterrupt.__init__(self, signal.Signals(number).name)
        self.number = number


def exit_code(stop: KeyboardInterrupt) -> int:
    """The exit code of a program that was stopped: 128 and the number of the signal, as in a shell."""
    return 128 + (stop.number if isinstance(stop, StopSignal) else signal.SIGINT)


@contextmanager
def stop_signals_raised() -> Generator[None]:
    """Raise `StopSignal` for SIGTERM and SIGHUP within this block, where they would end the program without a
    message.
    """
    terminals = [number for number in range(3) if os.isatty(number)]

    def answer(number: int, frame: FrameType | None) -> NoReturn:
        # Output to a terminal that has been closed is discarded: writing there would be an error.
        gone = [terminal for terminal in terminals if not os.isatty(terminal)]
        if gone:
            nowhere = os.open(os.devnull, os.O_RDWR)
            for terminal in gone:
                os.dup2(nowhere, terminal)
            os.close(nowhere)
        raise StopSignal(number)

    by_default = [number for number in STOP_SIGNALS if signal.getsignal(number) is signal.SIG_DFL]
    with _answered(dict.fromkeys(by_default, answer)):
        yield


@contextmanager
def interrupts_held() -> Generator[None]:
    """Defer stop signals within this block to its end (a critical section).

    Only the main thread is ever interrupted, so in others this does nothing.
    """
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    try:
        with _answered(dict.fromkeys(_heard(), note)):
            yield
    finally:
        for number in dict.fromkeys(came):
            signal.raise_signal(number)


@dataclass
class Stop:
    """The request to stop, by the user or another program; None where there is none."""

    by: KeyboardInterrupt | None = None

    def heed(self) -> None:
        """Raise what asked to stop: Python drops what is raised in a finalizer or a callback, and goes on.

        Raises
        ------
        KeyboardInterrupt
            Where something has.
        """
        if self.by is not None:
            raise self.by


@contextmanager
def stoppable() -> Generator[Stop]:
    """Record a request to stop within this block, so that the following work is not begun."""
    stop = Stop()

    def noted(answer: _Handler) -> _Handler:
        def note(number: int, frame: FrameType | None) -> None:
            try:
                answer(number, frame)
            except KeyboardInterrupt as asked:
                stop.by = asked
                raise

        return note

    with _answered({number: noted(answer) for number, answer in _heard().items()}):
        try:
            yield stop
        except Exception as error:  # because of the stop, as from a lock that was being released
            cause: BaseException | None = error
            while cause is not stop.by and cause is not None:
                cause = cause.__context__
            if cause is None:
                raise
            raise cause from None


def _heard() -> dict[int, _Handler]:
    """The handlers of the stop signals that are neither ignored nor left to the system, nor from outside Python."""
    handlers = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    return {number: handler for number, handler in handlers.items() if callable(handler)}


@contextmanager
def _answered(answers: Mapping[int, _Handler]) -> Generator[None]:
    """Install other handlers for signals within this block; only the main thread can do that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with ExitStack() as stack:
        # Each handler is restored, also where a signal whose own handler is (again) installed raises meanwhile.
        for number in answers:
            stack.callback(signal.signal, number, signal.getsignal(number))
        for number, answer in answers.items():
            signal.signal(number, answer)
        yield
