"""Several aircraft in one UAV route: what couples them, and what does not."""

import math

import gymnasium as gym
import numpy as np
import pytest

import fieldgym  # noqa: F401 - registers the environments
from fieldgym.info import part
from fieldgym.settings import SettingsError
from fieldgym.uav_route import COMBINED, actions_towards
from fieldmodels.machines.uav_route.batch import Flights, Rules
from fieldmodels.machines.uav_route.layouts import safe_route
from fieldmodels.machines.uav_route.parameters import (
    EXAMPLE,
    SECOND_UAV,
    Aircraft,
    Detection,
    Layout,
    LockLoss,
    World,
)
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.machines.uav_route.team import Team
from fieldmodels.model import ModelError

ENV = "fieldgym/UavRoute-v1"
SPEED = 0.25


def seen_from(off):
    """Slant range [km] at which a level aircraft is detected at 0.5, by azimuth [deg]: Tables 4.1, 4.2."""
    share = min(max(min(off - 30.0, 160.0 - off), 0.0), 1.0)
    signature = 5e-5 + share * (0.5 - 5e-5)
    return np.interp(signature, (1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0), (27.1, 48.1, 85.6, 152.2, 270.6, 481.2))


def vector(num_envs=4, reality=None, **settings):
    return gym.make_vec(
        ENV, num_envs=num_envs, vectorization_mode="vector_entry_point", settings=settings, reality=reality
    )


@pytest.mark.every("detection", ["deterministic", "stochastic"])
def test_aircraft_that_nothing_couples_fly_as_each_does_alone(detection):
    """To rounding with drawn scans; else to the step, which a leg's end of another aircraft divides anew."""
    odd = LockLoss(lose=48.7, engage=401.3, target=33.3)  # no multiples of the time between scans
    world = World(detection=Detection(detection=detection), lock_loss=odd)
    each = [
        Rules(world=world, layout=layout, step=0.1, aircraft=2, max_legs=30)
        for layout in (EXAMPLE, SECOND_UAV)
    ]
    team, alone = Team(3, each), [Flights(1, each[a]) for _ in range(3) for a in range(2)]
    for i in range(3):
        team.seed(i, np.random.default_rng(i))
    team.restart(range(3))
    for i, flight in enumerate(alone):
        flight.seed(0, np.random.default_rng(0))
        flight.flights["key"] = team.flights["key"][i]
        flight.restart([0])
    rng, total, own, last = np.random.default_rng(3), np.zeros(6), np.zeros(6), team.observe()
    while (last.over == 0).any():
        actions = np.column_stack([rng.uniform(-3, 3, 6), rng.uniform(3, 60, 6)])
        for i in np.flatnonzero((team.legs["going"].ravel() == 0) & (last.over == 0)):
            own[i] += alone[i].advance(actions[i : i + 1]).reward[0]
        last = team.advance(actions)
        total += last.reward
    numbers = np.column_stack([flight.observe().numbers for flight in alone])
    drawn = detection == "stochastic"
    np.testing.assert_allclose(last.numbers, numbers, atol=1e-9 if drawn else 0.4, rtol=0)
    np.testing.assert_allclose(total, own, atol=1e-9 if drawn else 0.01)
    assert (last.numbers[5] > 0).all()  # all have been detected
    assert (last.over == 2).any()


def flown_by_hand(paths, lock, dt=0.25):
    """Level straight legs past a radar at the origin that follows one aircraft, in plain Python.

    Returns:
        For each aircraft whether it is hit, when its flight ends, how long it was detected, lock losses.
    """
    count = len(paths)
    at, leg = [list(path[0]) for path in paths], [1] * count
    over, ends, seen, losses = [None] * count, [0.0] * count, [0.0] * count, [0] * count
    target, hidden, engaged, launched, time = None, 0.0, 0.0, 0.0, 0.0
    while None in over:
        found = {}
        for a in range(count):
            if over[a] is not None:
                continue
            to = paths[a][leg[a]]
            length = math.dist(at[a], to)
            ahead = [(to[j] - at[a][j]) / length for j in range(2)]
            here = [at[a][j] + 0.5 * SPEED * dt * ahead[j] for j in range(2)]
            ground = math.hypot(*here)
            off = math.degrees(math.acos(-(ahead[0] * here[0] + ahead[1] * here[1]) / ground))
            if ground < 365.0 and 30.0 < off < 160.0 and math.hypot(ground, 10.0) < seen_from(off):
                found[a] = ground
            step = min(SPEED * dt, length)
            at[a] = [at[a][j] + step * ahead[j] for j in range(2)]
            if step == length:
                leg[a] += 1
        time += dt
        if target is None and found:
            target, hidden, engaged, launched = min(found, key=found.get), 0.0, 0.0, 0.0
        if target is not None:
            if target in found:
                seen[target] += dt
                hidden, engaged = 0.0, engaged + dt
            else:
                hidden += dt
            if engaged >= lock.engage:
                launched += dt
            if hidden >= lock.lose:
                losses[target] += 1
                target = None
            elif launched >= lock.target:
                over[target], ends[target], target = "hit", time, None
        for a in range(count):
            if over[a] is None and leg[a] == len(paths[a]):
                over[a], ends[a] = "flown", time
                target = None if target == a else target
    return [state == "hit" for state in over], ends, seen, losses


