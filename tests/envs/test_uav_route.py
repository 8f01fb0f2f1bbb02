import math

import gymnasium as gym
import numpy as np
import pytest

import fieldgym  # noqa: F401 - registers the environments
from fieldgym.settings import SettingsError
from fieldgym.uav_route import UavRouteSettings, actions_towards
from fieldmodels.machines.uav_route.batch import NUMBERS, observed_names
from fieldmodels.machines.uav_route.layouts import distance_around, safe_route
from fieldmodels.machines.uav_route.parameters import EXAMPLE, INSTANT_KILL
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

ENV = "fieldgym/UavRoute-v1"
SAFE = safe_route(EXAMPLE)


def vector(num_envs=8, reality=None, **settings):
    return gym.make_vec(
        ENV, num_envs=num_envs, vectorization_mode="vector_entry_point", settings=settings, reality=reality
    )


def fly(envs, routes, seed=0):
    """Fly a route of waypoints, shape (points, 2) or (envs, points, 2); infos and rewards of each leg."""
    _, info = envs.reset(seed=seed)
    infos, rewards, over = [], [], np.zeros(envs.num_envs, dtype=bool)
    routes = np.broadcast_to(routes, (envs.num_envs, *np.shape(routes)[-2:]))
    for k in range(1, routes.shape[1]):
        actions = actions_towards(routes[:, k], info, envs.unwrapped.settings)
        _, reward, terminated, _, info = envs.step(actions)
        assert not (over & terminated).any()
        over |= terminated
        infos.append(info)
        rewards.append(reward)
    return infos, np.array(rewards)


def bent(angle, place):
    """A place turned about the origin."""
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return tuple(turn @ place)


def test_a_safe_route_arrives_unseen_where_the_straight_line_is_hit_at_once():
    infos, _ = fly(vector(1, layout="example", lock_loss=False), SAFE)
    assert infos[-1]["success"][0] == 1
    assert infos[-1]["time_over"][0] == 0
    infos, _ = fly(vector(1, layout="example", lock_loss=False), [EXAMPLE.start, EXAMPLE.goal])
    assert infos[-1]["damaged"][0] == 1
    assert infos[-1]["time_over"][0] <= 5


def test_the_straight_line_of_the_example_is_hit_after_200_s_of_detection():
    """Lock loss as in the source's example: launched after 150 s, hit 50 s later."""
    (info,), (reward,) = fly(vector(1, layout="example", progress="straight"), [EXAMPLE.start, EXAMPLE.goal])
    assert info["damaged"][0] == 1
    assert 200 <= info["time_over"][0] <= 205  # the hit is found at the end of a step of 5 s
    lose, engage, launch = info["timers"][0, 0]
    assert lose == 0
    assert engage == info["time_over"][0]
    assert launch == pytest.approx(engage - 150)
    flown = info["path_length"][0]
    came = math.hypot(10, 125) - info["remaining"][0]
    assert reward[0] == pytest.approx(-1.5 - 0.02 * flown + 0.04 * came)


@pytest.mark.every("radars", [1, 3])
def test_every_random_layout_has_a_route_that_arrives_unseen(radars):
    envs = vector(40, radars=radars, lock_loss=False)
    _, info = envs.reset(seed=0)
    flights = envs.unwrapped._task.flights
    routes = np.array([safe_route(flights.layout(i)) for i in range(40)])
    np.testing.assert_array_equal(info["layout.start"], routes[:, 0])
    infos, _ = fly(envs, routes)
    last = infos[-1]
    legs = {k: [one[k] for one in infos] for k in ("success", "time_over")}
    assert (np.max(legs["success"], axis=0) == 1).all()
    assert (np.max(legs["time_over"], axis=0) == 0).all()
    assert set(NUMBERS) < set(last)


def test_an_episode_agrees_with_the_same_plan_simulated():
    settings = {"layout": "example", "threshold": 0.6, "lose": 20.0, "engage": 1e4}
    route = np.array([EXAMPLE.start, (345.0, 80.0), (335.0, 40.0), EXAMPLE.goal])
    envs = vector(1, **settings)
    infos, _ = fly(envs, route)
    assert infos[-1]["success"][0] == 1
    flown = np.vstack([route[:3], infos[-1]["place"]])  # the goal's capture circle ends the last leg
    found = simulate_plan(flown, EXAMPLE.radars, UavRouteSettings(**settings).world, step=0.2).verification
    assert infos[-1]["path_length"][0] == pytest.approx(found.path_length, rel=1e-6)
    assert infos[-1]["time_over"][0] == pytest.approx(found.time_over, abs=5)
    assert found.time_over > 50
    assert infos[-1]["largest_probability"][0] == pytest.approx(found.largest_probability, abs=0.01)
    assert infos[-1]["lock_losses"][0] == found.lock_losses


