"""Stopping what takes too long, in processor time, so that it does not depend on the machine's load."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class TooLongError(Exception):
    """Something takes longer than it may."""


@contextmanager
def processor_limit(seconds: float | None) -> Iterator[None]:
    """Stop what takes longer; for the main thread. An outer limit goes on.

    Args:
        seconds: Processor time; None for no limit.

    Raises:
        TooLongError: When the time is over.
    """
    if seconds is None:
        yield
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise TooLongError(f"longer than {seconds:g} s")

    handler = signal.signal(signal.SIGPROF, stop)
    outer, _ = signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        left, _ = signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)
        if outer:
            signal.setitimer(signal.ITIMER_PROF, max(outer - (seconds - left), 1e-3))
