"""The search by flying: it arrives unseen, about as short as polished legs, whatever its neighbours do."""

import gymnasium
import numpy as np
import pytest

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import get_task
from fieldagents.tasks.uav_route.rollout import RolloutSearch
from fieldmodels.model import ModelError

UNSEEN = {"lock_loss": False}
SEEDS = TUNING_SEEDS[5000:5030]


@pytest.mark.nightly
def test_it_arrives_wherever_there_is_a_way_and_is_never_seen():
    table = run_episodes(RolloutSearch(UNSEEN), "uav_route", EnvironmentConfig(settings=UNSEEN), SEEDS)
    assert table["success"].all()
    assert (table["time_over"] == 0).all()
    assert table["length_ratio"].mean() < 1.045
    assert (table["length_ratio"] > 0.998).all()  # the bound is one, but for what a bank hides


def test_it_is_about_as_short_as_the_program_with_polished_legs():
    environment = EnvironmentConfig(settings=UNSEEN)
    legs = get_task("uav_route").agents["legs"].make(UNSEEN)
    mine, theirs = (
        run_episodes(agent, "uav_route", environment, SEEDS[:6])["path_length"].to_numpy()
        for agent in (RolloutSearch(UNSEEN), legs)
    )
    assert (mine / theirs).mean() < 1.01


def test_a_wider_margin_keeps_farther_off():
    environment = EnvironmentConfig(settings=UNSEEN)
    near, far = (
        run_episodes(RolloutSearch(UNSEEN, margin=m), "uav_route", environment, SEEDS[:12])
        for m in (2e-4, 1e-2)
    )
    assert far["success"].all()
    assert far["path_length"].mean() > near["path_length"].mean()
    assert far["largest_probability"].max() < near["largest_probability"].max() < 0.5


def test_a_flight_does_not_depend_on_its_neighbours():
    actions = []
    for count in (1, 3):
        env = gymnasium.make_vec(
            "fieldgym/UavRoute-v1", count, vectorization_mode="vector_entry_point", settings=UNSEEN
        )
        observation, info = env.reset(seed=5)
        actions.append(RolloutSearch(UNSEEN).act(observation, info)[0])
    np.testing.assert_array_equal(*actions)


def test_several_aircraft_are_refused_by_name():
    with pytest.raises(ModelError, match="single aircraft: set aircraft to 1"):
        RolloutSearch({"aircraft": 2})
