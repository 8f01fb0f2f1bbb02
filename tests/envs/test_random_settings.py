"""Every setting that may be drawn acts in its own row, is told, is restored; the others say why not."""

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldgym.info import part
from fieldmodels.machines.excitation.parameters import NAMES, PRESETS
from fieldmodels.settings import declared

ROWS, STEPS = 4, 6
NEAR = {"layout": "example", "capture": 120.0}
SHOT = {"layout": "example", "lock_loss": False, "capture": 0.1}
SEEN = {"layout": "example", "capture": 0.1, "threshold": 0.05}
IMAGES = {"sight": "image", "track": "straight"}
DRAWN = {
    "excitation": {
        "preset": (("table1", "soft"), {}),
        "truth_spread": ((0.0, 0.5), {}),
        "limits": (("paper", "wide"), {}),
        "noise": (("full_scale", "running_max"), {}),
        "noise_fraction": ((0.02, 0.5), {}),
        "bits": ((5, 15), {}),
        "decisions": ((2, 4), {}),
        "reward": (("bits", "relative_error"), {}),
        "weights": (((1.0, 1.0, 1.0, 1.0, 1.0), (0.0, 1.0, 0.0, 0.0, 0.0)), {}),
    },
    "heel_strike": {
        "gyro": ((0.0041, 0.5), {}),
        "collision_kind": (("ar1", "low_pass"), {}),
        "correlation": ((0.5, 0.995), {}),
        "envelope": ((0.1, 0.4), {}),
        "hold": ((0.1, 1.0), {}),
        "floor_one_sided": ((False, True), {}),
        "process": (((0.05, 0.8), (0.0, 0.1)), {}),
        "floor": (((0.0005, 0.004), (0.0, 0.02)), {}),
        "collision": (((0.02, 0.3), (0.1, 1.0)), {}),
        "dwell": ((1.0, 1e6), {}),
        "push_off": ((0.2, 0.9), {}),
        "strides": ((2, 4), {}),
        "decay": ((50.0, 333.0), {}),
        "score": (("angle", "angle_and_floor"), {}),
        "reward_scale": ((1.0, 5.0), {}),
        "reward_limit": ((0.01, 10.0), {}),
        "tuned_reset": ((0.1, 0.9), {}),
    },
    "line_following": {
        "light": ((1.0, 0.1), IMAGES),
        "dark_corner": (((0.0, 0.0, 30.0, 0.0), (100.0, 0.0, 1.0, 0.0)), IMAGES),
        "sun": (((0.0, 3.0), (3.0, 3.0)), IMAGES),
        "sun_shade": ((0.1, 0.9), {**IMAGES, "sun": (0.0, 3.0)}),
        "sensor": ((0.0, 0.1), {}),
        "yaw": ((0.0, 0.05), {}),
        "lateral": ((0.0, 0.05), {}),
        "bias": ((0.0, 0.1), {}),
        "latency_strides": ((0, 1), {}),
        "camera_yaws_with_inner": ((False, True), {}),
        "offset": ((0.0, 0.4), {}),
        "misalignment": ((0.0, 0.4), {}),
        "sided": ((False, True), {}),
        "tape": (("duvetyne", "duvetyne_wide"), {"misalignment": 0.5}),
        "floor": (("linoleum", "dark_grey"), {**IMAGES, "light": 0.3}),
        "strides": ((2, 4), {}),
        "limit": ((0.05, 0.3), {}),
        "threshold": ((90.0, 40.0), IMAGES),
        "rgb_thresholds": (((90.0, 90.0, 90.0), (90.0, 90.0, 5.0)), {**IMAGES, "colour": True}),
        "friction": ((0.8, 0.05), {"plant": "pymunk"}),
        "motor": ((10.0, 0.05), {"plant": "pymunk"}),
        "lost_offset": ((1.0, 0.05), {}),
        "lost_strides": ((1, 5), {"misalignment": 0.5, "sided": True, "offset": 0.5}),
        "effort_weight": ((0.0, 1.0), {}),
        "reward_limit": ((0.1, 3.0), {"lost_offset": 0.05}),
    },
    "pose_reaching": {
        "starts": (("T1", "T2"), {}),
        "success": (("strict", "loose"), {"starts": "T1"}),
        "timeout": ((0.2, 0.4), {}),
        "max_speed": ((0.5, 1.5), {}),
        "max_rate": ((1.0, 5.0), {}),
        "walls": (("stop", "slide"), {"max_speed": 10.0, "tick": 0.5}),
        "time_cost": ((0.0, 2.0), {}),
        "success_reward": ((1.0, 20.0), {"starts": "T1"}),
        "progress_reward": ((0.0, 5.0), {}),
        "wall_cost": ((0.0, 3.0), {"max_speed": 10.0, "tick": 0.5}),
    },
    "uav_route": {
        "tracking": (("each", "one"), {"aircraft": 4, "threshold": 0.05, "engage": 1e6}),
        "capture": ((5.0, 120.0), {"layout": "example"}),
        "max_legs": ((2, 5), {}),
        "length_cost": ((0.01, 0.5), {}),
        "progress_reward": ((0.01, 0.5), {}),
        "progress": (("straight", "around"), {}),
        "arrival_reward": ((1.0, 7.0), NEAR),
        "damage_cost": ((1.0, 7.0), SHOT),
        "late_cost": ((1.0, 7.0), {"max_legs": 2, "engage": 1e6}),
        "detection_cost": ((0.0, 1.0), SEEN),
        "sighting_cost": ((0.0, 1.0), SEEN),
        "threshold": ((0.05, 0.9), {}),
        "interpolation": (("linear", "log"), {}),
        "detection": (("deterministic", "stochastic"), {}),
        "scan_interval": ((5.0, 40.0), {"detection": "stochastic"}),
        "reach": ((100.0, 656.6), SEEN),
        "lose": ((10.0, 1e4), SEEN),
        "engage": ((0.0, 1e6), SEEN),
        "target": ((0.0, 1e6), SEEN),
        "engaged": (("accumulated", "elapsed"), {"threshold": 0.4, "engage": 1e5, "lose": 1e6}),
        "lock_loss": ((True, False), SEEN),
        "reading": (("right", "printed"), {"detection": "stochastic"}),
        "speed": ((0.1, 0.5), SEEN),
        "altitude": ((5.0, 30.0), {}),
        "bank": ((0.1, 1.0), SEEN),
        "least_turn": ((1e-3, 3.0), SEEN),
    },
}
"""Of each task's settings: two values that act differently, and what else is set so that they do."""
CASES = [(task, name) for task, table in DRAWN.items() for name in table]
each_setting = pytest.mark.parametrize(("task", "name"), CASES, ids=[f"{t}-{n}" for t, n in CASES])
each_task = pytest.mark.every("task", [t for t in fieldgym.TASKS if t != "line_following_pixels"])