def test_damage_costs_what_the_settings_say():
    rewards = []
    for cost in (0.0, 0.7):
        envs = vector(1, layout="example", damage_cost=cost)
        (info,), (reward,) = fly(envs, [EXAMPLE.start, EXAMPLE.goal])
        assert info["damaged"][0] == 1
        rewards.append(reward[0])
    assert rewards[0] - rewards[1] == pytest.approx(0.7)


def test_reward_is_what_the_page_says():
    """Length, progress, and what detection costs; without a leg left, the cost of being late."""
    prices = {"length_cost": 0.02, "progress_reward": 0.03, "detection_cost": 0.001, "sighting_cost": 0.25}
    envs = vector(32, max_legs=4, late_cost=0.7, engage=1e9, progress="straight", **prices)
    _, before = envs.reset(seed=2)
    envs.action_space.seed(0)
    for leg in range(4):
        _, reward, terminated, _, info = envs.step(envs.action_space.sample())
        seen = info["time_over"] - before["time_over"]
        expected = 0.03 * (before["remaining"] - info["remaining"])
        expected -= 0.02 * (info["path_length"] - before["path_length"]) + 0.001 * seen + 0.25 * (seen > 0)
        expected += info["success"] - (0.7 if leg == 3 else 0.0) * (1 - info["success"])
        np.testing.assert_allclose(reward, expected, atol=1e-9)
        assert not info["success"].any()
        before = info
    assert (seen > 0).any()
    assert terminated.all()


def test_progress_around_the_circle_is_a_potential():
    """Its rewards sum up to a difference of distances, whatever way is flown; a safe route loses little."""
    envs = vector(1, layout="example", length_cost=0.0, lock_loss=False)
    _, rewards = fly(envs, SAFE)
    potential = rewards.sum() - 3.0  # less the arrival
    away = vector(1, layout="example", length_cost=0.0, engage=1e9)
    detour = [EXAMPLE.start, (400.0, 150.0), (420.0, 40.0), (330.0, 5.0), (345.0, 0.0)]
    infos, rewards = fly(away, detour)
    assert infos[-1]["success"][0] == 1
    left = [
        distance_around(np.array(place), np.array(EXAMPLE.goal), np.zeros((1, 2)), 364.06)
        for place in (EXAMPLE.start, SAFE[2] * 345 / 340, infos[-1]["place"][0])
    ]
    assert left[0] == pytest.approx(139.14, abs=0.6)  # tangent, arc and spiral of the lower bound
    assert potential == pytest.approx(0.04 * (left[0] - left[1]), abs=1e-4)
    assert rewards.sum() - 3.0 == pytest.approx(0.04 * (left[0] - left[2]), abs=1e-4)


def around(places, goals):
    radars = np.zeros((1, 2))
    return np.array([distance_around(*ends, radars, 364.06) for ends in zip(places, goals, strict=True)])


def test_distance_around_is_at_least_straight_and_has_no_jumps():
    """For goals within the circle: a step of 100 m changes it by no more than 400 m."""
    rng = np.random.default_rng(0)
    n = 20_000
    goals = np.column_stack([rng.uniform(250, 362, n), np.zeros(n)])
    radius, bearing = rng.uniform(100, 700, n), rng.uniform(-np.pi, np.pi, n)
    places = np.column_stack([radius * np.cos(bearing), radius * np.sin(bearing)])
    moved = places + 0.1 * np.column_stack([np.cos(2 * bearing), np.sin(2 * bearing)])
    one, other = (around(at, goals) for at in (places, moved))
    assert np.abs(one - other).max() < 0.4
    assert (one >= np.hypot(*(goals - places).T) - 1e-9).all()
    outwards = np.column_stack([radius, np.zeros(n)])[radius > goals[:, 0]]
    goals = goals[radius > goals[:, 0]]
    straight = around(outwards, goals)
    np.testing.assert_allclose(straight, outwards[:, 0] - goals[:, 0], atol=1e-9)


