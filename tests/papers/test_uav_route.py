"""Figures 4.4 to 4.6 of the UAV route's source."""

from __future__ import annotations

import pytest

from papers.uav_route.figures import figures_4_4_to_4_6


@pytest.mark.nightly
def test_the_source_s_paths_are_shown_beside_routes_that_hold():
    done = figures_4_4_to_4_6.run(lambda _stage, _part: None)
    table = done.table.set_index(["planner", "Pd"])
    assert set(done.figures) == {"figure-4.4", "figure-4.5", "figure-4.6"}
    assert (table.loc["printed", "over the threshold [s]"] > 0).all()
    assert (table.loc["legs-2", "over the threshold [s]"] == 0).all()
    assert (table.loc["legs-2", "length [km]"] <= 1.015 * table.loc["legs-2", "lower bound [km]"]).all()
    assert not table.loc[("lattice-lock-loss", 0.5), "missile hits"]
    # a higher accepted probability allows a shorter route
    assert table.loc["legs-2", "length [km]"].is_monotonic_decreasing
