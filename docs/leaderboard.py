"""Write the leaderboard, docs/leaderboard.md, one table a task, and the README's table.

make leaderboard
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import Any

from curves import seconds

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

![A panel a task: the mean of every agent with its interval, by what it sees](pictures/leaderboard.svg)

All agents on the same published test seeds (`make leaderboard`). Each task's page says what the numbers mean,
[Evaluation](evaluation.md) how agents are compared.

- **Value**: mean ± half the 95 % interval. "97.4 %, 1.85": the share of successes, and the mean over these.
- **Bold**: best of those that see the observation alone. *Italics*: no competitors, since they see hidden
  values or do not act.
- **Decision**: wall time for one robot.
- **Training**: algorithm, teacher, environment steps, processor seconds of a run (*by the clock*: wall time
  on a busy machine). `fieldgym train <task>/<agent>` repeats it.

"""


def table(summary: dict[str, Any], second: str, note: str | None) -> str:
    """A task's section.

    Args:
        summary: What ``fieldgym evaluate`` has written.
        second: Metric beside the task's first; empty for none.
        note: What the table does not show.
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
    shown = [name for name in names if name not in LEFT_OUT]
    lines = [
        f"## {task}\n",
        f"`fieldgym evaluate {task}/benchmark`: {label}; {summary['episodes']} episodes.\n",
        f"| agent | sees | {' | '.join(shown)} | decision [ms] | training a run |",
        "|---|---|" + "---|" * (len(shown) + 2),
    ]
    for agent in sorted(rows, key=ranks.__getitem__):
        row = rows[agent]
        estimator, sees = row["kind"].startswith("estimator"), row["kind"].removeprefix("estimator, ")
        outside = estimator or sees == "privileged"
        values = []
        for scenario in shown:
            text = _cell([scores[scenario][agent][m.name] for m in metrics], metrics)
            values.append(f"**{text}**" if best[scenario] == agent else f"*{text}*" if outside else text)
        title = "" if agent in zoo else f": {about[agent]['title']}"
        right = SEES[sees] + (", does not act" if estimator else "")
        cells = [
            f"`{agent}`{title}",
            right,
            *values,
            _decision(summary, names, agent),
            _training(zoo.get(agent), task),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |")
    return "\n".join([*lines, "", *([note, ""] if note else [])])


LEFT_OUT = {"straight_from_30_cm"}
"""Scenarios whose scores are those of another one, within their intervals."""
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
    "excitation": "`ppo` and `sac` tie with `relative_error`, a search of the model: [why](excitation.md).",
}
"""What a table does not show."""
COLUMNS = ("task, metric", "reference", "best classical", "best learned", "given hidden values")
VERDICTS = {"better": "better", "worse": "worse", "cannot tell": "a tie"}
README = ROOT / "README.md"
BEGIN, END = "<!-- results: begin -->\n", "<!-- results: end -->"
LEARNERS = {"ppo": "PPO", "sac": "SAC", "AnnealedPPO": "PPO", "BranchingPPO": "PPO from branches",
            "Pathwise": "exact gradient, LSTM"}  # fmt: skip


def headline(summary: dict[str, Any], member: dict[str, Any]) -> str:
    """A task's row of the README."""
    task, (scenario, short) = summary["task"], HEADLINES[summary["task"]]
    metrics = get_task(task).metrics
    metric = next((m for m in metrics if m.name == member.get("metric")), metrics[0])
    zoo = {entry.name: entry for entry in list_zoo(task)}
    rows = {row["agent"]: row for row in summary["scenarios"][scenario]}
    scores = {agent: row["scores"] for agent, row in rows.items()}

    def best(agents: Sequence[str]) -> str:
        return min(agents, key=lambda agent: _rank(scores, agent, metric))

    def shown(agent: str) -> str:
        mark = "†" if rows[agent]["kind"] == "model" else ""
        return f"{_value(scores[agent][metric.name], metric)} `{agent}`{mark}"

    classical = [a for a, row in rows.items() if a not in zoo and row["kind"] in ("observation", "model")]
    learned = best([a for a in rows if a in zoo])
    knowing = [a for a, row in rows.items() if row["kind"] == "privileged"]
    cells = [
        f"[{task}](docs/leaderboard.md#{task}) `{scenario}`, {short}",
        shown(member.get("reference") or summary["baseline"]),
        shown(best(classical)),
        f"{shown(learned)} ({learned_by(zoo[learned], task)})",
        shown(best(knowing)) if knowing else "",
    ]
    return "| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |\n"


