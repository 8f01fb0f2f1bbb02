"""Features for policies that follow a schedule: where one entry of the observation lies between knots."""

from __future__ import annotations

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor


class Knots(BaseFeaturesExtractor):
    """Hat functions of one entry: 1 at their own knot, 0 at all others, linear between them.

    A linear network after it is a schedule with a value at each knot, as that of a clock would be; the
    entry must not be normalised.

    Args:
        space: Of observations with one dimension.
        entry: Number of the entry.
        low: The first knot.
        high: The last knot; values beyond it count as it, and so at the other end.
        knots: How many, evenly apart, at least two.
    """

    def __init__(
        self, space: spaces.Box, entry: int = -1, low: float = 0.0, high: float = 1.0, knots: int = 10
    ) -> None:
        super().__init__(space, knots)
        self.entry, self.low, self.gap, self.knots = entry, low, (high - low) / (knots - 1), knots

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features, shape (batch, knots)."""
        place = ((observations[:, self.entry : self.entry + 1 or None] - self.low) / self.gap).clamp(
            0, self.knots - 1
        )
        return (1.0 - (place - torch.arange(self.knots)).abs()).clamp(min=0.0)
