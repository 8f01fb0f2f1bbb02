"""What holds for every registered environment of fieldgym."""

import copy
import hashlib
import importlib.util
import json
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import fieldgym
import fieldgym.base
from fieldmodels.settings import declared

IDS = sorted(task.env_id for task in fieldgym.TASKS.values())
every_environment = pytest.mark.every("env_id", IDS)
needs_vector = pytest.mark.every("env_id", [i for i in IDS if gym.spec(i).vector_entry_point])


def equal(a, b):
    """Whether two nested structures of arrays are equal to the bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)
    if isinstance(a, np.ndarray) and a.dtype == object:
        return b.dtype == object and len(a) == len(b) and all(map(equal, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return type(a) is type(b) and (a == b or (a != a and b != b))  # NaN is equal to NaN here


def rollout(env, steps, action_seed=7):
    """Observations, rewards, flags and infos of random actions, resetting where an episode ends."""
    env.action_space.seed(action_seed)
    trace = []
    for _ in range(steps):
        step = env.step(env.action_space.sample())
        trace.append(step)
        if step[2] or step[3]:
            trace.append(env.reset())
    return trace


def digest(env_id):
    env = gym.make(env_id)
    sha = hashlib.sha256()
    observation, _ = env.reset(seed=11)
    sha.update(observation.tobytes())
    env.action_space.seed(5)
    for _ in range(30):
        observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        sha.update(observation.tobytes() + np.float64(reward).tobytes())
        if terminated or truncated:
            env.reset()
    return sha.hexdigest()


def save_state(state, folder):
    """Write a state without pickle: arrays as .npy, the rest as JSON."""
    folder.mkdir()
    arrays = {key: value for key, value in state.items() if isinstance(value, np.ndarray)}
    np.savez(folder / "state.npz", **arrays)
    rest = {key: value for key, value in state.items() if key not in arrays}
    (folder / "state.json").write_text(json.dumps(rest))


def continued(env_id, folder):
    """Digest of the steps that follow a saved state."""
    with np.load(folder / "state.npz", allow_pickle=False) as arrays:
        state = dict(arrays) | json.loads((folder / "state.json").read_text())
    env = gym.make(env_id).unwrapped
    env.set_state(state)
    sha = hashlib.sha256()
    for step in rollout(env, 40):
        sha.update(repr(step).encode() + step[0].tobytes())
    return sha.hexdigest()


def both(env_id, folder):
    """Digest of a fresh environment and of one that continues a state saved in a folder."""
    try:
        return [digest(env_id), continued(env_id, folder / env_id.replace("/", "-"))]
    except Exception as error:
        return [repr(error), repr(error)]


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """What another process makes of every environment, and the folder of the states that it continued."""
    folder = tmp_path_factory.mktemp("states")
    for env_id in IDS:
        env = gym.make(env_id).unwrapped
        env.reset(seed=21)
        rollout(env, 5)
        save_state(env.get_state(), folder / env_id.replace("/", "-"))
    code = (
        "import importlib.util, json\n"
        f"spec = importlib.util.spec_from_file_location('shared', {__file__!r})\n"
        "module = importlib.util.module_from_spec(spec)\n"
        "spec.loader.exec_module(module)\n"
        f"folder = module.Path({str(folder)!r})\n"
        "print(json.dumps({env_id: module.both(env_id, folder) for env_id in module.IDS}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1]), folder


def test_every_task_is_registered():
    assert IDS
    assert {task.env_id for task in fieldgym.TASKS.values()} <= set(IDS)


def test_registering_twice_is_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fieldgym.register()


@every_environment
def test_checker_of_gymnasium_is_silent(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, render_mode="rgb_array", disable_env_checker=True).unwrapped)


@every_environment
def test_checker_of_stable_baselines3_is_silent(env_id):
    from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env_for_sb3(gym.make(env_id, disable_env_checker=True).unwrapped)


@every_environment
def test_docstring_is_a_docs_page(env_id):
    page = gym.make(env_id).unwrapped.__doc__
    for heading in (
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Starting State",
        "Episode End",
        "Arguments",
        "Matches, deviates, assumed",
        "Version History",
    ):
        assert f"## {heading}" in page


@pytest.mark.every("task", fieldgym.TASKS.values())
def test_docs_page_is_up_to_date(task):
    """Renew with ``python docs/environments.py``."""
    folder = Path(__file__).parents[2] / "docs"
    spec = importlib.util.spec_from_file_location("docs_environments", folder / "environments.py")
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    assert (folder / "environments" / f"{task.name}.md").read_text() == generator.page(task)


@every_environment
def test_bounds_and_rewards_hold_in_random_rollouts(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=3)
    for step in rollout(env, 250):
        assert step[0] in env.observation_space
        if len(step) == 5:
            assert np.isfinite(step[1])


@every_environment
def test_action_that_is_not_a_number_is_refused(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    with pytest.raises(gym.error.InvalidAction, match="finite"):
        env.step(np.full(env.action_space.shape, np.nan, dtype=np.float32))
    with pytest.raises(gym.error.InvalidAction, match="shape"):
        env.step(np.zeros(17, dtype=np.float32))


@every_environment
def test_step_before_reset_is_refused(env_id):
    env = gym.make(env_id).unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.step(env.action_space.sample())


@every_environment
def test_unknown_option_of_a_reset_is_refused(env_id):
    for env in (gym.make(env_id).unwrapped, gym.make_vec(env_id, num_envs=2)):
        with pytest.raises(ValueError, match="not 'nonsense'"):
            env.reset(seed=0, options={"nonsense": 1})
        env.reset(seed=0, options={})


@every_environment
def test_a_step_after_the_end_warns(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    while True:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            break
    ended = env.get_state()
    with pytest.warns(UserWarning, match="episode is over"):
        env.step(env.action_space.sample())
    env.set_state(ended)
    with pytest.warns(UserWarning, match="episode is over"):
        env.step(env.action_space.sample())
    env.reset()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env.step(env.action_space.sample())


@needs_vector
def test_what_a_step_returns_is_never_written_again(env_id):
    env = gym.make_vec(env_id, num_envs=3)
    kept = [env.reset(seed=0)]
    env.action_space.seed(0)
    kept += [env.step(env.action_space.sample())]
    copies = copy.deepcopy(kept)
    for _ in range(60):
        env.step(env.action_space.sample())
    for ours, before in zip(kept, copies, strict=True):
        assert equal(dict(enumerate(ours)), dict(enumerate(before)))


@every_environment
def test_unknown_setting_is_named_with_the_nearest_known_one(env_id):
    field = next(iter(gym.make(env_id).unwrapped.settings.__dataclass_fields__))
    with pytest.raises(fieldgym.SettingsError, match=f"did you mean '{field}'"):
        gym.make(env_id, settings={f"{field}x": 1})


@every_environment
def test_all_wrong_settings_are_reported_at_once(env_id):
    with pytest.raises(fieldgym.SettingsError) as error:
        gym.make(env_id, settings={"nonsense_a": 1, "nonsense_b": 2})
    assert "nonsense_a" in str(error.value)
    assert "nonsense_b" in str(error.value)


@every_environment
def test_true_and_false_are_no_numbers(env_id):
    settings = type(gym.make(env_id).unwrapped.settings)
    numbers = [one for one in declared(settings).values() if one.items or one.type in (int, float)]
    assert numbers
    for one in numbers:
        value = [True] * len(one.items) if one.items else True
        with pytest.raises(fieldgym.SettingsError, match=f"{one.name} must be a number, not "):
            gym.make(env_id, settings={one.name: value})


@every_environment
def test_equal_seeds_and_states_give_equal_bits_in_another_process(env_id, elsewhere):
    found, folder = elsewhere
    assert found[env_id] == both(env_id, folder)
    assert not any("Error" in one for one in found[env_id])


@every_environment
def test_restored_state_continues_to_the_bit(env_id):
    env = gym.make(env_id).unwrapped
    env.reset(seed=21)
    rollout(env, 5)
    state = env.get_state()
    first = rollout(env, 40)
    env.set_state(state)
    assert all(
        equal(tuple_as_dict(a), tuple_as_dict(b)) for a, b in zip(first, rollout(env, 40), strict=True)
    )
    fresh = gym.make(env_id).unwrapped
    fresh.set_state(state)
    assert all(
        equal(tuple_as_dict(a), tuple_as_dict(b)) for a, b in zip(first, rollout(fresh, 40), strict=True)
    )


@every_environment
def test_what_is_no_snapshot_is_refused(env_id):
    with pytest.raises(ValueError, match="get_state"):
        gym.make(env_id).unwrapped.set_state({"nothing": 0})


def tuple_as_dict(step):
    return dict(enumerate(step))


@every_environment
def test_rgb_array_has_the_promised_shape(env_id):
    env = gym.make(env_id, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    before = env.render()
    env.step(env.action_space.sample())
    after = env.render()
    assert before.shape == after.shape == (540, 960, 3)
    assert after.dtype == np.uint8
    assert (before != after).any()
    env.close()


def test_other_environments_that_quit_pygame_leave_pictures_as_they_were():
    """In a process of its own: a font kept over the end of pygame crashes Python itself."""
    code = (
        "import gymnasium as gym, numpy as np, fieldgym, pygame\n"
        "env = gym.make('fieldgym/Excitation-v0', render_mode='rgb_array')\n"
        "env.reset(seed=0)\n"
        "before = env.render()\n"
        "for begins_again in (False, True):\n"
        "    other = gym.make('Pendulum-v1', render_mode='rgb_array')\n"
        "    other.reset(seed=0), other.render(), other.close()\n"
        "    if begins_again:\n"
        "        pygame.init()\n"
        "    np.testing.assert_array_equal(env.render(), before)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@every_environment
def test_human_mode_opens_and_closes_a_window(env_id):
    env = gym.make(env_id, render_mode="human").unwrapped
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
    env.close()


@every_environment
def test_unknown_render_mode_is_refused(env_id):
    with pytest.warns(UserWarning, match="render_mode"), pytest.raises(ValueError, match="render_mode"):
        gym.make(env_id, render_mode="ascii")


@pytest.mark.every("mode", AutoresetMode)
@needs_vector
def test_native_vector_equals_scalar_environments_to_the_bit(env_id, mode):
    native = gym.make_vec(env_id, num_envs=3, autoreset_mode=mode)
    scalar = gym.make_vec(
        env_id, num_envs=3, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}
    )
    assert native.metadata["autoreset_mode"] is mode
    assert native.action_space == scalar.action_space
    assert native.observation_space == scalar.observation_space
    assert equal(dict(enumerate(native.reset(seed=42))), dict(enumerate(scalar.reset(seed=42))))
    native.action_space.seed(1)
    for _ in range(230):
        actions = native.action_space.sample()
        a, b = native.step(actions), scalar.step(actions)
        for ours, theirs in zip(a, b, strict=True):
            assert equal(ours, theirs)
        ended = a[2] | a[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            with pytest.raises(gym.error.ResetNeeded, match="reset_mask"):
                native.step(actions)
            mask = {"reset_mask": ended}
            for ours, theirs in zip(
                native.reset(options=dict(mask)), scalar.reset(options=mask), strict=True
            ):
                assert equal(ours, theirs)


def form(info):
    """Type, dtype and shape of an info's entries, none of them nested."""
    assert not any(isinstance(value, dict) for value in info.values())
    return {key: (type(value), np.asarray(value).dtype, np.shape(value)) for key, value in info.items()}


