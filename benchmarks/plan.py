"""Plans and what they took: records the prices of counted work, and checks estimates on other runs.

Some runs are timed for the prices (non-negative least squares of relative errors, ``prices.json``), others
for the table in ``docs/cli.md``: of every shipped config a small run. ``record`` or ``check`` times one of
both sets; what ``plan.json`` has is not timed again: delete a run there to time it anew. Each run is a fork
of a process that has imported what commands need; imports are timed apart. Exit code 1 if a plan of the
second set is off by more than a factor of two.
"""

import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import platformdirs
import yaml
from scipy.optimize import nnls

from exam.table import put
from fieldagents import plan
from fieldagents.config import load_config
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.zoo import list_zoo
from fieldagents.sweep.config import SweepConfig
from fieldagents.tasks.uav_route.lower_bound import bound_to_capture, layouts_of
from fieldgym import find_task
from fieldmodels.machines.uav_route.parameters import World

PAGE = Path(__file__).parents[1] / "docs" / "cli.md"
TIMES = Path(__file__).with_name("plan.json")
STARTS = {
    "start:record": "fieldagents.record.make, fieldmodels.drivers.around",
    "start:diagnose": "fieldmodels.diagnosis.report, fieldmodels.contract",
    "start:evaluate": "fieldagents.evaluation.evaluate, fieldagents.evaluation.agents",
    "start:train": "fieldagents.learned.session, fieldagents.evaluation.agents",
}
CONFIGS = Path(__file__).parents[1] / "configs"
LIMIT = 150
"""Processor time after which a run is given up [s]."""


def overridden(changes):
    return [word for key, value in changes.items() for word in ("--set", f"{key}={json.dumps(value)}")]


def recording(model, *changes):
    return ["record", f"{model}/record", *(word for change in changes for word in ("--set", change))]


def diagnosis(log):
    return ["diagnose", f"{{folder}}/{log}.csv", "--machine", log.rpartition("-")[0]]


