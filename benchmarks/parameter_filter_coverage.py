"""Are the filters' intervals honest? Coverage of 2 sigma, errors and bits over seeds.

    python benchmarks/parameter_filter_coverage.py --seeds 40

Two vehicles, two kinds of noise, the constant excitation (24) and a random one (wide limits). Coverage
counts |estimate - truth| <= 2 sigma over all unknowns and seeds; a Gaussian has 0.954. Seeds here start at
50 000; the tests use others.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np

from fieldmodels.compiled import compiled
from fieldmodels.estimation.parameter_filter import METHODS, ParameterFilters, Terms
from fieldmodels.estimation.pseudo_inverse import pseudo_inverse
from fieldmodels.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.excitation.motion import CONSTANT, arm_motion
from fieldmodels.excitation.parameters import (
    LIMITS,
    LOWER,
    MODES,
    NAMES,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLE,
    SAMPLES,
    UPPER,
    Arm,
    SensorNoise,
    preset,
)
from fieldmodels.excitation.regression import (
    FEATURES,
    TERMS,
    add_feature_noise,
    fill_features,
    regressor,
)
from fieldmodels.excitation.sensors import full_scale, measure
from fieldmodels.information import fast

FIRST_SEED = 50_000
DECISIONS = 25
RULES = ("constant", "random")


@compiled
def chunks(signals, variances, gravity, y, noise):
    """Features (modes, decisions, 80, K) and noise (modes, decisions, K, K) of measured signals."""
    for mode in range(len(signals)):
        for n in range(y.shape[1] * y.shape[2]):
            chunk, sample = n // y.shape[2], n % y.shape[2]
            fill_features(signals[mode, n], variances[mode, n], gravity, y[mode, chunk, sample])
            add_feature_noise(signals[mode, n], variances[mode, n], gravity, noise[mode, chunk])


def commands(rule: str, rng: np.random.Generator) -> np.ndarray:
    """A schedule of 25 commands (amplitude, frequency, offset)."""
    if rule == "constant":
        return np.tile(CONSTANT, (DECISIONS, 1))
    limits = LIMITS["wide"]
    low = np.array([0.0, limits.frequency[0], limits.offset[0]])
    high = np.array([limits.amplitude, limits.frequency[1], limits.offset[1]])
    return low + (high - low) * rng.uniform(size=(DECISIONS, 3))


def runs(
    vehicle: np.ndarray, noise: SensorNoise, rule: str, seeds: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Measured signals and their variances, (3, 2000, 24) each, seed by seed."""
    arm = Arm()
    maxima = full_scale(vehicle, arm)
    truth = None
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        rng = np.random.default_rng(seed)
        if truth is None or rule != "constant":
            motion, _ = arm_motion(
                commands(rule, rng), LIMITS["wide"].acceleration, per_decision=SAMPLES * SUBSTEPS
            )
            truth = simulate(vehicle, motion, arm.row(), SAMPLE)[0]
        yield measure(truth, maxima, noise, rng)


def estimates(measured: np.ndarray, variances: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Estimate and standard deviation of every method (NaN where it gives none)."""
    y = np.empty((MODES, DECISIONS, SAMPLES, FEATURES))
    noise = np.zeros((MODES, DECISIONS, FEATURES, FEATURES))
    chunks(measured, variances, Arm().gravity, y, noise)
    filters = ParameterFilters(1, Terms(*TERMS), PRIOR_MEAN, np.sqrt(PRIOR_VARIANCE), methods=tuple(METHODS))
    for k in range(DECISIONS):
        filters.update(y[None, :, k], noise[None, :, k])
    found = {name: (filters.mean[name][0], np.sqrt(np.diag(filters.covariance[name][0]))) for name in METHODS}
    a, f = regressor(measured.transpose(1, 0, 2))
    solution = pseudo_inverse(a, f).x
    return found | {"pseudo-inverse": (solution, np.full_like(solution, math.nan))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--parameters", action="store_true", help="coverage of each unknown")
    options = parser.parse_args()
    prior = np.sqrt(PRIOR_VARIANCE)
    print(f"{options.seeds} seeds; coverage and average error with their standard error over seeds")
    print(
        f"{'vehicle':8}{'noise':13}{'excitation':12}{'estimator':16}{'coverage':>16}{'error %':>18}"
        f"{'median %':>10}{'error/prior':>13}{'bits':>8}"
    )
    for name in ("table1", "soft"):
        vehicle = preset(name)
        nonzero = vehicle != 0.0
        for kind in ("full_scale", "running_max"):
            for rule in RULES:
                table: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
                for measured, variances in runs(vehicle, SensorNoise(kind), rule, options.seeds):
                    for method, pair in estimates(measured, variances).items():
                        table.setdefault(method, []).append(pair)
                for method, pairs in table.items():
                    x, sigma = (np.array(part) for part in zip(*pairs, strict=True))
                    off = np.abs(x - vehicle)
                    inside = (off <= 2.0 * sigma).mean(axis=1)
                    percent = (off[:, nonzero] / np.abs(vehicle[nonzero])).mean(axis=1) * 100.0
                    known = not np.isnan(sigma).any()
                    root = math.sqrt(len(x))
                    bits = fast(sigma, LOWER, UPPER).sum(axis=1).mean() if known else math.nan
                    coverage = f"{inside.mean():.3f} +- {inside.std() / root:.3f}" if known else "-"
                    print(
                        f"{name:8}{kind:13}{rule:12}{method:16}{coverage:>16}"
                        f"{percent.mean():>10.1f} +- {percent.std() / root:<5.1f}{np.median(percent):>8.1f}"
                        f"{(off / prior).mean():>13.3f}{bits:>8.1f}"
                    )
                    if options.parameters and known:
                        each = (off <= 2.0 * sigma).mean(axis=0)
                        print("    " + " ".join(f"{n} {c:.2f}" for n, c in zip(NAMES, each, strict=True)))


if __name__ == "__main__":
    main()
