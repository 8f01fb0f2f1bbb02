"""Write the leaderboard, docs/leaderboard.md: one table a task.

fieldgym evaluate benchmark --set episodes=null; python docs/leaderboard.py results/benchmark
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from fieldagents.evaluation.agents import describe_agents
from fieldagents.policies.zoo import ZooEntry, list_zoo
from fieldagents.task import get_task
from fieldmodels.files import write_text
from fieldmodels.yaml import load_yaml

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "leaderboard.md"
SEES = {
    "observation": "observation",
    "model": "observation, settings",
    "diagnosis": "observation, diagnosis",
    "privileged": "hidden values",
}
HEAD = """# Leaderboard

![How many agents each task has, by what they see](pictures/leaderboard.svg)

*Reference and learned agents on the published test seeds, the same for all; made by `make leaderboard`.*

Mean ± half the 95 % interval over episodes (of shares the interval itself; learned agents: over all training
runs first). **Bold**: the best that see no more than the observation. *Italics*: not competitors, for they
see hidden values or do not act. *Decision*: milliseconds of one core for a decision, played alone.
*Training*: environment steps and minutes (wall time, beside other work) of a run, from its card in
`agents/fieldagents/zoo/`, and how many runs; a link leads to its config. Each task's page says what the
numbers mean, and [Evaluation](evaluation.md) how agents are compared.

"""


def table(summary: dict[str, Any], second: str) -> str:
    """A task's section.

    Args:
        summary: What ``fieldgym evaluate`` has written.
        second: Metric beside the task's first; empty for none.
    """
    task, names = summary["task"], list(summary["scenarios"])
    metrics = [get_task(task).metrics[0], *(m for m in get_task(task).metrics if m.name == second)]
    zoo = {entry.name: entry for entry in list_zoo(task)}
    about = {one["name"]: one for one in describe_agents(task)}
    rows = {row["agent"]: row for row in summary["scenarios"][names[0]]}
    scores = {s: {row["agent"]: row["scores"] for row in rows} for s, rows in summary["scenarios"].items()}
    decides = metrics[-1]
    fair = [agent for agent, row in rows.items() if row["kind"] == "observation"]
    ranks = {agent: mean(_rank(scores[s], agent, decides) for s in names) for agent in rows}
    best = {s: min(fair, key=lambda agent, s=s: _rank(scores[s], agent, decides)) for s in names}
    label = ", ".join(f"{m.title} [{_unit(m)}]" if _unit(m) else m.title for m in metrics)
    lines = [
        f"## {task}\n",
        f"`fieldgym evaluate {task}/benchmark`: {label}; {summary['episodes']} episodes.\n",
        f"| agent | sees | {' | '.join(names)} | decision [ms] | training a run |",
        "|---|---|" + "---|" * (len(names) + 2),
    ]
    for agent in sorted(rows, key=ranks.__getitem__):
        row = rows[agent]
        estimator, sees = row["kind"].startswith("estimator"), row["kind"].removeprefix("estimator, ")
        outside = estimator or sees == "privileged"
        values = []
        for scenario in names:
            text = ", ".join(_value(scores[scenario][agent][m.name], m) for m in metrics)
            values.append(f"**{text}**" if best[scenario] == agent else f"*{text}*" if outside else text)
        name = f"[`{agent}`](#{task}-{agent})" if agent in zoo else f"`{agent}`"
        title = about[agent]["title"]
        right = SEES[sees] + (", does not act" if estimator else "")
        cells = [
            f"{name}: {title}",
            right,
            *values,
            _decision(summary, names, agent),
            _training(zoo.get(agent)),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |")
    configs = [_config(task, agent) for agent in rows if agent in zoo]
    note = [NOTES[task], ""] if task in NOTES else []
    return "\n".join([*lines, "", *note, *configs, ""])


HEADLINES = {
    "excitation": ("full_scale_wide", "error of parameters [%]"),
    "heel_strike": ("ar1", "error of the foot [mm]"),
    "line_following": ("oval", "distance [mm]"),
    "line_following_pixels": ("oval", "distance [mm]"),
    "pose_reaching": ("T3", "time over shortest path's"),
    "uav_route": ("one_radar", "length over lower bound"),
}
"""Task to the scenario of the README and its metric in short."""
NOTES = {
    "heel_strike": "On 200 seeds that nobody had used (from 88,000,000), against the regime filter: `ppo` "
    "ties with it (-0.3 % in `ar1`, -0.004 ± 0.010 mm; -0.9 % in `low_pass`, -0.004 ± 0.006 mm), and the "
    "recurrent `pathwise` is ahead in both (-5.1 %, -0.072 ± 0.009 mm; -9.5 %, -0.040 ± 0.006 mm).",
    "excitation": "`ppo` was trained for too few decisions, on the bits gained, and is worse than chance.",
}
"""What a table does not show."""
README = ROOT / "README.md"
BEGIN, END = "<!-- results: begin -->\n", "<!-- results: end -->"
LEARNERS = {"ppo": "PPO", "sac": "SAC", "AnnealedPPO": "PPO", "BranchingPPO": "PPO with trials in copies",
            "Evolution": "CMA-ES", "Pathwise": "exact gradient, LSTM"}  # fmt: skip


def headline(summary: dict[str, Any], second: str) -> str:
    """A task's row of the README."""
    task, (scenario, short) = summary["task"], HEADLINES[summary["task"]]
    metrics = get_task(task).metrics
    metric = next((m for m in metrics if m.name == second), metrics[0])
    zoo = {entry.name: entry for entry in list_zoo(task)}
    rows = {row["agent"]: row for row in summary["scenarios"][scenario]}
    scores = {agent: row["scores"] for agent, row in rows.items()}

    def best(agents: Sequence[str]) -> str:
        return min(agents, key=lambda agent: _rank(scores, agent, metric))

    def shown(agent: str) -> str:
        return f"{_value(scores[agent][metric.name], metric)} `{agent}`"

    classical = [a for a, row in rows.items() if a not in zoo and row["kind"] in ("observation", "model")]
    learned = best([a for a in rows if a in zoo])
    card = zoo[learned].trainings[0].card
    kind = "DAgger" if card["title"].startswith("DAgger") else LEARNERS[card["algorithm"].rpartition(":")[2]]
    bound = [a for a, row in rows.items() if row["kind"] == "privileged"]
    label = f"[{task}](docs/leaderboard.md#{task}), {short}"
    limit = shown(best(bound)) if bound else ""
    cells = [label, shown(summary["baseline"]), shown(best(classical)), f"{shown(learned)} ({kind})", limit]
    return "| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |\n"


