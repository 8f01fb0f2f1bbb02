"""Features of images for a policy: averaged pixels, two convolutions, one layer."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

SHRINK = 4
"""Pixels along each side that are averaged to one: a line of tape is six wide."""


def is_image(space: spaces.Space[Any]) -> bool:
    """Whether observations are images, shape (rows, columns, channels), uint8."""
    return isinstance(space, spaces.Box) and space.dtype == "uint8" and len(space.shape) == 3


class ImageFeatures(BaseFeaturesExtractor):
    """Features of images in [0, 1], shape (batch, channels, rows, columns).

    Args:
        space: The image's space, channel first.
        features_dim: Number of features.
    """

    def __init__(self, space: spaces.Box, features_dim: int = 64) -> None:
        super().__init__(space, features_dim)
        self.convolutions = torch.nn.Sequential(
            torch.nn.AvgPool2d(SHRINK),
            torch.nn.Conv2d(space.shape[0], 8, kernel_size=5, stride=2),
            torch.nn.ReLU(),
            torch.nn.Conv2d(8, 16, kernel_size=3, stride=2),
            torch.nn.ReLU(),
            torch.nn.Flatten(),
        )
        with torch.no_grad():
            count = self.convolutions(torch.zeros(1, *space.shape)).shape[1]
        self.layer = torch.nn.Sequential(torch.nn.Linear(count, features_dim), torch.nn.ReLU())

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Features, shape (batch, features_dim)."""
        features: torch.Tensor = self.layer(self.convolutions(observations))
        return features
