"""Ending in good order: SIGTERM and SIGINT as a request that is met at the next place where work can stop."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGTERM, signal.SIGINT)
PATIENCE: dict[int, float] = {signal.SIGINT: 1.5, signal.SIGTERM: 60.0}
"""How long a request may wait for a place where work can stop [s]: Ctrl-C is somebody who waits."""


@contextmanager
def interruptible(leave: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM raise KeyboardInterrupt, and end the process where that is not met in time.

    Python meets a signal between two of its own steps, and a compiled loop may take minutes. So a thread
    waits beside it: where nobody has met a request within `PATIENCE`, it calls ``leave`` and ends the process
    with the exit code 130. What was written stays whole, as after any kill.

    Args:
        leave: Says so, and lets go of what the process holds.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    met = threading.Event()

    def meet(_number: int, _frame: FrameType | None) -> None:
        met.set()
        raise KeyboardInterrupt

    def watch() -> None:
        while number := os.read(ear, 1)[0]:
            if (patience := PATIENCE.get(number)) and not met.wait(patience):
                leave()
                os._exit(130)

    ear, mouth = os.pipe()
    os.set_blocking(mouth, False)
    before = signal.set_wakeup_fd(mouth, warn_on_full_buffer=False)
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        with _handling(SIGNALS, meet):
            yield
    finally:
        met.set()
        signal.set_wakeup_fd(before)
        os.set_blocking(mouth, True)
        os.write(mouth, b"\0")
        watcher.join()
        os.close(mouth)
        os.close(ear)


@contextmanager
def terminated_like_interrupted() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt, so that what ends in good order on Ctrl-C does so on both."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    with _handling((signal.SIGTERM,), stop):
        yield


@contextmanager
def stop_between() -> Iterator[Callable[[], bool]]:
    """Give a function that says whether the process has been asked to stop; a second request interrupts.

    Ray cancels a job by the same SIGINT.
    """
    asked = False

    def note(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    with _handling(SIGNALS, note):
        yield lambda: asked


@contextmanager
def _handling(
    signals: tuple[signal.Signals, ...], handler: Callable[[int, FrameType | None], None]
) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():  # only the main thread may set handlers
        yield
        return
    before = {number: signal.signal(number, handler) for number in signals}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
