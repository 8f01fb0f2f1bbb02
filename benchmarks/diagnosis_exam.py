"""Exam of the diagnosis: hide one effect at a time, or nothing, and count what is named.

    python benchmarks/diagnosis_exam.py --model rig --seeds 3

Sizes are set so that the effect raises the error of the refitted base by a given percentage. Seeds here
start at 1000; the tests use others.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import build
from fieldmodels.model import ModelError
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

FIRST_SEED = 1000
AMPLITUDE = {"rig": 8.0, "pendulum": 0.5}
OUTSIDE = ("cogging", "stribeck", "one-sided spring", "drag with position")
SCALE = {"x": 1.0, "v": 1.0}


def outside_force(name, size):
    """A force that no model lists, of a given size [N or N m] at the motion's usual amplitude."""

    def force(t, x, v, u):
        del t, u
        x, v = x / SCALE["x"], v / SCALE["v"]
        if name == "cogging":
            return size * np.sin(8 * x)
        if name == "stribeck":
            return -size * np.sign(v) * np.exp(-((v / 0.2) ** 2))
        if name == "one-sided spring":
            return -size * max(x, 0.0)
        return -size * v * x**2

    return force


def record(model, reality, seed, noise=True, coloured=0.0, outside=None):
    rng = np.random.default_rng(seed)
    return synthesise(
        model, reality, "mixed", duration=DURATION, step=STEP, amplitude=AMPLITUDE[model.name],
        rng=rng, noise=noise, coloured=coloured, outside=outside,
    )  # fmt: skip


def error_without(model, recording, fixed):
    """Error of the refitted base on a recording, in units of the sensors' noise."""
    scaled = model.scaled_to([recording])
    problem = build(scaled, [recording], model.horizons[1])
    noise = np.array([model.outputs[j].noise for j in problem.outputs])
    candidates = Candidates(
        problem, model.vector(fixed), frozenset(fixed), problem.blocks % 4, np.diag(1 / noise)
    )
    fitted = fit(problem, model.vector(fixed), candidates.free(()), candidates.whitener, iterations=8)
    rmse = predict(problem, fitted.parameters).rmse()
    known = np.array([o.noise for o in model.outputs])
    return float(np.nanmax(rmse / known))


def unit_values(model, effect, size):
    """The effect's parameters at a multiple of their typical step."""
    values = {}
    for p in effect.parameters:
        if p.name == "time":
            values[p.name] = DURATION * 0.45
        elif p.name == "frequency":
            values[p.name] = 1.3
        elif p.name == "limit":
            values[p.name] = AMPLITUDE[model.name] * max(1.0 - 0.1 * size, 0.05)
        elif p.name == "length":
            values[p.name] = 0.3
        elif p.name == "cosine":
            values[p.name] = 0.5 * size * p.starts[0]
        else:
            start = p.starts[0] if p.starts else p.nominal + p.scale
            values[p.name] = float(np.clip(p.nominal + size * (start - p.nominal), p.lower, p.upper))
    return values


def sized(model, effect, percent, fixed):
    """Values that raise the base's error by a percentage over the sensors' noise."""
    scaled = model.scaled_to([record(model, {}, 7)])
    wanted = np.sqrt((1 + percent / 100) ** 2 - 1)
    own = next(e for e in scaled.effects if e.name == effect.name)
    if effect.name.endswith("quantisation"):
        sigma = model.outputs[0].noise
        return {"step": float(wanted * sigma * np.sqrt(12))}
    # The error does not grow for ever (friction may stop the motion): take the first size that is enough.
    for size in np.geomspace(1e-3, 1e3, 31):
        values = unit_values(model, own, size)
        try:
            error = error_without(model, record(model, {effect.name: values}, 7, noise=False), fixed)
        except ModelError:
            break
        if error >= wanted:
            break
    return values


