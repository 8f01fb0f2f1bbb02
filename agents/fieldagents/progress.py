"""Progress on standard error: a bar in a terminal, plain lines in a log, nothing if quiet."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Report = Callable[[str, float], None]
"""Called with what is being done and how much of the whole is done, 0 to 1.

What follows ``": "`` are numbers that belong to the stage: they alone are no new line in a log.
"""


@contextmanager
def progress(*, quiet: bool = False) -> Iterator[Report]:
    """Give a function that shows progress.

    Args:
        quiet: Show nothing.
    """
    if quiet:
        yield lambda _stage, _fraction: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

        columns = (TextColumn("{task.description:<36}"), BarColumn(), TaskProgressColumn())
        with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("", total=1.0)
            yield lambda stage, fraction: bar.update(task, description=stage, completed=fraction)
    else:
        yield _Lines()


def stages(report: Report, part: float) -> Report:
    """Show what is prepared within a short piece of work, at this part of the whole."""
    return lambda stage, _: report(stage, part) if stage else None


class _Lines:
    """One line for every new stage and every further tenth."""

    def __init__(self) -> None:
        self._last: tuple[str, int] = ("", -1)

    def __call__(self, stage: str, fraction: float) -> None:
        now = (stage.partition(": ")[0], int(10 * fraction))
        if now != self._last:
            self._last = now
            print(f"{100 * fraction:3.0f} %  {stage}", file=sys.stderr, flush=True)
