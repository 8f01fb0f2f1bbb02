"""The radar's states of figure 4.2, disengaged, engaged, launched, damaged, as the timers of (4.3)-(4.7)."""

from __future__ import annotations

from typing import Any

from fieldmodels.compiled import inlined
from fieldmodels.machines.uav_route.parameters import ELAPSED, IN_SAMPLES, UNBROKEN


@inlined
def launched(engage: float, c: Any) -> bool:
    """Whether a radar whose engage timer stands at ``engage`` has launched its missile."""
    return engage > 0.0 and engage >= c.engage


@inlined
def timers_after(
    lose: float, engage: float, launch: float, detected: bool, time: float, c: Any
) -> tuple[float, float, float, bool, bool]:
    """Let a radar's timers run.

    Args:
        lose: Lock-loss timer x_LL.
        engage: Engage timer x_eng.
        launch: Launch timer x_launch.
        detected: Whether the radar detects the aircraft all this while.
        time: How long it takes [s].
        c: Thresholds, and how the equations are read.

    Returns:
        The three timers; whether an engaged radar has lost its lock; whether the missile has hit.
    """
    if c.timers == IN_SAMPLES:
        return samples_after(lose, engage, launch, detected, c)
    before = engage
    if detected:
        lose = 0.0
        engage += time
    else:
        lose += time
        if c.engaged == ELAPSED and engage > 0.0:
            engage += time
        elif c.engaged == UNBROKEN and not launched(engage, c):
            engage = 0.0
    if not detected and lose >= c.lose:
        return lose, 0.0, 0.0, before > 0.0, False
    if launched(before, c):
        launch += time
    elif launched(engage, c):
        launch = engage - c.engage  # the missile leaves within this time
    return lose, engage, launch, False, launched(engage, c) and launch >= c.target


@inlined
def samples_after(
    lose: float, engage: float, launch: float, detected: bool, c: Any
) -> tuple[float, float, float, bool, bool]:
    """One sample of (4.3) and (4.5)-(4.7) as printed: counts against times, events of the sample before."""
    lost, fired = lose >= c.lose, engage >= c.engage
    damaged = launch >= c.target
    had = engage > 0.0
    lose = 0.0 if detected else lose + 1.0
    engage = 0.0 if lost else engage + (1.0 if detected else 0.0)
    launch = 0.0 if lost else launch + (1.0 if fired else 0.0)
    return lose, engage, launch, lost and had, damaged