@every_environment
def test_an_entry_of_info_keeps_its_dtype_and_shape_from_reset_on(env_id):
    """And is one number or array: what libraries that store an info beside observations can take."""
    for env in (gym.make(env_id), gym.make_vec(env_id, num_envs=3)):
        _, info = env.reset(seed=1)
        first = form(info)
        env.action_space.seed(1)
        for _ in range(20):
            *_, info = env.step(env.action_space.sample())
            now = form(info)
            assert now.keys() >= first.keys()
            assert {key: now[key] for key in first} == first
            first = now


@needs_vector
def test_a_mode_of_resets_is_told_by_name_or_refused(env_id):
    assert (
        gym.make_vec(env_id, autoreset_mode="SameStep").metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    )
    with pytest.raises(ValueError, match="at once"):
        gym.make_vec(env_id, autoreset_mode="at once")


@needs_vector
def test_a_row_does_not_depend_on_the_batch(env_id):
    small = gym.make_vec(env_id, num_envs=2)
    large = gym.make_vec(env_id, num_envs=9)
    small.reset(seed=5)
    large.reset(seed=5)
    large.action_space.seed(0)
    for _ in range(10):
        actions = large.action_space.sample()
        a, b = small.step(actions[:2]), large.step(actions)
        assert np.array_equal(a[0], b[0][:2])
        assert np.array_equal(a[1], b[1][:2])


