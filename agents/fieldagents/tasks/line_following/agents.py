"""Line following: the law (3.1) with its search, and the classical answers beside it.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, section 3.5.3. The law is

    theta_k = a x_{k-1} + b x_k + c theta_{k-1}    (3.1)

with the line's place x [m], the turn theta [rad] and weights found by a random search. All agents hold their
last command while the line is lost. On images they find the line as the camera board's firmware does.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from fieldagents.agent import Agent, Sees
from fieldagents.task import ReferenceAgent
from fieldgym.info import part
from fieldgym.line_following import WIDTH_SCALE, LineFollowingSettings
from fieldgym.settings import read_settings
from fieldmodels.machines.line_following.declaration import nominal_plant
from fieldmodels.machines.line_following.firmware import line_position
from fieldmodels.machines.line_following.parameters import Camera, Exposure, Gait
from fieldmodels.machines.line_following.plant import MEMORY, turn_of
from fieldmodels.settings import part_of

Floats = NDArray[np.float64]

TUNED = Path(__file__).with_name("tuned.json")
"""Weights, as ``python -m fieldagents.tasks.line_following.search`` found them."""
LOOK_AHEAD = Camera().look_ahead
STRIDE = Gait().stride


@cache
def tuned() -> dict[str, Any]:
    """Tuned weights of every agent that has some."""
    found: dict[str, Any] = json.loads(TUNED.read_text())
    return found


class Steering(Agent):
    """An agent that steers by what the camera board sends: entries 0-8 (or 13) of the observation.

    Attributes:
        limit: Largest turn of a stride [rad].
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        read = read_settings(dict(settings), LineFollowingSettings)
        self.limit, self.latency = read.limit, read.latency_strides
        limits = part_of(read, Exposure).levels
        self._threshold = limits if read.colour else limits[:1]
        self._board: _Board | None = None

    @abstractmethod
    def turn(self, observation: Floats, info: Mapping[str, Any]) -> Floats:
        """Turns [rad] for what is observed, shape (environments,)."""

    def forget(self, begun: NDArray[np.bool_]) -> None:
        """Forget the episodes that are over; ``begun`` says in which environments."""

    def reset(self, seed: int) -> None:  # noqa: ARG002
        """See ``Agent.reset``."""
        self._board = None

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if self._board is not None:
            self._board.forget(begun)
        self.forget(begun)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[np.float32]:
        """See ``Agent.act``."""
        if observation.ndim == 4:
            if self._board is None:
                self._board = _Board(len(observation), self._threshold)
            seen = self._board.read(observation)
        else:
            seen = np.asarray(observation, dtype=np.float64)
        asked = self.turn(seen, info) / self.limit
        action = np.clip(np.where(seen[:, 8] > 0.5, seen[:, 4], asked), -1.0, 1.0)
        if self._board is not None:
            self._board.remember(action)
        return action[:, None].astype(np.float32)

    def overruled(self, action: NDArray[Any]) -> None:
        """See ``Agent.overruled``."""
        if self._board is not None:
            self._board.correct(np.asarray(action, dtype=np.float64)[:, 0])


class _Board:
    """The camera board and the robot's memory of what it sent, for agents that are given images."""

    def __init__(self, count: int, threshold: tuple[float, ...]) -> None:
        self._camera, self._threshold = Camera(), threshold
        self._seen = np.zeros((count, 9))

    def forget(self, begun: NDArray[np.bool_]) -> None:
        """Begin anew."""
        self._seen[begun] = 0.0

    def read(self, images: NDArray[np.uint8]) -> Floats:
        """What the other environment would have observed."""
        seen = self._seen
        for i, image in enumerate(images):
            place, found = line_position(image, self._camera, self._threshold)
            seen[i, 1:4] = seen[i, 0:3]
            seen[i, 8] = 0.0 if found else 1.0
            if found:
                seen[i, 0] = place / WIDTH_SCALE
        return seen

    def remember(self, action: Floats) -> None:
        """Take in what is commanded."""
        self._seen[:, 5:8] = self._seen[:, 4:7]
        self.correct(action)

    def correct(self, action: Floats) -> None:
        """Take in what was commanded instead."""
        self._seen[:, 4] = action


class Linear(Steering):
    """A weighted sum of what is observed; (3.1) is one of the last two places and the last command.

    Args:
        weights: Entry of the observation to its weight: of a place [rad/m], of a turn [1].
    """

    def __init__(self, settings: Mapping[str, Any], weights: Mapping[int, float]) -> None:
        super().__init__(settings)
        self._entries = list(weights)
        scales = [self.limit if 4 <= entry < 8 else WIDTH_SCALE for entry in weights]
        self._weights = np.array(list(weights.values())) * scales
        if max(self._entries) > 8:  # it reads a second band, which changes nothing else
            self.settings = {"bands": 2}

    def turn(self, observation: Floats, info: Mapping[str, Any]) -> Floats:  # noqa: ARG002
        """See ``Steering.turn``."""
        return np.asarray(observation[:, self._entries] @ self._weights)


