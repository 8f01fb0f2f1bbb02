"""What the walking robot, its camera, its tape and its floor are, as numbers with their sources.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 3 ("the dissertation"). It gives the step's
order, the camera's angle, the band of rows and the turn's radius; what it does not give is marked
*assumed*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, check_declared

TurnLimit = Annotated[
    float,
    Setting("Largest turn of a stride (assumed).", "rad", above=0, most=0.5),
]


@dataclass(frozen=True)
class Gait:
    """How the robot walks and turns.

    Attributes:
        step: Length of one step [m] (chapter 2).
        step_time: Time of one step [s] (assumed).
    """

    step: float = 0.35
    step_time: float = 0.6
    limit: TurnLimit = 0.15

    def __post_init__(self) -> None:
        """Check the limit; see ``check_declared``."""
        check_declared(self)

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
    """What disturbs the walk and the sensor in the kinematic plant (all assumed)."""

    sensor: Annotated[float, Setting("Standard deviation of the line's place.", "m", least=0, most=0.5)] = (
        0.02
    )
    yaw: Annotated[float, Setting("Standard deviation of a stride's turn.", "rad", least=0, most=0.2)] = 0.01
    lateral: Annotated[
        float, Setting("Standard deviation of a stride's sideways slip.", "m", least=0, most=0.2)
    ] = 0.005
    bias: Annotated[
        float,
        Setting(
            "Largest steering bias; each episode draws its own, a stride.",
            "rad",
            least=0,
            most=0.2,
        ),
    ] = 0.02

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


Reflectance = float | tuple[float, float, float]
"""Share of the light that is reflected; three numbers for red, green and blue."""


@dataclass(frozen=True)
class Tape:
    """A tape on the floor.

    Attributes:
        width: Width [m].
        reflectance: Share of the light that it reflects, or of red, green and blue light.
    """

    width: float = 0.0508
    reflectance: Reflectance = 0.0125


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

FLOORS: dict[str, Reflectance] = {
    "linoleum": 0.30,
    "cement": 0.27,
    "white": 0.80,
    "dark_grey": 0.15,
    "track_red": (0.30, 0.14, 0.10),
    "track_green": (0.10, 0.24, 0.12),
}
"""Share of the light that floors reflect (assumed; linoleum and tape read 165 and 35, Fig 3.13). The last two
are the red-brown lanes and the green areas beside them in Barton Hall (section 3.1.2)."""


Threshold = Annotated[
    float,
    Setting("Level below which a pixel is tape (section 3.4.2).", above=0, below=255),
]


Level = Annotated[float, Setting("", above=0, below=256)]
RgbThresholds = Annotated[
    tuple[Level, Level, Level] | None,
    Setting("Levels of red, green and blue; below all three a pixel is tape. None for `threshold` in each."),
]


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
    """

    mean: float = 160.0
    gain: float = 2400.0
    pedestal: float = 0.065
    noise: float = 5.0
    threshold: Threshold = 90.0
    rgb_thresholds: RgbThresholds = None

    @property
    def levels(self) -> tuple[float, float, float]:
        """Thresholds of red, green and blue."""
        return self.rgb_thresholds or (self.threshold,) * 3


FULL_LIGHT_GAIN = 452.0
"""Gain at which linoleum at full light reads 165 [levels]."""


Finite = Annotated[float, Setting("")]
Length = Annotated[float, Setting("", above=0)]
Light = Annotated[float, Setting("", least=0, most=1)]


@dataclass(frozen=True)
class Lighting:
    """Light on the floor; it acts where images are rendered."""

    light: Annotated[float, Setting("Light everywhere, 1 for a well lit hall.", least=0, most=2)] = 1.0
    dark_corner: Annotated[
        tuple[Finite, Finite, Length, Light] | None,
        Setting("Centre x, y and radius of a dark corner [m], and the light there; None for none."),
    ] = None
    sun: Annotated[
        tuple[Finite, Length] | None,
        Setting("Direction [rad] and length [m] of the robot's shadow; None for no sun."),
    ] = None
    sun_shade: Annotated[float, Setting("Share of the light in the shadow.", least=0, most=1)] = 0.25

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


SHADOW_WIDTH = 0.5
"""Width of the robot's shadow [m] (assumed)."""


@dataclass(frozen=True, kw_only=True)
class WalkRules:
    """How a walk begins, moves and sees."""

    plant: Annotated[
        Literal["kinematic", "pymunk"],
        Setting(
            "`kinematic`, or `pymunk`: rigid bodies whose feet can slip and whose motor can give way.",
            fixed="one kind of physics moves all rows",
        ),
    ] = "kinematic"
    sight: Annotated[
        Literal["geometry", "image"],
        Setting(
            "`geometry` computes the line's centroid; `image` runs the firmware on an image.",
            fixed="images are kept of all rows or of none",
        ),
    ] = "geometry"
    bands: Annotated[
        int,
        Setting(
            "Bands of rows whose centroid is observed.",
            least=1,
            most=2,
            fixed="it shapes the observation",
        ),
    ] = 1
    latency_strides: Annotated[
        int, Setting("Strides of a command's delay beyond the gait's own.", least=0, most=1)
    ] = 0
    camera_yaws_with_inner: Annotated[
        bool, Setting("The camera turns with the inner legs, not the body.")
    ] = False
    offset: Annotated[
        float, Setting("Largest distance from the line at the start.", "m", least=0, most=0.5)
    ] = 0.2
    misalignment: Annotated[
        float, Setting("Largest heading error at the start.", "rad", least=0, most=0.5)
    ] = 0.1
    sided: Annotated[bool, Setting("Every episode starts at the largest distance.")] = False
    tape: Annotated[
        Literal["duvetyne", "shurtape", "masking", "gaffer", "duvetyne_wide"],
        Setting("The tape; `duvetyne_wide` is twice as wide."),
    ] = "duvetyne"
    floor: Annotated[
        Literal["linoleum", "cement", "white", "dark_grey", "track_red", "track_green"], Setting("The floor.")
    ] = "linoleum"
    colour: Annotated[
        bool,
        Setting("Images have red, green and blue.", fixed="it shapes the images"),
    ] = False

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)
