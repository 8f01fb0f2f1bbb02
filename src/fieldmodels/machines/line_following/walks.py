"""Walks that advance stride by stride on a track: what environments and evaluations work with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.machines.line_following.body import Body, Hardware
from fieldmodels.machines.line_following.declaration import as_plants, nominal_plant
from fieldmodels.machines.line_following.firmware import centroid
from fieldmodels.machines.line_following.parameters import (
    TAPES,
    Camera,
    Exposure,
    Gait,
    Lighting,
    Noise,
    WalkRules,
)
from fieldmodels.machines.line_following.plant import (
    BANDS,
    MEMORY,
    WALK,
    draw,
    land,
    move,
    order,
    scan,
    start,
    take_in,
)
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.sensor import make_optics
from fieldmodels.machines.line_following.tracks import Track
from fieldmodels.model import ModelError
from fieldmodels.settings import kernel_rows
from fieldmodels.streams import drawn_key

Image = NDArray[np.uint8]
YAW, LATERAL, SENSOR, PIXELS = 0, 1, 2, 5
"""Which of a stride's draws is what; each band of the sensor has its own."""
CHANNELS = Channels(
    commands=("steering",),
    observed=("line",) * BANDS,
    without="a robot steers, and its camera measures the line; offset and heading are an overhead tracker's",
)
"""Where stock effects can act on a walk: both bands of the camera are one sensor."""


@dataclass(frozen=True, kw_only=True)
class Scene(WalkRules):
    """What the walks walk on and see with.

    Attributes:
        track: The line.
        camera: The camera.
        gait: Step length, step time, largest turn.
        noise: Noise of sensor and walk.
        exposure: Exposure and threshold.
        lighting: Light on the floor.
        hardware: Masses, friction and motor of the rigid bodies.
    """

    track: Track = field(kw_only=False)
    camera: Camera = field(default_factory=Camera)
    gait: Gait = field(default_factory=Gait)
    noise: Noise = field(default_factory=Noise)
    exposure: Exposure = field(default_factory=Exposure)
    lighting: Lighting = field(default_factory=Lighting)
    hardware: Hardware = field(default_factory=Hardware)


def kernel_scene(scene: Scene, batch: int) -> NDArray[Any]:
    """A scene as the kernels read it, shape (batch,)."""
    return kernel_rows(scene, batch, {"tape_width": TAPES[scene.tape].width})


def _make_body(stride: float, gait: Gait, hardware: Hardware) -> Body:
    """The rigid bodies of walks with strides of one length [m]."""
    return Body(replace(gait, step=stride / 2.0), hardware)


