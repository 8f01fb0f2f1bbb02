"""Each layout's bound is the shortest of its kind, and is proven once, by this process or an earlier one."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.tasks.uav_route import kept_bounds, lower_bound
from fieldagents.tasks.uav_route.limits import limits_of, steepest
from fieldgym import find_task
from fieldmodels.machines.uav_route.parameters import Aircraft, Detection, World

WORLD = World()


def layouts(count, **settings):
    envs = find_task("uav_route").make_vec(count, settings={"layout": "random", **settings})
    _, info = envs.reset(seed=70)
    envs.close()
    return lower_bound.layouts_of(info)


LAYOUTS = layouts(12)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_bounds.platformdirs, "user_cache_dir", lambda _: str(tmp_path / "cache"))
    lower_bound._bound_to_capture.cache_clear()
    return tmp_path / "cache" / "bounds"


@pytest.fixture
def proven(monkeypatch):
    """The layouts whose bounds are computed, as they are."""
    found, compute = [], lower_bound.bound_to_capture
    monkeypatch.setattr(
        lower_bound, "bound_to_capture", lambda layout, *of: found.append(layout) or compute(layout, *of)
    )
    return found


def bounds(world=WORLD, capture=5.0, say=lambda _: None):
    return kept_bounds.kept_bounds(LAYOUTS, world, capture, say)


TRIED = 5001


@pytest.mark.every("threshold", [0.2, 0.5, 0.8])
def test_no_way_to_the_circle_and_on_inside_is_shorter(threshold):
    # every straight that a way inside may follow is tried, where the bound solves for the best
    world = World(detection=Detection(threshold=threshold))
    circle = limits_of(world).side
    radius, limit = steepest(world, True)
    tried = np.linspace(0.0, circle, TRIED)
    past = 0
    for layout in LAYOUTS:
        (start, goal), (radar,) = np.array([layout.start, layout.goal]), np.array(layout.radars)
        r, inner = math.dist(start, radar), math.dist(goal, radar)
        bound = lower_bound.lower_bound(layout, world)
        if not r > circle > inner or bound == pytest.approx(math.dist(start, goal)):
            continue
        past += 1
        edges = np.linspace(inner, circle, 401)
        gained, inside = np.zeros(TRIED), np.zeros(TRIED)
        for near, far in pairwise(edges):
            most = limit[min(np.searchsorted(radius, far), len(limit) - 1)]
            steep = np.minimum(np.arcsin(np.minimum(tried / (0.5 * (near + far)), 1.0)), most)
            gained += np.tan(steep) * (far - near) / (0.5 * (near + far))
            inside += (far - near) / np.cos(steep)
        between = np.arccos((start - radar) @ (goal - radar) / (r * inner))
        left, tangent = between - gained, math.acos(circle / r)
        straight = np.sqrt(r**2 + circle**2 - 2 * r * circle * np.cos(left))
        around = math.sqrt(r**2 - circle**2) + circle * (left - tangent)
        ways = (np.where(left <= tangent, straight, around) + inside)[left >= 0]
        assert bound == pytest.approx(ways.min(), abs=1e-3)
        assert bound <= ways.min() + 1e-9
    assert past >= 4


def test_what_an_earlier_run_has_proven_is_not_proven_again(cache, proven):
    said = []
    first = bounds(say=said.append)
    assert proven == LAYOUTS
    assert said[::5] == ["Proving bounds of 12 layouts (0 of 12)", "Proving bounds of 12 layouts (10 of 12)"]
    again = bounds(say=said.append)
    assert again == first == [lower_bound._bound_to_capture(one, WORLD, 5.0)[0] for one in LAYOUTS]
    assert len(proven) == 12
    assert len(said) == 6
    assert len(list(cache.iterdir())) == 1


@pytest.mark.every(
    "other",
    [
        {"world": World(aircraft=Aircraft(altitude=5.0))},
        {"world": World(detection=Detection(threshold=0.4))},
        {"capture": 8.0},
    ],
)
@pytest.mark.usefixtures("cache")
def test_another_world_has_bounds_of_its_own(other):
    before = bounds()
    assert not any(a == b for a, b in zip(bounds(**other), before, strict=True))
    assert bounds() == before


@pytest.mark.usefixtures("cache")
def test_luck_and_lock_loss_have_no_bounds_of_their_own(proven):
    before = bounds()
    lucky = replace(
        WORLD, detection=Detection(detection="stochastic"), lock_loss=replace(WORLD.lock_loss, lose=1.0)
    )
    assert bounds(lucky) == before
    assert len(proven) == 12


@pytest.mark.every(
    "content", ["", "{", "[]", "null", '{"code": 1}', '{"code": "CODE", "bounds": [1]}', "other"]
)
def test_a_damaged_file_or_one_of_other_code_is_replaced(content, cache, proven):
    first = bounds()
    proven.clear()
    (path,) = cache.iterdir()
    whole = path.read_text()
    code = kept_bounds._code()
    path.write_text(whole.replace(code, "other") if content == "other" else content.replace("CODE", code))
    assert bounds() == first
    assert len(proven) == 12
    assert path.read_text() == whole


def test_without_a_cache_bounds_are_the_same(cache, tmp_path, proven):
    first = bounds()
    for path in (*cache.iterdir(), cache):
        path.unlink() if path.is_file() else path.rmdir()
    cache.write_text("a file where the folder should be")
    assert bounds() == bounds() == first
    assert len(proven) == 36


def test_what_another_process_has_kept_meanwhile_stays(cache, monkeypatch, proven):
    bounds()
    (path,) = cache.iterdir()
    whole = path.read_text()
    path.unlink()
    compute = lower_bound.bound_to_capture

    def meanwhile(*of):
        path.write_text(whole)
        return compute(*of)

    monkeypatch.setattr(lower_bound, "bound_to_capture", meanwhile)
    kept_bounds.kept_bounds(layouts(13)[-1:], WORLD, 5.0, lambda _: None)
    before = len(proven)
    bounds()
    assert len(proven) == before


def test_an_evaluation_says_what_it_proves(cache):
    del cache
    said = []
    place = EnvironmentConfig(settings={"layout": "random", "max_legs": 2})
    agent = make_agent("straight", "uav_route", place.settings).runs[0]
    first = run_episodes(agent, "uav_route", place, range(3), lambda *now: said.append(now))
    stages = [stage for stage, _ in said if stage]
    assert stages == [f"Proving bounds of 3 layouts ({number} of 3)" for number in range(3)]
    said.clear()
    again = run_episodes(agent, "uav_route", place, range(3), lambda *now: said.append(now))
    assert not any(stage for stage, _ in said)
    assert first.equals(again)
