"""What a task truly is: its model, the reality, and the stock effects that this names around the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.named import apply_reality, stepped, with_named
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.model import Model
from fieldmodels.reality import Reality


@dataclass(frozen=True)
class ConfiguredModel:
    """A task's model in a reality.

    Attributes:
        model: The model, with stock effects around it if the reality names some.
        reality: The reality, checked.
        typical: The model's own parameter vector, samplers at their typical values, shape (own,).
        extremes: Two such, with every sampler at its smallest and at its largest value, shape (2, own).
        stock: What steps the stock effects; None without any.
    """

    model: Model
    reality: Reality
    typical: FloatArray
    extremes: FloatArray
    stock: Stepped | None

    def around(self, model: Model) -> Model:
        """The same stock effects around the model of other settings."""
        return with_named(model, self.reality.effects)


def configure_model(
    source: Any, model: Model, channels: Channels, batch: int, step: float
) -> ConfiguredModel:
    """Read what a user hands in as ``reality=``.

    Args:
        source: See ``fieldmodels.reality.read_reality``; beside the model's own effects it may name stock
            effects of the signals that the task commands and measures (``drivers.named.stock_of``).
        model: The task's model.
        channels: Which signals these are.
        batch: Number of rows.
        step: Sampling interval of the task [s].

    Raises:
        ModelError: As ``read_reality``; also for a stock effect that cannot act in the task.
    """
    around, reality = apply_reality(model, source, channels)
    own = len(model.names)
    return ConfiguredModel(
        model=around,
        reality=reality,
        typical=reality.typical(around)[:own],
        extremes=reality.extremes(around)[:, :own],
        stock=stepped(around, reality, channels, batch, step),
    )
