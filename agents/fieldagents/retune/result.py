"""What comes out of closing the loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from fieldagents.evaluation.summary import Summary
from fieldagents.retune.recovery import Recovery
from fieldagents.task import Metric

NOMINAL, RETUNED, ORACLE = "nominal", "retuned", "oracle"
"""The agents: tuned in the nominal simulation, in the extended one, in the hidden reality itself."""
HIDDEN, EXTENDED = "hidden reality", "extended simulation"
SIMULATION = "nominal simulation"
"""Where they are tested."""


@dataclass(frozen=True)
class Retuning:
    """What an agent gains by being tuned in the extended simulation.

    Attributes:
        name: Name of the loop.
        agent: Name of what is tuned.
        title: How it is tuned.
        metric: By which the loss is counted.
        recovered: Share of the loss recovered; None where the hidden reality is not known: then there is no
            oracle, and the extended simulation stands for it, which is a forecast and no measurement.
        tuning_seconds: Agent to the time that its tuning took [s].
        evaluation: Every agent in every simulation, compared with the nominal agent; the first scenario is
            the one that counts.
    """

    name: str
    agent: str
    title: str
    metric: Metric
    recovered: Recovery | None
    tuning_seconds: Mapping[str, float]
    evaluation: Summary

    def mean(self, agent: str, tested_in: str) -> float | None:
        """An agent's mean score in one of the simulations."""
        rows = {row.agent: row for row in self.evaluation.scenarios[tested_in]}
        return rows[agent].means[self.metric.name]

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents, as they were tuned."""
        return tuple(self.tuning_seconds)

    @property
    def tested_in(self) -> str:
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
            "hidden_known": self.recovered is not None,
            "recovered": self.recovered and asdict(self.recovered),
            "means": {
                agent: {where: self.mean(agent, where) for where in self.evaluation.scenarios}
                for agent in self.agents
            },
            "tuning_seconds": dict(self.tuning_seconds),
            "evaluation": self.evaluation.to_json(),
        }

    def sentence(self) -> str:
        """What came out, in plain words."""
        scale, unit = (100, " %") if self.metric.binary else (1, f" {self.metric.unit}".removesuffix(" 1"))
        means = {agent: self.mean(agent, self.tested_in) for agent in self.agents}
        said = {
            agent: "no value" if mean is None else f"{scale * mean:.4g}{unit}"
            for agent, mean in means.items()
        }
        begin = (
            f"{self.metric.title} of {self.agent}, tested in the {self.tested_in}: {said[NOMINAL]} if "
            f"tuned in the nominal simulation, {said[RETUNED]} if tuned in the extended one"
        )
        begin = begin[0].upper() + begin[1:]
        if self.recovered is None:
            return (
                f"{begin}. No hidden reality is known, so this is the extended simulation's forecast, "
                "not a measurement: try both on the machine."
            )
        begin += f", {said[ORACLE]} if tuned in the hidden reality itself (the oracle)"
        if self.recovered.outcome == "nothing to recover":
            return f"{begin}. Nothing to recover: the oracle is not better than the nominal agent."
        if self.recovered.share is None:
            return f"{begin}. Too few episodes to say more."
        share = f"{100 * self.recovered.share:.1f} % of the loss recovered"
        if self.recovered.ci95 is None:
            return f"{begin}: {share}, of too few episodes for an interval."
        low, high = self.recovered.ci95
        return f"{begin}: {share} (95 % interval {100 * low:.1f} to {100 * high:.1f})."
