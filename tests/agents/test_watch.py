"""Watching an agent: the very episode that the evaluation scores, in a window or as a film."""

import json
import os
import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from fieldagents import watch as room
from fieldagents.agent import Agent
from fieldagents.cli import app
from fieldagents.config import ConfigError, EnvironmentConfig, environment_of
from fieldagents.evaluation.agents import AgentRuns, make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.operator import Operator
from fieldagents.watch import WatchError, watch
from fieldgym.film import FilmError
from fieldgym.line_following import LineFollowingEnv

SHORT = EnvironmentConfig(settings={"strides": 1})


def run(*arguments: object):
    return CliRunner().invoke(app, ["watch", *map(str, arguments)])


@pytest.mark.every("agent", ["oracle_gains", "ppo"])
def test_a_film_shows_the_episode_that_is_scored(tmp_path, agent):
    seen = watch("heel_strike", agent, SHORT, seed=5, film=tmp_path / "walk.gif")
    scored = run_episodes(
        make_agent(agent, "heel_strike", SHORT.settings).runs[0], "heel_strike", SHORT, range(5, 6)
    )
    assert (seen.steps, seen.finished) == (1, True)
    assert seen.episode_return == pytest.approx(scored["return"].item(), rel=1e-12)
    with Image.open(tmp_path / "walk.gif") as film:
        assert film.size == (960, 540)
        assert 7 < film.n_frames < 14  # a stride of about a second, ten pictures a second
        first = np.asarray(film.convert("RGB"))
        film.seek(film.n_frames - 1)
        assert (first != np.asarray(film.convert("RGB"))).any()


def test_a_film_is_no_longer_than_asked_for(tmp_path):
    seen = watch("heel_strike", None, EnvironmentConfig(), film=tmp_path / "walk.webp", seconds=0.6)
    assert seen.agent == "sensor_only"  # the first in the table that acts
    assert not seen.finished
    with Image.open(tmp_path / "walk.webp") as film:
        assert film.n_frames == 6


def test_without_a_name_the_agent_is_watched_that_the_task_shows(tmp_path):
    """Straight flight, first in the table, is seen by a radar and ends after one step."""
    seen = watch("uav_route", None, EnvironmentConfig(), film=tmp_path / "flight.webp", seconds=0.3)
    assert seen.agent == "receding"
    assert seen.steps > 1 or not seen.finished