def test_a_radar_that_follows_one_does_what_plain_python_says():
    """Three aircraft on random legs about a radar; no code is shared with what is tested."""
    lock, teams, legs = LockLoss(lose=20.0, engage=200.0, target=100.0), 12, 6
    rng = np.random.default_rng(4)
    angle = rng.uniform(-0.5, 0.5, (teams, 3, legs + 1))
    radius = rng.uniform(320.0, 480.0, (teams, 3, legs + 1))
    paths = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    world = World(aircraft=Aircraft(bank=0.0), lock_loss=lock)
    goal = (-5000.0, 0.0)
    rules = Rules(
        world=world, layout=Layout((370.0, 0.0), goal, ((0.0, 0.0),)), step=0.25, aircraft=3, tracking="one",
        max_legs=legs, least_leg=0.1,
    )  # fmt: skip
    team = Team(teams, [rules] * 3)
    for i in range(teams):
        team.seed(i, np.random.default_rng(i))
    team.restart(range(teams))
    team.flights["place"] = paths[:, :, 0].reshape(-1, 2)
    last, routes = team.observe(), paths.reshape(-1, legs + 1, 2)
    while (last.over == 0).any():
        done = np.minimum(team.flights["legs"] + 1, legs)
        ahead = routes[np.arange(3 * teams), done] - team.flights["place"]
        towards = np.arctan2(*-team.flights["place"].T[::-1])  # the radar's bearing
        last = team.advance(np.column_stack([np.arctan2(*ahead.T[::-1]) - towards, np.hypot(*ahead.T)]))
    by_hand = [flown_by_hand(own.tolist(), lock) for own in paths]
    hit, ends, seen, losses = (np.concatenate([own[k] for own in by_hand]) for k in range(4))
    np.testing.assert_array_equal(last.over == 2, hit)
    np.testing.assert_allclose(last.numbers[2], ends, atol=3.0)
    np.testing.assert_allclose(last.numbers[5], seen, atol=6.0)
    np.testing.assert_array_equal(last.numbers[8], losses)
    assert 5 < hit.sum() < 30
    assert losses.sum() > 5


@pytest.mark.every(("tracking", "hits"), [("each", 2), ("one", 1)])
def test_a_followed_aircraft_shields_the_other_until_its_flight_is_over(tracking, hits):
    """Side by side across the radar's face: one radar, one target; the second is locked on too late."""
    layout = {
        "start": (350.0, 40.0),
        "goal": (350.0, -40.0),
        "radars": [(0.0, 0.0)],
        "others": [{"start": (355.0, 40.0), "goal": (355.0, -40.0)}],
    }
    env = vector(1, aircraft=2, tracking=tracking, layout=layout)
    _, info = env.reset(seed=0)
    over = np.array([False])
    while not over[0]:
        actions = actions_towards(info["layout.goal"], info, env.unwrapped.settings)
        _, _, over, _, info = env.step(actions)
    assert info["each.damaged"].sum() == hits
    assert info["each.damaged"][0, 0] == 1  # the nearer one is the likelier
    if tracking == "one":
        assert info["each.time_over"][0, 1] == pytest.approx(320 - 200, abs=40)
        assert info["each.success"][0, 1] == 1
    assert info["success"] == 0


SETTINGS = (
    {"aircraft": 2, "tracking": "one"},
    {"aircraft": 3, "radars": 3, "detection": "stochastic", "tracking": "one", "sighting_cost": 0.1},
    {"aircraft": 2, "layout": "example", "progress": "around"},
)


