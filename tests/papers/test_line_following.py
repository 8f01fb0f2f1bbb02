"""The numbers behind chapter 3's claims, against what shares no code with them."""

import numpy as np
import pytest

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS
from fieldmodels.machines.line_following.parameters import FLOORS, TAPES, Camera, Exposure, Lighting
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.tracks import straight
from papers.line_following.photographs import peaks, photograph, side_sensors
from papers.line_following.venues import law, walk


@pytest.mark.every("light", [1.0, 0.2])
def test_a_photographed_chart_has_the_levels_of_the_robot_s_camera(light):
    """The compiled renderer against the chart's formula: tape, floor and the noise of each."""
    view = make_view(Camera(), lighting=Lighting(light=light))
    image = Renderer(straight(), Camera(), view).image((20.0, 0.0, 0.0), 20.0, 1)
    share = 0.04  # of the view that is tape
    chart = np.array([TAPES["duvetyne"].reflectance] + [FLOORS["linoleum"]] * round(1 / share))
    levels = photograph(chart, Exposure(), np.random.default_rng(0), light)
    assert np.median(levels[0]) == pytest.approx(np.median(image[40:80, 79:81]), abs=3)
    assert np.median(levels[1]) == pytest.approx(np.median(image[:, :60]), abs=3)
    assert levels[1].std() == pytest.approx(image[:, :60].std(), rel=0.1)


def test_peaks_are_those_that_were_put_in():
    rng = np.random.default_rng(1)
    for centres in ([50], [20, 60, 250], [9, 17, 21, 26, 200]):
        assert peaks(np.array([rng.normal(c, 0.7, 2000) for c in centres])) == len(centres)
    assert peaks(np.array([rng.normal(c, 4.0, 2000) for c in (17, 19, 22)])) == 1


def test_a_ratio_forgives_the_light_and_levels_do_not():
    found = side_sensors.run(lambda *_: None, readings=500, noise=0.0).statistics
    assert found["right, light from a tenth to full, by ratio of red to green [1]"].value == 1.0
    # red in little light is nearer to what green read at calibration; green stays nearest to itself
    red, green = np.array(FLOORS["track_red"]), np.array(FLOORS["track_green"])
    dim = np.exp(np.linspace(np.log(0.1), 0, 200_001))[:, None] * red
    wrong = np.mean(np.linalg.norm(dim - green, axis=1) < np.linalg.norm(dim - red, axis=1))
    right = found["right, light from a tenth to full, by components [1]"]
    assert right.low <= 1 - wrong / 2 <= right.high


def test_walks_are_those_of_the_evaluation():
    """Stride by stride here, summed up there."""
    settings = {"track": "oval"}
    walked = walk("tuned", 4, **settings)
    agent = make_agent("tuned", "line_following", settings).runs[0]
    table = run_episodes(agent, "line_following", EnvironmentConfig(settings=settings), TEST_SEEDS[:4])
    np.testing.assert_allclose(np.abs(walked.place[15:]).mean(axis=0), table["mean_offset"], atol=1e-12)
    np.testing.assert_array_equal(walked.failed, table["failed"] > 0)


def test_overshoot_costs_effort_only_where_nothing_is_noisy():
    numbers = [law.run(lambda *_: None, searches=3, walks=10, noise=noise).statistics for noise in (0.0, 1.0)]
    quiet, noisy = (n["rank correlation of overshoot and effort [1]"] for n in numbers)
    assert quiet.low > 0.3
    assert noisy.high < -0.1