def learned_by(entry: ZooEntry, task: str) -> str:
    """Algorithm of a learned agent, and whom it learned from with what that one sees."""
    card = entry.trainings[0].card
    config, about = card["config"], {one["name"]: one["sees"] for one in describe_agents(task)}
    algorithm = LEARNERS[card["algorithm"].rpartition(":")[2]]
    if imitate := config.get("imitate"):
        own = f", then {algorithm}" if card["runs"][0]["steps"] else ""
        return f"DAgger, teacher `{imitate['teacher']}`: {SEES[about[imitate['teacher']]]}{own}"
    return f"{algorithm}, from `{config['begin']}`" if config.get("begin") else algorithm


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


def _cell(found: Sequence[dict[str, Any]], metrics: Sequence[Any]) -> str:
    """All metrics of a scenario; a share goes without its interval, and the next is a mean over these."""
    if not metrics[0].binary:
        return ", ".join(map(_value, found, metrics))
    share, *others = (_value(*one).partition(" (")[0] for one in zip(found, metrics, strict=True))
    return ", ".join([f"{share} %", *others])


def _decision(summary: dict[str, Any], names: Sequence[str], agent: str) -> str:
    times = [summary["decision_ms"][scenario].get(agent) for scenario in names]
    alone = [one["alone"] for one in times if one]
    return f"{float(f'{mean(alone):.2g}'):g}" if alone else ""


def _training(entry: ZooEntry | None, task: str) -> str:
    """Algorithm and teacher, steps and time of a run, and the runs for each scenario that was trained for."""
    if entry is None:
        return ""
    cards = [training.card for training in entry.trainings]
    steps, config = cards[0]["runs"][0]["steps"], cards[0]["config"]
    parts = [learned_by(entry, task)] + ([f"{steps:,} steps"] if steps else [])
    if imitate := config.get("imitate"):
        count = imitate["rounds"] * imitate["steps"] * config["num_envs"]
        parts.append(f"{count:,} steps of imitation")
    spent, clock = zip(*map(seconds, entry.trainings), strict=True)
    took = f"{mean(spent):.0f} s" + " by the clock" * ("clock" in clock)
    runs = " + ".join(str(len(card["runs"])) for card in cards)
    return f"{', '.join([*parts, took])} ({runs} runs)"


def fresh(summary: dict[str, Any]) -> str:
    """How learned agents compare with the baseline on seeds that nobody had used."""
    found = []
    for agent in (row["agent"] for row in next(iter(summary["scenarios"].values()))):
        for scenario, rows in summary["scenarios"].items():
            paired = next(row["against_baseline"] for row in rows if row["agent"] == agent)
            if paired:
                low, high = paired["ci95"]
                found.append(
                    f"`{agent}` {paired['difference']:+.3f} ± {(high - low) / 2:.3f} mm in `{scenario}` "
                    f"({paired['percent']:+.1f} %, {VERDICTS[paired['verdict']]})"
                )
    first, count = summary["first_seed"], summary["episodes"]
    return (
        f"On {count} unused seeds (from {first:,}), paired with `{summary['baseline']}`: {', '.join(found)}."
    )


def main(folder: Path) -> None:
    """Write the page and the README's table from what ``make leaderboard`` has evaluated into a folder."""
    members = load_yaml(ROOT / "configs" / "benchmark.yaml")["suite"]
    tasks = [(_read(folder / name.partition("/")[0]), of or {}) for name, of in members.items()]
    notes = NOTES | {"heel_strike": fresh(_read(folder / "fresh"))}
    sections = [table(one, of.get("metric", ""), notes.get(one["task"])) for one, of in tasks]
    write_text(PAGE, HEAD + "\n".join(sections))
    before, rest = README.read_text(encoding="utf-8").split(BEGIN)
    rows = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"
    rows += "".join(headline(*one) for one in tasks)
    write_text(README, f"{before}{BEGIN}{rows}{END}{rest.split(END)[1]}")


def _read(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]))