def test_a_turned_map_gives_the_same_episode():
    layouts = [
        {"start": bent(angle, EXAMPLE.start), "goal": bent(angle, EXAMPLE.goal), "radars": [(0.0, 0.0)]}
        for angle in (0.0, 2.2)
    ]
    one, other = (vector(1, layout=layout) for layout in layouts)
    for a, b in zip(one.reset(seed=0)[:1], other.reset(seed=0)[:1], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)
    one.action_space.seed(4)
    for _ in range(12):
        action = one.action_space.sample()
        a, b = one.step(action), other.step(action)
        np.testing.assert_allclose(a[0], b[0], atol=1e-4)
        np.testing.assert_allclose(a[1], b[1], atol=1e-6)
        assert a[2] == b[2]


def test_actions_lead_to_waypoints_or_as_far_as_a_leg_goes():
    envs = vector(16, longest_leg=120.0, engage=1e9)
    _, info = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(5):
        ahead = rng.uniform(-150, 150, (16, 2))
        length = np.clip(np.hypot(*ahead.T), 2.5, 120.0)
        aim = info["place"] + ahead * (length / np.hypot(*ahead.T))[:, None]
        actions = actions_towards(info["place"] + ahead, info, envs.unwrapped.settings)
        _, _, over, _, info = envs.step(actions)
        np.testing.assert_allclose(info["place"][~over], aim[~over], atol=1e-3)
        assert not over.all()
    one_length = UavRouteSettings(least_leg=10.0, longest_leg=10.0)
    assert np.isfinite(actions_towards(aim, info, one_length)).all()


def test_headings_are_relative_to_the_nearest_radar():
    envs = vector(1, layout={"start": (400, 0), "goal": (0, 390), "radars": [(0, 0), (400, 600)]})
    _, info = envs.reset(seed=0)
    assert info["radial"][0] == pytest.approx(math.pi)  # the first one lies to the south
    *_, info = envs.step(np.array([[-0.5, 1.0]], dtype=np.float32))  # left of south: to the east
    np.testing.assert_allclose(info["place"], [[400, 500]], atol=1e-3)
    assert info["radial"][0] == pytest.approx(math.pi / 2)  # the second one lies ahead


@pytest.mark.every("detection", ["deterministic", "stochastic"])
def test_equal_seeds_mean_equal_layouts_and_luck_whatever_is_done(detection):
    """Luck is drawn by time: an agent that acts otherwise for one leg meets the same numbers after it."""
    envs = vector(20, detection=detection, engage=1e9, lose=1e9)
    _, first = envs.reset(seed=3)
    _, again = envs.reset(seed=3)
    np.testing.assert_array_equal(first["layout.radars"], again["layout.radars"])
    np.testing.assert_array_equal(first["layout.goal"], again["layout.goal"])
    away = np.tile(np.float32([1.0, 0.0]), (20, 1))  # straight away from the radar, and back
    times = []
    for legs in ((1.0, 1.0), (0.98, 0.98)):
        envs.reset(seed=3)
        for heading in legs:
            *_, info = envs.step(away * np.float32([heading, 1.0]))
        times.append(info["time"])
    np.testing.assert_allclose(times[0], times[1])
    envs.reset(seed=4)
    *_, other = envs.step(away)
    assert (other["layout.goal"] != first["layout.goal"]).any()


def test_drawn_looks_of_a_vector_env_are_those_of_the_scalar_one():
    settings = {"detection": "stochastic", "radars": 2, "engage": 1e9}
    envs, one = vector(3, **settings), gym.make(ENV, settings=settings)
    envs.reset(seed=10)
    one.reset(seed=12)
    envs.action_space.seed(1)
    for _ in range(10):
        actions = envs.action_space.sample()
        observation, reward, *_, info = envs.step(actions)
        alone = one.step(actions[2])
        np.testing.assert_array_equal(observation[2], alone[0])
        assert reward[2] == alone[1]
        assert info["time_over"][2] == alone[4]["time_over"]
    assert info["time_over"][2] > 0


def test_observations_are_named_and_bounded():
    for radars in (1, 4):
        envs = vector(4, radars=radars, longest_leg=5000.0, engage=1e9, max_legs=10_000)
        observation, _ = envs.reset(seed=0)
        assert observation.shape == (4, len(observed_names(radars)))
        for _ in range(30):  # far away
            observation, *_ = envs.step(np.tile(np.float32([1.0, 1.0]), (4, 1)))
        assert (np.abs(observation) <= 100).all()
        assert (observation[:, 0] == 100).all()