@needs_vector
def test_a_batch_of_another_size_is_refused(env_id):
    envs = gym.make_vec(env_id, num_envs=4)
    envs.reset(seed=0)
    with pytest.raises(gym.error.InvalidAction, match=r"shape \(4, "):
        envs.step(envs.action_space.sample()[:3])


@needs_vector
def test_vector_state_continues_to_the_bit(env_id):
    env = gym.make_vec(env_id, num_envs=4)
    env.reset(seed=8)
    env.action_space.seed(2)
    actions = [env.action_space.sample() for _ in range(30)]
    for action in actions[:10]:
        env.step(action)
    state = env.get_state()
    first = [env.step(action) for action in actions]
    env.set_state(state)
    for ours, action in zip(first, actions, strict=True):
        assert equal(dict(enumerate(ours)), dict(enumerate(env.step(action))))
    fresh = gym.make_vec(env_id, num_envs=4)
    fresh.set_state(state)
    for ours, action in zip(first, actions, strict=True):
        assert equal(dict(enumerate(ours)), dict(enumerate(fresh.step(action))))
    with pytest.raises(ValueError, match="num_envs"):
        gym.make_vec(env_id, num_envs=3).set_state(state)


@needs_vector
def test_vector_frames_are_one_for_each_environment(env_id):
    env = gym.make_vec(env_id, num_envs=2, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    frames = env.render()
    assert len(frames) == 2
    assert frames[0].shape == (540, 960, 3)
    env.close()


@needs_vector
def test_making_a_vector_environment_warns_of_nothing(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make_vec(env_id, num_envs=2)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


@needs_vector
def test_vector_wrappers_of_gymnasium_work(env_id):
    env = gym.wrappers.vector.RecordEpisodeStatistics(gym.make_vec(env_id, num_envs=2))
    env.reset(seed=0)
    env.action_space.seed(0)
    total = 0.0
    for _ in range(1000):
        _, reward, _, _, info = env.step(env.action_space.sample())
        total += reward[0]
        if "episode" in info and info["_episode"][0]:
            break
    assert info["episode"]["r"][0] == pytest.approx(total, rel=1e-12)


@needs_vector
def test_a_reset_of_some_rows_begins_these_and_leaves_the_others_as_they_are(env_id):
    count, mask = 4, np.array([False, True, False, True])
    envs = gym.make_vec(env_id, count, vectorization_mode="vector_entry_point").unwrapped
    alone = [gym.make(env_id).unwrapped for _ in range(count)]
    with pytest.raises(fieldgym.base.ResetNeeded):
        envs.reset(seed=5, options={"reset_mask": mask})
    envs.reset(seed=5)
    for i, env in enumerate(alone):
        env.reset(seed=5 + i)
    envs.action_space.seed(1)
    for step in range(8):
        actions = envs.action_space.sample()
        observation, reward, terminated, truncated, _ = envs.step(actions)
        singles = [env.step(action) for env, action in zip(alone, actions, strict=True)]
        assert equal(observation, np.stack([one[0] for one in singles]))
        assert equal(reward, np.array([one[1] for one in singles]))
        ended = terminated | truncated
        begin = ended if ended.any() else mask
        if step in (2, 5) or ended.any():
            after, info = envs.reset(options={"reset_mask": begin})
            first = [env.reset() if begin[i] else None for i, env in enumerate(alone)]
            for i in range(count):
                assert equal(after[i], observation[i] if first[i] is None else first[i][0])
            assert all(equal(flags, begin) for key, flags in info.items() if key.startswith("_"))
    for wrong in (mask.astype(int), mask[:3], np.zeros(count, dtype=bool)):
        with pytest.raises(ValueError, match="reset_mask"):
            envs.reset(options={"reset_mask": wrong})


@pytest.mark.every("name", ["HeelStrike", "Excitation", "UavRoute"])
def test_threads_change_no_bit(name):
    """Five rows on three threads: shares of one, two and two; an episode begins in between."""
    env_id = next(i for i in gym.registry if i.startswith(f"fieldgym/{name}-v"))
    short = {"HeelStrike": {"strides": 3}, "Excitation": {"decisions": 3}, "UavRoute": {"max_legs": 3}}[name]
    one, three = (gym.make_vec(env_id, num_envs=5, settings=short, threads=n) for n in (1, 3))
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(one.reset(seed=0)[0], three.reset(seed=0)[0])
    for _ in range(6):
        action = rng.uniform(-1, 1, one.action_space.shape).astype(np.float32)
        for mine, other in zip(one.step(action)[:4], three.step(action)[:4], strict=True):
            np.testing.assert_array_equal(mine, other)
    with pytest.raises(ValueError, match="threads=0"):
        gym.make_vec(env_id, num_envs=5, threads=0)