class PurePursuit(Steering):
    """Goes along the arc that leads to the line's place at the look-ahead distance."""

    def turn(self, observation: Floats, info: Mapping[str, Any]) -> Floats:  # noqa: ARG002
        """See ``Steering.turn``."""
        place = observation[:, 0] * WIDTH_SCALE
        return np.asarray(2.0 * place / (LOOK_AHEAD**2 + place**2) * STRIDE)


def walk_matrices(
    latency: int, memory: float, plant: NDArray[Any] | None = None
) -> tuple[Floats, Floats, Floats]:
    """The walk near its line: state offset, heading, curvature, bias and the last three commands.

    Args:
        latency: Strides that a command waits.
        memory: Share of the curvature that is left after a stride.
        plant: The plant, shape (), dtype ``PLANT``; its bias and its camera's yaw shift the walk and are not
            here. None is nominal.

    Returns:
        Matrices A (7, 7), B (7, 1) and C (1, 7) of z' = A z + B theta, x = C z.
    """
    plant = nominal_plant() if plant is None else plant
    stride = STRIDE * (1.0 - float(plant["foot_slip"]["step"]))
    turns = turns_of(latency, plant)
    a = np.zeros((7, 7))
    a[0, :3] = 1.0, stride, -0.5 * stride**2
    a[1, 1:4] = 1.0, -stride, 1.0
    a[2, 2] = memory
    a[3, 3] = 0.999  # a bias lasts; just below 1 so that the design has a solution
    a[1, 4:] = turns[1:]
    a[5, 4] = a[6, 5] = 1.0
    b = np.zeros((7, 1))
    b[1, 0], b[4, 0] = turns[0], 1.0
    camera = Camera()
    tilted = replace(camera, pitch=camera.pitch + float(plant["camera_pitch"]["angle"]))
    ahead = tilted.look_ahead
    scale = float(plant["sensor_gain"]["factor"]) * camera.metres_per_pixel / tilted.metres_per_pixel
    c = scale * np.array([[-1.0, -ahead, 0.5 * ahead**2, 0.0, 0.0, 0.0, 0.0]])
    return a, b, c


def turns_of(latency: int, plant: NDArray[Any]) -> Floats:
    """What a stride's turn has of this stride's command and of each of the three before, shape (4,)."""
    unbiased = plant.copy()
    unbiased["steering_bias"]["turn"] = 0.0
    small = 1e-6  # no motor gives way
    commands = small * np.eye(MEMORY)
    return np.array([turn_of(one[latency:], unbiased[()], 0.0, 1.0) for one in commands]) / small


