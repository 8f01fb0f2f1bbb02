"""A policy that imitates acts as its teacher does, from what it may see alone."""

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.run import SpaceError
from fieldagents.learned.training import train
from fieldagents.policies.policy import OnnxAgent
from fieldagents.seeds import TUNING_SEEDS

STUDENT = {
    "name": "student",
    "task": "heel_strike",
    "steps": 0,
    "num_envs": 16,
    "environment": {"settings": {"strides": 40}},
    "imitate": {"teacher": "adaptive", "rounds": 6, "steps": 40, "epochs": 20, "batch_size": 128},
    "network": {"hidden": [32]},
}


@pytest.mark.nightly
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_student_scores_as_its_teacher_does(tmp_path, algorithm):
    """The teacher is a linear rule of the observation, so nothing hinders the student from being it."""
    config = TrainConfig(**STUDENT, algorithm=algorithm)
    run = train(config, progress=False, out=tmp_path / "run")
    student = OnnxAgent(run / "policy.onnx")
    (teacher,) = make_agent("adaptive", "heel_strike", {}).runs
    (plain,) = make_agent("fixed_tuned", "heel_strike", {}).runs
    environment = EnvironmentConfig(settings={"strides": 40})
    errors = [
        run_episodes(agent, "heel_strike", environment, TUNING_SEEDS[:40])["error_mm"].mean()
        for agent in (student, teacher, plain)
    ]
    assert errors[0] < errors[1] + 0.15 * (errors[2] - errors[1])
    rng = np.random.default_rng(0)
    seen = rng.uniform(0, 1, (50, 6)).astype(np.float32)
    assert not np.allclose(student.act(seen, {})[0], student.act(seen, {})[1])  # it is no constant


@pytest.mark.nightly
def test_a_memory_makes_up_for_what_the_student_is_not_told(tmp_path):
    """A teacher that knows the line's place is followed more closely from ten strides than from one."""
    offsets = []
    for stack in (1, 10):
        config = TrainConfig(
            name="student",
            task="line_following",
            steps=0,
            num_envs=32,
            stack=stack,
            environment={"settings": {"track": "oval"}},
            imitate={
                "teacher": "ceiling",
                "rounds": 10,
                "steps": 60,
                "epochs": 6,
                "batch_size": 256,
                "learning_rate": 3e-3,
            },
            validation={"episodes": 100},
        )
        run = train(config, progress=False, out=tmp_path / str(stack))
        agent = OnnxAgent(run / "policy.onnx")
        table = run_episodes(agent, "line_following", config.environment, TUNING_SEEDS[:60])
        offsets.append(table["mean_offset"].mean())
    assert offsets[1] < 0.95 * offsets[0]


def test_what_cannot_imitate_is_refused(tmp_path):
    with pytest.raises(ValueError, match="without steps there must be somebody to imitate"):
        TrainConfig(**{**STUDENT, "imitate": None})
    with pytest.raises(ValueError, match=r"no agent 'adaptiv' .did you mean 'adaptive'"):
        TrainConfig(**{**STUDENT, "imitate": {"teacher": "adaptiv"}})
    recurrent = TrainConfig(**STUDENT, algorithm="recurrent_ppo", policy="MlpLstmPolicy")
    with pytest.raises(SpaceError, match="not by recurrence"):
        train(recurrent, progress=False, out=tmp_path / "run")


def test_the_critic_learns_before_the_policy_moves(tmp_path):
    """After imitation the first updates do not change what the policy would do, and the later ones do."""
    config = TrainConfig(
        **{
            **STUDENT,
            "steps": 16 * 8 * 4,
            "imitate": {**STUDENT["imitate"], "rounds": 1, "epochs": 1, "critic_updates": 3},
            "learner": {"n_steps": 8, "batch_size": 64, "n_epochs": 4},
            "validation": {"every": 4, "episodes": 4},
        }
    )
    curve = pd.read_csv(train(config, progress=False, out=tmp_path / "run") / "curve.csv")
    moved = curve["approx_kl"].to_numpy()[1:]
    assert (moved[:3] == 0).all()
    assert moved[3] > 0
    assert curve["explained_variance"].to_numpy()[4] > curve["explained_variance"].to_numpy()[1]