def test_a_window_can_be_closed_at_any_time(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    asked = iter([True])
    monkeypatch.setattr(room, "_closed", lambda: next(asked))
    seen = watch("heel_strike", "gated_tuned", EnvironmentConfig())
    assert (seen.steps, seen.finished) == (1, False)


def test_what_an_agent_sketches_is_shown(monkeypatch, tmp_path):
    from fieldgym.heel_strike import HeelStrikeEnv

    class Sketcher(Agent):
        name = "sketcher"

        def act(self, observation, info):
            return np.zeros((1, 3), dtype=np.float32)

        def sketch(self):
            return {"chosen": 7}

    shown = []
    monkeypatch.setattr(HeelStrikeEnv, "show", lambda self, chosen: shown.append(chosen), raising=False)
    monkeypatch.setattr(room, "make_agent", lambda *_: AgentRuns("sketcher", (Sketcher(),)))
    watch("heel_strike", "ppo", SHORT, film=tmp_path / "walk.gif")
    assert shown == [7]


def test_the_command_prints_what_was_seen(tmp_path):
    done = run(
        "heel_strike", "--set", "settings.strides=1", "--out", tmp_path / "w.gif", "--seed", 3, "--json"
    )
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert (result["agent"], result["seed"], result["steps"], result["finished"]) == (
        "sensor_only",
        3,
        1,
        True,
    )
    assert (tmp_path / "w.gif").stat().st_size > 10_000


@pytest.mark.every(
    ("agent", "film", "message"),
    [
        ("gated_tuned", "walk.avi", r"walk\.avi: a film ends in \.gif, \.webp or \.mp4"),
        ("imm", "walk.gif", "imm is an estimator and does not act; watch one of sensor_only"),
        ("gated", "walk.gif", "no agent 'gated' .did you mean 'gated_tuned'"),
    ],
)
def test_what_cannot_be_watched_is_said(tmp_path, agent, film, message):
    with pytest.raises((WatchError, FilmError), match=message):
        watch("heel_strike", agent, SHORT, film=tmp_path / film)
    assert not list(tmp_path.iterdir())


def test_mistakes_in_settings_name_what_was_typed():
    with pytest.raises(ConfigError, match=r"--set settings.stride=5: settings.stride: unknown key"):
        environment_of("heel_strike", ["settings.stride=5"])
    with pytest.raises(ConfigError, match="no task 'heel' "):
        environment_of("heel")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a screen cannot be hidden")
def test_a_machine_without_a_screen_is_told_what_to_do():
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    command = [sys.executable, "-c", "from fieldagents.cli import main; main()", "watch", "heel_strike"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2
    assert "\nError: no window can be opened here" in "\n" + done.stderr
    assert "--out film.gif" in done.stderr


def test_an_operator_takes_over_by_keyboard(monkeypatch):
    """Section 3.5.2: the switch decides who steers, the joystick's place is the turn."""
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(room, "_closed", lambda: False)
    held = defaultdict(bool)
    strides = iter(range(100))

    def keys(kind):
        assert kind == pygame.KEYDOWN
        stride = next(strides)
        held[pygame.K_LEFT] = stride >= 2
        return [pygame.event.Event(pygame.KEYDOWN, key=pygame.K_s)] if stride in (2, 5) else []

    commands = []
    step = LineFollowingEnv.step

    def watched_step(self, action):
        commands.append(float(action[0]))
        return step(self, action)

    monkeypatch.setattr(pygame.event, "get", keys)
    monkeypatch.setattr(pygame.key, "get_pressed", lambda: held)
    monkeypatch.setattr(LineFollowingEnv, "step", watched_step)
    settings = {"strides": 8, "track": "straight"}
    watch("line_following", "pure_pursuit", EnvironmentConfig(settings=settings), seed=3)
    assert commands[2:5] == [0.25, 0.5, 0.75]  # the operator pushes the joystick to the left
    assert commands[5] not in (0.25, 0.5, 0.75, 1.0)  # the robot steers again at once


@pytest.mark.every("agent", ["tuned", "lqg"])
def test_agents_know_what_the_operator_did(monkeypatch, agent):
    """On images an agent keeps its own account of commands; after a take-over it is the true one."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(room, "_closed", lambda: False)
    monkeypatch.setattr(Operator, "read_keys", lambda self: self.move(1))
    monkeypatch.setattr(room, "Operator", lambda: Operator(steering=True))
    settings = {"strides": 5, "track": "straight"}
    kept = []
    make = room.make_agent

    def keep(*arguments):
        kept.append(make(*arguments))
        return kept[-1]

    monkeypatch.setattr(room, "make_agent", keep)
    watch("line_following_pixels", agent, EnvironmentConfig(settings=settings), seed=3)
    own = kept[0].runs[0]
    assert np.allclose(own._board._seen[0, 4:8], [1.0, 1.0, 0.75, 0.5])
    if agent == "lqg":
        assert np.isclose(own._mean[0, 4], own.limit)
        assert own._mean[0, 1] > 0.3  # turned left by 0.25 + 0.5 + 0.75 + 1 + 1 of the limit


def test_the_joystick_springs_back_and_the_switch_centres_it():
    operator = Operator()
    own = np.array([0.3], dtype=np.float32)
    operator.move(1)
    assert operator.action(own) == own  # without the switch the joystick does nothing
    operator.switch()
    for direction in (-1, -1, -1, -1, -1, 0):
        operator.move(direction)
    assert operator.action(own) == -0.75
    operator.switch()
    assert (operator.steering, operator.joystick) == (False, 0.0)
