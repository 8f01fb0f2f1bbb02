"""Plans and what they took: records the prices of counted work, and checks estimates on other runs.

Some runs are timed for the prices (non-negative least squares of relative errors, ``prices.json``), others
for the table in ``docs/cli.md``; ``record`` or ``check`` times one of both sets. What ``plan.json`` has is
not timed again: delete a run there to time it anew. Each run is a fork of a
process that has imported what commands need; imports are timed apart.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from fieldagents import plan
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.zoo import list_zoo
from fieldmodels.exam.table import put

PAGE = Path(__file__).parents[1] / "docs" / "cli.md"
TIMES = Path(__file__).with_name("plan.json")
STARTS = {
    "start:record": "fieldagents.record.make, fieldmodels.drivers.around",
    "start:diagnose": "fieldmodels.diagnosis.report, fieldmodels.contract",
    "start:evaluate": "fieldagents.evaluation",
    "start:train": "fieldagents.learned.session, fieldagents.evaluation.agents",
}
EVALUATE = "name: e\ntask: {task}\nenvironments: {{usual: {{}}}}\nagents: [{agents}]\nbaseline: {first}\n"
TUNED = {"tiny": ["--set", "network.hidden=[32]"], "wide": ["--set", "network.hidden=[128,128]"]}


def recording(model, *changes):
    return ["record", f"{model}/record", *(word for change in changes for word in ("--set", change))]


def diagnosis(log):
    return ["diagnose", f"{{folder}}/{log}.csv", "--model", log.rpartition("-")[0]]


def training(name, steps, *words):
    return ["train", name, "--set", f"steps={steps}", "--set", "validation.episodes=4", *words]


def evaluation(task, agents, episodes):
    changes = (f"agents={agents}", f"episodes={episodes}", f"baseline={agents.strip('[]').split(',')[0]}")
    return ["evaluate", f"{{folder}}/{task}.yaml", *(word for one in changes for word in ("--set", one))]


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
}
GUESSED = {
    "tuned": 4.0, "searched steps": 0.02, "imitated": 0.2, "learned": 0.3, "steps": 0.02, "calls": 0.5,
    "batches": 2.0, "validations": 0.1, "validated": 0.002, "played": 0.02, "scenarios": 1.0, "cases": 15.0,
    "hostile cases": 0.9, "search": 5.0, "fitted rows": 1.0, "read rows": 0.01, "recorded rows": 0.005,
    "kernels": 0.6,
}  # fmt: skip
"""Of kinds that no run has timed; a plan that rests on one says so [s]."""
WEIGHT = 0.1
"""Of a guess, beside a run's relative error."""
FOR_CHECK = ("rig-c", "rig-d", "pendulum-b", "servo-b", "heel_strike-b")
EXAM = ["exam", "--set", "develop", "--machine", "rig", "--cases", "1", "--workers", "0", "--kind"]
RUNS = {
    "record": {
        **LOGS,
        "rig, long": recording("rig", "duration=2000"),
        **{f"diagnose {log}": diagnosis(log) for log in LOGS if log[-1] in "ab" and log not in FOR_CHECK},
        **{
            f"train {task} {steps}": training(f"{task}/ppo", steps)
            for task, steps in (("heel_strike", 10_000), ("uav_route", 10_000), ("pose_reaching", 10_000))
        },
        "train heel_strike, tiny": training("heel_strike/ppo", 40_000, *TUNED["tiny"]),
        "train pose_reaching sac": training("pose_reaching/sac", 3000),
        "train pose_reaching, large batches": training("pose_reaching/ppo_annealed", 200_000),
        "train uav_route, large batches": training("uav_route/ppo_unseen", 300_000),
        "evaluate heel_strike": evaluation("heel_strike", "[ranger]", 20),
        "evaluate heel_strike, two": evaluation("heel_strike", "[ranger,adaptive]", 60),
        "evaluate pose_reaching": evaluation("pose_reaching", "[direct]", 30),
        "exam": [*EXAM, "nothing"],
    },
    "check": {
        "record rig 4,000 s": recording("rig", "duration=4000", "seed=21"),
        "record pendulum 300 s": recording("pendulum", "duration=300"),
        "record servo 100 s": recording("servo", "duration=100"),
        "record heel_strike 200 s": recording("heel_strike", "duration=200"),
        "record rig 60 s": recording("rig", "seed=22"),
        "record pendulum 10 s": recording("pendulum", "duration=10"),
        **{f"diagnose {log}": diagnosis(log) for log in FOR_CHECK},
        "train heel_strike, 30,000 steps": training("heel_strike/ppo", 30_000),
        "train uav_route, wide": training("uav_route/ppo", 10_000, *TUNED["wide"]),
        "train pose_reaching, 20,000 steps": training("pose_reaching/ppo", 20_000),
        "train pose_reaching sac, 4,500": training("pose_reaching/sac", 4500),
        "train heel_strike, twins": training("heel_strike/ppo_twins", 100_000),
        "evaluate heel_strike, 100": evaluation("heel_strike", "[ranger]", 100),
        "evaluate heel_strike, 2 x 30": evaluation("heel_strike", "[adaptive,ranger]", 30),
        "evaluate pose_reaching, 60": evaluation("pose_reaching", "[direct]", 60),
        "exam of a rig": [*EXAM, "single"],
        "record rig, 6 episodes": recording("rig", "episodes=6", "duration=30"),
    },
}  # fmt: skip


