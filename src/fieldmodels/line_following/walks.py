"""Walks that advance stride by stride on a track: the working surface of environments and evaluations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.line_following.parameters import Camera, Gait, Noise, Tape
from fieldmodels.line_following.plant import BANDS, NEUTRAL, PARAMETERS, WALK, advance, begin
from fieldmodels.line_following.sensor import make_optics
from fieldmodels.line_following.tracks import Track
from fieldmodels.model import ModelError


class Walks:
    """A batch of kinematic walks on one track.

    Noise depends on a walk's seed and on the number of its strides alone, never on what is commanded or on
    its neighbours in the batch: equal seeds give every agent the same noise, to the bit.

    Attributes:
        track: The line.
        camera: The camera; a second band, if asked for, is the third of the view above the first.
        gait: Step length, step time, largest turn.
        walks: All state, shape (batch,), dtype ``WALK``.
    """

    def __init__(
        self,
        batch: int,
        track: Track,
        *,
        camera: Camera | None = None,
        gait: Gait | None = None,
        noise: Noise | None = None,
        tape: Tape | None = None,
        bands: int = 1,
        latency: int = 0,
        camera_yaws_with_inner: bool = False,
        plant: ArrayLike | None = None,
        offset: float = 0.2,
        misalignment: float = 0.1,
    ) -> None:
        """Make walks; restart each before the first stride.

        Args:
            batch: Number of walks.
            track: The line.
            camera: The camera.
            gait: The gait.
            noise: Noise of sensor and walk.
            tape: The tape.
            bands: Bands of rows that are looked at, 1 or 2.
            latency: Strides that a command waits beside the gait's own delay, 0 or 1.
            camera_yaws_with_inner: Whether the camera turns with the inner legs.
            plant: Parameter vector of the plant, shape (11,) or (batch, 11); None is nominal.
            offset: Largest distance from the line at the start [m].
            misalignment: Largest heading error at the start [rad].

        Raises:
            ModelError: If a number makes no sense.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one walk, not {batch}")
        if bands not in range(1, BANDS + 1):
            raise ModelError(f"the camera has 1 or 2 bands, not {bands}")
        if latency not in (0, 1):
            raise ModelError(f"a command can wait 0 or 1 strides, not {latency}")
        self.track, self.camera, self.gait = track, camera or Camera(), gait or Gait()
        noise, vector = noise or Noise(), np.asarray(NEUTRAL if plant is None else plant, dtype=np.float64)
        if vector.shape not in ((PARAMETERS,), (batch, PARAMETERS)):
            raise ModelError(
                f"a plant has shape ({PARAMETERS},) or ({batch}, {PARAMETERS}), not {vector.shape}"
            )
        self.plants = np.array(np.broadcast_to(vector, (batch, PARAMETERS)))
        self.walks: NDArray[Any] = np.zeros(batch, dtype=WALK)
        self._noises = np.array([noise.sensor, noise.yaw, noise.lateral, noise.bias])
        one = self.camera
        optics = [make_optics(one), make_optics(one, 2 * one.first_row - one.last_row, one.first_row)]
        self._sight = (
            track.table, track.spacing, track.closed, (tape or Tape()).width, tuple(optics[:bands]),
            camera_yaws_with_inner,
        )  # fmt: skip
        self._latency, self._start = latency, (offset, misalignment)
        self._begun = np.zeros(batch, dtype=np.bool_)

    def __len__(self) -> int:
        """Number of walks."""
        return len(self.walks)

    def restart(self, which: Iterable[int], rngs: Iterable[np.random.Generator]) -> None:
        """Start several walks anew, each with noise keyed by one draw from its own generator."""
        for i, rng in zip(which, rngs, strict=True):
            key = rng.integers(0, 2**64, dtype=np.uint64)
            begin(self.walks, int(i), key, *self._sight, self.plants[i], self._noises, *self._start)
            self._begun[i] = True

    def advance(self, commands: ArrayLike) -> None:
        """Take every walk through one stride.

        Args:
            commands: Turns [rad], left positive, shape (batch,); limited to the gait's limit.

        Raises:
            ModelError: If the commands have the wrong shape or a walk was never started.
        """
        values = np.ascontiguousarray(commands, dtype=np.float64)
        if values.shape != (len(self),):
            raise ModelError(f"commands must have shape ({len(self)},), not {values.shape}")
        if not self._begun.all():
            raise ModelError("restart every walk before the first stride")
        table, spacing, closed, width, bands, with_inner = self._sight
        advance(
            self.walks, values, table, spacing, closed, width, bands, with_inner, self._latency,
            self.plants, self._noises, self.gait.stride, self.gait.limit,
        )  # fmt: skip

    def state(self) -> NDArray[Any]:
        """An exact snapshot of all walks: a plain structured array, shape (batch,)."""
        return self.walks.copy()

    def set_state(self, state: NDArray[Any]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of another batch size or kind.
        """
        if state.dtype != WALK or state.shape != self.walks.shape:
            raise ModelError(f"a snapshot of {len(self)} walks is needed, not {state.shape} {state.dtype}")
        self.walks[...] = state
        self._begun[:] = True