def towards_the_ball(observation):
    """Actions that bring robots to the ball, there to face +y: along a dipole's field lines."""
    x, y, cosine, sine = np.atleast_2d(observation)[:, :4].T
    bearing = np.arctan2(-y, -x)
    off = 2.0 * bearing - np.pi / 2 - np.arctan2(sine, cosine)
    rate = np.clip(3.0 * np.arctan2(np.sin(off), np.cos(off)) / 4.0, -1.0, 1.0)
    return np.stack([np.full_like(rate, -0.6), rate], axis=1).astype(np.float32)


DRIVEN = {("pose_reaching", name): towards_the_ball for name in ("success", "success_reward")}
"""What chooses the actions where random ones would not show a setting."""


def trace(env, actions, observation, chooses=None):
    """Observation, reward, ends and public info of every step, one list of bytes for each row."""
    rows = len(env.get_state()["generators"])
    vector = hasattr(env, "num_envs")
    found = [[] for _ in range(rows)]
    over = np.zeros(rows, dtype=bool)
    for action in actions * (40 if chooses else 1):
        if chooses:
            action = chooses(observation)
        one = env.step(action if vector else action[0])
        observation = one[0]
        for i in np.flatnonzero(~over):
            told = [one[4][key] for key in sorted(one[4]) if not key.startswith(("_", "privileged."))]
            values = [np.asarray(part)[i] if vector else np.asarray(part) for part in (*one[:4], *told)]
            found[i].append(b"".join(value.tobytes() for value in values))
        over |= np.atleast_1d(one[2]) | np.atleast_1d(one[3])
        if over.all():
            break
    return found


def as_setting(value):
    """A value out of an info's array."""
    return tuple(value) if isinstance(value, list) else value