class Lqg(Steering):
    """A Kalman filter of offset, heading, curvature and bias, and a quadratic regulator on its estimate.

    Args:
        bend: Standard deviation of the curvature's change in a stride [1/m].
        effort: Weight of a turn's change against the offset.
        plant: The plant as the design knows it, shape (), dtype ``PLANT``; None is nominal.
    """

    sees: Sees = "model"

    def __init__(
        self, settings: Mapping[str, Any], bend: float, effort: float, plant: NDArray[Any] | None = None
    ) -> None:
        super().__init__(settings)
        read = read_settings(dict(settings), LineFollowingSettings)
        plant = nominal_plant() if plant is None else plant
        self._a, self._b, self._c = walk_matrices(read.latency_strides, 0.97, plant)
        self._shift = self._c[0, 1] * float(plant["camera_yaw"]["angle"])
        self._most = min(self.limit, float(plant["actuator_saturation"]["turn"]))
        cost = np.zeros((7, 7))
        cost[0, 0] = 1.0
        cost[4, 4] = effort
        cross = np.zeros((7, 1))
        cross[4, 0] = -effort  # effort * (theta - last theta)^2
        weight = np.array([[effort]])
        solution = solve_discrete_are(self._a, self._b, cost, weight, s=cross)
        inner = weight + self._b.T @ solution @ self._b
        self._gain = np.linalg.solve(inner, self._b.T @ solution @ self._a + cross.T)[0]
        self._process = np.diag(
            [max(read.lateral, 1e-4) ** 2, max(read.yaw, 1e-4) ** 2, bend**2, 1e-10, 0.0, 0.0, 0.0]
        )
        gain, step = float(plant["sensor_gain"]["factor"]), float(plant["sensor_quantisation"]["step"])
        self._noise = (gain * max(read.sensor, 1e-3)) ** 2 + step**2 / 12
        self._first = np.diag(
            [read.offset**2 / 3, read.misalignment**2 / 3, 0.06**2, max(read.bias, 1e-4) ** 2 / 3, 0, 0, 0]
        ) + 1e-9 * np.eye(7)
        self._start = np.zeros(7)
        self._start[3] = plant["steering_bias"]["turn"]
        self._mean = np.zeros((0, 7))
        self._covariance = np.zeros((0, 7, 7))

    def forget(self, begun: NDArray[np.bool_]) -> None:
        """See ``Steering.forget``."""
        if len(self._mean) != len(begun):
            self._mean = np.zeros((len(begun), 7))
            self._covariance = np.tile(self._first, (len(begun), 1, 1))
        self._mean[begun] = self._start
        self._covariance[begun] = self._first

    def turn(self, observation: Floats, info: Mapping[str, Any]) -> Floats:  # noqa: ARG002
        """See ``Steering.turn``."""
        seen = observation[:, 8] < 0.5
        place = observation[:, 0] * WIDTH_SCALE
        innovation = place - self._shift - self._mean @ self._c[0]
        spread = self._covariance @ self._c[0]
        gain = np.where(seen[:, None], spread / (spread @ self._c[0] + self._noise)[:, None], 0.0)
        mean = self._mean + gain * innovation[:, None]
        covariance = self._covariance - gain[:, :, None] * spread[:, None, :]
        turn = -(mean @ self._gain)
        turn = np.where(seen, np.clip(turn, -self._most, self._most), mean[:, 4])
        self._mean = mean @ self._a.T + turn[:, None] * self._b[:, 0]
        self._covariance = self._a @ covariance @ self._a.T + self._process
        return np.asarray(turn)

    def overruled(self, action: NDArray[Any]) -> None:
        """See ``Agent.overruled``."""
        super().overruled(action)
        done = np.asarray(action, dtype=np.float64)[:, 0] * self.limit
        self._mean = self._mean + (done - self._mean[:, 4])[:, None] * self._b[:, 0]


class Privileged(Steering):
    """Knows offset, heading, curvature and bias: places the stride after the next one on the line.

    Args:
        gain: Share of the offset that the stride after next takes away.
    """

    sees: Sees = "privileged"

    def __init__(self, settings: Mapping[str, Any], gain: float) -> None:
        super().__init__(settings)
        self._gain = gain

    def turn(self, observation: Floats, info: Mapping[str, Any]) -> Floats:
        """See ``Steering.turn``."""
        truth = part(info, "privileged")
        offset, heading = truth["offset"], truth["heading"]
        here, ahead, bias = truth["curvature"], truth["curvature_ahead"], truth["bias"]
        offset = offset + STRIDE * heading - 0.5 * here * STRIDE**2
        heading = heading + bias - here * STRIDE
        if self.latency:
            heading = heading + observation[:, 4] * self.limit
            offset = offset + STRIDE * heading - 0.5 * ahead * STRIDE**2
            heading = heading + bias - ahead * STRIDE
        return np.asarray(0.5 * ahead * STRIDE - self._gain * offset / STRIDE - heading)


def _linear(name: str, title: str) -> ReferenceAgent:
    def build(settings: Mapping[str, Any]) -> Agent:
        weights = {int(entry): weight for entry, weight in tuned()[name]["weights"].items()}
        return Linear(settings, weights)

    return ReferenceAgent(name, title, build)


TUNED_TITLE = "the law (3.1), weights by CMA-ES"
MEMORY_TITLE = "weighs the last four places and the last four turns, by CMA-ES"
LQG_TITLE = "Kalman filter and quadratic regulator"

AGENTS = (
    _linear("printed", "the law (3.1), weights by its random search of 1000 sets"),
    _linear("tuned", TUNED_TITLE),
    ReferenceAgent(
        "at_once",
        "points the robot at the line, as if it turned at once",
        lambda settings: Linear(settings, {0: 1.0 / LOOK_AHEAD}),
    ),
    ReferenceAgent("pure_pursuit", "goes along the arc to the line's place", PurePursuit),
    _linear("memory", MEMORY_TITLE),
    ReferenceAgent(
        "lqg",
        LQG_TITLE,
        lambda settings: Lqg(settings, tuned()["lqg"]["bend"], tuned()["lqg"]["effort"]),
        "model",
    ),
    _linear("two_bands", "weighs four places of each of two bands and four turns, by CMA-ES"),
    ReferenceAgent(
        "ceiling",
        "knows place, curvature and bias",
        lambda settings: Privileged(settings, tuned()["ceiling"]["gain"]),
        "privileged",
    ),
)
"""In the order of presentation."""
