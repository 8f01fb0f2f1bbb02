"""The operator's switch and stick, on the keyboard or a gamepad, for tasks that a human can take over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

RATE = 0.25
"""How far the stick moves in a step while a key is held; it springs back as fast."""
DEAD_ZONE = 0.1
"""Deflection of a gamepad's stick up to which it counts as released."""


@dataclass
class Operator:
    """A switch between self steering and the operator, and a joystick (section 3.5.2 of the dissertation).

    The robot goes on reading its camera while the operator steers, so that it is ready when the switch goes
    back. What the stick means is the task's matter (``TaskDefinition.steer``).

    Attributes:
        steering: Whether the operator steers.
        joystick: Where the stick is, -1 (right) to 1 (left).
        ahead: The same, -1 (backwards) to 1 (ahead).
        turn: Twist of the stick, -1 (to the right) to 1 (to the left).
        gamepad: A gamepad of pygame, which then moves the stick; None for the keyboard.
    """

    steering: bool = False
    joystick: float = 0.0
    ahead: float = 0.0
    turn: float = 0.0
    gamepad: Any = None

    def find_gamepad(self) -> None:
        """Take the first gamepad that is plugged in, if there is one."""
        import pygame

        pygame.joystick.init()
        self.gamepad = pygame.joystick.Joystick(0) if pygame.joystick.get_count() else None

    def read_keys(self) -> None:
        """Take in keyboard and gamepad of pygame's window.

        S or the gamepad's first button is the switch, the arrows are the stick, Q and E twist it; a gamepad's
        right stick twists it.
        """
        import pygame

        for event in pygame.event.get(pygame.KEYDOWN):
            if event.key == pygame.K_s:
                self.switch()
        if self.gamepad is not None:
            for event in pygame.event.get(pygame.JOYBUTTONDOWN):
                if event.button == 0:
                    self.switch()
            left, back, twist = (float(self.gamepad.get_axis(k)) for k in range(3))
            self.joystick, self.ahead, self.turn = (
                0.0 if abs(way) < DEAD_ZONE else float(np.clip(-way, -1.0, 1.0))
                for way in (left, back, twist)
            )
            return
        held = pygame.key.get_pressed()
        pairs = ((pygame.K_LEFT, pygame.K_RIGHT), (pygame.K_UP, pygame.K_DOWN), (pygame.K_q, pygame.K_e))
        self.move(*(int(held[one]) - int(held[other]) for one, other in pairs))

    def switch(self) -> None:
        """Throw the switch; the stick begins in the middle."""
        self.steering = not self.steering
        self.joystick = self.ahead = self.turn = 0.0

    def move(self, direction: int, ahead: int = 0, turn: int = 0) -> None:
        """Move the stick: 1 to the left, ahead, twisted to the left; -1 back, 0 lets it spring back."""
        self.joystick = moved(self.joystick, direction)
        self.ahead = moved(self.ahead, ahead)
        self.turn = moved(self.turn, turn)

    def action(self, own: NDArray[np.float32]) -> NDArray[np.float32]:
        """The joystick where the operator steers, else the agent's own action."""
        return np.full_like(own, self.joystick) if self.steering else own


def moved(place: float, direction: int) -> float:
    """Where one axis of the stick is a step later."""
    if direction:
        return float(np.clip(place + RATE * direction, -1.0, 1.0))
    return float(np.sign(place) * max(abs(place) - RATE, 0.0))
