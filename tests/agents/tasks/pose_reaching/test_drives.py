"""Paths taught by a human: keys and gamepad, the file of drives, and the agent that learns from it."""

from collections import defaultdict
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from fieldagents import watch as room
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import AgentError, known_agent, make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.operator import Operator
from fieldagents.seeds import TEST_SEEDS
from fieldagents.tasks.pose_reaching.drives import RecordedDrives
from fieldagents.tasks.pose_reaching.path_memory.teachers import starts_facing
from fieldagents.tasks.pose_reaching.task import steer
from fieldagents.watch import watch
from fieldgym.pose_reaching import PoseReachingEnv
from fieldmodels.recording import RecordingError
from papers.pose_reaching.pilot import Pilot, drive_by_keys

TASK = "pose_reaching"
TEACHING = {"success": "loose", "timeout": 30.0}


@pytest.fixture(scope="module")
def taught(tmp_path_factory):
    """Nine drives by arrow keys, from the right half, facing the ball."""
    path = tmp_path_factory.mktemp("drives") / "drives.csv"
    drives, env = RecordedDrives(path, {}), PoseReachingEnv(TEACHING)
    for start in starts_facing(9):
        drive_by_keys(env, drives, start)
    return path


def test_nine_drives_by_keyboard_teach_the_way_from_anywhere(taught):
    agent = make_agent(str(taught), TASK, {}).runs[0]
    assert "9 recorded drives" in agent.title
    played = run_episodes(agent, TASK, EnvironmentConfig(), TEST_SEEDS[:100])
    assert played["success"].mean() > 0.97


def test_a_memory_holds_what_the_drives_did(taught):
    """Each remembered command, driven for a tick from its pose, ends at the drive's next pose."""
    table = pd.read_csv(taught)
    states = RecordedDrives(taught, {}).states()
    last = table.groupby("episode").size().to_numpy()
    assert len(states) <= (last - 1).sum()
    env = PoseReachingEnv()
    for i in range(0, len(states), 37):
        env.reset(seed=0, options={"pose": states.poses[i]})
        action = np.array([2 * states.speed[i] - 1, states.rate[i] / 4], dtype=np.float32)
        _, _, arrived, _, info = env.step(action)
        away = np.abs(table[["x", "y", "heading"]].to_numpy() - states.poses[i]).sum(axis=1)
        row = np.flatnonzero(away < 1e-12)[-1]  # the robot may have stood here before
        if not arrived:
            np.testing.assert_allclose(info["pose"][:2], table[["x", "y"]].to_numpy()[row + 1], atol=1e-5)


def test_a_drive_in_the_window_is_kept_and_drives(monkeypatch, tmp_path):
    """From pygame's keys to an agent: what a user does."""
    import pygame

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr(room, "_closed", lambda: False)
    seen, pilot = [], Pilot()
    reset, step = PoseReachingEnv.reset, PoseReachingEnv.step
    monkeypatch.setattr(PoseReachingEnv, "reset", lambda self, **kw: seen.append(r := reset(self, **kw)) or r)
    monkeypatch.setattr(PoseReachingEnv, "step", lambda self, a: seen.append(r := step(self, a)) or r)
    operators = []
    monkeypatch.setattr(room, "Operator", lambda: operators.append(Operator()) or operators[-1])

    def pressed():
        left, ahead = pilot.keys(seen[-1][-1]["pose"], operators[-1], 1.0, 4.0)
        keys = {pygame.K_LEFT: left > 0, pygame.K_RIGHT: left < 0}
        return defaultdict(bool, keys | {pygame.K_UP: ahead > 0, pygame.K_DOWN: ahead < 0})

    monkeypatch.setattr(pygame.time, "Clock", lambda: SimpleNamespace(tick=lambda _: 0))
    monkeypatch.setattr(pygame.event, "get", lambda kind: [])
    monkeypatch.setattr(pygame.key, "get_pressed", pressed)
    path = tmp_path / "drives.csv"
    settings = EnvironmentConfig(settings={**TEACHING, "starts": "T1"})
    for number, seed in enumerate((4, 8), start=1):
        pilot = Pilot()
        kept = watch(TASK, "path_memory", settings, seed=seed, save=path)
        assert kept.kept == f"{path}: {number} drives"
    table = pd.read_csv(path)
    assert list(table.columns) == ["t", "episode", "speed", "turn_rate", "x", "y", "heading"]
    assert set(np.round(table["speed"] % 0.25, 6)) == {0.0}  # the stick moves by quarters
    assert watch(TASK, str(path), EnvironmentConfig(), film=tmp_path / "drive.gif", seconds=1.0).steps == 10


def test_a_drive_that_does_not_arrive_is_not_kept(tmp_path):
    path = tmp_path / "drives.csv"
    late = EnvironmentConfig(settings={"timeout": 0.5})
    watched = watch(TASK, "graceful", late, film=tmp_path / "a.gif", save=path)
    assert watched.kept == "not kept: the drive did not arrive"
    assert not path.exists()


def test_a_gamepad_moves_the_stick(monkeypatch):
    import pygame

    events = {
        pygame.KEYDOWN: [],
        pygame.JOYBUTTONDOWN: [SimpleNamespace(button=0), SimpleNamespace(button=3)],
    }
    monkeypatch.setattr(pygame.event, "get", lambda kind: events[kind])
    axes = [-0.5, -1.0, 0.05]
    operator = Operator(gamepad=SimpleNamespace(get_axis=axes.__getitem__))
    operator.read_keys()
    assert (operator.steering, operator.joystick, operator.ahead, operator.turn) == (True, 0.5, 1.0, 0.0)
    own = np.zeros(2, dtype=np.float32)
    assert steer(operator, own).tolist() == [1.0, 0.5]
    operator.ahead = -1.0
    assert steer(operator, own).tolist() == [-1.0, 0.5]  # a unicycle stops
    assert steer(operator, np.zeros(3, dtype=np.float32)).tolist() == [-1.0, 0.0, 0.5]


def test_drives_that_cannot_teach_are_refused(taught, tmp_path):
    with pytest.raises(
        RecordingError, match=r"does not divide the tick of 0\.25 s; set settings\.tick: 0\.1"
    ):
        make_agent(str(taught), TASK, {"tick": 0.25})
    table = pd.read_csv(taught)
    far = tmp_path / "far.csv"
    table.assign(x=table["x"] + 1.0).to_csv(far, index=False)
    with pytest.raises(RecordingError, match="none of 9 drives moves and arrives"):
        make_agent(str(far), TASK, {})
    blind = tmp_path / "blind.csv"
    table.drop(columns="heading").to_csv(blind, index=False)
    with pytest.raises(RecordingError, match="heading is missing"):
        make_agent(str(blind), TASK, {})
    assert "learns from recorded drives" in known_agent(str(taught), "uav_route")
    assert "no such file" in known_agent(str(tmp_path / "none.csv"), TASK)
    with pytest.raises(AgentError, match="no agent that learns"):
        watch("heel_strike", None, EnvironmentConfig(), film=tmp_path / "w.gif", save=tmp_path / "d.csv")
    with pytest.raises(RecordingError, match=r"ends in \.csv or \.parquet"):
        watch(TASK, None, EnvironmentConfig(), film=tmp_path / "w.gif", save=tmp_path / "d.txt")
