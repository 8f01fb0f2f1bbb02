"""What a command will do, said before it does it: what it counts, what that takes, whether it can end.

Work is counted in units whose prices ``benchmarks/plan.py`` has recorded in ``prices.json``; one short
measurement tells how fast this machine is. An estimate is shown and, where it is absurd, refuses the work; no
result depends on it.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from itertools import pairwise
from math import prod
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldmodels.files import check_writable

if TYPE_CHECKING:
    from fieldagents.config import EnvironmentConfig
    from fieldagents.evaluation.config import EvaluateConfig
    from fieldagents.learned.config import TrainConfig
    from fieldagents.record.config import RecordConfig
    from fieldagents.retune.config import RealitiesConfig, RetuneConfig
    from fieldagents.sweep.config import SweepConfig, TuneConfig
    from fieldmodels.engine import Engine
    from fieldmodels.model import Model
    from fieldmodels.recording import Recording

PRICES = Path(__file__).with_name("prices.json")
LONGEST = 3e8
"""Processor time beyond which a command is refused: ten years [s]."""
PROCESS, LEARNER = 5e8, 9e8
"""Memory of a process with all that it imports, and of one that trains [bytes]."""
FITTED = 30_000
"""Rows of a log whose fits are priced; of a longer one as many are fitted."""
Work = dict[str, float]


class PlanError(ValueError):
    """Work that cannot end on this machine."""


@dataclass(frozen=True)
class Plan:
    """What a command will do.

    Attributes:
        does: In a few words.
        out: Where results go.
        work: Units of each kind of work, ``kind:name``.
        memory: Largest at a time [bytes].
        notes: What else is known beforehand.
        workers: Processes that share the work.
    """

    does: str
    out: Path
    work: Work
    memory: float = PROCESS
    notes: tuple[str, ...] = ()
    workers: int = 1

    @property
    def recorded_s(self) -> float:
        """Processor time on the machine on which the prices were recorded [s]."""
        return sum(units * price(kind) for kind, units in self.work.items())

    @property
    def processor_s(self) -> float:
        """Processor time on this machine [s]."""
        return self.recorded_s * slowness()

    def check(self) -> None:
        """Refuse what cannot be written or cannot end.

        Raises:
            OutputError: If the results cannot be written.
            PlanError: If the memory or the time cannot be had.
        """
        check_writable(self.out)
        there = memory_there()
        if self.memory > there:
            raise PlanError(
                f"{self.does} needs about {_bytes(self.memory)} of memory, and {_bytes(there)} are there; "
                "ask for less at a time (shorter, a coarser step, fewer episodes or workers)"
            )
        if self.recorded_s > LONGEST:
            raise PlanError(f"{self.does} would take about {_time(self.recorded_s)}; ask for less")

    def words(self) -> str:
        """The plan in a few lines."""
        shared = f" on {self.workers} processes" if self.workers > 1 else ""
        timed = {name.partition(":")[0] for name in _recorded()["prices"]}
        guess = "about" if {name.partition(":")[0] for name in self.work} <= timed else "as a guess"
        took = f"{guess} {_time(self.processor_s)} of processor time{shared}, {_bytes(self.memory)} of memory"
        return "\n  ".join([f"Plan: {self.does}, into {self.out}", took, *self.notes])

    def to_json(self) -> dict[str, Any]:
        """The plan as plain data."""
        plain = asdict(self) | {"out": str(self.out), "notes": list(self.notes)}
        return {"schema": 1, **plain, "processor_s": round(self.processor_s, 2)}


def _bytes(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{max(number / 1e6, 1):.0f} MB"


def _time(seconds: float) -> str:
    for unit, size in (("years", 31_557_600.0), ("days", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.2g} s"


@cache
def _recorded() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(PRICES.read_text(encoding="utf-8"))
    return found


def price(kind: str) -> float:
    """Recorded processor time of a unit of work [s]; what was not timed has that of its task or kind."""
    prices, first = _recorded()["prices"], kind.partition(":")[0]
    if kind in prices:
        return float(prices[kind])
    for like in (kind.partition("/")[0] + "/", first + ":"):
        if same := [value for name, value in prices.items() if name.startswith(like)]:
            return float(median(same))
    return float(_recorded()["guessed"][first])


def measured_s() -> float:
    """Processor time of a fixed piece of work, interpreted and on arrays [s]: the best of a few."""

    def once() -> float:
        began, values = time.process_time(), np.linspace(0.0, 1.0, 1000)
        for _ in range(300):
            values = np.sin(values) + sum(range(100)) * 1e-9
        return time.process_time() - began

    return min(once() for _ in range(5))


@cache
def slowness() -> float:
    """How much slower this machine is than the one on which prices were recorded."""
    return measured_s() / float(_recorded()["machine_s"])


def memory_there() -> float:
    """Memory that this process can still get [bytes], infinite where nobody says."""
    there = [float("inf")]
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        there += [1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable")]
        most, used = (Path(f"/sys/fs/cgroup/memory.{name}").read_text() for name in ("max", "current"))
        there.append(float(most) - float(used))
    except (OSError, ValueError):  # no Linux, or no limit
        pass
    return min(there)


def of_recording(config: RecordConfig, out: Path) -> Plan:
    """Of ``fieldgym record``."""
    from fieldmodels.registry import get_model

    model, refined = get_model(config.machine), 8
    rows = config.episodes * config.duration / (config.step or 0.01)
    columns = 3 * (len(model.inputs) + 2 * len(model.outputs) + len(model.states) + 2)
    work = {"start:record": 1.0, "kernels:any": 1.0, f"recorded rows:{model.name}": rows / 1000}
    counted = "" if config.step is None else f" ({rows:,.0f} rows)"
    does = f"record {config.episodes * config.duration:g} s of {model.name}{counted}"
    if config.step is None:  # a task's recorder has a step of its own: of a flight, seconds
        rows = min(rows, 50.0 * config.episodes * config.duration / model.horizons[0])
    return Plan(does, out, work, PROCESS + 8.0 * rows * refined * columns)


def of_diagnosis(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    out: Path,
    loop: RetuneConfig | None,
) -> Plan:
    """Of ``fieldgym diagnose``."""
    from fieldmodels.diagnosis.cutting import check_range, main_horizon
    from fieldmodels.diagnosis.pilot import identifiable

    check_range(model, [*train, *test])
    rows = sum(len(one) for one in (*train, *test))
    scaled = model.scaled_to([*train, *test])  # horizons that are not stated follow the data
    horizon = main_horizon(scaled, train)
    windows = sum(len(scaled.windows(one, horizon)) for one in (*train, *test))
    fitted = min(sum(len(one) for one in train), FITTED)
    work = {
        "start:diagnose": 1.0,
        f"search:{model.name}": 1.0,
        f"fitted rows:{model.name}": fitted / 1000,
        "read rows:any": rows / 1000,
    }
    notes = [f"{rows:,} rows, {windows:,} windows of {horizon:g} s, {len(model.effects)} listed effects"]
    notes += identifiable(model, train, fixed)
    if loop is not None:
        made = 2 if loop.hidden is None else 3  # agents, each played in as many simulations
        _add(work, _retuned(loop, made, made**2 * loop.episodes, loop.episodes))
        notes.append(f"then {loop.agent} of {loop.task} is tuned anew")
    columns = len(model.parameters) + len(model.inputs) + 2 * len(model.outputs)
    memory = PROCESS + 8.0 * (10 * rows * columns + 40 * fitted * columns)
    return Plan(f"diagnose {model.name}", out, work, memory, tuple(notes))


def of_training(config: TrainConfig, out: Path) -> Plan:
    """Of ``fieldgym train``."""
    work = {"start:train": 1.0, **_trained(config), **_bounds(config.task, _validations([config]))}
    updates = -(-config.steps // config.update_steps)
    notes = (f"{config.steps:,} steps of {config.num_envs} environments, {updates:,} updates", *_proven(work))
    buffer = 8.0 * 64 * int(config.argument("buffer_size", 0) or 0)
    return Plan(f"train {config.algorithm} on {config.task}", out, work, LEARNER + buffer, notes)


def _trained(config: TrainConfig) -> Work:
    """What a training run counts: steps in environments, the calls that make them, and what is learned."""
    from fieldagents.policies.algorithms import is_on_policy

    task, kind = config.task, config.kind.__name__
    if plant := config.environment.settings.get("plant"):  # rigid bodies take a hundred times as long
        task = f"{task}, {plant}"
    updates = -(-config.steps // config.update_steps)
    steps = float(updates * config.update_steps)
    if is_on_policy(config.kind):
        samples = steps * float(config.argument("n_epochs", 1)) * getattr(config.kind, "SHARE_LEARNED", 1.0)
        batches = samples / float(config.argument("batch_size", config.update_steps))
    else:
        each = int(config.argument("gradient_steps", 1))
        learning = max(updates - int(config.argument("learning_starts", 0)) // config.update_steps, 0)
        batches = float(learning * (config.update_steps if each < 0 else each))
        samples = batches * float(config.argument("batch_size", 256))
    weights = 1000.0 + sum(a * b for a, b in pairwise((64, *config.network.hidden)))
    rounds = -(-config.steps // config.round_steps)
    validations = (rounds + config.validation.every - 1) // config.validation.every
    work = {
        f"runs:{task}/{kind}": 1.0,
        f"steps:{task}/{kind}": steps / 1000,
        f"calls:{task}": steps / config.num_envs / 1000,
        f"batches:{kind}": batches / 1000,
        "learned:any": samples * weights / 1e9,
    }
    if "recorded" in config.learner:  # episodes that are played again, not environments
        work |= {f"replayed:{task}": float(config.argument("episodes")), f"calls:{task}": 0.0}
    if config.imitate is not None:
        validations += 1
        imitated = float(config.imitate.rounds * config.imitate.steps * config.num_envs)
        epochs = config.imitate.epochs * (config.imitate.rounds + 1) / 2
        work[f"taught:{task}/{config.imitate.teacher}"] = imitated / 1000
        work["imitated:any"] = imitated * epochs * weights / 1e9
    played = float(validations * len(config.environments))
    return work | {f"validations:{task}": played, f"validated:{task}": played * config.validation.episodes}


def _validations(configs: Iterable[TrainConfig]) -> Iterable[tuple[EnvironmentConfig, int]]:
    return ((place, config.validation.episodes) for config in configs for place in config.environments)


def _bounds(task: str, places: Iterable[tuple[EnvironmentConfig, int]]) -> Work:
    """Bounds that some episodes are divided by: one a layout, however often and by whomever it is played."""
    from fieldagents.task import get_task

    if not any(metric.bound for metric in get_task(task).metrics):
        return {}
    layouts: Counter[str] = Counter()
    for place, episodes in places:
        layouts |= Counter({str(place.settings): episodes * int(place.settings.get("aircraft", 1))})
    return {f"bounds:{task}": float(layouts.total())}


def _proven(work: Work) -> tuple[str, ...]:
    return tuple(
        f"{units:,.0f} bounds; what was proven before is kept"
        for kind, units in work.items()
        if kind.startswith("bounds:")
    )


def of_evaluation(configs: Sequence[EvaluateConfig], name: str, out: Path, engine: Engine) -> Plan:
    """Of ``fieldgym evaluate``, of one evaluation or a suite."""
    work: Work = {"start:evaluate": 1.0}
    episodes = 0
    for config in configs:
        work[f"kernels:{config.task}"] = 1.0
        scenarios = float(len(config.environments))
        for agent in config.agents:
            who, played = f"{config.task}/{agent}", scenarios * config.episodes
            episodes += int(played)
            _add(
                work,
                {
                    f"compared:{config.task}": scenarios,
                    f"scenarios:{who}": scenarios,
                    f"played:{who}": played,
                },
            )
        _add(work, _bounds(config.task, ((one, config.episodes) for one in config.environments.values())))
    notes = (f"{episodes:,} episodes; what was played before is not played again", *_proven(work))
    return _jobs(f"evaluate {name}", out, work, notes, engine)


def of_realities(config: RealitiesConfig, out: Path, engine: Engine) -> Plan:
    """Of ``fieldgym evaluate`` where realities are drawn."""
    many = config.realities
    work: Work = {"start:evaluate": 1.0, f"realities:{config.task}": float(many)}
    # tuned once for the nominal simulation, then in each reality by the diagnosis and by the truth
    _add(work, _retuned(config, 2 * many + 1, 3 * many * config.episodes, many * config.episodes))
    notes = (f"{many} realities; those that are done are kept", *_proven(work))
    return _jobs(f"evaluate {config.name}", out, work, notes, engine)


EFFORT = ("experiments", "walks", "evaluations", "rounds", "seconds")
"""Options of tuners that their work is proportional to."""


def _retuned(config: RetuneConfig, made: int, played: int, layouts: int) -> Work:
    """Agents that are tuned, with more or less effort than usual, and the episodes that are played."""
    from fieldagents.config import EnvironmentConfig
    from fieldagents.retune.trained import tuner_of

    usual = tuner_of(config.task, config.agent).options.model_fields
    effort = prod(float(config.options[key]) / usual[key].default for key in EFFORT if key in config.options)
    who, place = f"{config.task}/{config.agent}", EnvironmentConfig(settings=config.settings)
    work = {f"tuned:{who}": made * effort, f"played:{who}": float(played)}
    return work | _bounds(config.task, [(place, layouts)])


def of_sweep(config: SweepConfig | TuneConfig, out: Path, engine: Engine) -> Plan:
    """Of ``fieldgym sweep``: a grid, or searches."""
    from fieldagents.sweep.config import SweepConfig, changed

    work: Work = {"start:train": 1.0}
    if isinstance(config, SweepConfig):
        runs = [run for _, _, run in config.runs]
        for run in runs:
            _add(work, _trained(run))
        for task in {run.task for run in runs}:
            _add(work, _bounds(task, _validations(run for run in runs if run.task == task)))
        note = f"{len(runs)} training runs"
    else:
        for study in config.studies.values():
            if study.train is None:
                _add(work, {f"searched steps:{config.task}": config.budget / 1000})
                continue
            typical = {key: sampler.typical for key, sampler in study.space.items()}
            run = changed(study.train, study.change | typical)
            validation = run.validation.model_copy(update={"episodes": config.episodes})
            run = run.model_copy(update={"environment": config.environment, "validation": validation})
            runs_in = config.budget / max(run.steps, 1)
            _add(work, {kind: units * runs_in for kind, units in _trained(run).items()})
        _add(work, _bounds(config.task, [(config.environment, config.episodes)]))
        note = f"{len(config.studies)} searches of {config.budget:,} steps each"
    # what a first run loads, the others of its process have
    work |= {kind: float(max(engine.workers, 1)) for kind in work if kind.startswith("runs:")}
    notes = (note, "what is done already is kept", *_proven(work))
    return _jobs(f"sweep {config.name}", out, work, notes, engine, LEARNER)


def of_exam(machines: Sequence[str], out: Path, engine: Engine) -> Plan:
    """Of ``fieldgym exam``: the machine of each case, or ``degenerate``."""
    kinds = ("hostile cases:any" if name == "degenerate" else f"cases:{name}" for name in machines)
    counts = {kind: float(count) for kind, count in Counter(kinds).items()}
    work = {"start:diagnose": 1.0, **counts}
    note = f"{len(machines)} cases; those that are done are kept"
    return _jobs("examine", out, work, (note,), engine)


def of_reproduction(runs: int, left: Sequence[float | None], out: Path, engine: Engine) -> Plan:
    """Of ``fieldgym reproduce``: how many runs, and what each that is left took when it was recorded [s]."""
    unknown = f", and nobody has timed {left.count(None)} of the others" if None in left else ""
    work = {"start:evaluate": 1.0, "seconds:any": sum(s or 0.0 for s in left)}
    note = f"{runs} runs, {runs - len(left)} of them done before{unknown}"
    return _jobs("reproduce", out, work, (note,), engine)


def _jobs(
    does: str, out: Path, work: Work, notes: tuple[str, ...], engine: Engine, each: float = PROCESS
) -> Plan:
    workers = engine.workers if engine.name == "local" else 0
    return Plan(does, out, work, PROCESS + each * max(workers, 1), notes, max(workers, 1))


def _add(work: Work, more: Mapping[str, float]) -> None:
    for kind, units in more.items():
        work[kind] = work.get(kind, 0.0) + units
