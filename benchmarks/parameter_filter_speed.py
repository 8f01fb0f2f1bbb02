"""Speed of the parameter filters, as ratios within one run, and how far they are from each other.

    python benchmarks/parameter_filter_speed.py

One sample is 18 equations of 22 unknowns. filterpy, NumPy and the compiled filter update the same Kalman
filter, sample by sample; the filters of the environment sum a chunk of 80 samples and then estimate once.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from fieldmodels.estimation.filterpy_reference import FilterpyFilter
from fieldmodels.estimation.parameter_filter import METHODS, ParameterFilters, Terms
from fieldmodels.information import binned, closed, fast
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.parameters import (
    LOWER,
    MODES,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLE,
    SAMPLES,
    SOFT,
    UPPER,
    Arm,
    SensorNoise,
)
from fieldmodels.machines.excitation.regression import (
    FEATURES,
    FORCE,
    TERMS,
    add_feature_noise,
    fill_features,
    regressor,
)
from fieldmodels.machines.excitation.sensors import full_scale, measure

DECISIONS = 10
SECONDS = 1.0
BATCH = 16
DEVIATION = np.sqrt(PRIOR_VARIANCE)


def best(call: Callable[[], object], per_call: int) -> float:
    """Shortest processor time of one of ``per_call`` units [s]; the first call is not timed."""
    call()
    shortest, begin = np.inf, time.process_time()
    while time.process_time() - begin < SECONDS:
        start = time.process_time()
        call()
        shortest = min(shortest, time.process_time() - start)
    return shortest / per_call


def numpy_run(a: np.ndarray, f: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The joint update with NumPy, as one would write it."""
    mean, covariance, identity = PRIOR_MEAN.copy(), np.diag(PRIOR_VARIANCE), np.eye(len(PRIOR_MEAN))
    for regressor_k, target in zip(a, f, strict=True):
        innovation = regressor_k @ covariance @ regressor_k.T + noise
        gain = np.linalg.solve(innovation, regressor_k @ covariance).T
        mean = mean + gain @ (target - regressor_k @ mean)
        covariance = (identity - gain @ regressor_k) @ covariance
    return mean, covariance


def main() -> None:
    """Print the tables."""
    arm = Arm()
    motion, _ = arm_motion(np.tile(CONSTANT, (DECISIONS, 1)), np.inf, per_decision=SAMPLES * SUBSTEPS)
    truth = simulate(SOFT, motion, arm.row(), SAMPLE)[0]
    measured, variances = measure(truth, full_scale(SOFT, arm), SensorNoise(), np.random.default_rng(0))
    a, f = regressor(measured.transpose(1, 0, 2), variances=variances[:, 0])
    r = variances[:, 0, FORCE : FORCE + 6].ravel()

    def by_filterpy() -> tuple[np.ndarray, np.ndarray]:
        reference = FilterpyFilter(PRIOR_MEAN, DEVIATION, r)
        for k in range(len(f)):
            reference.update(a[k], f[k])
        return reference.mean, reference.covariance

    y = np.empty((MODES, len(f), FEATURES))
    noise = np.zeros((MODES, FEATURES, FEATURES))
    for mode in range(MODES):
        for n in range(len(f)):
            fill_features(measured[mode, n], variances[mode, n], arm.gravity, y[mode, n])
            add_feature_noise(measured[mode, n], variances[mode, n], arm.gravity, noise[mode])
    noise /= DECISIONS

    def chunked(method: str) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        filters = ParameterFilters(BATCH, Terms(*TERMS), PRIOR_MEAN, DEVIATION, methods=(method,))
        chunks = [
            np.repeat(y[None, :, SAMPLES * k : SAMPLES * (k + 1)], BATCH, axis=0) for k in range(DECISIONS)
        ]
        noises = np.repeat(noise[None], BATCH, axis=0)

        def run() -> tuple[np.ndarray, np.ndarray]:
            filters.restart()
            for chunk in chunks:
                filters.update(chunk, noises)
            return filters.mean[method][0], filters.covariance[method][0]

        return run

    exact = by_filterpy()
    sigma = np.sqrt(np.diag(exact[1]))
    samples = len(f)
    rows = [
        ("filterpy", best(by_filterpy, samples), exact),
        ("NumPy", best(lambda: numpy_run(a, f, np.diag(r)), samples), numpy_run(a, f, np.diag(r))),
    ]
    rows += [(f"sums of a chunk, {m}", best(chunked(m), samples * BATCH), chunked(m)()) for m in METHODS]
    print(f"{'update of one sample (18 x 22)':32}{'us':>9}{'faster':>9}{'mean off':>12}{'sigma off':>12}")
    for name, seconds, (mean, covariance) in rows:
        same = not name.endswith(("compensated", "low_passed"))
        off = f"{np.max(np.abs(mean - exact[0]) / sigma):.1e}" if same else "-"
        wide = f"{np.max(np.abs(np.sqrt(np.diag(covariance)) / sigma - 1)):.1e}" if same else "-"
        print(f"{name:32}{seconds * 1e6:9.2f}{rows[0][1] / seconds:9.1f}{off:>12}{wide:>12}")
    print("mean off in the filter's own sigma, sigma off relative, both against filterpy\n")

    forms = [
        ("binned, eq (15)", best(lambda: binned(exact[0], sigma, LOWER, UPPER), 1)),
        ("closed", best(lambda: closed(exact[0], sigma, LOWER, UPPER), 1)),
        ("fast", best(lambda: fast(sigma, LOWER, UPPER), 1)),
    ]
    print(f"{'metric of 22 parameters':32}{'us':>9}{'faster':>9}")
    for name, seconds in forms:
        print(f"{name:32}{seconds * 1e6:9.2f}{forms[0][1] / seconds:9.1f}")

    print("\nlargest difference from the binned sum [bits], 10 bits; sigma in bins D = range / 1024")
    heads = ("closed, inside", "fast, inside", "closed, edge", "fast, edge")
    print(f"{'sigma / D':>10}{'bits':>8}" + "".join(f"{head:>16}" for head in heads))
    places = 512.0 + np.linspace(0.0, 1.0, 21)
    for size in (0.1, 0.25, 0.5, 1.0, 2.0, 10.0, 100.0, 200.0, 296.0, 1000.0, 1e4):
        middle, edge = binned(places, size, 0.0, 1024.0), binned(0.0, size, 0.0, 1024.0)
        near = [
            np.abs(closed(places, size, 0.0, 1024.0) - middle).max(),
            np.abs(fast(size, 0.0, 1024.0) - middle).max(),
        ]
        off = [abs(closed(0.0, size, 0.0, 1024.0) - edge), abs(fast(size, 0.0, 1024.0) - edge)]
        print(f"{size:10g}{middle.mean():8.3f}" + "".join(f"{d:16.4f}" for d in (*near, *off)))


if __name__ == "__main__":
    main()