def begun(task, name, seed=3):
    """A batch whose rows have drawn both values, its first observation, and what each row has drawn."""
    values, others = DRAWN[task][name]
    settings = {**others, name: {"choice": list(values)}}
    envs = gym.make_vec(fieldgym.TASKS[task].env_id, num_envs=ROWS, settings=settings)
    while True:
        observation, info = envs.reset(seed=seed)
        told = list(map(as_setting, part(info, "privileged.settings")[name].tolist()))
        if len(set(told)) == 2:
            return envs, observation, told, seed
        seed += ROWS


def some_actions(envs, count=STEPS):
    envs.action_space.seed(5)
    return [envs.action_space.sample() for _ in range(count)]


@each_task
def test_every_setting_is_declared_and_may_be_drawn_or_says_why_not(task):
    kind = fieldgym.TASKS[task].settings
    assert list(declared(kind)) == list(kind.__dataclass_fields__)
    fixed = {name for name, one in declared(kind).items() if one.setting.fixed}
    assert set(DRAWN[task]) == set(declared(kind)) - fixed


@pytest.mark.matrix(
    keep=(
        "excitation-limits",
        "heel_strike-strides",
        "line_following-sun_shade",
        "pose_reaching-max_speed",
        "uav_route-late_cost",
    )
)
@each_setting
def test_a_drawn_setting_acts_in_its_own_row_and_in_no_other(task, name):
    envs, observation, told, seed = begun(task, name)
    values, others = DRAWN[task][name]
    actions = some_actions(envs)
    chooses = DRIVEN.get((task, name))
    ours = trace(envs, actions, observation, chooses)
    acted = False
    for i in range(ROWS):
        for value in values:
            twin = gym.make(fieldgym.TASKS[task].env_id, settings={**others, name: value}).unwrapped
            first, _ = twin.reset(seed=seed + i)
            same = np.array_equal(first, observation[i])
            same &= trace(twin, [action[i : i + 1] for action in actions], first, chooses) == [ours[i]]
            assert same or value != told[i]
            acted |= not same
    assert acted


@pytest.mark.matrix(
    keep=(
        "excitation-truth_spread",
        "heel_strike-gyro",
        "line_following-tape",
        "pose_reaching-max_speed",
        "uav_route-engaged",
    )
)
@each_setting
def test_a_drawn_setting_comes_back_from_a_snapshot(task, name):
    """Of a later episode, with other draws than the first one's."""
    envs, _, told, _ = begun(task, name)
    actions = some_actions(envs, 3 * STEPS)
    envs.step(actions[0])
    for _ in range(20):
        now = list(map(as_setting, part(envs.reset()[1], "privileged.settings")[name].tolist()))
        if now != told:
            break
    assert now != told
    state = envs.get_state()
    ours = [envs.step(action) for action in actions]
    _, others = DRAWN[task][name]
    settings = {**others, name: {"choice": list(DRAWN[task][name][0])}}
    fresh = gym.make_vec(fieldgym.TASKS[task].env_id, num_envs=ROWS, settings=settings)
    fresh.set_state(state)
    again = [fresh.step(action) for action in actions]
    for a, b in zip(ours, again, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a[:4], b[:4], strict=True))
        one, other = (part(info, "privileged.settings")[name] for info in (a[4], b[4]))
        assert np.array_equal(one, other)


@pytest.mark.every(("task", "name"), CASES)
def test_a_setting_out_of_bounds_is_refused_by_name(task, name):
    kind, env_id = fieldgym.TASKS[task].settings, fieldgym.TASKS[task].env_id
    one = declared(kind)[name]
    if one.type is bool:
        return
    limit = one.items[0] if one.items else one.setting
    bad = next((end for end in (limit.least, limit.above) if end is not None), 0.0) - 1.0
    wrong = "nonsense" if one.choices else bad
    wrong = (wrong,) * len(one.items) if one.items else wrong
    for value in (wrong, {"choice": [wrong]}):
        with pytest.raises(fieldgym.SettingsError, match=name):
            gym.make(env_id, settings={name: value})