def outcome(diagnosis, truth):
    named = [c.effect for c in diagnosis.causes]
    inside = set(named) | {a for c in diagnosis.causes for a in c.alternatives}
    if not truth:
        return "right" if diagnosis.verdict == "consistent" else diagnosis.verdict
    if named == [truth] and diagnosis.verdict == "named":
        return "right"
    if truth in inside:
        return "in set" if len(named) == 1 else "with more"
    return "abstained" if not named else "wrong"


def main() -> None:
    global DURATION, STEP
    parser = argparse.ArgumentParser()
    parser.add_argument("--model", default="rig")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--percent", type=float, nargs="*", default=[25.0])
    parser.add_argument("--effects", nargs="*")
    parser.add_argument("--nothing", type=int, default=10)
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--step", type=float, default=0.01)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    DURATION, STEP = options.duration, options.step
    model = get_model(options.model)
    table: dict[str, Counter[str]] = {}
    seconds = []

    def ask(label, truth, reality, seed, fixed=None, **more):
        train, test = (record(model, reality, seed + k, **more) for k in (0, 500))
        began = time.perf_counter()
        diagnosis = diagnose(model, [train], [test], fixed=fixed)
        seconds.append(time.perf_counter() - began)
        result = outcome(diagnosis, truth)
        if truth == "?":
            result = {"unknown": "right", "consistent": "abstained"}.get(diagnosis.verdict, "wrong")
        table.setdefault(label, Counter())[result] += 1
        if options.verbose or result in ("wrong", "with more"):
            causes = [
                (
                    c.effect,
                    [f"{v.value:.3g}" for v in c.parameters.values()],
                    round(c.nats, 1),
                    f"{c.p_value:.1g}",
                    c.alternatives,
                )
                for c in diagnosis.causes
            ]
            ranks = [(r[0], round(r[1], 1), f"{r[2]:.1g}") for r in diagnosis.evidence.ranking[:3]]
            left = diagnosis.unknown and (diagnosis.unknown.direction, f"{diagnosis.unknown.p_value:.1g}")
            print(
                "   ",
                label,
                reality,
                result,
                diagnosis.verdict,
                causes,
                ranks,
                left,
                f"{diagnosis.seconds:.1f}s",
                flush=True,
            )

    for effect in model.effects:
        if options.effects is not None and effect.name not in options.effects:
            continue
        fixed = {}
        if effect.name in ("payload", "actuator_gain"):
            fixed = {p.name: p.nominal for p in model.parameters}
        for percent in options.percent:
            values = sized(model, effect, percent, fixed)
            for k in range(options.seeds):
                ask(
                    f"{effect.name} {percent:g} %",
                    effect.name,
                    {effect.name: values},
                    options.first + k,
                    fixed,
                )
    for k in range(options.nothing):
        ask("nothing, white noise", "", {}, options.first + 100 + k)
        ask("nothing, coloured noise", "", {}, options.first + 200 + k, coloured=0.5)
    if options.effects is None or "outside" in options.effects:
        peak = record(model, {}, 7, noise=False)
        SCALE["x"] = float(np.std(peak[model.outputs[0].name]))
        SCALE["v"] = float(np.std(np.gradient(peak[model.outputs[0].name], STEP)))
        for name in OUTSIDE:
            for k in range(options.seeds):
                ask(
                    f"outside: {name}",
                    "?",
                    {},
                    options.first + 300 + k,
                    outside=outside_force(name, 0.08 * AMPLITUDE[model.name]),
                )
    columns = ["right", "in set", "with more", "abstained", "unknown", "named", "ambiguous", "wrong"]
    print(f"{'':34}" + "".join(f"{c:>11}" for c in columns))
    for label, counts in table.items():
        print(f"{label:34}" + "".join(f"{counts.get(c, 0) or '':>11}" for c in columns))
    print(f"{len(seconds)} diagnoses, median {np.median(seconds):.2f} s, longest {max(seconds):.2f} s")


if __name__ == "__main__":
    main()
