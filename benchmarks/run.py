"""What users wait for, each as a ratio within one run, held against the ratios last accepted.

    python benchmarks/run.py             # measure; exit 1 where a ratio is 1.5 times the accepted one
    python benchmarks/run.py --only step --accept

Each thing is timed in turns with a yardstick of its kind: an environment's step with CartPole's, a command
with Python's start, a diagnosis with plain Python work, a first step with Numba's smallest kernel. Writes
``results.json`` beside this file and ``docs/speed.md``; ``--accept`` writes ``accepted.json`` as well.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from diagnosis_speed import RECORDS, record
from growth import with_candidates, with_copies, with_radars, with_rate, with_recordings
from steppers import native, scalar, steps_a_second

import fieldgym
from fieldagents.tasks.uav_route.certified import certified_plan
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.files import write_text
from fieldmodels.machines.uav_route.layouts import random_layout
from fieldmodels.registry import get_model

HERE = Path(__file__).parent
RESULTS, ACCEPTED, PAGE = HERE / "results.json", HERE / "accepted.json", HERE.parent / "docs" / "speed.md"
WORSE = 1.5
"""A ratio that has grown by this factor fails."""
IDS = [task.env_id for task in fieldgym.TASKS.values()]
THEIRS = "CartPole-v1"
LONG = {"HeelStrike": {"strides": 1_000_000}, "Excitation": {"decisions": 100_000}}
"""Settings whose episodes don't end while they are timed."""
ROWS = {"LineFollowingPixels": 16, "Excitation": 16}
"""Rows of a vector environment whose step is long; 64 of the others."""


MAIN = "import sys; from fieldagents.cli import main; sys.argv[0] = 'fieldgym'; main()"
"""The command line, in a process of its own."""


class Ratio(NamedTuple):
    """One line of the page."""

    name: str
    ratio: float
    means: str


def settings_of(env_id: str) -> dict[str, Any]:
    """Settings to time an environment with."""
    return LONG.get(env_id.split("/")[1].split("-")[0], {})


def steps() -> Iterator[Ratio]:
    """Steps of the environments: one alone, and a row of a vector environment."""
    for env_id in IDS:
        name = env_id.split("/")[1].split("-")[0]
        rows, own = ROWS.get(name, 64), settings_of(env_id)
        rates = steps_a_second({
            "one": (scalar(env_id, settings=own), 1),
            "row": (native(env_id, rows, settings=own), rows),
            "CartPole": (scalar(THEIRS), 1),
        })  # fmt: skip
        yield Ratio(f"{name}: a step", rates["CartPole"] / rates["one"], "times a step of CartPole")
        yield Ratio(
            f"{name}: a row's step of {rows}", rates["one"] / rates["row"], "times a step of one alone"
        )


def spent(arguments: list[str], **options: Any) -> float:
    """Processor time of a command and its children [s]."""
    before = os.times()
    subprocess.run(arguments, check=True, capture_output=True, **options)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


MANY = ("HeelStrike", "LineFollowing", "Excitation", "UavRoute")
"""Environments that are worth a thousand copies: each step is long, or was."""


def named(name: str) -> str:
    """The id of an environment."""
    return next(i for i in IDS if f"/{name}-" in i)


def many() -> Iterator[Ratio]:
    """A row of 1024 of the environments whose steps are long, against a row of CartPole's vector form."""
    theirs = native(THEIRS, 1024)
    for name in MANY:
        own = native(named(name), 1024, settings=settings_of(named(name)))
        ours, unit = in_turns([partial(own, 0), lambda: [theirs(k) for k in range(16)]], rounds=4)
        yield Ratio(f"{name}: a row's step of 1024", 16 * ours / unit, "times a row's step of 1024 CartPoles")


def growths() -> Iterator[Ratio]:
    """Exponents of cost against copies, radars, rate, recordings and candidates."""
    for name in MANY:
        found = with_copies(named(name), settings_of(named(name)))
        yield Ratio(f"{name}: growth with copies", found, "exponent of processor time, 16 to 256 copies")
    yield Ratio("UavRoute: growth with radars", with_radars(named("UavRoute")), "exponent of processor time")
    yield Ratio("diagnosis: growth with rate", with_rate(), "exponent of processor time, 100 Hz to 1 kHz")
    yield Ratio("diagnosis: growth with recordings", with_recordings(), "exponent of processor time")
    yield Ratio("diagnosis: growth with candidates", with_candidates(), "with 23, times that with 8")


def demonstration() -> Iterator[Ratio]:
    """All of ``fieldgym demo``, its children included."""
    with tempfile.TemporaryDirectory() as folder:
        own = spent([sys.executable, "-c", MAIN, "demo", "--out", folder])
    unit = in_turns([additions])[0]
    yield Ratio("fieldgym demo", own / unit, "times a million additions in Python")


