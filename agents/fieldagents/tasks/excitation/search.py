"""Tuning of the excitation's agents that decide before they measure, on tuning seeds and the prior alone.

``python -m fieldagents.tasks.excitation.search`` writes ``tuned.json`` anew (some minutes).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray

from fieldagents.seeds import TUNING_SEEDS
from fieldagents.tasks.excitation.agents import to_command
from fieldagents.tasks.excitation.criteria import forecast, relative_error
from fieldgym.excitation import ExcitationSettings
from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.extras import needed
from fieldmodels.files import write_text
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.motion import CONSTANT
from fieldmodels.machines.excitation.parameters import (
    CG,
    INERTIA,
    LIMITS,
    LOWER,
    MODES,
    PRESETS,
    UNKNOWNS,
    UPPER,
    SensorNoise,
)
from fieldmodels.machines.excitation.prediction import Predictor, Situation
from fieldmodels.machines.excitation.regression import FEATURES
from fieldmodels.machines.excitation.sensors import FULL, full_scale, variances
from fieldmodels.machines.excitation.shaker import CHANNELS, FINEST, Shakers, error_percents

Floats = NDArray[np.float64]

RESULT = Path(__file__).with_name("tuned.json")
"""What the reference agents read."""
SCENARIOS: Mapping[str, Mapping[str, str]] = {
    f"{preset}/{limits}/{noise}": {"preset": preset, "limits": limits, "noise": noise}
    for preset, limits, noise in (
        ("table1", "wide", "full_scale"),
        ("table1", "paper", "full_scale"),
        ("table1", "wide", "running_max"),
        ("soft", "wide", "full_scale"),
    )
}
"""Settings that are tuned for; the keys of the result."""
EPISODES = 6
"""Tuning episodes for each constant command; as many later ones check the winner."""
PRIOR_VEHICLES = 3
"""Vehicles drawn from the prior on which a schedule is judged; as many others check it."""
GRID = (np.linspace(0.25, 1.0, 4), np.linspace(0.0, 1.0, 6), np.linspace(0.0, 1.0, 5))
"""Amplitudes, frequencies and offsets of the constant commands, as shares of their ranges."""
BLOCK = 5
"""Commands that the search of a schedule repeats at first."""
BLOCK_EVALUATIONS, FREE_EVALUATIONS = 500, 600
"""Schedules tried, of repeated commands and then of all free."""


def prior_vehicles(number: int, rng: np.random.Generator) -> Floats:
    """Vehicles drawn uniformly from the prior's ranges, with the inertia of some body, shape (number, 22).

    Args:
        number: How many.
        rng: Source of all randomness.
    """
    found: list[Floats] = []
    while len(found) < number:
        drawn = rng.uniform(LOWER, UPPER)
        drawn[0] = max(drawn[0], 0.5)
        xx, yy, zz, xz, yz, xy = drawn[INERTIA:CG]
        principal = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        if principal[0] > 0.01 and principal[0] + principal[1] > principal[2]:
            found.append(drawn)
    return np.array(found)


def start_of(vehicles: Floats, maxima: Floats, noise: SensorNoise) -> Situation:
    """Before the first decision of experiments whose filters weigh as if they knew their vehicles."""
    count = len(vehicles)
    empty = np.zeros((count, MODES, FEATURES, FEATURES))
    scale = np.zeros_like(maxima) if noise.kind == "running_max" else maxima
    return Situation(
        mean=vehicles,
        covariance=np.zeros((count, UNKNOWNS, UNKNOWNS)),
        moments=empty,
        noise=empty,
        samples=np.zeros(count),
        command=np.tile(CONSTANT, (count, 1)),
        phase=np.zeros(count),
        variances=np.tile(variances(scale, noise.fraction), (count, 1, 1)),
    )


class Schedules:
    """Judges whole schedules by the average relative error that the filter should end with.

    Args:
        settings: Of the environment.
        vehicles: On which they are judged, shape (vehicles, 22).
    """

    def __init__(self, settings: ExcitationSettings, vehicles: Floats) -> None:
        noise = settings.sensor_noise
        self._limits, self._most = LIMITS[settings.limits], settings.bits
        self._predictor = Predictor(limits=self._limits, noise=noise)
        self._start = start_of(vehicles, full_scale(PRESETS[settings.preset]), noise)

    def __call__(self, actions: Floats) -> Floats:
        """Mean over the vehicles of each schedule's cost, shape (schedules,).

        Args:
            actions: Shape (schedules, decisions, 3).
        """
        wanted = to_command(actions, self._limits)
        outlook = self._predictor.outlook(self._start, np.tile(wanted, (len(self._start), 1, 1, 1)))
        seen = forecast(self._start, outlook, FULL.unknowns, self._most)
        return np.asarray(relative_error(seen).mean(axis=0))


def ending_errors(
    settings: ExcitationSettings, schedules: Floats, seeds: range, reality: Any = None
) -> Floats:
    """Average % error at the end of the environment's own episodes, shape (schedules,).

    Args:
        settings: Of the environment.
        schedules: Actions that take turns, shape (schedules, n, 3); of a constant command n = 1.
        seeds: Of the episodes.
        reality: Of the environment.
    """
    model, limits = ExcitationModel(settings.preset), LIMITS[settings.limits]
    batch = len(schedules) * len(seeds)
    around, truth = apply_reality(model, reality, CHANNELS)
    shakers = Shakers(
        batch,
        settings,
        truth.vector(around)[: len(model.names)],
        stock=stepped(around, truth, CHANNELS, batch, FINEST),
    )
    shakers.restart(range(batch), [np_random(seed)[0] for _ in schedules for seed in seeds])
    commands = np.repeat(to_command(repeated(schedules, settings.decisions), limits), len(seeds), axis=0)
    for decision in range(settings.decisions):
        shaken = shakers.advance(commands[:, decision])
    errors = error_percents(shaken.mean, shakers.truth, shakers.estimated)[0]
    return np.asarray(errors.reshape(len(schedules), len(seeds)).mean(axis=1))


def tune(settings: ExcitationSettings, log: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Tune every agent that decides beforehand, for one kind of environment.

    Args:
        settings: The environment's settings.
        log: Called with a line for each agent.

    Returns:
        Agent to its actions, with its score on what tuned it and on as much else.
    """
    first, other = TUNING_SEEDS[:EPISODES], TUNING_SEEDS[5000 : 5000 + EPISODES]
    grid = 2.0 * np.array(list(product(*GRID))) - 1.0
    errors = ending_errors(settings, grid[:, None], first)
    best = grid[np.argmin(errors)]
    found: dict[str, Any] = {
        "best_constant": {
            "actions": np.round(best[None], 4).tolist(),
            "tuned_percent": round(float(errors.min()), 3),
            "checked_percent": round(float(ending_errors(settings, best[None, None], other)[0]), 3),
        }
    }
    log(f"best_constant: {found['best_constant']}")
    rng = np.random.default_rng(1)
    judges = {
        "schedule": [Schedules(settings, prior_vehicles(PRIOR_VEHICLES, rng)) for _ in range(2)],
        "oracle_schedule": [Schedules(settings, PRESETS[settings.preset][None])] * 2,
    }
    for name, (judge, check) in judges.items():
        actions = _search(judge, settings.decisions)
        found[name] = {
            "actions": np.round(actions, 4).tolist(),
            "tuned_cost": round(float(judge(actions[None])[0]), 5),
            "checked_cost": round(float(check(actions[None])[0]), 5),
        }
        log(f"{name}: {found[name]['tuned_cost']}, on other vehicles {found[name]['checked_cost']}")
    return found


