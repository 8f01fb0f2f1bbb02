"""What the walking robot, its camera, its tape and its floor are, as numbers with their sources.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 3 ("the dissertation"). It gives the step's
order, the camera's angle, the band of rows and the turn's radius; what it does not give is marked
*assumed*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fieldmodels.model import ModelError


@dataclass(frozen=True)
class Gait:
    """How the robot walks and turns.

    Attributes:
        step: Length of one step [m] (chapter 2).
        step_time: Time of one step [s] (assumed).
        limit: Largest turn of one stride [rad] (assumed; a circle of 9 m needs 0.078).
    """

    step: float = 0.35
    step_time: float = 0.6
    limit: float = 0.15

    @property
    def stride(self) -> float:
        """Length of a stride, one step of the outer and one of the inner legs [m]."""
        return 2.0 * self.step

    @property
    def stride_time(self) -> float:
        """Time of a stride [s]."""
        return 2.0 * self.step_time


@dataclass(frozen=True)
class Camera:
    """A CMUcam4 on the front of the body, looking down at the floor ahead (section 3.5.1).

    Attributes:
        height: Height above the floor [m] (assumed).
        pitch: Angle of the optical axis below the horizon [rad] (section 3.5.1: "roughly 45 degrees").
        field_of_view: Horizontal field of view [rad] (assumed).
        width: Columns of the image.
        rows: Rows of the image.
        first_row: First row of the band that is looked at.
        last_row: Row after the last one of the band; the middle third of the view (section 3.3.2).
        least_pixels: Fewer tape pixels in the band mean that the line is lost (assumed).
    """

    height: float = 1.0
    pitch: float = math.pi / 4
    field_of_view: float = math.radians(50.0)
    width: int = 160
    rows: int = 120
    first_row: int = 40
    last_row: int = 80
    least_pixels: int = 60

    def __post_init__(self) -> None:
        """Check that the band lies in the image and sees the floor.

        Raises:
            ModelError: If it does not.
        """
        if not 0 <= self.first_row < self.last_row <= self.rows:
            raise ModelError(f"rows {self.first_row} to {self.last_row} are no band of {self.rows} rows")
        if self.depression(0) <= 0.0:
            raise ModelError("the camera's upper rows look above the horizon: raise pitch or field_of_view")

    @property
    def focal(self) -> float:
        """Focal length [pixels]."""
        return self.width / 2.0 / math.tan(self.field_of_view / 2.0)

    def depression(self, row: float) -> float:
        """Angle of a row's centre below the horizon [rad]."""
        return self.pitch + math.atan((row + 0.5 - self.rows / 2.0) / self.focal)

    def distance(self, row: float) -> float:
        """Distance ahead at which a row's centre meets the floor [m]."""
        return self.height / math.tan(self.depression(row))

    @property
    def look_ahead(self) -> float:
        """Distance ahead at which the band's middle row meets the floor [m]."""
        return self.distance((self.first_row + self.last_row - 1) / 2.0)

    @property
    def metres_per_pixel(self) -> float:
        """Sideways distance on the floor of one column at the band's middle row [m]."""
        depth = self.look_ahead * math.cos(self.pitch) + self.height * math.sin(self.pitch)
        return depth / self.focal


@dataclass(frozen=True)
class Noise:
    """What disturbs the walk and the sensor in the kinematic plant (all assumed).

    Attributes:
        sensor: Standard deviation of the centroid [m].
        yaw: Standard deviation of a stride's turn [rad].
        lateral: Standard deviation of a stride's sideways slip [m].
        bias: Largest steering bias of an episode [rad a stride]; drawn from +- this.
    """

    sensor: float = 0.02
    yaw: float = 0.01
    lateral: float = 0.005
    bias: float = 0.02


@dataclass(frozen=True)
class Tape:
    """A tape on the floor.

    Attributes:
        width: Width [m].
        reflectance: Share of the light that it reflects.
    """

    width: float = 0.0508
    reflectance: float = 0.0125


TAPES = {
    "duvetyne": Tape(),
    "shurtape": Tape(reflectance=0.025),
    "masking": Tape(reflectance=0.031),
    "gaffer": Tape(reflectance=0.0375),
    "duvetyne_wide": Tape(width=0.1016),
}
"""The dissertation's tapes. Duvetyne is 2 inches wide and "about twice as dark as the second darkest"; the
floor of the same photo is eight times as bright as the lightest (section 3.4.1, Fig 3.11), taken for 0.3.
``duvetyne_wide`` is the line thickened with extra tape (section 3.6)."""

FLOORS = {"linoleum": 0.30, "cement": 0.27, "white": 0.80, "dark_grey": 0.15}
"""Share of the light that floors reflect (assumed; linoleum and tape read 165 and 35, Fig 3.13)."""


@dataclass(frozen=True)
class Exposure:
    """How the camera turns light into pixels, and the firmware pixels into tape.

    A pixel is ``gain (reflectance light + pedestal)`` with the gain set so that the image's mean is
    ``mean``, up to ``most``: section 3.4.2 says that auto exposure moves the tape's level with the light. The
    pedestal is what the sensor reads without light; Duvetyne is 24 times darker than linoleum but reads 35
    beside 165 (Fig 3.13), which takes a pedestal of 0.065. It makes tape in the dark look like floor: the
    line is lost (section 3.6), where a sensor without one would see tape everywhere.

    Attributes:
        mean: Mean level that auto exposure aims at (Fig 3.13).
        gain: Largest gain, in levels (assumed: five times the gain at full light).
        pedestal: Reading without light, in units of full light.
        noise: Standard deviation of a pixel at the gain of full light, in levels; grows with the gain.
        threshold: A pixel below it is tape, in levels (section 3.4.2, by its calibration).
    """

    mean: float = 160.0
    gain: float = 2400.0
    pedestal: float = 0.065
    noise: float = 5.0
    threshold: float = 90.0


FULL_LIGHT_GAIN = 452.0
"""Gain at which linoleum at full light reads 165 [levels]."""


@dataclass(frozen=True)
class Lighting:
    """Light on the floor.

    Attributes:
        ambient: Light everywhere, 1 for a well lit hall.
        dark_x: Centre of a dark corner [m].
        dark_y: Centre of a dark corner [m].
        dark_radius: Radius within which it is dark [m]; 0 for no dark corner. The light comes back over the
            same distance.
        dark_light: Light in the dark corner.
        sun_azimuth: Direction to which the sun throws the robot's shadow [rad].
        sun_length: Length of the shadow [m]; 0 for no sun.
        sun_shade: Share of the light that is left in the shadow.
    """

    ambient: float = 1.0
    dark_x: float = 0.0
    dark_y: float = 0.0
    dark_radius: float = 0.0
    dark_light: float = 0.05
    sun_azimuth: float = 0.0
    sun_length: float = 0.0
    sun_shade: float = 0.25


SHADOW_WIDTH = 0.5
"""Width of the robot's shadow [m] (assumed)."""
