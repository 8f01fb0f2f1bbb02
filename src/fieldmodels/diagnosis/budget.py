"""A time budget: the best verdict so far, and what was left out for it.

It is a user's wish, and the one thing in a diagnosis that depends on the clock; without one nothing does.
The clock itself is asked between fits: one simulation may cost a hundred times another (a narrow hysteresis,
plain motion), so a number of simulations would keep no time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from fieldmodels.diagnosis.effort import watched

Result = TypeVar("Result")
SEARCH, JUDGED = 0.6, 0.85
"""Shares of the budget at which the search and the judging end; the rest is for measuring what they found."""
SHOWN = 4
"""Names of what was left out that are listed."""


class OverBudgetError(Exception):
    """The time is over amid a step."""


class Budget:
    """How long a diagnosis may take.

    Attributes:
        seconds: From now on; None for as long as it takes.
        left_out: What was left out.
    """

    def __init__(self, seconds: float | None = None, clock: Callable[[], float] = time.perf_counter) -> None:
        """Start the clock.

        Raises:
            ValueError: If the time is no positive number.
        """
        if seconds is not None and not seconds > 0.0:
            raise ValueError(f"budget: {seconds:g} s; give a positive time, or leave it out")
        self.seconds, self._clock = seconds, clock
        self._began = clock() if seconds is not None else 0.0
        self.left_out: list[str] = []

    def lacks(self, what: str, share: float = 1.0) -> bool:
        """Whether a share of the budget is spent, so that something is left out; it is noted."""
        if self.seconds is None or self._clock() - self._began < share * self.seconds:
            return False
        self.left_out.append(what)
        return True

    def within(
        self, what: str, act: Callable[[], Result], otherwise: Result, share: float = JUDGED
    ) -> Result:
        """What a step gives; where time lacks before it or runs out amid it, what stands without it."""
        if self.seconds is None:
            return act()

        def ask() -> None:
            if self.lacks(what, share):
                raise OverBudgetError

        try:
            with watched(ask):
                ask()
                return act()
        except OverBudgetError:
            return otherwise

    def words(self) -> str:
        """What was left out, in a sentence; empty if nothing was."""
        names = list(dict.fromkeys(self.left_out))
        if not names or self.seconds is None:
            return ""
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        spent = self._clock() - self._began
        return (
            f"Stopped after {spent:.3g} s of a budget of {self.seconds:g} s; "
            f"not tried: {', '.join(names[:SHOWN])}{more}."
        )