def forked(words, out):
    """What a command prints as JSON, its processor time [s] and memory [bytes]."""
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.dup2(write, 1)
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
    took, memory, code = json.loads(Path(f"{out}.took").read_text())
    if code:
        raise RuntimeError(f"{words}: exit code {code}: {said[-500:]}")
    return json.loads(said), took, memory


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
    return planned, took, memory


def all_runs(which, known):
    """Time the runs of a set that are not known; logs are recorded where a run needs one."""
    left = {name: words for name, words in RUNS[which].items() if name not in known}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for task in ("heel_strike", "pose_reaching"):
            agents = {"heel_strike": "ranger, adaptive", "pose_reaching": "direct"}[task]
            (folder / f"{task}.yaml").write_text(
                EVALUATE.format(task=task, agents=agents, first=agents.split(",")[0])
            )
        needed = {log for log in LOGS if any(f"{{folder}}/{log}.csv" in words for words in left.values())}
        for number, (log, words) in enumerate(LOGS.items()):
            if log not in needed:
                continue
            forked([*words, "--set", f"name={log}", "--set", "format=csv"], folder / f"log{number}")
            (folder / f"log{number}" / f"{log}.csv").rename(folder / f"{log}.csv")
        for number, (name, words) in enumerate(left.items()):
            planned, took, memory = timed(
                [w.replace("{folder}", str(folder)) for w in words], folder, f"run{number}"
            )
            print(
                f"{name}: {took:.2f} s, planned {planned['processor_s']} s, {memory / 1e9:.2f} GB", flush=True
            )
            yield name, planned, took, memory


def imported(modules):
    """Processor time of importing some modules in a process of their own [s]."""
    code = f"import {modules}, fieldagents.cli, time\nprint(time.process_time())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def time_all(which):
    """Time the runs that ``plan.json`` lacks, and keep what each counted and took as soon as it has ended."""
    kept = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    own = kept.setdefault(which, {"starts": {}, "runs": []})
    own["starts"] = own["starts"] or {kind: imported(modules) for kind, modules in STARTS.items()}
    for name, planned, took, memory in all_runs(which, {run["name"] for run in own["runs"]}):
        counted = {"work": planned["work"], "planned_GB": planned["memory"] / 1e9}
        measured = {"took_s": took, "had_GB": memory / 1e9, "slowness_s": plan.measured_s()}
        own["runs"].append({"name": name, **counted, **measured})
        TIMES.write_text(json.dumps(kept, indent=1) + "\n")


def of_the_zoo():
    """What the zoo's trainings by reward took, where that was kept: whole runs of the shipped configs."""
    for entry in list_zoo():
        for training in entry.trainings:
            took = [run["processor_seconds"] for run in training.card["runs"] if "processor_seconds" in run]
            config = TrainConfig.model_validate(training.card["config"])
            if took and config.imitate is None:  # what imitation takes is guessed from them
                name = f"train {config.task}/{config.name}, the zoo's {config.steps:,} steps"
                yield name, plan.of_training(config, PAGE), float(np.median(took))


def publish():
    """Prices from the runs of one set, and how well they tell those of the other."""
    times = json.loads(TIMES.read_text())
    machine = float(np.median([run["slowness_s"] for run in times["record"]["runs"]]))
    starts = times["record"]["starts"]
    runs = times["record"]["runs"]
    kinds = sorted({kind for run in runs for kind in run["work"]} - {*starts, "seconds:any"})
    took = np.array([run["took_s"] * machine / run["slowness_s"] for run in runs])
    relative = np.array([[run["work"].get(kind, 0.0) for kind in kinds] for run in runs]) / took[:, None]
    guess = np.array([GUESSED[kind.partition(":")[0]] for kind in kinds])
    # What the runs leave open stays near a guess instead of becoming nothing.
    both = np.vstack([relative * guess, WEIGHT * np.eye(len(kinds))])
    found = guess * nnls(both, np.r_[np.ones(len(runs)), np.full(len(kinds), WEIGHT)])[0]
    prices = {kind: float(f"{value:.3g}") for kind, value in zip(kinds, found, strict=True)}
    guessed = {kind: value for kind, value in GUESSED.items() if not any(k.startswith(kind) for k in prices)}
    whole = {"machine_s": machine, "prices": {**starts, **prices, "seconds:any": 1.0}, "guessed": guessed}
    plan.PRICES.write_text(json.dumps(whole, indent=1) + "\n")
    plan._recorded.cache_clear()
    lines = [
        "| run | planned [s] | took [s] | ratio | memory: planned, had [GB] |",
        "|---|---:|---:|---:|---:|",
    ]
    rows = []
    for run in times["check"]["runs"]:
        estimate = plan.Plan("", PAGE, run["work"]).recorded_s * run["slowness_s"] / machine
        took = run["took_s"] + sum(times["check"]["starts"].get(kind, 0.0) for kind in run["work"])
        rows.append((run["name"], estimate, took, f"{run['planned_GB']:.1f}, {run['had_GB']:.1f}"))
    rows += [(name, planned.recorded_s, took, "") for name, planned, took in of_the_zoo()]
    for name, estimate, took, memory in rows:
        lines.append(f"| {name} | {estimate:.2g} | {took:.2g} | {estimate / took:.2f} | {memory} |")
    good = sum(0.5 <= estimate / took <= 2.0 for _, estimate, took, _ in rows)
    words = f"Within a factor of two in {good} of {len(rows)} runs (`python benchmarks/plan.py`)."
    put("\n".join([words, "", *lines, ""]), PAGE, "plans and what they took")


if __name__ == "__main__":
    for which in sys.argv[1:] or ("record", "check"):
        time_all(which)
    if TIMES.exists() and {"record", "check"} <= set(json.loads(TIMES.read_text())):
        publish()
