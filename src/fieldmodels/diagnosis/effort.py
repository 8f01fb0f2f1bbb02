"""How much a diagnosis simulates, and the threads that share the work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from threading import Lock
from typing import TypeVar

VARIABLE = "FIELDGYM_THREADS"
"""Environment variable: threads of a diagnosis whose options leave them open."""
Item = TypeVar("Item")
Result = TypeVar("Result")


class Meter:
    """Counts the windows that a diagnosis simulates, whichever thread does."""

    def __init__(self) -> None:
        self.windows = 0
        self._lock = Lock()

    def add(self, windows: int) -> None:
        """Count some more."""
        with self._lock:
            self.windows += windows


_METER: ContextVar[Meter | None] = ContextVar("meter", default=None)


@contextmanager
def metered() -> Iterator[Meter]:
    """Count the windows that are simulated inside."""
    meter = Meter()
    token = _METER.set(meter)
    try:
        yield meter
    finally:
        _METER.reset(token)


_WATCH: ContextVar[Callable[[], None] | None] = ContextVar("watch", default=None)


@contextmanager
def watched(ask: Callable[[], None]) -> Iterator[None]:
    """Ask at every simulation inside, which what is asked may end by an exception."""
    token = _WATCH.set(ask)
    try:
        yield
    finally:
        _WATCH.reset(token)


def simulated(windows: int) -> None:
    """Say that so many windows are simulated."""
    if ask := _WATCH.get():
        ask()
    meter = _METER.get()
    if meter is not None:
        meter.add(windows)


def threads_of(wanted: int) -> int:
    """Number of threads: as wanted, or by the environment where that is 0, else one.

    Raises:
        ValueError: If the number is none.
    """
    said = os.environ.get(VARIABLE, "1")
    try:
        number = wanted or int(said)
    except ValueError:
        raise ValueError(f"{VARIABLE}={said}: not a whole number; give 1 or more") from None
    if number < 1:
        raise ValueError(f"threads: {number}; give 1 or more (options, or {VARIABLE})")
    return number


def shared(function: Callable[[Item], Result], items: Sequence[Item], threads: int) -> list[Result]:
    """Results of all items, in their order; compiled kernels leave the interpreter to other threads."""
    if threads == 1 or len(items) < 2:
        return [function(item) for item in items]
    pool = ThreadPoolExecutor(min(threads, len(items)))
    try:
        jobs = [pool.submit(copy_context().run, function, item) for item in items]
        return [job.result() for job in jobs]
    finally:
        pool.shutdown(cancel_futures=True)  # who interrupts waits for what runs, not for what waits