def test_settings_make_the_world():
    assert UavRouteSettings(lock_loss=False).world.lock_loss == INSTANT_KILL
    world = UavRouteSettings(reading="printed", engaged="unbroken", threshold=0.7).world
    assert world.reading.draw == "above"
    assert world.reading.heading == "own_leg"
    assert world.lock_loss.engaged == "unbroken"
    assert world.detection.threshold == 0.7
    assert UavRouteSettings(layout="example").rules[0].layout == EXAMPLE


def test_reality_changes_the_flight_and_a_faulty_sensor_only_what_is_told():
    settings = {"layout": "example", "engage": 1e9}
    still, windy = vector(1, **settings), vector(1, {"wind": {"north": 0.0, "east": -40.0}}, **settings)
    (calm,), _ = fly(still, [EXAMPLE.start, EXAMPLE.goal])
    (blown,), _ = fly(windy, [EXAMPLE.start, EXAMPLE.goal])
    assert blown["time"][0] == pytest.approx(calm["time"][0] * 0.25 / 0.29, rel=0.01)
    biased = vector(1, {"sensor_bias": {"north": 3000.0, "east": 0.0}}, **settings)
    _, info = biased.reset(seed=0)
    np.testing.assert_allclose(info["place"], [[353, 125]])
    np.testing.assert_allclose(info["privileged.place"], [[350, 125]])


@pytest.mark.every(
    ("settings", "error", "words"),
    [
        ({"layot": "example"}, SettingsError, "did you mean 'layout'"),
        ({"layout": "nowhere"}, SettingsError, "layout"),
        ({"layout": {"start": (0, 0), "goal": (9, 9), "radars": []}}, SettingsError, "radars"),
        ({"layout": {"start": (0, 0), "goal": (9, 9), "radar": [(0, 0)]}}, SettingsError, "radar"),
        ({"layout": {"start": (0, math.nan), "goal": (9, 9), "radars": [(0, 0)]}}, SettingsError, "start"),
        ({"radars": 5}, SettingsError, "radars"),
        ({"threshold": 1.0}, SettingsError, "threshold"),
        ({"least_leg": 600.0}, SettingsError, "shortest of the legs"),
        ({"layout": {"start": (0, 0), "goal": (3, 0), "radars": [(9, 9)]}}, ModelError, "capture radius"),
    ],
)
def test_bad_settings_are_refused(settings, error, words):
    with pytest.raises(error, match=words):
        gym.make(ENV, settings=settings)


def test_a_broken_snapshot_is_refused_and_changes_nothing():
    env = gym.make(ENV).unwrapped
    env.reset(seed=1)
    env.step(np.zeros(2, dtype=np.float32))
    kept = env.get_state()
    with pytest.raises(ValueError, match="get_state makes one"):
        env.set_state({**kept, "flights": kept["flights"][:, :9]})
    assert np.array_equal(env.get_state()["flights"], kept["flights"])


def test_a_plan_is_drawn_until_it_is_taken_back():
    env = gym.make(ENV, render_mode="rgb_array", settings={"layout": "example"}).unwrapped
    env.reset(seed=0)
    bare = env.render()
    env.show(SAFE)
    planned = env.render()
    assert (planned != bare).any()
    env.show()
    assert np.array_equal(env.render(), bare)
    with pytest.raises(ValueError, match="plan has shape"):
        env.show([1.0, 2.0, 3.0])


def test_pictures_of_all_endings_can_be_drawn():
    """A hit, a late end, an arrival, with and without locks that can be lost: each shows another picture."""
    frames = []
    for settings, goal in (
        ({"lock_loss": False}, EXAMPLE.goal),
        ({"max_legs": 1}, (400.0, 125.0)),
        ({"engage": 1e9}, EXAMPLE.goal),
    ):
        env = gym.make(ENV, render_mode="rgb_array", settings={"layout": "example", **settings}).unwrapped
        _, info = env.reset(seed=0)
        batch = {key: np.asarray(info[key])[None] for key in ("place", "radial")}
        _, _, over, _, info = env.step(actions_towards([goal], batch, env.settings)[0])
        assert over
        frames.append(env.render())
    assert (frames[0] != frames[1]).any()
    assert (frames[1] != frames[2]).any()