@pytest.mark.every("settings", SETTINGS)
def test_rows_snapshots_and_totals(settings):
    """A row is the scalar environment, a snapshot amid legs goes on to the bit, and numbers add up."""
    envs = vector(3, {"wind": {"north": 15.0, "east": 5.0}}, **settings)
    one = gym.make(ENV, settings=settings, reality={"wind": {"north": 15.0, "east": 5.0}}).unwrapped
    observation, info = envs.reset(seed=5)
    alone, _ = one.reset(seed=7)
    np.testing.assert_array_equal(observation[2], alone)
    envs.action_space.seed(1)
    actions = [envs.action_space.sample() for _ in range(40)]
    ended, kept, after = False, None, []
    for k, action in enumerate(actions):
        if k == 4:
            kept = envs.get_state()
            assert (info["leg_left"] > 0).any()
        observation, reward, over, _, info = envs.step(action)
        after.append((observation, reward))
        assert observation in envs.observation_space
        if not ended:
            alone, gain, ended, _, own = one.step(action[2])
            np.testing.assert_array_equal(observation[2], alone)
            assert (reward[2], over[2]) == (gain, ended)
            np.testing.assert_array_equal(info["timers"][2], own["timers"])
        for name, combine in COMBINED.items():
            np.testing.assert_allclose(info[name], combine(part(info, "each")[name], axis=1))
        finished = info["each.success"] + info["each.damaged"] + (info["each.legs"] == 60)
        np.testing.assert_array_equal(over, (finished > 0).all(axis=1))
    envs.set_state(kept)
    for k, action in enumerate(actions[4:], 4):
        observation, reward, *_ = envs.step(action)
        np.testing.assert_array_equal(observation, after[k][0])
        np.testing.assert_array_equal(reward, after[k][1])


def test_reward_is_the_sum_over_the_aircraft():
    """Length and progress of all, one arrival and one hit in the same episode."""
    layout = {
        "start": (480.0, 0.0),
        "goal": (430.0, 0.0),
        "radars": [(0.0, 0.0)],
        "others": [{"start": (350.0, 100.0), "goal": (350.0, -100.0)}],
    }
    env = vector(1, aircraft=2, layout=layout, progress="straight")
    _, info = env.reset(seed=0)
    start, total, over = info["each.remaining"][0], 0.0, [False]
    while not over[0]:
        _, reward, over, _, info = env.step(
            actions_towards(info["layout.goal"], info, env.unwrapped.settings)
        )
        total += reward[0]
    each = part(info, "each")
    assert each["success"].tolist() == [[1, 0]]
    assert each["damaged"].tolist() == [[0, 1]]
    way = 0.04 * (start - each["remaining"][0]) - 0.02 * each["path_length"][0]
    assert total == pytest.approx(3.0 - 1.5 + way.sum())


def test_random_layouts_leave_every_aircraft_an_unseen_way_past_common_radars():
    envs = vector(20, aircraft=4, radars=4)
    _, info = envs.reset(seed=0)
    starts = info["layout.start"]
    assert starts.shape == (20, 4, 2)
    assert len(np.unique(starts.round(6).reshape(-1, 2), axis=0)) == 80
    for start, goal, radars in zip(starts, info["layout.goal"], info["layout.radars"], strict=True):
        for a in range(4):
            own = Layout(tuple(start[a]), tuple(goal[a]), tuple(map(tuple, radars)))
            assert simulate_plan(safe_route(own), own.radars).verification.undetected
    single = vector(20, radars=4)
    _, alone = single.reset(seed=0)
    np.testing.assert_array_equal(starts[:, 0], alone["layout.start"])
    np.testing.assert_array_equal(info["layout.radars"], alone["layout.radars"])


def test_all_aircraft_are_drawn():
    env = gym.make(ENV, render_mode="rgb_array", settings={"aircraft": 2, "layout": "example"}).unwrapped
    env.reset(seed=0)
    both = env.render()
    env._task.flights.flights["place"][1] += 60.0
    assert (env.render() != both).any()
    env.show([[EXAMPLE.start, EXAMPLE.goal], [SECOND_UAV.start, SECOND_UAV.goal]])
    assert (env.render() != both).any()


@pytest.mark.every(
    ("settings", "error", "words"),
    [
        ({"aircraft": 0}, SettingsError, "aircraft"),
        ({"aircraft": 9}, SettingsError, "aircraft"),
        ({"aircraft": 3, "layout": "example"}, ModelError, "`others` a start and a goal"),
        (
            {"aircraft": 2, "layout": {"start": (400, 0), "goal": (350, 0), "radars": [(0, 0)]}},
            ModelError,
            "1 aircraft fly, and aircraft=2",
        ),
    ],
)
def test_bad_teams_are_refused(settings, error, words):
    with pytest.raises(error, match=words):
        gym.make(ENV, settings=settings)


def test_stock_effects_need_a_single_aircraft():
    with pytest.raises(ModelError, match="choose aircraft=1"):
        vector(2, {"north_bias": {"bias": 100.0}}, aircraft=2)
