"""The replay buffer: what is drawn is real, what follows it is what followed, returns are n-step returns."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.learned.replay import RealReplayBuffer

STEPS, ENVS, LENGTH = 200, 3, 7
GAMMA = 0.9


class Counter:
    """Stands in for the environments: says which of them only reset in the last step."""

    def __init__(self) -> None:
        self.late_resets = np.zeros(ENVS, dtype=bool)


def filled(rows: int, n_steps: int = 1) -> RealReplayBuffer:
    """Episodes of 7 steps; an observation names episode, step and environment; every 2nd is truncated."""
    counter = Counter()
    box = gymnasium.spaces.Box(-1e6, 1e6, (3,), np.float32)
    buffer = RealReplayBuffer(
        rows * ENVS + 1,
        box,
        gymnasium.spaces.Box(-1, 1, (1,), np.float32),
        device="cpu",
        n_envs=ENVS,
        environment=counter,
        rng=np.random.default_rng(0),
        n_steps=n_steps,
        gamma=GAMMA,
    )
    columns = np.arange(ENVS)
    episode, step = np.zeros(ENVS, int), columns.copy()  # the environments' episodes end at other times
    for _ in range(STEPS):
        late = step == LENGTH
        counter.late_resets = late
        before = np.stack([episode, step, columns], axis=1).astype(np.float32)
        episode, step = np.where(late, episode + 1, episode), np.where(late, 0, step + 1)
        after = np.stack([episode, step, columns], axis=1).astype(np.float32)
        done = ~late & (step == LENGTH)
        infos = [{"TimeLimit.truncated": bool(d and e % 2)} for d, e in zip(done, episode, strict=True)]
        reward = np.where(late, -1e6, step)
        buffer.add(before, after, np.zeros((ENVS, 1), np.float32), reward, done, infos)
    return buffer


@pytest.mark.parametrize("rows", [STEPS + 5, 50])
@pytest.mark.parametrize("n_steps", [1, 3])
def test_what_is_drawn_is_what_happened(rows, n_steps):
    """Before the ring is full, and after it has been written several times."""
    buffer = filled(rows, n_steps)
    batch = buffer.sample(4000)
    (episode, step, column), (later, last, same) = (
        part.numpy().astype(int).T for part in (batch.observations, batch.next_observations)
    )
    assert (step < LENGTH).all()  # never a late reset
    assert (episode == later).all()
    assert (column == same).all()
    taken = last - step
    assert set(taken) <= set(range(1, n_steps + 1))
    time = later * (LENGTH + 1) + last
    newest = np.array([time[column == one].max() for one in range(ENVS)])
    assert ((taken == n_steps) | (last == LENGTH) | (time == newest[column])).all()
    rewards = np.array(
        [sum(GAMMA**k * (s + 1 + k) for k in range(t)) for s, t in zip(step, taken, strict=True)]
    )
    np.testing.assert_allclose(batch.rewards.numpy()[:, 0], rewards, rtol=1e-5)
    np.testing.assert_allclose(batch.discounts.numpy()[:, 0], GAMMA**taken, rtol=1e-5)
    np.testing.assert_array_equal(batch.dones.numpy()[:, 0], (last == LENGTH) & (later % 2 == 0))


def test_every_real_step_that_is_kept_is_drawn_equally_often():
    """Chi-squared over some 130 steps and 40 000 draws; false alarm once in 1000."""
    from scipy import stats

    buffer = filled(50)
    batch = buffer.sample(40_000)
    found = np.unique(batch.observations.numpy(), axis=0, return_counts=True)[1]
    rows = np.arange(50) != buffer.pos
    assert len(found) == buffer._real[rows].sum()
    assert stats.chisquare(found).pvalue > 1e-3


def test_observations_are_normalised_by_the_statistics_of_the_draw():
    buffer = filled(STEPS + 5)
    envs = gymnasium.make_vec("CartPole-v1", num_envs=ENVS, vectorization_mode="vector_entry_point")
    from fieldagents.learned.vector import NativeVecEnv

    normaliser = VecNormalize(NativeVecEnv(envs, seed=0), clip_obs=5.0)
    normaliser.obs_rms.mean, normaliser.obs_rms.var = np.array([1.0, 2.0, 3.0]), np.full(3, 4.0)
    buffer._rng = np.random.default_rng(5)
    raw = buffer.sample(100)
    buffer._rng = np.random.default_rng(5)
    drawn = buffer.sample(100, env=normaliser)
    expected = np.clip((raw.observations.numpy() - [1, 2, 3]) / 2, -5, 5)
    np.testing.assert_allclose(drawn.observations.numpy(), expected, rtol=1e-5)


@pytest.mark.parametrize("rows", [STEPS + 5, 50])
def test_a_restored_buffer_draws_the_same(rows):
    buffer = filled(rows)
    state = buffer.get_state()
    other = filled(rows)
    other.reset()
    for array in other._arrays().values():
        array[:] = 0
    other.set_state(state)
    for one in (buffer, other):
        one._rng = np.random.default_rng(9)
    for left, right in zip(buffer.sample(500), other.sample(500), strict=True):
        np.testing.assert_array_equal(left, right)


class Line(gymnasium.vector.VectorEnv):
    """Points on a line that are pushed and shall be at zero; ten steps an episode; resets one step late."""

    metadata = {"autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, n: int) -> None:
        self.num_envs = n
        self.single_observation_space = gymnasium.spaces.Box(-3, 3, (1,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-2, 2, (1,), np.float32)
        self._place, self._count = np.zeros(n), np.zeros(n, dtype=int)

    def reset(self, *, seed=None, options=None):
        self._rng = np.random.default_rng(seed)
        self._place, self._count = self._rng.uniform(-2, 2, self.num_envs), np.zeros(self.num_envs, dtype=int)
        return self._place[:, None].astype(np.float32), {}

    def step(self, actions):
        late = self._count == 10
        moved = np.clip(self._place + actions[:, 0], -3, 3)
        self._place = np.where(late, self._rng.uniform(-2, 2, self.num_envs), moved)
        self._count = np.where(late, 0, self._count + 1)
        reward = np.where(late, 0.0, -(self._place**2))
        over = self._count == 10
        return self._place[:, None].astype(np.float32), reward, np.zeros_like(over), over, {}


def test_sac_learns_where_to_go_through_the_adapter():
    from stable_baselines3.common.logger import configure

    from fieldagents.learned.config import TrainConfig
    from fieldagents.learned.export import to_onnx
    from fieldagents.learned.session import make_run
    from fieldagents.learned.vector import NativeVecEnv
    from fieldagents.policies.policy import OnnxAgent

    section = {
        "learning_starts": 200,
        "gradient_steps": 4,
        "batch_size": 64,
        "learning_rate": 3e-3,
        "gamma": 0.5,
    }
    config = TrainConfig(
        name="line", task="heel_strike", algorithm="sac", steps=1200, num_envs=8, sac=section,
        network={"hidden": [16], "activation": "relu"},
    )  # fmt: skip
    run = make_run(config, NativeVecEnv(Line(8), seed=0))
    run.model.set_logger(configure(None, []))
    run.learn(config.steps, None, fresh=True)
    agent = OnnxAgent(to_onnx(run.policy, run.normaliser, "test"))
    places = np.linspace(-1.8, 1.8, 50, dtype=np.float32)[:, None]
    left = places + agent.act(places, {})
    assert np.abs(left).mean() < 0.45  # 0.9 without moving, 0.2 as a rule
