"""Are the estimators' intervals honest? Coverage of 2 sigma, errors and bits over seeds.

    python benchmarks/parameter_filter_coverage.py --seeds 40 --fits 10

Three vehicles (``table1``, ``soft``, and one drawn around ``soft`` for each seed), two kinds of noise, the
constant excitation (24) and a random one (wide limits). Coverage counts |estimate - truth| <= 2 sigma over
all unknowns and seeds; a Gaussian has 0.954. Seeds here start at 50 000; the tests use others.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np

from fieldmodels.compiled import compiled
from fieldmodels.estimation.parameter_filter import METHODS, ParameterFilters, Terms
from fieldmodels.estimation.pseudo_inverse import pseudo_inverse
from fieldmodels.information import fast
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.output_error import fit_vehicle
from fieldmodels.machines.excitation.parameters import (
    LIMITS,
    LOWER,
    MODES,
    NAMES,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLE,
    SAMPLES,
    SOFT,
    TABLE1,
    UPPER,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import (
    FEATURES,
    TERMS,
    add_feature_noise,
    fill_features,
    regressor,
)
from fieldmodels.machines.excitation.sensors import full_scale, measure
from fieldmodels.machines.excitation.shaker import FACTORS, drawn_around

FIRST_SEED = 50_000
DECISIONS = 25
DRAWN = 0.5
"""The vehicle ``drawn`` differs from ``soft`` by up to this share in each unknown."""
VEHICLES = ("table1", "soft", "drawn")
KINDS = ("full_scale", "running_max")
RULES = ("constant", "random")
ALONG = (1, 2, 5, 10, 25)
ARM = Arm()
DEVIATION = np.sqrt(PRIOR_VARIANCE)


@compiled
def fill_chunks(signals, variances, gravity, y, noise):
    """Features (modes, decisions, 80, K) and noise (modes, decisions, K, K) of measured signals."""
    for mode in range(len(signals)):
        for n in range(y.shape[1] * y.shape[2]):
            chunk, sample = n // y.shape[2], n % y.shape[2]
            fill_features(signals[mode, n], variances[mode, n], gravity, y[mode, chunk, sample])
            add_feature_noise(signals[mode, n], variances[mode, n], gravity, noise[mode, chunk])


def commands(rule, rng):
    """A schedule of 25 commands (amplitude, frequency, offset)."""
    if rule == "constant":
        return np.tile(CONSTANT, (DECISIONS, 1))
    limits = LIMITS["wide"]
    low = np.array([0.0, limits.frequency[0], limits.offset[0]])
    high = np.array([limits.amplitude, limits.frequency[1], limits.offset[1]])
    return low + (high - low) * rng.uniform(size=(DECISIONS, 3))


def runs(name, kind, rule, seeds) -> Iterator[tuple[np.ndarray, ...]]:
    """Vehicle, motion, measured signals and their variances (3, 2000, 24), seed by seed."""
    kept = {}
    for seed in range(FIRST_SEED, FIRST_SEED + seeds):
        rng = np.random.default_rng(seed)
        vehicle = {"table1": TABLE1, "soft": SOFT}.get(name)
        if vehicle is None:
            vehicle = drawn_around(SOFT, DRAWN, rng.uniform(-1.0, 1.0, FACTORS))
        key = vehicle.tobytes()
        if key not in kept:
            kept = {key: full_scale(vehicle, ARM)}
        motion, _ = arm_motion(
            commands(rule, rng), LIMITS["wide"].acceleration, per_decision=SAMPLES * SUBSTEPS
        )
        truth = simulate(vehicle, motion, ARM.row(), SAMPLE)[0]
        if rule == "still":
            truth[:] = 0.0
        yield vehicle, motion, *measure(truth, kept[key], SensorNoise(kind), rng)


def filtered(measured, variances):
    """Estimate and standard deviation of every filter after each decision, shape (25, 22) each."""
    y = np.empty((MODES, DECISIONS, SAMPLES, FEATURES))
    noise = np.zeros((MODES, DECISIONS, FEATURES, FEATURES))
    fill_chunks(measured, variances, ARM.gravity, y, noise)
    filters = ParameterFilters(1, Terms(*TERMS), PRIOR_MEAN, DEVIATION, methods=tuple(METHODS))
    found = {name: (np.empty((DECISIONS, 22)), np.empty((DECISIONS, 22))) for name in METHODS}
    for k in range(DECISIONS):
        filters.update(y[None, :, k], noise[None, :, k])
        for name, (mean, sigma) in found.items():
            mean[k] = filters.mean[name][0]
            sigma[k] = np.sqrt(np.diag(filters.covariance[name][0]))
    return found


def pm(values: np.ndarray, form: str) -> str:
    """Mean and its standard error."""
    return f"{values.mean():{form}} +- {values.std(ddof=1) / math.sqrt(len(values)):{form}}"


def scores(vehicles, x, sigma):
    """Coverage, average % error and its median, error in prior deviations, and bits."""
    off = np.abs(x - vehicles)
    nonzero = vehicles[0] != 0.0
    percent = 100.0 * (off[:, nonzero] / np.abs(vehicles[:, nonzero])).mean(axis=1)
    known = np.isfinite(sigma).all()
    covered = (off <= 2.0 * sigma).mean(axis=1)
    bits = fast(sigma, LOWER, UPPER).sum(axis=1).mean() if known else math.nan
    return (
        f"{pm(covered, '.3f') if known else '-':>16}{pm(percent, '.2f'):>18}{np.median(percent):>10.2f}"
        f"{(off / DEVIATION).mean():>13.4f}{bits:>8.1f}"
    )


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--fits", type=int, default=10, help="seeds of the output-error fit (1 s each)")
    parser.add_argument("--parameters", action="store_true", help="coverage and bias of each unknown, too")
    parser.add_argument("--told", type=float, default=1.0, help="factor on the variances that are told")
    parser.add_argument("--vehicles", nargs="*", default=VEHICLES, choices=VEHICLES)
    options = parser.parse_args()
    print(
        f"{options.seeds} seeds ({options.fits} for the output-error fit); +- is a standard error over seeds"
    )
    print(
        f"{'vehicle':8}{'noise':13}{'excitation':12}{'estimator':16}{'coverage':>16}{'error %':>18}"
        f"{'median %':>10}{'error/prior':>13}{'bits':>8}"
    )
    along = []
    for name in options.vehicles:
        for kind in KINDS:
            for rule in (*RULES, "still") if kind == "full_scale" else RULES:
                vehicles, paths, table = [], [], {}
                for n, (vehicle, motion, measured, variances) in enumerate(
                    runs(name, kind, rule, options.seeds)
                ):
                    variances = options.told * variances
                    found = filtered(measured, variances)
                    vehicles.append(vehicle)
                    paths.append(found["compensated"])
                    for method, (mean, sigma) in found.items():
                        table.setdefault(method, []).append((mean[-1], sigma[-1]))
                    if rule == "still":
                        continue
                    solution = pseudo_inverse(*regressor(measured.transpose(1, 0, 2))).x
                    table.setdefault("pseudo-inverse", []).append((solution, np.full(22, math.nan)))
                    if n < options.fits:
                        start = found["compensated"][0][-1]
                        fit = fit_vehicle(measured, variances, motion, start)
                        pair = fit.mean, np.sqrt(np.diag(fit.covariance))
                        table.setdefault("output error", []).append(pair)
                true = np.array(vehicles)
                for method, pairs in table.items():
                    x, sigma = (np.array(part) for part in zip(*pairs, strict=True))
                    print(f"{name:8}{kind:13}{rule:12}{method:16}{scores(true[: len(x)], x, sigma)}")
                    if options.parameters and np.isfinite(sigma).all():
                        each = (np.abs(x - true[: len(x)]) <= 2.0 * sigma).mean(axis=0)
                        bias = (
                            100.0 * (x - true[: len(x)]).mean(axis=0) / np.where(true[0], true[0], DEVIATION)
                        )
                        for label, c, e in zip(NAMES, each, bias, strict=True):
                            print(f"    {label:16} coverage {c:.2f}, mean error {e:8.1f} %")
                x, sigma = (np.array(part) for part in zip(*paths, strict=True))
                covered = (np.abs(x - true[:, None]) <= 2.0 * sigma).mean(axis=(0, 2))
                bits = fast(sigma, LOWER, UPPER).sum(axis=2).mean(axis=0)
                along.append(
                    f"{name:8}{kind:13}{rule:12}"
                    + "".join(f"{covered[k - 1]:>8.3f}{bits[k - 1]:>7.1f}" for k in ALONG)
                )
    print("\nThe compensated filter along the run: coverage and bits after so many decisions of 0.4 s")
    print(f"{'vehicle':8}{'noise':13}{'excitation':12}" + "".join(f"{k:>8}{'':>7}" for k in ALONG))
    print("\n".join(along))


if __name__ == "__main__":
    main()
