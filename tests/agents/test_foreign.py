"""Third-party environments, wrappers, policies and callbacks: trained in, evaluated, compared, watched."""

import re
import sys
from pathlib import Path

import gymnasium
import numpy as np
import onnx
import pandas as pd
import pytest
import yaml
from gymnasium.vector import AutoresetMode

from fieldagents.agent import Agent
from fieldagents.config import ConfigError, EnvironmentConfig, load_config
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.run import SpaceError
from fieldagents.learned.training import prepare, train
from fieldagents.policies.policy import PolicyError
from fieldagents.seeds import TEST_SEEDS
from fieldagents.watch import WatchError, watch
from fieldgym import find_task
from fieldgym.foreign import is_foreign
from fieldgym.sb3 import NativeVecEnv

THEIRS = '''
import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.policies import ActorCriticPolicy


class Cart(gymnasium.Env):
    """Reach zero: the action is what the place changes by, an episode ends near it or after some steps."""

    metadata = {"render_modes": ["rgb_array"]}

    def __init__(self, size=1.0, most=12, broken=False, render_mode=None):
        if broken:
            raise RuntimeError("the wheel is off")
        self.observation_space = Box(-np.inf, np.inf, (2,), np.float32)
        self.action_space = Box(-size, size, (1,), np.float32)
        self.most, self.render_mode = most, render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place, self.count = float(self.np_random.uniform(-3, 3)), 0
        return self._seen(), {"place": self.place}

    def step(self, action):
        assert self.count < self.most, "stepped after its end"
        self.place, self.count = self.place + float(action[0]), self.count + 1
        over = abs(self.place) < 0.05
        return self._seen(), -abs(self.place), over, self.count >= self.most, {"place": self.place}

    def render(self):
        return np.full((20, 20, 3), 128, np.uint8)

    def _seen(self):
        return np.array([self.place, self.count / 10], np.float32)


class Ladder(Cart):
    """The same with actions that can be counted."""

    def __init__(self, **options):
        super().__init__(**options)
        self.action_space = Discrete(3)

    def step(self, action):
        return super().step([float(action) - 1.0])


class Named(Cart):
    """Observations that are no array."""

    def __init__(self, **options):
        super().__init__(**options)
        self.observation_space = gymnasium.spaces.Dict({"place": Box(-np.inf, np.inf, (2,), np.float32)})

    def _seen(self):
        return {"place": super()._seen()}


class Shifted(gymnasium.ObservationWrapper):
    """Observations with something added."""

    def __init__(self, env, by):
        super().__init__(env)
        self.by = by

    def observation(self, observation):
        return observation + np.float32(self.by)


class Told(BaseCallback):
    """Writes down how often it was called."""

    def __init__(self, file, most=10**9):
        super().__init__()
        self.file, self.most = file, most

    def _on_step(self):
        with open(self.file, "a") as file:
            file.write(".")
        return self.n_calls < self.most


class Narrow(ActorCriticPolicy):
    """A policy of one's own."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options | {"net_arch": [5]})


for name, kind in {"Cart-v3": Cart, "Ladder-v0": Ladder, "Named-v0": Named, "NoVersion": Cart}.items():
    gymnasium.register(f"theirs/{name}" if name == "Named-v0" else name, kind)
'''
PPO = {"name": "small", "algorithm": "ppo", "steps": 256, "num_envs": 4, "network": {"hidden": [8]}}
PPO |= {"learner": {"n_steps": 16, "batch_size": 32}, "validation": {"every": 2, "episodes": 3}}
DOCS = Path(__file__).parents[2] / "docs"
CART = "theirs_for_test:Cart-v3"