def _search(judge: Schedules, decisions: int) -> Floats:
    """The best schedule: first of a few repeated commands, then of all of them free."""
    block = evolve(judge, np.zeros((BLOCK, 3)), decisions, 0.5, BLOCK_EVALUATIONS)
    return evolve(judge, repeated(block[None], decisions)[0], decisions, 0.15, FREE_EVALUATIONS)


def repeated(blocks: Floats, decisions: int) -> Floats:
    """Blocks of commands, shape (schedules, n, 3), repeated over all decisions."""
    return np.asarray(np.take(blocks, np.arange(decisions) % blocks.shape[1], axis=1))


def evolve(
    judge: Callable[[Floats], Floats], start: Floats, decisions: int, width: float, evaluations: int
) -> Floats:
    """Covariance matrix adaptation (Hansen): the best of all candidates, of the start's shape.

    Args:
        judge: Costs of schedules, from shape (schedules, decisions, 3) to (schedules,).
        start: Actions that take turns, where the search begins, shape (n, 3).
        decisions: Length of a schedule.
        width: Standard deviation of the first candidates.
        evaluations: How many candidates to try.

    Raises:
        MissingExtraError: Without the package ``cma``.
    """
    cma = needed("cma")
    search = cma.CMAEvolutionStrategy(
        np.clip(start, -0.95, 0.95).ravel(),
        width,
        {"seed": 1, "popsize": 20, "maxfevals": evaluations, "bounds": [-1, 1], "verbose": -9},
    )
    while not search.stop():
        candidates = search.ask()
        schedules = repeated(np.array(candidates).reshape(-1, *start.shape), decisions)
        search.tell(candidates, judge(schedules).tolist())
    return np.asarray(search.result.xbest).reshape(start.shape)


def _main(out: Annotated[Path, typer.Option(help="Where the tuned values go.")] = RESULT) -> None:
    """Tune what is decided beforehand, in some minutes."""
    found: dict[str, Any] = {"command": "python -m fieldagents.tasks.excitation.search"}
    for name, settings in SCENARIOS.items():
        print(name, file=sys.stderr)
        found[name] = tune(
            ExcitationSettings(**settings),  # type: ignore[arg-type]
            lambda line: print(" ", line, file=sys.stderr, flush=True),
        )
        write_text(out, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(_main)