def _rank(scores: dict[str, Any], agent: str, metric: Any) -> float:
    """Place among all in a scenario: who has no value for half of the episodes comes last."""

    def worth(name: str) -> float:
        score = scores[name][metric.name]
        if score["mean"] is None or score["share"] < 0.5:
            return float("inf")
        return float(score["mean"]) * (1.0 if metric.lower_is_better else -1.0)

    return float(sum(worth(other) < worth(agent) for other in scores))


def _unit(metric: Any) -> str:
    return {"m": "mm", "1": ""}.get(metric.unit, str(metric.unit))


def _value(score: dict[str, Any], metric: Any) -> str:
    """Mean and half the interval, to the latter's second digit."""
    if score["mean"] is None:
        return "–"
    factor = 1000.0 if metric.unit == "m" else 100.0 if metric.binary else 1.0
    low, high = score["ci95"] or (score["mean"], score["mean"])
    if metric.binary:  # its interval is not symmetric
        return f"{factor * score['mean']:.1f} ({factor * low:.1f} to {factor * high:.1f})"
    half = factor * (high - low) / 2.0
    digits = max(0, 1 - math.floor(math.log10(half))) if half > 0.0 else 3
    text = f"{factor * score['mean']:.{digits}f}" + (f" ± {half:.{digits}f}" if half > 0.0 else "")
    return text if score["share"] > 0.9995 else f"{text} (of {100 * score['share']:.1f} %)"


def _decision(summary: dict[str, Any], names: Sequence[str], agent: str) -> str:
    times = [summary["decision_ms"][scenario].get(agent) for scenario in names]
    alone = [one["alone"] for one in times if one]
    return f"{mean(alone):.2g}" if alone else ""


def _training(entry: ZooEntry | None) -> str:
    if entry is None:
        return ""
    runs = [run for training in entry.trainings for run in training.card["runs"]]
    steps, minutes = mean(run["steps"] for run in runs), mean(run["seconds"] for run in runs) / 60.0
    counted = f"{steps:,.0f} steps, " if steps else ""
    return f"{counted}{minutes:.1f} min ({len(runs)} runs)"


def _config(task: str, agent: str) -> str:
    """The config of a learned agent, one click away."""
    text = (ROOT / "configs" / task / f"{agent}.yaml").read_text(encoding="utf-8")
    name = f"configs/{task}/{agent}.yaml"
    code = f"<pre><code>{text.replace('&', '&amp;').replace('<', '&lt;')}</code></pre>"
    return f'<details id="{task}-{agent}"><summary>{name}</summary>\n{code}\n</details>'


def main(folder: Path) -> None:
    """Write the page, and the table of the README, from the results of ``fieldgym evaluate benchmark``."""
    members = load_yaml(ROOT / "configs" / "benchmark.yaml")["suite"]
    found = [json.loads(path.read_text(encoding="utf-8")) for path in folder.glob("*/summary.json")]
    summaries = {one["task"]: one for one in found}
    tasks = [
        (summaries[name.partition("/")[0]], (of or {}).get("metric", "")) for name, of in members.items()
    ]
    write_text(PAGE, HEAD + "\n".join(table(*one) for one in tasks))
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    rows = "| task, metric | reference | best classical | best learned | bound |\n|---|---|---|---|---|\n"
    rows += "".join(headline(*one) for one in tasks)
    write_text(README, f"{before}{BEGIN}{rows}{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
