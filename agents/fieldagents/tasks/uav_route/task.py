"""UAV route: what is measured, and who records its model's data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fieldagents.task import Metric, Recorder, TaskDefinition

if TYPE_CHECKING:
    import numpy as np

    from fieldagents.record.config import RecordConfig
    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording


def record(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """An aircraft that flies from waypoint to waypoint while a radar scans it."""
    from fieldmodels.machines.uav_route.recording import record_flight

    return record_flight(
        reality,
        config.duration,
        episodes=config.episodes,
        step=config.step or 2.0,
        noise=config.noise,
        rng=rng,
    )


TASK = TaskDefinition(
    name="uav_route",
    metrics=(
        Metric("success", "1", "arrived", "success", lower_is_better=False, over="last", binary=True),
        Metric(
            "length_ratio",
            "1",
            "length over the bound of undetected paths, if arrived",
            "path_length",
            over="last",
            given="success",
            bound="fieldagents.tasks.uav_route.kept_bounds:shortest_flights",
        ),
        Metric("path_length", "km", "length, if arrived", "path_length", over="last", given="success"),
        Metric("damaged", "1", "hit by a missile", "damaged", over="last", binary=True),
        Metric("time_over", "s", "time detected", "time_over", over="last"),
        Metric(
            "longest_detection", "s", "longest detection without a break", "longest_detection", over="last"
        ),
        Metric(
            "largest_probability",
            "1",
            "largest probability of detection",
            "largest_probability",
            over="last",
        ),
        Metric("lock_losses", "1", "locks that radars lost", "lock_losses", over="last"),
        Metric("legs", "1", "legs", "legs", over="last"),
        Metric(
            "no_plan",
            "1",
            "no plan, and so left",
            "agent.no_plan",
            over="last",
            binary=True,
            optional=True,
        ),
        Metric(
            "infeasible",
            "1",
            "proven that the planner's formulation has no plan",
            "agent.infeasible",
            over="last",
            binary=True,
            optional=True,
        ),
        Metric(
            "plan_gap", "1", "gap of the plan to the solver's bound", "agent.gap", over="last", optional=True
        ),
        Metric(
            "plan_bound",
            "1",
            "the solver's bound on its own objective (km; seconds of (4.22) in the source's program)",
            "agent.bound",
            over="last",
            optional=True,
        ),
    ),
    recorder=Recorder(("uav_route",), ("step", "episodes", "noise"), record),
    picture="receding",
)
