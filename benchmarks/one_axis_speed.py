"""Speed of the driver on one-axis benches, as ratios within this run.

    python benchmarks/one_axis_speed.py

Effects that are off should cost nothing: the driver with every effect off is compared with a loop that knows
no effects at all, one window after the other. Then each effect's cost when on, and the driver against SciPy's
integrator. All in processor time.
"""

from __future__ import annotations

import math
import time

import numpy as np
from scipy.integrate import solve_ivp

from fieldmodels.compiled import compiled
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

BATCH = 64


@compiled
def bare_rig(parameters, command, step, starts, samples, states, out):  # type: ignore[no-untyped-def]
    """A rig without any effect, its steps counted as the full kernel counts them."""
    for p in range(parameters.shape[0]):
        m, c, k = parameters[p]
        substeps = 1
        while (math.sqrt(k / m) + c / m) * step > 0.2 * substeps:
            substeps *= 2
        h = step / substeps
        for w in range(len(starts)):
            x, v = states[w]
            for j in range(samples):
                out[p, w, j, 0] = x
                out[p, w, j, 1] = v
                u = command[starts[w] + j]
                for _ in range(substeps):
                    a1 = (u - c * v - k * x) / m
                    v2 = v + 0.5 * h * a1
                    a2 = (u - c * v2 - k * (x + 0.5 * h * v)) / m
                    v3 = v + 0.5 * h * a2
                    a3 = (u - c * v3 - k * (x + 0.5 * h * v2)) / m
                    v4 = v + h * a3
                    a4 = (u - c * v4 - k * (x + h * v3)) / m
                    x += h / 6 * (v + 2 * (v2 + v3) + v4)
                    v += h / 6 * (a1 + 2 * (a2 + a3) + a4)


def best(call, repeats=7):  # type: ignore[no-untyped-def]
    """Shortest of several runs, in processor time [s]."""
    call()
    times = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


def main() -> None:
    rig = get_model("rig")
    data = synthesise(rig, None, "mixed", amplitude=8.0, duration=60.0, rng=np.random.default_rng(0))
    windows = rig.windows(data, 0.5)
    batch = np.tile(rig.nominal, (BATCH, 1))
    steps = BATCH * len(windows) * windows.samples

    nominal = best(lambda: rig.simulate(batch, windows))
    out = np.full((BATCH, len(windows), windows.samples, 2), np.nan)
    bare = best(
        lambda: bare_rig(
            batch[:, :3].copy(),
            data["force"],
            data.step,
            windows.starts,
            windows.samples,
            windows.states,
            out,
        )
    )
    np.testing.assert_allclose(out, rig.simulate(batch, windows), rtol=1e-12, atol=1e-15)
    print(f"rig, all effects off: {steps / nominal / 1e6:.1f} million samples/s; "
          f"{nominal / bare:.2f} x the time of a kernel without effects")  # fmt: skip

    for name in ("rig", "pendulum"):
        model = get_model(name)
        excitation = ("mixed", 8.0) if name == "rig" else ("swing", 1.2)
        data = synthesise(model, None, excitation[0], amplitude=excitation[1], duration=60.0,
                          rng=np.random.default_rng(0))  # fmt: skip
        windows = model.windows(data, model.horizons[1])
        off = best(lambda: model.simulate(np.tile(model.nominal, (BATCH, 1)), windows))  # noqa: B023
        samples = BATCH * len(windows) * windows.samples
        print(f"{name}: {samples / off / 1e6:.1f} million samples/s; time with an effect on:")
        for effect in model.effects:
            values = {p.name: p.starts[-1] if p.starts else p.nominal + p.scale for p in effect.parameters}
            vector = np.tile(model.vector(effects={effect.name: values}), (BATCH, 1))
            on = best(lambda: model.simulate(vector, windows), 3)  # noqa: B023
            print(f"    {effect.name:22} {on / off:5.2f} x")

    m, c, k = rig.nominal[:3]
    began = time.process_time()
    for _ in range(100):
        solve_ivp(lambda _t, y: [y[1], (1.0 - c * y[1] - k * y[0]) / m], (0, 0.01), [0.1, 0.0], rtol=1e-8)
    scipy = (time.process_time() - began) / 100
    print(f"SciPy solve_ivp, one sample: {scipy / (nominal / steps):.0f} x the kernel's time")


if __name__ == "__main__":
    main()