THREADED = {"HeelStrike": 64, "Excitation": 64, "UavRoute": 1024}


def threads() -> Iterator[Ratio]:
    """The busier one's time where two threads share the rows, for the environments whose steps are long.

    It is what a step takes where both find a processor free; a busy machine does not change it.
    """
    for name, rows in THREADED.items():
        settings = settings_of(named(name))
        envs = [gym.make_vec(named(name), num_envs=rows, settings=settings, threads=n) for n in (1, 2)]
        for env in envs:
            env.reset(seed=0)
        rng = np.random.default_rng(0)
        actions = rng.uniform(-1.0, 1.0, (26, *envs[0].action_space.shape)).astype(np.float32)
        alone, shared = [], []
        for action in actions:
            for env, times in zip(envs, (alone, shared), strict=True):
                began = time.process_time(), time.thread_time()
                env.step(action)
                whole, here = time.process_time() - began[0], time.thread_time() - began[1]
                times.append(max(here, whole - here))
        ratio = median(shared[1:]) / median(alone[1:])
        yield Ratio(
            f"{name}: {rows} rows on two threads", ratio, "of one's processor time, the busier thread"
        )


def planners() -> Iterator[Ratio]:
    """Planners of UavRoute, on a random layout."""
    layouts = {n: random_layout(np.random.default_rng(n), n) for n in (1, 3)}
    works = {
        "legs past 3 radars": partial(leg_plan, layouts[3]),
        "lattice past 1 radar": partial(lattice_plan, layouts[1]),
        "certified past 1 radar": partial(certified_plan, layouts[1]),
    }
    *own, unit = in_turns([*works.values(), additions], rounds=3)
    for name, value in zip(works, own, strict=True):
        yield Ratio(f"planner: {name}", value / unit, "times a million additions in Python")


ENOUGH = -130.0
"""Return of an episode of HeelStrike that a small training reaches; one without any has -197."""
TRAINING = ["train", "heel_strike/ppo", "--set", "steps=40000", "--set", "network.hidden=[32]",
            "--set", "validation.episodes=4"]  # fmt: skip


def training() -> Iterator[Ratio]:
    """A small training, which must reach a score."""
    with tempfile.TemporaryDirectory() as folder:
        own = spent([sys.executable, "-c", MAIN, *TRAINING, "--out", f"{folder}/run"])
        reached = json.loads(Path(folder, "run", "run.json").read_text())["validation_return"]
    if reached < ENOUGH:
        raise RuntimeError(f"{' '.join(TRAINING)} reached a return of {reached:.0f}, not {ENOUGH:.0f}")
    unit = in_turns([additions])[0]
    yield Ratio(
        f"training of HeelStrike to a return of {ENOUGH:.0f}",
        own / unit,
        "times a million additions in Python",
    )


def in_turns(
    works: list[Callable[[], Any]], clock: Callable[[], float] = time.process_time, rounds: int = 5
) -> list[float]:
    """Median time of each of some works, done in turns after once without a clock [s]."""
    times: list[list[float]] = [[] for _ in works]
    for i in range(rounds + 1):
        for work, own in zip(works, times, strict=True):
            began = clock()
            work()
            if i:
                own.append(clock() - began)
    return [median(own) for own in times]


def additions() -> None:
    """A yardstick: a million additions in Python."""
    total = 0.0
    for i in range(1_000_000):
        total += i


def diagnoses() -> Iterator[Ratio]:
    """Diagnoses of records of a rig on one thread, and the simulations that they count themselves."""
    model, options = get_model("rig"), DiagnosisOptions(threads=1)
    found: dict[str, float] = {}
    for name in list(RECORDS)[:3]:
        data = record(*RECORDS[name])
        own, unit = in_turns([partial(diagnose, model, [data], options=options), additions], rounds=2)
        found[name] = own / unit
        yield Ratio(f"diagnosis: {name}", own / unit, "times a million additions in Python")
        count = diagnose(model, [data], options=options).simulations
        yield Ratio(f"diagnosis: {name}, simulations", count, "plain simulations of its windows")
    short, long = list(found.values())[1:3]
    growth = np.log(long / short) / np.log(1e4 / 3e3)
    yield Ratio("diagnosis: growth with rows", float(growth), "exponent of processor time against rows")


def commands() -> Iterator[Ratio]:
    """Commands that answer at once, against a start of Python that imports NumPy."""

    def started(*arguments: str) -> Callable[[], None]:
        return lambda: subprocess.run([sys.executable, *arguments], check=True, capture_output=True) and None

    works = [started("-c", MAIN, *words) for words in (("--help",), ("list",))]
    *own, base = in_turns([*works, started("-c", "import numpy")], time.perf_counter)
    for name, value in zip(("--help", "list"), own, strict=True):
        yield Ratio(f"fieldgym {name}", value / base, "times a start of Python with NumPy")


