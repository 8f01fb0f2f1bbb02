"""Put finished training runs into the zoo: ``python -m fieldagents.learned.publish RUN... --name ppo ...``.

The runs differ in their training seed alone; every one is published and scored, none is picked.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer

from fieldagents.config import load_config
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.conditioning import as_trained
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.policy import OnnxAgent
from fieldagents.policies.zoo import ZOO, ZooError
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldmodels.files import write_bytes, write_text

EPISODES = 50


def publish(
    runs: Sequence[Path],
    name: str,
    scenario: str,
    title: str,
    zoo: Path = ZOO,
    episodes: int = EPISODES,
    asks: Sequence[str] = (),
) -> Path:
    """Put runs into the zoo and score each of its policies on the published test seeds.

    The curve there holds the validated rows of every run's curve.

    Args:
        runs: Folders of finished runs of one config, each with its own training seed.
        name: Name of the entry.
        scenario: Name of the scenario that the runs were trained in.
        title: One line that says what it is.
        zoo: The zoo's folder.
        episodes: Test episodes for each policy.
        asks: Settings of its training that it has in any scenario, such as how much is observed.

    Returns:
        The folder in the zoo.

    Raises:
        ZooError: If a run is unfinished, the runs differ in more than their seed, or a setting that is asked
            for is none of theirs.
    """
    configs = [_finished_config(run) for run in runs]
    common = [config.model_dump(mode="json", exclude={"seed"}) for config in configs]
    if any(one != common[0] for one in common):
        raise ZooError("the runs of an entry may differ in their seed alone; these differ in other keys")
    if len({config.seed for config in configs}) < len(configs):
        raise ZooError("two runs have the same training seed")
    if unknown := set(asks) - set(configs[0].environment.settings):
        raise ZooError(f"asked for, but no setting of the training: {', '.join(sorted(unknown))}")
    folder = zoo / configs[0].task / name / scenario
    cards, curves = [], []
    for run, config in sorted(zip(runs, configs, strict=True), key=lambda pair: pair[1].seed):
        policy = f"policy_seed{config.seed}.onnx"
        data = (run / "policy.onnx").read_bytes()
        write_bytes(folder / policy, data)
        made = {"seed": config.seed, "policy": policy, "sha256": hashlib.sha256(data).hexdigest()}
        scores = score(OnnxAgent(folder / policy), config, episodes)
        cards.append({**made, **_read_json(run / "run.json"), "test_scores": scores})
        curve = pd.read_csv(run / "curve.csv", dtype=str, keep_default_na=False)  # digits as they are
        curve.insert(0, "seed", str(config.seed))
        curves.append(curve[curve["validation_return"] != ""])
    card = {
        "schema": 1,
        "title": title,
        "task": configs[0].task,
        "algorithm": configs[0].algorithm,
        "config": common[0],
        "versions": _read_json(runs[0] / "versions.json"),
        "test_seeds": [TEST_SEEDS.start, TEST_SEEDS.start + episodes],
        "runs": cards,
        **({"asks": list(asks)} if asks else {}),
    }
    write_text(folder / "curve.csv", pd.concat(curves).to_csv(index=False, lineterminator="\n"))
    write_text(folder / "card.json", json.dumps(card, indent=2, allow_nan=False) + "\n")
    return folder


def score(agent: OnnxAgent, config: TrainConfig, episodes: int = EPISODES) -> dict[str, float | None]:
    """Mean return and metrics of a policy over the first published test seeds; None without any value."""
    result = run_episodes(as_trained(agent), config.task, config.environment, TEST_SEEDS[:episodes])
    names = ["return", *(metric.name for metric in get_task(config.task).metrics)]
    means = {name: float(result[name].mean()) for name in names}
    return {name: None if math.isnan(mean) else mean for name, mean in means.items()}


def _finished_config(run: Path) -> TrainConfig:
    if not (run / "run.json").is_file():
        raise ZooError(f"{run}: not the folder of a finished run (it has no run.json)")
    return load_config(run / "config.yaml", TrainConfig)


def _read_json(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _main(
    runs: Annotated[list[Path], typer.Argument(help="Folders of finished runs.")],
    name: Annotated[str, typer.Option(help="Name of the entry.")],
    scenario: Annotated[str, typer.Option(help="Name of the scenario they were trained in.")],
    title: Annotated[str, typer.Option(help="One line that says what it is.")],
    ask: Annotated[list[str], typer.Option(help="A setting that it has in any scenario.")] = [],  # noqa: B006
) -> None:
    print(publish(runs, name, scenario, title, asks=ask))


if __name__ == "__main__":
    typer.run(_main)