def test_one_number_of_a_pair_may_be_drawn():
    settings = {"process": [0.05, {"uniform": [0.5, 1.0]}], "floor": {"choice": [[0.0, 0.001], [0.0, 0.01]]}}
    envs = gym.make_vec("fieldgym/HeelStrike-v0", num_envs=ROWS, settings=settings)
    _, info = envs.reset(seed=2)
    told = part(info, "privileged.settings")
    assert (told["process"][:, 0] == 0.05).all()
    assert len(np.unique(told["process"][:, 1])) == ROWS
    assert set(map(tuple, told["floor"].tolist())) == {(0.0, 0.001), (0.0, 0.01)}
    action = np.zeros((ROWS, 3), np.float32)
    rewards = envs.step(action)[1]
    for i in range(ROWS):
        own = {name: tuple(values[i].tolist()) for name, values in told.items() if name[0] != "_"}
        twin = gym.make("fieldgym/HeelStrike-v0", settings=own).unwrapped
        twin.reset(seed=2 + i)
        assert twin.step(action[i])[1] == rewards[i]


@pytest.mark.every(
    ("value", "words"),
    [
        ((0.1, -0.1), "process: each of process must be at least 0|process.*greater than or equal to 0"),
        ((0.1, 0.2, 0.3), "process"),
        (
            [0.1, {"uniform": [0.5, 11.0]}],
            r"process: uniform: \[0.5, 11.0\] can draw 11, outside \[0, 10\] rad/s2",
        ),
        ([0.1, 0.2, {"uniform": [0.5, 1.0]}], "process must be 2 numbers or samplers"),
        ({"uniform": [0.1, 0.2]}, "process: a choice of tuples, or a list with samplers, is needed"),
        ({"choice": [[0.1, 0.2, 0.3]]}, "process must be 2 numbers"),
        ({"choice": [[0.1, 20.0]]}, "each of process must be at least 0, at most 10 rad/s2"),
    ],
)
def test_a_pair_that_is_not_allowed_is_named(value, words):
    with pytest.raises(fieldgym.SettingsError, match=words):
        gym.make("fieldgym/HeelStrike-v0", settings={"process": value})


def test_a_drawn_vehicle_is_what_its_filter_takes_for_known():
    """With five unknowns the others are the drawn preset's, also after a snapshot's restart."""
    settings = {"variant": "table2", "preset": {"choice": ["table1", "soft"]}, "decisions": 2}
    envs, fresh = (gym.make_vec("fieldgym/Excitation-v0", num_envs=ROWS, settings=settings) for _ in range(2))
    action = np.zeros((ROWS, 3), np.float32)
    known = ~np.isin(NAMES, ("inertia_x", "cg_y", "cg_z", "damping_pitch", "stiffness_pitch"))
    infos = [envs.reset(seed=1)[1], envs.step(action)[4]]
    fresh.reset(seed=9)
    fresh.set_state(envs.get_state())
    infos += [env.step(action)[4] for env in (envs, fresh) for _ in range(4)]  # into the next episode
    drawn = [info["privileged.settings.preset"].tolist() for info in infos]
    assert drawn[0] == drawn[2] == drawn[6]
    assert drawn[2] != drawn[3] == drawn[7]
    for info, presets in zip(infos, drawn, strict=True):
        for i, preset in enumerate(presets):
            np.testing.assert_array_equal(info["estimate.mean"][i][known], PRESETS[preset][known])
            np.testing.assert_array_equal(info["privileged.truth"][i], PRESETS[preset])


def test_each_camera_photographs_its_own_light():
    """Rows of images are the scalar environments' of what was drawn for them, also where one number is."""
    settings = {"dark_corner": [5.0, 0.0, {"uniform": [0.5, 5.0]}, 0.0], "light": {"choice": [0.5, 1.0]}}
    settings |= {"track": "straight"}
    envs = gym.make_vec("fieldgym/LineFollowingPixels-v1", num_envs=ROWS, settings=settings)
    images, info = envs.reset(seed=7)
    told = part(info, "privileged.settings")
    assert len(np.unique(told["dark_corner"][:, 2])) == ROWS
    assert len(np.unique(told["light"])) == 2
    action = np.zeros((ROWS, 1), np.float32)
    steps = [envs.step(action) for _ in range(3)]
    for i in range(ROWS):
        own = {"dark_corner": tuple(told["dark_corner"][i].tolist()), "light": float(told["light"][i])}
        twin = gym.make("fieldgym/LineFollowingPixels-v1", settings=settings | own).unwrapped
        np.testing.assert_array_equal(twin.reset(seed=7 + i)[0], images[i])
        for step in steps:
            np.testing.assert_array_equal(twin.step(action[i])[0], step[0][i])
