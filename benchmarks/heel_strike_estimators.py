"""How far below the dissertation's estimators one can go: tuned on one set of walks, tested on another.

    python benchmarks/heel_strike_estimators.py

Mean |error| at heel strikes [mm], before the reset. Stationary noise: Ranger's nominal levels on a flat and
on a rough floor. Hidden regimes: what ``fieldgym/HeelStrike-v0`` uses.
"""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike.parameters import CollisionKind, Noise, Regimes
from fieldmodels.machines.heel_strike.search import Walks, record_walks, score_gains

DECAY = 1000 / 3
TUNING, TEST = range(0, 4), range(1000, 1008)
STRIDES = 300


def walks(seeds: range, noise: Noise | Regimes) -> Walks:
    """Walks of some seeds, with the bank of filters."""
    return record_walks([np.random.default_rng(s) for s in seeds], STRIDES, noise=noise, bank=True)


def best(on: Walks, grid: FloatArray, rows: FloatArray | None = None) -> FloatArray:
    """The best of a grid of gains."""
    return grid[np.argmin(score_gains(on, grid, rows))]


def refined(on: Walks, start: FloatArray, rows: FloatArray | None = None) -> FloatArray:
    """Coordinate search on log scales from a start; gains (4,), or (8, 4) given the regime."""
    gains = start.copy()
    table = gains.reshape(-1, 4)
    for width in (4.0, 2.0, 1.4, 1.4):
        for row in range(len(table)):
            for column in range(3):
                trial = np.repeat(gains[None], 9, axis=0)
                view = trial.reshape(9, -1, 4)
                view[:, row, column] = np.clip(table[row, column] * width ** np.linspace(-1, 1, 9), 1e-4, 1.0)
                gains[...] = best(on, trial, rows)
    return gains


def sensor_only(resets: FloatArray) -> FloatArray:
    """Gains that use no model, as Ranger: S_MS = 1."""
    return np.array([[1.0, 1.0, reset, DECAY] for reset in resets])


def row(noise: Noise | Regimes) -> dict[str, float]:
    """All estimators on one noise."""
    tune, test = walks(TUNING, noise), walks(TEST, noise)
    resets = np.geomspace(0.01, 1, 25)
    paper = np.array([[s, s, r, DECAY] for s in np.linspace(0, 1, 21) for r in np.linspace(0, 1, 21)])
    logs = np.geomspace(0.001, 1, 19)
    fixed = np.array([[s, s, r, DECAY] for s in logs for r in resets])
    found = {
        "Ranger .1": sensor_only(np.array([0.1]))[0],
        "Ranger tuned": best(tune, sensor_only(resets)),
        "paper grid": best(tune, paper),
        "log grid": refined_pair(tune, best(tune, fixed)),
        "gated": refined(tune, best(tune, fixed)),
    }
    result = {name: float(score_gains(test, gains[None])[0]) for name, gains in found.items()}
    if isinstance(noise, Regimes):
        given = refined(tune, np.repeat(found["gated"][None], 8, axis=0), tune.regime)
        result["oracle gains"] = float(score_gains(test, given[None], test.regime)[0])
    for name, column in (("EKF", 3), ("IMM", 4)):
        if name == "EKF" or isinstance(noise, Regimes):
            result[name] = float(np.abs(test.estimator_mm[:, column]).mean())
    return result


def refined_pair(on: Walks, start: FloatArray) -> FloatArray:
    """Refine S_MS and S_HR with S_MS the same in both phases."""
    grid = np.array(
        [
            [s, s, r, DECAY]
            for s in np.clip(start[0] * np.geomspace(0.6, 1.6, 9), 0, 1)
            for r in np.clip(start[2] * np.geomspace(0.8, 1.25, 9), 0, 1)
        ]
    )
    return best(on, grid)


def main() -> None:
    """Print the tables."""
    kinds: tuple[CollisionKind, ...] = ("low_pass", "ar1")
    for kind in kinds:
        for floor in (0.0, 0.004):
            show(f"{kind}, floor {1000 * floor:g} mm", row(Noise(collision_kind=kind, floor=floor)))
        show(f"{kind}, hidden regimes", row(Regimes(collision_kind=kind)))


def show(title: str, values: dict[str, float]) -> None:
    """Print one line of a table."""
    print(f"{title:26s}", "  ".join(f"{name} {value:.3f}" for name, value in values.items()), flush=True)


if __name__ == "__main__":
    main()