@pytest.fixture(autouse=True)
def theirs(tmp_path, monkeypatch):
    """A module of a user's own that can be imported; what it registers is forgotten afterwards."""
    (tmp_path / "theirs_for_test.py").write_text(THEIRS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    before = set(gymnasium.registry)
    yield
    for name in set(gymnasium.registry) - before:
        del gymnasium.registry[name]
    sys.modules.pop("theirs_for_test", None)


def loaded(kind, **data):
    path = Path("config.yaml")
    path.write_text(yaml.safe_dump(data))
    return load_config(path, kind)


def trained(out, **data):
    return train(loaded(TrainConfig, **PPO | data), progress=False, out=Path(out))


def problems(**data):
    with pytest.raises(ConfigError) as error:
        loaded(TrainConfig, **PPO | data)
    return error.value.problems


@pytest.mark.every("name", ["Pendulum-v1", CART, "theirs_for_test:NoVersion", "a/B-v0", "m:a/B-v0"])
def test_names_of_environments_of_others(name):
    assert is_foreign(name)
    assert find_task(name).env_id == name


@pytest.mark.every("name", ["pendulum", "heel_strike", "cart.py", "cart.py:Cart", "extended.yaml"])
def test_names_that_are_not(name):
    assert not is_foreign(name)


def test_the_identifier_of_a_task_is_the_task():
    config = loaded(TrainConfig, **PPO, task="fieldgym/HeelStrike-v0")
    assert config.task == "heel_strike"


def test_a_policy_of_others_is_trained_and_compared_over_its_runs(tmp_path):
    wrappers = [{"theirs_for_test:Shifted": {"by": 0.5}}]
    environment = {"settings": {"most": 9}, "wrappers": wrappers}
    for seed in range(5):
        trained(tmp_path / "runs" / str(seed), task=CART, environment=environment, seed=seed)
    curve = pd.read_csv(tmp_path / "runs" / "0" / "curve.csv")
    assert curve["steps"].iloc[-1] == 256
    assert np.isfinite(curve["validation_episode_return"].iloc[-1])
    config = loaded(
        EvaluateConfig, name="e", task=CART, environments={"short": environment}, episodes=20,
        agents=["random", "still", str(tmp_path / "runs")], baseline="random",
    )  # fmt: skip
    summary = evaluate(config, tmp_path / "out")
    rows = {row.agent: row for row in summary.scenarios["short"]}
    assert rows[str(tmp_path / "runs")].runs == 5
    table = pd.read_parquet(tmp_path / "out" / "episodes.parquet")
    np.testing.assert_allclose(table["episode_return"], table["return"])
    assert table["steps"].max() == 9
    starts = np.array([abs(np.random.Generator(np.random.PCG64(s)).uniform(-3, 3)) for s in TEST_SEEDS[:20]])
    still = table[table["agent"] == "still"].sort_values("seed")
    np.testing.assert_allclose(still["return"], -9 * starts, rtol=1e-6)  # whoever stays pays nine times
    assert summary.environments["short"]["wrappers"] == wrappers


def test_more_training_is_better():
    """One of Gymnasium's own, learned far above chance within seconds."""
    learner = {"n_steps": 32, "batch_size": 256, "n_epochs": 10, "learning_rate": 3e-3}
    learned = {"num_envs": 8, "steps": 12_000, "learner": learner, "network": {"hidden": [32]}}
    folder = trained("cart", **learned, task="CartPole-v1", validation={"every": 10, "episodes": 10})
    scores = {
        name: run_episodes(
            make_agent(name, "CartPole-v1", {}).runs[0], "CartPole-v1", EnvironmentConfig(), TEST_SEEDS[:20]
        )["episode_return"].mean()
        for name in ("random", str(folder))
    }
    assert scores["random"] < 40
    assert scores[str(folder)] > 100


@pytest.mark.parametrize(
    ("algorithm", "learner", "more"),
    [
        ("sac", {"learning_starts": 40, "batch_size": 16, "buffer_size": 500}, {"round_updates": 10}),
        ("tqc", {"learning_starts": 40, "batch_size": 16, "buffer_size": 500}, {"round_updates": 10}),
        ("recurrent_ppo", {"n_steps": 16, "batch_size": 32}, {"policy": "MlpLstmPolicy"}),
        ("a2c", {"n_steps": 8}, {"stack": 2}),
    ],
)
def test_any_algorithm_learns_in_an_environment_of_others(algorithm, learner, more):
    folder = trained("run", task=CART, **{"algorithm": algorithm, "learner": learner, "steps": 128} | more)
    agent = make_agent(str(folder), CART, {}).runs[0]
    played = run_episodes(agent, CART, EnvironmentConfig(), TEST_SEEDS[:3])
    assert np.isfinite(played["return"]).all()


def test_actions_that_can_be_counted():
    task = "theirs_for_test:Ladder-v0"
    folder = trained("run", task=task)
    for name in (str(folder), "random", "still"):
        played = run_episodes(make_agent(name, task, {}).runs[0], task, EnvironmentConfig(), TEST_SEEDS[:4])
        assert (played["steps"] <= 12).all()


def test_observations_that_are_no_array_need_a_wrapper_which_the_message_names():
    task = "theirs_for_test:theirs/Named-v0"
    with pytest.raises(SpaceError, match=r"environment\.wrappers: \['gymnasium\.wrappers:FlattenObs") as said:
        trained("run", task=task)
    assert "Dict" in str(said.value)
    remedy = re.search(r"\['(.*)'\]", str(said.value))
    folder = trained("other", task=task, environment={"wrappers": [remedy[1]]})
    assert (folder / "run.json").is_file()


def test_wrappers_go_around_a_task_of_the_package_and_its_metrics_stay():
    settings = {"strides": 8}

    def played(*wrappers):
        environment = EnvironmentConfig(settings=settings, wrappers=wrappers)
        agent = make_agent("adaptive", "heel_strike", settings).runs[0]
        return run_episodes(agent, "heel_strike", environment, TEST_SEEDS[:4])

    plain = played()
    same, other = (played({"theirs_for_test:Shifted": {"by": by}}) for by in (0.0, 2.0))
    pd.testing.assert_frame_equal(plain, same)
    assert (plain["error_mm"] != other["error_mm"]).all()


def test_a_policy_trained_in_wrappers_around_a_task(tmp_path):
    environment = {"settings": {"strides": 8}, "wrappers": [{"theirs_for_test:Shifted": {"by": 1.0}}]}
    folder = trained(tmp_path / "run", task="heel_strike", environment=environment)
    assert yaml.safe_load((folder / "config.yaml").read_text())["environment"]["wrappers"]


def test_a_further_environment_has_the_wrappers_of_the_first():
    environment = {"wrappers": [{"theirs_for_test:Shifted": {"by": 1.0}}]}
    config = loaded(TrainConfig, **PPO, task=CART, environment=environment, also=[{"settings": {"most": 5}}])
    assert config.environments[1].wrappers == config.environments[0].wrappers


def test_callbacks_are_called_and_may_end_a_run():
    trained("run", task=CART, callbacks=[{"theirs_for_test:Told": {"file": "calls"}}])
    assert Path("calls").read_text() == "." * (256 // 4)  # once for a step of all four rows
    stop = [{"theirs_for_test:Told": {"file": "more", "most": 20}}]
    folder = trained("short", task=CART, callbacks=stop)
    assert len(Path("more").read_text()) == 20
    assert yaml.safe_load((folder / "run.json").read_text())["steps"] == 20 * 4


def test_a_policy_and_a_network_of_ones_own(tmp_path):
    folder = trained(tmp_path / "run", task=CART, policy="theirs_for_test:Narrow")
    model = onnx.load(folder / "policy.onnx")
    assert {5} <= {size for weights in model.graph.initializer for size in weights.dims}
    more = {"optimizer_class": "torch.optim:SGD"}
    config = loaded(TrainConfig, **PPO | {"network": {"more": more}}, task=CART)
    assert config.network.imported["optimizer_class"].__name__ == "SGD"


def test_a_resumed_run_goes_on_with_new_episodes(tmp_path):
    from fieldagents.learned.session import run_training

    config = loaded(TrainConfig, **PPO | {"steps": 512}, task=CART, checkpoint_every=1)
    prepare(config, tmp_path / "run")
    run_training(config, tmp_path / "run", lambda *_: None, until=128)
    begun = pd.read_csv(tmp_path / "run" / "curve.csv")
    assert begun["steps"].iloc[-1] == 128
    train(config, resume=tmp_path / "run", progress=False)
    curve = pd.read_csv(tmp_path / "run" / "curve.csv")
    pd.testing.assert_frame_equal(curve.iloc[: len(begun)][["steps"]], begun[["steps"]])
    assert curve["steps"].iloc[-1] == 512


def test_where_the_generators_stand_decides_the_next_episodes():
    rows = NativeVecEnv(find_task(CART).make_vec(2, autoreset_mode=AutoresetMode.DISABLED), seed=1)
    rows.reset()
    kept = rows.get_state()
    wanted = rows.reset()
    rows.reset()
    rows.set_state(kept)
    np.testing.assert_array_equal(rows.reset(), wanted)
    assert not rows.exact


def test_it_is_watched_in_its_wrappers_to_its_own_end(tmp_path):
    environment = EnvironmentConfig(wrappers=({"gymnasium.wrappers:TimeLimit": {"max_episode_steps": 4}},))
    seen = watch(CART, "still", environment, seed=3, film=tmp_path / "film.gif")
    assert (seen.steps, seen.finished) == (4, True)
    assert (tmp_path / "film.gif").is_file()


def test_what_cannot_be_drawn_is_said(tmp_path):
    gymnasium.register("Blind-v0", "gymnasium.envs.toy_text.blackjack:BlackjackEnv")
    environment = EnvironmentConfig(wrappers=("gymnasium.wrappers:FlattenObservation",))
    watch("Blind-v0", "still", environment, film=tmp_path / "film.gif")
    import theirs_for_test

    theirs_for_test.Cart.metadata = {"render_modes": []}
    with pytest.raises(WatchError, match="cannot be drawn as 'rgb_array'; it knows no picture"):
        watch(CART, "still", EnvironmentConfig(), film=tmp_path / "film.gif")


def test_a_policy_that_does_not_fit_is_refused_before_the_first_episode(tmp_path):
    folder = trained(tmp_path / "run", task=CART)
    for act in (
        lambda: run_episodes(
            make_agent(str(folder), "Pendulum-v1", {}).runs[0], "Pendulum-v1", EnvironmentConfig(), range(2)
        ),
        lambda: watch("Pendulum-v1", str(folder), EnvironmentConfig(), film=tmp_path / "film.gif"),
    ):
        with pytest.raises(PolicyError, match=r"made for observations of shape \(2,\), the env.* \(3,\)"):
            act()


class Peeking(Agent):
    """Keeps what it is told."""

    def __init__(self, settings):
        del settings
        self.name, self.told = "peeking", []

    def act(self, observation, info):
        self.told.append(dict(info))
        return np.zeros((len(observation), 1), np.float32)


def test_an_agent_that_sees_observations_is_told_nothing_else():
    agent = Peeking({})
    run_episodes(agent, CART, EnvironmentConfig(), TEST_SEEDS[:2])
    assert agent.told
    assert not any(agent.told)


@pytest.mark.nightly
def test_the_config_of_the_docs_is_trained_and_evaluated(tmp_path):
    blocks = (DOCS / "training.md").read_text().split("```yaml\n")
    (block,) = (one.split("```")[0] for one in blocks if "task: Pendulum-v1" in one)
    Path("docs.yaml").write_text(block)
    short = ["steps=480", "learner.learning_starts=80", "round_updates=20"]
    config = load_config(Path("docs.yaml"), TrainConfig, short)
    assert config.steps < load_config(Path("docs.yaml"), TrainConfig).steps
    folder = train(config, progress=False, out=tmp_path / "run")
    environments = {"own": config.environment.model_dump(mode="json")}
    compared = loaded(
        EvaluateConfig, name="e", task="Pendulum-v1", environments=environments, episodes=3,
        agents=["still", str(folder)], baseline="still",
    )  # fmt: skip
    evaluate(compared, tmp_path / "out")
    assert set(pd.read_parquet(tmp_path / "out" / "episodes.parquet")["steps"]) == {100}


@pytest.mark.every(
    ("change", "place", "message"),
    [
        ({"task": "Pendulum-v9"}, "task", "it provides versioned environments"),
        ({"task": "Pendulu-v1"}, "task", "Did you mean: `Pendulum`"),
        ({"task": "nowhere_at_all:Cart-v0"}, "task", "cannot be imported: ModuleNotFoundError"),
        ({"task": "theirs_for_test:Cart-v9"}, "task", "Cart"),
        ({"environment": {"settings": {"sise": 2}}}, "environment.settings", "unexpected keyword .*'sise'"),
        ({"environment": {"settings": {"broken": True}}}, "environment.settings", "the wheel is off"),
        ({"environment": {"reality": {"lag": {"t": 1}}}}, "environment.reality", "leave the reality out"),
        ({"environment": {"wrappers": ["theirs_for_test:Shifted"]}}, "environment.wrappers.0", "'by'"),
        ({"environment": {"wrappers": ["theirs_for_test:Shiftd"]}}, "environment.wrappers.0", "imported"),
        ({"environment": {"wrappers": ["Shifted"]}}, "environment.wrappers.0", "is not module:Class"),
        ({"environment": {"wrappers": [3]}}, "environment.wrappers.0", "argument: value"),
        ({"environment": {"wrappers": ["builtins:type"]}}, "environment.wrappers.0", "no environment"),
        (
            {"environment": {"wrappers": ["gymnasium.wrappers:GrayscaleObservation"]}},
            "environment.wrappers.0",
            "cannot be put around",
        ),
        ({"callbacks": ["theirs_for_test:Cart"]}, "callbacks.0", "inherits from .*BaseCallback"),
        ({"callbacks": ["theirs_for_test:Told"]}, "callbacks.0", "'file'"),
        ({"policy": "MlpPolcy"}, "policy", "did you mean 'MlpPolicy'"),
        ({"policy": "theirs_for_test:Cart"}, "policy", "inherits from .*BasePolicy"),
        ({"network": {"more": {"optimizer_class": "torch:No"}}}, "network.more.optimizer_class", "imported"),
    ],
)
def test_a_mistake_is_said_with_its_place_and_what_would_be_right(change, place, message):
    (said,) = problems(**{"task": CART} | change)
    assert re.search(rf"config\.yaml:\d+: {re.escape(place)}: ", said)
    assert re.search(message, said, re.IGNORECASE), said