def training(name, part, updates, **changes):
    """A part of a shipped training, some updates at least; of one that only imitates, as many rounds."""
    config = load_config(Path(name), TrainConfig)
    starts = int(config.argument("learning_starts", 0) or 0)
    steps = starts + max(updates * config.update_steps, round(part * (config.steps - starts)))
    changes |= {"steps": steps} if config.steps else {"imitate.rounds": max(updates // 2, 2)}
    return ["train", name, *overridden(changes)]


def evaluation(name, episodes, scenarios):
    config = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    places = dict([*config["environments"].items()][:scenarios])
    return ["evaluate", name, *overridden({"episodes": episodes, "environments": places})]


def sweeping(name):
    """One run of a shipped grid, of few steps."""
    config = load_config(Path(name), SweepConfig)
    seed = {key: values[:1] for key, values in config.grid.items()}
    return [
        "sweep",
        name,
        "--workers",
        "0",
        *overridden({"grid": seed, "change.steps": _least(config.train[0])}),
    ]


def searching(name, *, of_agents):
    """A shipped search of few steps, in reference agents or in trainings."""
    config = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    studies = {key: study for key, study in config["studies"].items() if ("agent" in study) == of_agents}
    if not studies:
        return None
    steps = [_least(study["train"]) for study in studies.values() if "train" in study]
    for study, least in zip(studies.values(), steps, strict=False):
        study.setdefault("change", {})["steps"] = least
    least = (
        {"budget": 4 * max(steps), "episodes": 8, "rungs": []}
        if steps
        else {"budget": config["budget"] // 100}
    )
    changes = {"studies": studies, **least}
    return ["sweep", name, "--workers", "0", *overridden(changes)]


def _least(name):
    config = load_config(Path(name), TrainConfig)
    return int(config.argument("learning_starts", 0) or 0) + 2 * config.update_steps


def shipped(kind):
    """Names of shipped configs that are read as a kind of config."""
    for path in sorted(CONFIGS.glob("*/*.yaml")):
        data = yaml.safe_load(path.read_text())
        keys = {"train": "num_envs", "evaluate": "baseline", "realities": "realities", "tune": "studies"}
        keys |= {"sweep": "grid", "record": "excitation"}
        if path.stem.startswith("record") if kind == "record" else keys[kind] in data:
            yield f"{path.parent.name}/{path.stem}"


SLOW = ("uav_route/benchmark_printed",)
"""A run of these takes minutes."""


def hidden(task):
    return yaml.safe_load((CONFIGS / task / "retune.yaml").read_text())["hidden"]


TASKS = sorted(path.parent.name for path in CONFIGS.glob("*/retune.yaml"))
LOGS = {
    "rig-a": recording("rig", "duration=20"),
    "rig-b": recording("rig", "duration=90", "seed=5"),
    "rig-c": recording("rig", "duration=45", "seed=6", "reality={}"),
    "rig-d": recording("rig", "duration=200", "seed=7"),
    "pendulum-a": recording("pendulum", "duration=30"),
    "pendulum-b": recording("pendulum", "duration=60", "seed=8"),
    "servo-a": recording("servo", "duration=20"),
    "servo-b": recording("servo", "duration=50", "seed=9"),
    "heel_strike-a": recording("heel_strike"),
    "heel_strike-b": recording("heel_strike", "seed=10", "duration=150"),
    **{f"{task}-r": ["record", f"{task}/record", *overridden({"reality": hidden(task)})] for task in TASKS},
}
GUESSED = {
    "tuned": 4.0, "searched steps": 0.02, "imitated": 0.2, "taught": 0.02, "learned": 0.05, "steps": 0.02,
    "calls": 0.5, "batches": 2.0, "runs": 1.0, "validations": 0.1, "validated": 0.002, "played": 0.01,
    "scenarios": 0.3, "compared": 0.1, "cases": 15.0, "hostile cases": 0.9, "search": 5.0, "fitted rows": 1.0,
    "read rows": 0.01, "recorded rows": 0.005, "kernels": 0.6, "realities": 5.0,
    "replayed": 0.02,
}  # fmt: skip
"""Of kinds that no run has timed; a plan that rests on one says so [s]."""
WEIGHT = 0.003
"""Of a guess, beside a run's relative error."""
FOR_CHECK = ("rig-c", "rig-d", "pendulum-b", "servo-b", "heel_strike-b")
EXAM = ["exam", "--set", "develop", "--machine", "rig", "--cases", "1", "--workers", "0", "--kind"]
RUNS = {
    "record": {
        **LOGS,
        "rig, long": recording("rig", "duration=2000"),
        **{f"diagnose {log}": diagnosis(log) for log in LOGS if log[-1] in "ab" and log not in FOR_CHECK},
        "exam": [*EXAM, "nothing"],
        **{f"record {name}": ["record", name] for name in shipped("record")},
        **{f"train {name}, little": training(name, 0, 2) for name in shipped("train")},
        **{f"train {name}, more": training(name, 1 / 16, 9) for name in shipped("train")},
        "train heel_strike, tiny": training("heel_strike/ppo", 1 / 16, 9, **{"network.hidden": [32]}),
        **{
            f"evaluate {name}, {count}": evaluation(name, count, 1)
            for name in shipped("evaluate")
            for count in ((2, 10) if name not in SLOW else (2,))
        },
        **{
            f"search {name}, agents": words
            for name in shipped("tune")
            if (words := searching(name, of_agents=True))
        },
        **{
            f"evaluate {name}, 2": ["evaluate", name, *overridden({"realities": 2, "episodes": 2})]
            for name in shipped("realities")
        },
    },
    "check": {
        "record rig 4,000 s": recording("rig", "duration=4000", "seed=21"),
        "record pendulum 300 s": recording("pendulum", "duration=300"),
        "record servo 100 s": recording("servo", "duration=100"),
        "record heel_strike 200 s": recording("heel_strike", "duration=200"),
        "record rig 60 s": recording("rig", "seed=22"),
        "record pendulum 10 s": recording("pendulum", "duration=10"),
        **{f"diagnose {log}": diagnosis(log) for log in FOR_CHECK},
        "exam of a rig": [*EXAM, "single"],
        "record rig, 6 episodes": recording("rig", "episodes=6", "duration=30"),
        **{f"sweep {name}": sweeping(name) for name in shipped("sweep")},
        **{f"search {name}": searching(name, of_agents=False) for name in shipped("tune")},
        **{
            f"diagnose and retune {task}": [*diagnosis(f"{task}-r"), "--then-retune", f"{task}/retune"]
            for task in TASKS
        },
        **{f"evaluate {name}": evaluation(name, 4, 2) for name in shipped("evaluate") if name not in SLOW},
        **{f"train {name}": training(name, 1 / 32, 5) for name in shipped("train")},
        "train uav_route, wide": training("uav_route/ppo", 1 / 32, 5, **{"network.hidden": [128, 128]}),
    },
}  # fmt: skip


def forked(words, out):
    """What a command prints as JSON, its processor time [s] and memory [bytes]."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(write, 1)
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
        platformdirs.user_cache_dir = lambda _: str(out)  # bounds are not kept from run to run
        plan.price = lambda _: 0.0  # of new work there is none yet
        os.dup2(os.open("/dev/null" if "FIELDGYM_SAY" not in os.environ else "/dev/tty", os.O_WRONLY), 2)
        from fieldagents.cli import app

        before, code = resource.getrusage(resource.RUSAGE_SELF), 1
        sys.stdout = os.fdopen(1, "w")
        try:
            app([*words, "--out", str(out), "--json"])
        except SystemExit as end:
            code = end.code or 0
        sys.stdout.flush()
        after = resource.getrusage(resource.RUSAGE_SELF)
        took = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        Path(f"{out}.took").write_text(json.dumps([took, after.ru_maxrss * 1024.0, code]))
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    try:
        took, memory, code = json.loads(Path(f"{out}.took").read_text())
    except OSError:
        took, memory, code = 0.0, 0.0, f"none, after {LIMIT} s"
    if code:
        raise RuntimeError(f"{words}: exit code {code}: {said[-500:]}")
    return json.loads(said), took, memory


def parts(work, folder):
    """Work and processor time [s] of a run's jobs, of an agent together; of a reality's, of its parts."""
    found = Counter()
    for path in folder.glob("jobs/*/result.json"):
        job = json.loads(path.read_text())
        if isinstance(job["result"], dict) and "hidden" in job["result"]:
            for part, took in job["result"]["seconds"].items():
                found["realities:" if part in ("record", "diagnose") else "tuned:"] += took
        else:
            found["/" + job["label"].partition(": ")[2]] += job["processor_s"]
    for name, took in found.items():
        own = {
            kind: units
            for kind, units in work.items()
            if (kind.startswith(name) if name.endswith(":") else kind.endswith(name))
        }
        yield own, took


def kernels():
    from fieldmodels.compiled import cache_folder

    return len(list(cache_folder().iterdir()))


def timed(words, folder, name):
    """A run's plan, what it took without compiling, and its memory."""
    planned, _, _ = forked([*words, "--dry-run"], folder / "dry")
    for attempt in range(3):
        before = kernels()
        _, took, memory = forked(words, folder / f"{name}-{attempt}")
        if kernels() == before:
            break
    own = [
        {"work": work, "took_s": took} for work, took in parts(planned["work"], folder / f"{name}-{attempt}")
    ]
    return planned, took, memory, own


def all_runs(which, known):
    """Time the runs of a set that are not known; logs are recorded where a run needs one."""
    left = {name: words for name, words in RUNS[which].items() if name not in known}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        needed = {log for log in LOGS if any(f"{{folder}}/{log}.csv" in words for words in left.values())}
        for number, (log, words) in enumerate(LOGS.items()):
            if log not in needed:
                continue
            forked([*words, "--set", f"name={log}", "--set", "format=csv"], folder / f"log{number}")
            (folder / f"log{number}" / f"{log}.csv").rename(folder / f"{log}.csv")
        for number, (name, words) in enumerate(left.items()):
            words = [word.replace("{folder}", str(folder)) for word in words]
            try:
                planned, took, memory, own = timed(words, folder, f"run{number}")
            except RuntimeError as error:
                print(f"{name}: {error}", flush=True)
                continue
            print(f"{name}: {took:.2f} s", flush=True)
            yield {
                "name": name,
                "work": planned["work"],
                "planned_GB": planned["memory"] / 1e9,
                "took_s": took,
                "had_GB": memory / 1e9,
                "slowness_s": plan.measured_s(),
                "parts": own,
            }


def imported(modules):
    """Processor time of importing some modules in a process of their own [s]."""
    code = f"import {modules}, fieldagents.cli, time\nprint(time.process_time())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def proven(count=100):
    """Processor time of proving the bound of a layout [s]."""
    _, info = find_task("uav_route").make_vec(count, settings={"layout": "random"}).reset(seed=1)
    layouts = layouts_of(info)
    bound_to_capture(layouts[0], World(), 4.0)  # the world's limits are found once
    began = time.process_time()
    for layout in layouts:
        bound_to_capture(layout, World(), 5.0)
    return (time.process_time() - began) / count


def time_all(which):
    """Time the runs that ``plan.json`` lacks, and keep what each counted and took as soon as it has ended."""
    kept = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    if "starts" not in kept:
        kept["starts"] = {kind: imported(modules) for kind, modules in STARTS.items()}
        kept["starts"]["bounds:uav_route"] = proven()
        kept["slowness_s"] = plan.measured_s()
    own = kept.setdefault(which, {"runs": []})
    for module in ", ".join(STARTS.values()).split(", "):
        importlib.import_module(module)
    for run in all_runs(which, {run["name"] for run in own["runs"]}):
        own["runs"].append(run)
        TIMES.write_text(json.dumps(kept).replace('{"name"', '\n{"name"') + "\n")


def of_the_zoo():
    """What the zoo's trainings took, where that was kept: whole runs of the shipped configs."""
    for entry in list_zoo():
        for training in entry.trainings:
            took = [run["processor_seconds"] for run in training.card["runs"] if "processor_seconds" in run]
            config = TrainConfig.model_validate(training.card["config"])
            if took:
                name = f"train {config.task}/{config.name}, the zoo's {config.steps:,} steps"
                yield name, plan.of_training(config, PAGE), float(np.median(took))


def _kind(name):
    """What a run is counted among: its command, or the zoo's trainings."""
    return "train, whole runs of the zoo" if name.startswith("of the zoo") else f"`{name.split()[0]}`"


def publish():
    """Prices from the runs of one set, and how well they tell those of the other.

    Returns:
        Whether all plans of the other are within a factor of two.
    """
    times = json.loads(TIMES.read_text())
    machine = float(np.median([run["slowness_s"] for run in times["record"]["runs"]]))
    starts = {kind: took * machine / times["slowness_s"] for kind, took in times["starts"].items()}
    runs = [
        {**part, "took_s": part["took_s"] * machine / run["slowness_s"]}
        for run in times["record"]["runs"]
        for part in (run, *run.get("parts", []))
        if part["work"] and part["took_s"] > 0
    ]
    for run in runs:
        run["took_s"] -= run["work"].get("bounds:uav_route", 0.0) * starts["bounds:uav_route"]
    kinds = sorted({kind for run in runs for kind in run["work"]} - {*starts, "seconds:any"})
    took = np.array([run["took_s"] for run in runs])
    relative = np.array([[run["work"].get(kind, 0.0) for kind in kinds] for run in runs]) / took[:, None]
    guess = np.array([GUESSED[kind.partition(":")[0]] for kind in kinds])
    # What the runs leave open stays near a guess instead of becoming nothing.
    both = np.vstack([relative * guess, WEIGHT * np.eye(len(kinds))])
    found = guess * nnls(both, np.r_[np.ones(len(runs)), np.full(len(kinds), WEIGHT)])[0]
    prices = {kind: float(f"{value:.3g}") for kind, value in zip(kinds, found, strict=True)}
    guessed = {kind: value for kind, value in GUESSED.items() if not any(k.startswith(kind) for k in prices)}
    starts = {kind: float(f"{value:.3g}") for kind, value in starts.items()}
    whole = {"machine_s": machine, "prices": {**starts, **prices, "seconds:any": 1.0}, "guessed": guessed}
    plan.PRICES.write_text(json.dumps(whole, indent=1) + "\n")
    plan._recorded.cache_clear()
    rows = []
    for run in times["check"]["runs"]:
        slow = run["slowness_s"] / machine
        estimate = plan.Plan("", PAGE, run["work"]).recorded_s * slow
        took = run["took_s"] + slow * sum(starts.get(kind, 0.0) for kind in run["work"])
        rows.append((run["name"], estimate, took))
    rows += [(f"of the zoo: {name}", planned.recorded_s, took) for name, planned, took in of_the_zoo()]
    kinds = list(dict.fromkeys(_kind(name) for name, _, _ in rows))
    lines = ["| plans of | runs | planned over taken time |", "|---|---:|---|"]
    for kind in kinds:
        ratios = [estimate / took for name, estimate, took in rows if _kind(name) == kind]
        lines.append(f"| {kind} | {len(ratios)} | {min(ratios):.2f} to {max(ratios):.2f} |")
    good = sum(0.5 <= estimate / took <= 2.0 for _, estimate, took in rows)
    words = f"Within a factor of two in {good} of {len(rows)} runs (`python benchmarks/plan.py`)."
    put("\n".join([words, "", *lines, ""]), PAGE, "plans and what they took")
    return good == len(rows)


if __name__ == "__main__":
    for which in sys.argv[1:] or ("record", "check"):
        time_all(which)
    sys.exit(not publish())
