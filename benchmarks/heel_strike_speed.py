"""Speed of the heel-strike kernel: compiled against plain Python, and each part's share, in one run.

python benchmarks/heel_strike_speed.py
"""

from __future__ import annotations

import math
import random
import time

import numpy as np

from fieldmodels.machines.heel_strike.lanes import FEW
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Noise, Regimes
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.machines.heel_strike.search import record_walks, score_gains
from fieldmodels.machines.heel_strike.strides import Strides

PAPER = (1.0, 1.0, 0.1, 1000 / 3)


def plain_python(steps: int) -> float:
    """Truth (2.11) by RK4, noise and estimator (2.14), as one would write them first: steps a second."""
    rng, dt, stiffness = random.Random(0), 0.002, 9.81
    theta, omega, torque, noise = 0.0, 1.0, 0.0, 0.0
    estimate, rate, since = 0.0, 1.0, 0
    begin = time.process_time()
    for k in range(steps):
        if k % 125 == 0:
            torque = rng.uniform(-0.5, 0.5)
        before = theta
        a1 = torque - stiffness * math.sin(theta)
        v2 = omega + dt / 2 * a1
        a2 = torque - stiffness * math.sin(theta + dt / 2 * omega)
        v3 = omega + dt / 2 * a2
        a3 = torque - stiffness * math.sin(theta + dt / 2 * v2)
        v4 = omega + dt * a3
        a4 = torque - stiffness * math.sin(theta + dt * v3)
        theta += dt / 6 * (omega + 2 * v2 + 2 * v3 + v4)
        omega += dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        since += 1
        noise = 0.995 * noise + 0.005 * rng.uniform(-0.5, 0.5)
        gyro = omega + max(0.0, 1 - since / 125) * noise + rng.gauss(0.0, 0.0041)
        rate += 333.3 * (gyro - rate) * dt
        estimate += rate * dt
        if before < 0 <= theta or before > 0 >= theta:
            estimate += 0.1 * (theta - estimate)
            omega -= 0.5 * (omega - math.copysign(1.0, omega))
            since = 0
    return steps / (time.process_time() - begin)


def walking(bank: bool, reality: np.ndarray | None = None, strides: int = 100, batch: int = 64) -> float:
    """Physics steps a second of several walkers."""
    walkers = Strides(batch, noise=Regimes(), reality=reality, bank=bank)
    for i in range(batch):
        walkers.seed(i, np.random.default_rng(i))
    walkers.advance(PAPER)
    best = 0.0
    for _ in range(3):
        begin = time.process_time()
        steps = sum(int(walkers.advance(PAPER).samples.sum()) for _ in range(strides))
        best = max(best, steps / (time.process_time() - begin))
    return best


def main() -> None:
    """Print steps a second on one core, and ratios to plain Python."""
    model = HeelStrikeModel()
    plain = max(plain_python(100_000) for _ in range(3))
    rows = [("plain Python: truth + noise + one estimator", plain)]
    rows.append(("truth + noise + agent + two Rangers + EKF", walking(bank=False)))
    rows.append(("the same, so few walkers that each goes by itself", walking(bank=False, batch=FEW - 1)))
    biased = model.vector(effects={"gyro_bias": {"rate": 1e-9}})
    rows.append(("the same, all effects switched in", walking(False, biased)))
    rows.append(("the same, with the bank of eight filters", walking(bank=True, strides=30)))
    walks = record_walks([np.random.default_rng(0)], 200)
    gains = np.array(
        [[a, a, h, 1000 / 3] for a in np.geomspace(0.01, 1, 16) for h in np.geomspace(0.01, 1, 16)]
    )
    score_gains(walks, gains)
    begin = time.process_time()
    score_gains(walks, gains)
    speed = len(gains) * len(walks.gyro) / (time.process_time() - begin)
    rows.append(("search: 256 gain sets on recorded walks", speed))
    windows = model.windows(record_walk(200, np.random.default_rng(1), Noise()), 1.0)
    model.simulate(model.nominal, windows)
    begin = time.process_time()
    model.simulate(np.repeat(model.nominal[None], 20, axis=0), windows)
    rows.append(("prediction for a diagnosis", 20 * windows.lengths.sum() / (time.process_time() - begin)))
    for name, speed in rows:
        print(f"{name:48s} {speed / 1e6:9.2f} million steps/s   {speed / plain:8.1f} x")
    print(f"strides a second, one core: {rows[1][1] / 500:.0f}")


if __name__ == "__main__":
    main()
