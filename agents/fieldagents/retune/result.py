"""What comes out of closing the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fieldagents.evaluation.summary import Summary
from fieldagents.retune.won_back import WonBack
from fieldagents.task import Metric

NOMINAL, RETUNED, ORACLE = "nominal", "retuned", "oracle"
"""The agents: designed in the nominal simulation, in the extended one, in the hidden reality itself."""
HIDDEN, EXTENDED = "hidden reality", "extended simulation"
SIMULATION = "nominal simulation"
"""Where they are flown."""


@dataclass(frozen=True)
class Retuning:
    """What an agent wins by being designed in the simulation that has learned.

    Attributes:
        name: Name of the loop.
        agent: Name of what is designed.
        title: How it is designed.
        metric: By which the loss is counted.
        hidden: Whether the hidden reality is known, so that agents were flown in it and the oracle exists.
            Else the extended simulation stands for it, which is a forecast and no measurement.
        won_back: Share of the loss won back; None without a hidden reality.
        design_seconds: Agent to the time that its design took [s].
        evaluation: Every agent in every simulation, compared with the nominal agent; the first scenario is
            the one that counts.
    """

    name: str
    agent: str
    title: str
    metric: Metric
    hidden: bool
    won_back: WonBack | None
    design_seconds: Mapping[str, float]
    evaluation: Summary

    def mean(self, agent: str, flown_in: str) -> float | None:
        """An agent's mean score in one of the simulations."""
        rows = {row.agent: row for row in self.evaluation.scenarios[flown_in]}
        return rows[agent].means[self.metric.name]

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents, as they were designed."""
        return tuple(self.design_seconds)

    @property
    def flown_in(self) -> str:
        """Where the agents are held against each other."""
        return next(iter(self.evaluation.scenarios))

    def to_json(self) -> dict[str, Any]:
        """The content of ``retune.json``."""
        return {
            "schema": 1,
            "name": self.name,
            "task": self.evaluation.task,
            "agent": self.agent,
            "title": self.title,
            "metric": asdict(self.metric),
            "summary": self.sentence(),
            "hidden_known": self.hidden,
            "won_back": self.won_back and asdict(self.won_back),
            "means": {
                agent: {where: self.mean(agent, where) for where in self.evaluation.scenarios}
                for agent in self.agents
            },
            "design_seconds": dict(self.design_seconds),
            "evaluation": self.evaluation.to_json(),
        }

    def sentence(self) -> str:
        """What came out, in plain words."""
        scale, unit = (100, " %") if self.metric.binary else (1, f" {self.metric.unit}".removesuffix(" 1"))
        said = {
            agent: "no value"
            if (mean := self.mean(agent, self.flown_in)) is None
            else f"{scale * mean:.4g}{unit}"
            for agent in self.agents
        }
        begin = (
            f"{self.agent} in the {self.flown_in}, {self.metric.title}: {said[NOMINAL]} designed in the "
            f"nominal simulation, {said[RETUNED]} designed in the extended one"
        )
        if self.won_back is None:
            return (
                f"{begin}. No hidden reality is known, so this is the extended simulation's forecast, "
                "not a measurement: fly both on the machine."
            )
        begin += f", {said[ORACLE]} designed in the hidden reality itself (the oracle)"
        if self.won_back.outcome == "nothing to win":
            return f"{begin}. Nothing to win: the oracle is not better than the nominal agent."
        if self.won_back.share is None:
            return f"{begin}. Too few episodes to say more."
        share = f"{100 * self.won_back.share:.1f} % of the loss won back"
        if self.won_back.ci95 is None:
            return f"{begin}: {share}, of too few episodes for an interval."
        low, high = self.won_back.ci95
        return f"{begin}: {share} (95 % interval {100 * low:.1f} to {100 * high:.1f})."