FIRST = "import gymnasium as g, fieldgym; e = g.make({!r}); e.reset(seed=0); e.step(e.action_space.sample())"
SMALL = "import numba\n@numba.njit\ndef f(x):\n    return x + 1\nf(1.0)"


def first_steps() -> Iterator[Ratio]:
    """First step on a fresh installation, where nothing is compiled yet, against Numba's smallest kernel."""

    def fresh(code: str) -> float:
        with tempfile.TemporaryDirectory() as folder:
            places = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME", "TMPDIR")  # wherever kernels may lie
            own = os.environ | dict.fromkeys(places, folder)
            return spent([sys.executable, "-c", code], env=own)

    base = median(fresh(SMALL) for _ in range(3))
    for env_id in IDS:
        ratio = fresh(FIRST.format(env_id)) / base
        yield Ratio(
            f"{env_id.split('/')[1]}: first step, nothing compiled", ratio, "times Numba's smallest kernel"
        )


GROUPS: dict[str, Callable[[], Iterator[Ratio]]] = {
    "step": steps, "many": many, "threads": threads, "growth": growths, "diagnosis": diagnoses,
    "command": commands, "first": first_steps, "planner": planners, "training": training,
    "demo": demonstration,
}  # fmt: skip


def page(found: dict[str, Any]) -> str:
    """The page of speeds; all groups are in ``results.json``."""

    def ratio(start: str) -> str:
        name = next(name for name in found if name.startswith(start))
        return f"{found[name]['ratio']:.3g}"

    names = [name.partition(":")[0] for name in found if name.endswith(": a step")]
    rows = [
        f"| {name} | {ratio(f'{name}: a step')} | {ratio(f'{name}: a row')} | {ratio(f'{name}-v')} |"
        for name in names
    ]
    return "\n".join([
        "# Speed", "",
        "![How many steps of CartPole a step of each environment take"
        "s, alone and in a vector](pictures/speed.svg)", "",
        "Times are ratios within one run, which do not depend on the machine; less is better. `make bench`",
        f"measures them again and fails if one is {WORSE} times the accepted one.",
        "`benchmarks/results.json` holds all, also growth with size and the cost of a diagnosis.", "",
        "- **Alone**: a step of one environment, in steps of CartPole.",
        "- **In a vector**: a row's step among 64 (Excitation, pixels: 16), in steps of one alone.",
        "- **First step**: with nothing compiled, in times of Numba's smallest kernel.", "",
        "| environment | alone | in a vector | first step |", "|---|---|---|---|", *rows, "",
        f"`fieldgym --help` takes {ratio('fieldgym --help')} times, `fieldgym list` {ratio('fieldgym list')} "
        f"times a start of Python with NumPy,",
        f"`fieldgym demo` {ratio('fieldgym demo')} times a million additions in Python.", "",
    ])  # fmt: skip


def main() -> int:
    """Measure, write, compare; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", choices=GROUPS, nargs="+", default=list(GROUPS), help="some groups")
    parser.add_argument("--accept", action="store_true", help="take what is measured for the accepted ratios")
    arguments = parser.parse_args()
    before = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    accepted = json.loads(ACCEPTED.read_text()) if ACCEPTED.exists() else {}
    measured: dict[str, Any] = {}
    for group in arguments.only:
        for one in GROUPS[group]():
            limit = WORSE * accepted.get(one.name, float("inf"))
            verdict = "  WORSE" if one.ratio > limit else ""
            print(f"{one.name:58s}{one.ratio:12.4g}  {one.means}{verdict}", flush=True)
            measured[one.name] = {"group": group, "ratio": round(one.ratio, 4), "means": one.means}
    kept = {name: one for name, one in before.items() if one["group"] not in arguments.only}
    found = dict(sorted({**kept, **measured}.items(), key=lambda item: list(GROUPS).index(item[1]["group"])))
    worse = [n for n, one in measured.items() if one["ratio"] > WORSE * accepted.get(n, float("inf"))]
    if arguments.accept:
        accepted |= {name: one["ratio"] for name, one in measured.items()}
        write_text(ACCEPTED, json.dumps(accepted, indent=2) + "\n")
    write_text(RESULTS, json.dumps(found, indent=2) + "\n")
    write_text(PAGE, page(found))
    for name in worse:
        print(f"{name}: {measured[name]['ratio']:.3g}, {WORSE} times worse than {accepted[name]:.3g}")
    return 1 if worse and not arguments.accept else 0


if __name__ == "__main__":
    sys.exit(main())
