"""The operator's switch and joystick on the keyboard, for tasks that a human can take over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

RATE = 0.25
"""How far the joystick moves in a step while an arrow key is held; it springs back as fast."""


@dataclass
class Operator:
    """A switch between self steering and the operator, and a joystick (section 3.5.2 of the dissertation).

    The robot goes on reading its camera while the operator steers, so that it is ready when the switch goes
    back.

    Attributes:
        steering: Whether the operator steers.
        joystick: Where the joystick is, -1 (right) to 1 (left).
    """

    steering: bool = False
    joystick: float = 0.0

    def read_keys(self) -> None:
        """Take in the keyboard of pygame's window: S is the switch, the arrows are the joystick."""
        import pygame

        for event in pygame.event.get(pygame.KEYDOWN):
            if event.key == pygame.K_s:
                self.switch()
        held = pygame.key.get_pressed()
        self.move(int(held[pygame.K_LEFT]) - int(held[pygame.K_RIGHT]))

    def switch(self) -> None:
        """Throw the switch; the joystick begins in the middle."""
        self.steering, self.joystick = not self.steering, 0.0

    def move(self, direction: int) -> None:
        """Move the joystick: 1 to the left, -1 to the right, 0 lets it spring back."""
        if direction:
            self.joystick = float(np.clip(self.joystick + RATE * direction, -1.0, 1.0))
        else:
            self.joystick = float(np.sign(self.joystick) * max(abs(self.joystick) - RATE, 0.0))

    def action(self, own: NDArray[np.float32]) -> NDArray[np.float32]:
        """The joystick where the operator steers, else the agent's own action."""
        return np.full_like(own, self.joystick) if self.steering else own
