"""Features of images: learned by convolutions, or fixed: where a dark line runs through them."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

SHRINK = 4
"""Pixels along each side that are averaged to one: a line of tape is six wide."""
CLEAR = 0.1, 0.2
"""How much darker than the floor around it, of 1, the darkest place of a band is where no line and where
surely a line is in it."""
REACH = 2.0
"""Bands over which what is seen stands in for what is not."""


def is_image(space: spaces.Space[Any]) -> bool:
    """Whether observations are images, shape (rows, columns, channels), uint8."""
    return isinstance(space, spaces.Box) and space.dtype == "uint8" and len(space.shape) == 3


class DarkLine(torch.nn.Module):
    """The course of a dark line through an image from bottom to top, as a polynomial of the height.

    Rows are averaged in bands. A band's line is where it is darker than the floor around it, by more than
    half of what its darkest place is; its place is the centroid of that, -1 to 1, left positive. The features
    are the coefficients of the places in discrete orthonormal polynomials, and how surely the line is seen
    in the upper, the middle and the lower third, 0 to 1.

    Args:
        space: The images', shape (rows, columns, channels).
        band: Rows of a band.
        floor: Columns around a place that are averaged to the floor's level, an odd number.
        order: Coefficients.

    Raises:
        ValueError: If the bands do not divide the rows, or are not three times some number.
    """

    polynomials: torch.Tensor
    columns: torch.Tensor
    contrast: torch.Tensor
    neighbours: torch.Tensor

    def __init__(self, space: spaces.Box, band: int = 4, floor: int = 61, order: int = 4) -> None:
        super().__init__()
        self.rows, self.width, self.channels = space.shape
        self.band, self.bands = band, self.rows // band
        if self.rows % band or self.bands % 3 or order > self.bands:
            raise ValueError(f"bands of {band} rows do not divide the thirds of an image of {self.rows} rows")
        height = torch.linspace(1.0, -1.0, self.bands, dtype=torch.float64)
        basis, triangle = torch.linalg.qr(torch.stack([height**k for k in range(order)], dim=1))
        basis = basis * torch.sign(torch.diagonal(triangle)) / self.bands**0.5
        column = torch.arange(self.width)
        around = ((column[:, None] - column).abs() <= floor // 2).float()
        number = torch.arange(self.bands).float()
        self.register_buffer("polynomials", basis.float())
        self.register_buffer("columns", 1.0 - (column + 0.5) * (2.0 / self.width))
        self.register_buffer("contrast", around / around.sum(dim=0) - torch.eye(self.width))
        self.register_buffer("neighbours", torch.exp((number[:, None] - number).abs() / -REACH))

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Features, shape (batch, order + 3), of images, shape (batch, rows, columns, channels), 0 to 255."""
        pixels = image.reshape(-1, self.bands, self.band, self.width, self.channels)
        level = pixels.sum(dim=(2, 4), dtype=torch.float32) / (255.0 * self.band * self.channels)
        dark = level @ self.contrast
        darkest = dark.amax(dim=2, keepdim=True)
        weight = (dark - 0.5 * darkest).clamp(min=0.0)
        place = (weight * self.columns).sum(dim=2) / (weight.sum(dim=2) + 1e-6)
        none, surely = CLEAR
        seen = ((darkest.squeeze(2) - none) / (surely - none)).clamp(0.0, 1.0)
        nearby = ((seen * place) @ self.neighbours) / (seen @ self.neighbours + 1e-6)
        place = seen * place + (1.0 - seen) * nearby
        return torch.cat([place @ self.polynomials, seen.reshape(-1, 3, self.bands // 3).mean(dim=2)], dim=1)


class ImageFeatures(BaseFeaturesExtractor):
    """Averaged pixels, two convolutions, one layer: learned features of images, channel first, in [0, 1].

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
