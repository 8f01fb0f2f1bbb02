"""The trained policies of pose reaching, by their cards (which ``test_zoo`` scores again)."""

import pytest

from fieldagents.policies.zoo import get_entry


@pytest.mark.every("name", ["ppo", "sac"])
def test_every_run_arrives_from_anywhere(name):
    (training,) = get_entry("pose_reaching", name).trainings
    assert training.settings == {"starts": "T3", "success": "strict"}
    assert [run["test_scores"]["success"] >= 0.98 for run in training.card["runs"]] == [True] * 5


def test_ppo_is_quicker_than_the_shortest_path_at_full_speed():
    """The path has turns of 0.3 m; a robot that may turn on the spot and stop 5 cm short can beat it."""
    (training,) = get_entry("pose_reaching", "ppo").trainings
    ratios = [run["test_scores"]["time_ratio"] for run in training.card["runs"]]
    assert max(ratios) < 0.88  # one that turns one way only is at 0.98
    assert sum(ratios) / len(ratios) < 0.87
    assert all(run["test_scores"]["success"] == 1.0 for run in training.card["runs"])