class Walks:
    """A batch of walks on one track.

    Noise depends on a walk's seed and on the number of its strides alone, never on what is commanded or on
    its neighbours in the batch: equal seeds give every agent the same noise, to the bit.

    Attributes:
        scenes: What each walks on and sees with; track, camera and what is kept of each are the same.
        walks: All state, shape (batch,), dtype ``WALK``.
        plants: What each walk and camera truly is, shape (batch,), dtype ``PLANT``.
        images: What each camera saw last, shape (batch, rows, columns), uint8, and 3 where scenes have
            ``colour``; only if the sight is ``image``.
        stock: Stock effects around the walks, or None.
    """

    def __init__(
        self,
        batch: int,
        scene: Scene,
        reality: ArrayLike | None = None,
        stock: Stepped | None = None,
    ) -> None:
        """Make walks; restart each before the first stride.

        Args:
            batch: Number of walks.
            scene: What they walk on and see with.
            reality: Parameter vector of ``LineFollowing``, shape (n,) or (batch, n); None is nominal.
            stock: Stock effects around them, by ``CHANNELS``.

        Raises:
            ModelError: If the batch is empty or the parameters have the wrong shape.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one walk, not {batch}")
        plants = nominal_plant(scene.gait, scene.camera) if reality is None else as_plants(reality)
        if plants.shape not in ((), (batch,)):
            raise ModelError(f"a batch of {batch} takes one reality or {batch}, not {plants.shape}")
        self.scenes, self.stock = [scene] * batch, stock
        self.records = kernel_scene(scene, batch)
        self._given = np.zeros((batch, MEMORY))
        if stock is not None:
            stock.kept["given"] = self._given
        self.plants = np.array(np.broadcast_to(plants, (batch,)))
        self.walks: NDArray[Any] = np.zeros(batch, dtype=WALK)
        one, track = scene.camera, scene.track
        above = (2 * one.first_row - one.last_row, one.first_row)
        self._rows = ((one.first_row, one.last_row), above)[: scene.bands]
        self._bands = tuple(make_optics(one, *rows) for rows in self._rows)
        self._body_of = lru_cache(maxsize=batch)(_make_body)
        self._renderer_of = lru_cache(maxsize=batch)(self._make_renderer)
        self._track = (track.table, track.spacing, track.closed)
        self._begun = np.zeros(batch, dtype=np.bool_)
        self._rigid = scene.plant == "pymunk"
        self._picture = (one.rows, one.width, 3) if scene.colour else (one.rows, one.width)
        self.images: Image | None = None
        if scene.sight == "image":
            self.images = np.zeros((batch, *self._picture), dtype=np.uint8)

    def __len__(self) -> int:
        """Number of walks."""
        return len(self.walks)

    def set_reality(self, rows: list[int], vectors: FloatArray) -> None:
        """Give some walks, before they begin again, other parameters; shape (len(rows), n)."""
        self.plants[rows] = as_plants(vectors)

    def set_scene(self, i: int, scene: Scene) -> None:
        """Let a walk, before it begins again, be in another scene with the same track, camera and bands."""
        self.scenes[i] = scene
        self.records[i] = kernel_scene(scene, 1)[0]

    def restart(self, which: Iterable[int], rngs: Iterable[np.random.Generator]) -> None:
        """Start several walks anew, each with noise keyed by one draw from its own generator."""
        rows = list(which)
        for i, rng in zip(rows, rngs, strict=True):
            self.seed(i, rng)
        self.begin(rows)

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Key the noise of walk ``i`` by one draw from ``rng``; ``begin`` then starts it."""
        self.walks["key"][i] = drawn_key(rng)

    def begin(self, rows: list[int]) -> None:
        """Start several walks, whose noise has been keyed."""
        if self.stock is not None:
            self.stock.begin(rows)
            self._given[rows] = 0.0
            self._change(rows, 0.0)
        for i in rows:
            start(self.walks, i, self.walks["key"][i], *self._track, self.records)
            if self._rigid:
                body = self._body(i)
                body.place(*(float(self.walks[name][i]) for name in ("x", "y", "heading")))
                self.walks["bodies"][i] = body.state
        self._begun[rows] = True
        self._scan(np.array(rows, dtype=np.int64))

    def advance(self, commands: ArrayLike) -> None:
        """Take every walk through one stride and scan again.

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
        if self.stock is None:
            self._walk(values)
        else:
            self._walk_as_given(values, self.stock)
        self._scan(np.arange(len(self)))

    def _walk(self, commands: FloatArray) -> None:
        """Take every walk through one stride, shape (batch,) [rad]."""
        if self._rigid:
            for i, value in enumerate(commands):
                self._walk_bodies(self._body(i), i, float(value))
        else:
            move(self.walks, commands, *self._track, self.plants, self.records)

    def _walk_as_given(self, commands: FloatArray, stock: Stepped) -> None:
        """As ``_walk``, by what the actuators make of the commands; what is remembered as sent was sent."""
        sent, limit = self.walks["commands"].copy(), self.records["limit"]
        self.walks["commands"] = self._given
        self._change(list(range(len(self))), self.scenes[0].gait.stride_time)
        self._walk(stock.given(commands[:, None])[:, 0])
        self._given[:] = self.walks["commands"]
        self.walks["commands"][:, 0] = np.clip(commands, -limit, limit)
        self.walks["commands"][:, 1:] = sent[:, :-1]
        stock.tick()

    def _change(self, rows: list[int], duration: float) -> None:
        """Let the parameters of some walks be what they are over the time that comes [s]."""
        if self.stock is not None and self.stock.moves:
            self.plants[rows] = as_plants(self.stock.change(rows, duration))

    def _walk_bodies(self, body: Body, i: int, command: float) -> None:
        """Take one walk through a stride of rigid bodies."""
        noise = self.scenes[i].noise
        turn = order(self.walks, i, command, self.plants[i], self.records)
        body.state = self.walks["bodies"][i].copy()
        body.stride(turn + noise.yaw * draw(self.walks, i, YAW))
        sideways, heading = noise.lateral * draw(self.walks, i, LATERAL), float(self.walks["heading"][i])
        body.state[[0, 6, 12]] -= sideways * np.sin(heading)
        body.state[[1, 7, 13]] += sideways * np.cos(heading)
        self.walks["bodies"][i] = body.state
        land(self.walks, i, *body.pose, *self._track, float(self.plants["stride"][i]))

    def _scan(self, which: NDArray[np.int64]) -> None:
        """Let some walks read their cameras."""
        if self.images is None:
            scan(self.walks, which, *self._track, self._bands, self.plants, self.records)
        else:
            self._scan_images(which, self.images)
        if self.stock is not None and self.stock.senses:
            self._show(which, self.stock)

    def _show(self, which: NDArray[np.int64], stock: Stepped) -> None:
        """Put what the sensor shows of the line in the place of what it would; a lost line stays as it is."""
        lines, lost = self.walks["lines"][which, :, 0], self.walks["lost"][which]
        shown = stock.shown(np.where(lost, np.nan, lines), which)
        self.walks["lines"][which, :, 0] = np.where(lost, lines, shown)

    def _scan_images(self, which: NDArray[np.int64], images: Image) -> None:
        """Let some walks take photographs, and their camera boards find the line in them."""
        for i in which:
            scene = self.scenes[i]
            image = self._photograph(i, images[i])
            for band, (first, last) in enumerate(self._rows):
                limit = scene.exposure.levels if scene.colour else scene.exposure.threshold
                column, count = centroid(image, first, last, limit)
                place = (scene.camera.width / 2.0 - column) * scene.camera.metres_per_pixel
                take_in(self.walks, i, band, place, count >= self._bands[band].least, self.plants[i])

    def image(self, i: int) -> Image:
        """What one walk's camera sees, shaped as in ``images``; drawn anew unless images are the sight.

        Both sights put the sensor's noise into where the line is, and so does this picture.
        """
        if self.images is not None:
            image: Image = self.images[i]
            return image
        return self._photograph(i, np.zeros(self._picture, dtype=np.uint8))

    def _body(self, i: int) -> Body:
        """The rigid bodies of a walk."""
        return self._body_of(float(self.plants["stride"][i]), self.scenes[i].gait, self.scenes[i].hardware)

    def _renderer(self, i: int) -> Renderer:
        """What draws the images of a walk's camera."""
        scene = self.scenes[i]
        look = scene.tape, scene.floor, scene.exposure, scene.lighting
        return self._renderer_of(float(self.plants["camera_height"][i]), *look)

    def _make_renderer(
        self, height: float, tape: str, floor: str, exposure: Exposure, lighting: Lighting
    ) -> Renderer:
        scene = self.scenes[0]
        camera = replace(scene.camera, height=height)
        return Renderer(scene.track, camera, make_view(camera, tape, floor, exposure, lighting, scene.colour))

    def _photograph(self, i: int, image: Image) -> Image:
        """Render what one walk's camera sees; a swaying body makes the line's noise."""
        one, plant, scene = self.walks[i], self.plants[i], self.scenes[i]
        sway = scene.noise.sensor / scene.camera.look_ahead * draw(self.walks, i, SENSOR)
        heading = float(one["heading"]) + float(plant["camera_yaw"]["angle"]) - sway
        if scene.camera_yaws_with_inner:
            heading -= float(one["turned"])
        key = (int(one["key"]) + PIXELS + 8 * int(one["count"])) % 2**64
        pose = (float(one["x"]), float(one["y"]), heading)
        return self._renderer(i).image(
            pose, float(one["arc"]), key, image, float(plant["camera_pitch"]["angle"])
        )

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
        if self.images is not None:
            for i in range(len(self)):
                self._photograph(i, self.images[i])
