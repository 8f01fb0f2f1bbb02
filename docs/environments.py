"""Write the page and the film of every environment.

    python docs/environments.py [TASK...]

A page is the class docstring of the environment, followed by its settings and where stock effects act.
"""

from __future__ import annotations

import inspect
import re
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from fieldagents.evaluation.agents import make_agent
from fieldagents.watch import Episode, watchable
from fieldgym import TASKS, Task
from fieldmodels.files import replacing, write_text
from fieldmodels.registry import get_model
from fieldmodels.settings import declared

FOLDER = Path(__file__).parent / "environments"
MOST_STEPS, FRAMES, SIZE = 160, 48, (640, 360)


def page(task: Task) -> str:
    """The Markdown page of one task."""
    environment = gym.make(task.env_id).unwrapped
    text = inspect.cleandoc(environment.__doc__ or "")
    return (
        f"# {task.title}\n\n`{task.env_id}`\n\n![The task while it runs]({task.name}.webp)\n\n{text}\n\n"
        f"## Settings\n\n{settings(task)}\n\n## Stock effects\n\n{stock_effects(task)}\n"
    )


def settings(task: Task) -> str:
    """The settings of a task as a table, or a link to the table of a task that has the same."""
    first = next(other for other in TASKS.values() if other.settings is task.settings)
    if first is not task:
        return f"Those of [{first.title}]({first.name}.md#settings)."
    rows = "\n".join(f"| `{n}` | {d} | {m} |" for n, d, m in settings_of(task.settings))
    return (
        f"`{task.settings.__name__}`; *fixed* ones are never random.\n\n"
        f"| Setting | Default, range | Meaning |\n|---|---|---|\n{rows}"
    )


def stock_effects(task: Task) -> str:
    """Where stock effects can act on a task, as it declares."""
    channels, parameters = task.channels, get_model(task.model).parameters
    names = {
        "commands": channels.commands,
        "sensors": tuple(dict.fromkeys(channels.observed)),
        "parameters": tuple(p.name for p in parameters),
    }
    listed = "\n".join(
        f"- {title}: {', '.join(f'`{n}`' for n in own)}" for title, own in names.items() if own
    )
    text = f"A `reality` may name [stock effects](../realities.md) of\n\n{listed}\n"
    if channels.prompt:
        prompt = ", ".join(f"`{n}`" for n in channels.prompt)
        text += f"\nEffects with dynamics (lag, delay, rate limit) cannot act on {prompt}.\n"
    if not (channels.commands and channels.observed):
        text += f"\nThere are no others: {channels.without}.\n"
    return text.rstrip()


def interval(bounds: str) -> str:
    """Bounds in words as an interval: "greater than 0, at most 10" as "(0, 10]"."""
    found = re.fullmatch(r"(at least|greater than) (\S+), (at most|less than) (\S+)", bounds)
    if found:
        low, least, high, most = found.groups()
        return f"{'[' if low == 'at least' else '('}{least}, {most}{']' if high == 'at most' else ')'}"
    for words, symbol in {"at least": "≥", "greater than": ">", "at most": "≤", "less than": "<"}.items():
        bounds = bounds.replace(words, symbol)
    return bounds


def settings_of(kind: type[Any]) -> list[tuple[str, str, str]]:
    """Name, default with its range, and meaning of every setting, as declared."""
    rows = []
    for name, one in declared(kind).items():
        default = round(one.default, 4) if isinstance(one.default, float) else one.default
        unit, fixed = one.setting.unit, one.setting.fixed
        meaning = f"{one.setting.meaning[:-1]} [{unit}]." if unit else one.setting.meaning
        named = one.choices and all(f"`{choice}`" in meaning for choice in one.choices)
        bounds = "" if named else interval(one.range())
        stated = ", ".join(filter(None, (f"`{default}`", bounds)))
        rows.append((name, stated, f"{meaning} *Fixed.*" if fixed else meaning))
    return rows


def film(task: Task, path: Path) -> None:
    """Film a reference agent at work, small enough for a page."""
    env = task.make(render_mode="rgb_array", disable_env_checker=True).unwrapped
    name = watchable(task.name)[0]
    episode = Episode(task.name, env, make_agent(name, task.name, {}).runs[0], seed=3)
    frames = [env.render() for _ in islice(episode.steps(), MOST_STEPS)]
    chosen = np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))
    small = [Image.fromarray(frames[i]).resize(SIZE, Image.Resampling.LANCZOS) for i in chosen]
    pace = 90 if len(small) > 20 else 1000  # milliseconds; few steps are long ones, each to be read
    with replacing(path) as temporary:
        small[0].save(
            temporary, save_all=True, append_images=small[1:], duration=pace, loop=0, quality=40, method=6
        )


def main() -> None:
    """Write the pages and films of the tasks that are named, or of all."""
    for task in TASKS.values():
        if len(sys.argv) > 1 and task.name not in sys.argv[1:]:
            continue
        write_text(FOLDER / f"{task.name}.md", page(task))
        film(task, FOLDER / f"{task.name}.webp")
        print(FOLDER / f"{task.name}.md")


if __name__ == "__main__":
    main()
