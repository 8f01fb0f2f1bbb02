"""`fieldgym watch`: an agent of the table at work, in a window or as a film."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent, checked_actions, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import agent_names, keep_drives, known_agent, make_agent
from fieldagents.operator import Operator
from fieldagents.progress import Report
from fieldagents.task import Drives, get_task
from fieldgym import find_task
from fieldgym.film import check_ending, write_film
from fieldgym.foreign import ForeignTask

SLICES = 10
"""Pictures a second of a film whose steps are long enough to be drawn in slices."""

Frame = NDArray[np.uint8]


class WatchError(ValueError):
    """What cannot be watched, or not on this machine."""


@dataclass(frozen=True)
class Watched:
    """An episode that was watched.

    Attributes:
        agent: Who acted.
        seed: Seed of the episode.
        steps: Its steps.
        episode_return: Sum of its rewards.
        finished: Whether it came to its end (a film ends earlier where it is long enough).
        kept: What became of the drive that was to be kept, in words; empty if none was.
    """

    agent: str
    seed: int
    steps: int
    episode_return: float
    finished: bool
    kept: str = ""


def watch(
    task: str,
    agent: str | None,
    environment: EnvironmentConfig,
    *,
    seed: int = 0,
    film: Path | None = None,
    seconds: float = 20.0,
    save: Path | None = None,
    trust_pickle: bool = False,
    progress: Report = lambda _stage, _part: None,
) -> Watched:
    """Let an agent play one episode where it can be seen.

    In a window, a task that has an operator can be taken over by keyboard or gamepad; see ``Operator``.

    Args:
        task: Name of the task.
        agent: Its name as ``fieldgym list`` has it, or another that ``make_agent`` knows; None takes the
            first of ``watchable``.
        environment: Settings and reality.
        seed: Seed of the episode.
        film: Write a film to this file, by its ending, instead of opening a window.
        seconds: Longest film [s].
        save: Add the drive to this file of drives, from which an agent learns; in a window the operator then
            steers from the beginning.
        trust_pickle: See ``make_agent``.
        progress: Called with what is being done and the part of the film that is done.

    Raises:
        WatchError: If there is no such agent, it does not act, or there is no screen.
        FilmError: If no such film can be written.
        AgentError: If no agent of the task learns from drives.
        RecordingError: If the file of drives cannot be added to.
    """
    acting = watchable(task)
    if agent is None and not acting:
        raise WatchError(f"task {task!r} has no agent that acts; name a policy file: --agent policy.onnx")
    name = agent or acting[0]
    if name not in acting:
        if name in agent_names(task):
            raise WatchError(f"{name} is an estimator and does not act; watch one of {', '.join(acting)}")
        if problem := known_agent(name, task):
            raise WatchError(problem)
    if film is not None:
        check_ending(film)
    if film is None:
        _check_screen()
    actor = make_agent(name, task, environment.settings, trust_pickle).runs[0]
    env = _environment(task, actor, environment, "human" if film is None else "rgb_array")
    actor.fits(env.observation_space, env.action_space)
    drives = None if save is None else keep_drives(task, save, environment.settings)
    operator = Operator() if film is None and find_task(task).operator else None
    if operator is not None and drives is not None:
        operator.switch()
    episode = Episode(task, env, actor, seed, operator, drives)
    try:
        if film is None:
            if operator is not None:
                operator.find_gamepad()
            progress(f"{task}: {name}", 0.0)
            for _ in episode.steps():
                if _closed():
                    break
        else:
            rate = SLICES if hasattr(env, "step_frames") else float(env.metadata.get("render_fps", 30))
            most = max(1, round(seconds * rate))
            frames = islice(_frames(episode, rate), most)
            write_film(film, frames, rate, lambda n: progress(f"{task}: {name}", n / most))
    finally:
        env.close()
    kept = "" if drives is None else drives.add(episode.rows)
    return Watched(name, seed, episode.count, episode.total, episode.over, kept)


class Episode:
    """An agent of the batch interface in a single environment."""

    def __init__(
        self,
        task: str,
        env: Any,
        agent: Agent,
        seed: int,
        operator: Operator | None = None,
        drives: Drives | None = None,
    ) -> None:
        self._task, self.env, self._agent, self._seed, self._operator = task, env, agent, seed, operator
        self._drives = drives
        self.rows: list[Mapping[str, float]] = []
        self.count, self.total, self.over = 0, 0.0, False

    def steps(self) -> Iterator[None]:
        """Play; what there is to draw can be drawn after each step."""
        agent, env = self._agent, self.env
        agent.reset(self._seed)
        observation, info = env.reset(seed=self._seed)
        agent.begin_episodes(np.ones(1, dtype=np.bool_))
        while not self.over:
            seen = visible(_batch(info), agent.sees, self._task)
            given = agent.act(np.asarray(observation)[None], seen)
            action = checked_actions(given, agent.name, 1, env.action_space)[0]
            shown = dict(agent.sketch() or {})
            if (operator := self._operator) is not None:
                operator.read_keys()
                if operator.steering:
                    action = get_task(self._task).steer(operator, action)
                    agent.overruled(action[None])
                shown |= {"steering": operator.steering, "joystick": operator.joystick}
            if shown and hasattr(env, "show"):
                env.show(**shown)
            before = info
            observation, reward, terminated, truncated, info = env.step(action)
            self.count, self.total = self.count + 1, self.total + float(reward)
            self.over = terminated or truncated
            if self._drives is not None:
                self.rows.append(self._drives.row(before, action))
                if self.over:
                    self.rows.append(self._drives.row(info, action))
            yield


def _environment(task: str, actor: Agent, environment: EnvironmentConfig, mode: str) -> Any:
    """The environment to be watched; one of the package's own ends by itself and needs no wrapper.

    Raises:
        WatchError: If it cannot be drawn in this way.
    """
    settings = {"settings": {**environment.settings, **actor.settings}}
    options = {"render_mode": mode, "disable_env_checker": True, **environment.options, **settings}
    env = find_task(task).make(**options)
    if isinstance(find_task(task), ForeignTask) or environment.wrappers:
        known = env.metadata.get("render_modes") or ()
        if mode not in known:
            env.close()
            raise WatchError(
                f"{task} cannot be drawn as {mode!r}; it knows {', '.join(known) or 'no picture'}"
            )
        return env
    return env.unwrapped


def _frames(episode: Episode, rate: float) -> Iterator[Frame]:
    """Pictures of an episode: slices of each step where the environment draws them, else one a step."""
    env = episode.env
    for _ in episode.steps():
        if hasattr(env, "step_frames"):
            yield from env.step_frames(rate)
        else:
            yield env.render()


def _batch(info: Mapping[str, Any]) -> dict[str, Any]:
    """The info of a batch of one from that of a single environment."""
    return {
        key: _batch(value) if isinstance(value, Mapping) else np.asarray(value)[None]
        for key, value in info.items()
    }


def watchable(task: str) -> list[str]:
    """Names of the task's agents that act, first the one that the task shows."""
    known = get_task(task)
    agents = known.agents
    acting = [name for name in agent_names(task) if name not in agents or not agents[name].estimator]
    return sorted(acting, key=lambda name: name != known.picture)


def _check_screen() -> None:
    """Raise unless a window can be seen, or the user has chosen a driver."""
    if os.environ.get("SDL_VIDEODRIVER"):
        return
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

    try:
        pygame.display.init()
        driver = pygame.display.get_driver()
    except pygame.error as error:
        driver = str(error)
    if driver not in ("x11", "wayland", "windows", "cocoa"):
        raise WatchError(f"no window can be opened here ({driver}): write a film with --out film.gif instead")


def _closed() -> bool:
    """Whether the window has been closed."""
    import pygame

    return bool(pygame.event.get(pygame.QUIT))
