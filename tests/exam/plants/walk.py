"""A robot that walks along a straight line and sees it with a camera, with anything wrong with it.

A stride goes straight along the heading at its beginning, then the heading turns; the camera board sends the
place of the tape's centroid in a band of rows. Written from docs/line_following.md; places are in metres,
left positive, along a line without end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray

Rng = np.random.Generator
Values = Mapping[str, float]
LIMIT = 0.15
"""Largest turn of a stride [rad]."""
LAW = (-0.3, 0.8, 0.2)
"""Weights of the last but one place of the line, of the last one and of the last command (3.1)."""
HEIGHT, PITCH, VIEW = 1.0, math.radians(45.0), math.radians(50.0)
"""The camera as calibrated: height [m], depression of its axis, horizontal field of view."""
COLUMNS, ROWS, BAND = 160, 120, (40, 80)
"""The image, and the rows that are looked at."""
FOCAL = 0.5 * COLUMNS / math.tan(0.5 * VIEW)
"""Focal length [pixels]."""
WIDTH = 0.0508
"""Of the tape [m]."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
EXCITATION = 0.05
"""Standard deviation of the turns that are added to the law's [rad]."""
NOISE = {"line": 0.02, "offset": 0.005, "heading": 0.01, "yaw": 0.01, "lateral": 0.005}
"""Standard deviations: of the three sensors, of a stride's turn [rad] and of its slip to the side [m]."""

Turn = Callable[[float, int], float]
"""(turn so far, stride) to turn; called once a stride, in order."""
Sight = Callable[[float, int], float]
"""(line's place so far, stride) to what is shown; called once a stride, in order."""


@dataclass
class Walker:
    """A robot with what is wrong with it.

    Attributes:
        stride: Its length [m].
        height: Of the camera [m].
        delay: By how many strides commands are late.
        limit: Largest turn that the motor carries out [rad].
        slip: Share of a turn that is lost, and share of the turn before that is added.
        turns: What becomes of each turn then.
        pushes: Turns that are added [rad], by stride.
        sideways: Way to the left of each stride [m], by its turn.
        yaw: By how much the camera looks to the left [rad].
        pitch: By how much it looks further down [rad].
        sights: What becomes of the line's place, noise not included.
        quantum: To what it is rounded, noise included [m].
        holds: Strides at which a new place is shown; None for all.
        law: What steers it.
        start: Offset [m] and heading [rad] at first.
    """

    stride: float = 0.7
    height: float = HEIGHT
    delay: float = 0.0
    limit: float = math.inf
    slip: tuple[float, float] = (0.0, 0.0)
    turns: list[Turn] = field(default_factory=list)
    pushes: Callable[[int], float] | None = None
    sideways: Callable[[float], float] | None = None
    yaw: float = 0.0
    pitch: float = 0.0
    sights: list[Sight] = field(default_factory=list)
    quantum: float = 0.0
    holds: Callable[[int], bool] | None = None
    law: tuple[float, float, float] = LAW
    start: tuple[float, float] = (0.0, 0.0)

    def look(self, offset: FloatArray, heading: FloatArray) -> FloatArray:
        """Place of the tape's centroid in the band [m], shape (...,); not a number where it is not seen."""
        low, high = (math.atan((row - 0.5 * ROWS) / FOCAL) for row in BAND)
        below = 0.5 * (low + high) + 0.5 * (high - low) * NODES
        rows = WEIGHTS / np.cos(below) ** 2
        ahead = self.height / np.tan(PITCH + self.pitch + below)
        depth = np.hypot(ahead, self.height) * np.cos(below)
        seen = heading + self.yaw
        side = -(offset[..., None] + ahead * np.sin(seen)[..., None]) / np.cos(seen)[..., None]
        half = 0.5 * WIDTH / np.abs(np.cos(seen))[..., None]
        edge = 0.5 * COLUMNS
        left = np.clip(FOCAL / depth * (side - half), -edge, edge)
        right = np.clip(FOCAL / depth * (side + half), -edge, edge)
        pixels = (right - left) @ rows
        middle = math.atan(((BAND[0] + BAND[1] - ROWS) / 2.0) / FOCAL)
        calibrated = HEIGHT / math.sin(PITCH + middle) * math.cos(middle) / FOCAL
        with np.errstate(invalid="ignore"):
            return np.asarray(calibrated * ((right**2 - left**2) @ rows) / (2.0 * pixels))


def simulate(walker: Walker, added: FloatArray, noise: FloatArray) -> FloatArray:
    """Walk, steered by the law.

    Args:
        walker: The robot, fresh: what remembers is used up.
        added: Turns that are added to the law's commands [rad], shape (n,).
        noise: Of line, offset, heading, a stride's turn and its way to the side, shape (n, 5).

    Returns:
        Command [rad], line [m], offset [m] and heading [rad] at each stride, shape (n, 4).
    """
    result = np.full((len(added), 4), np.nan)
    (offset, heading), before, line, law = walker.start, 0.0, 0.0, walker.law
    commands = [0.0, 0.0, 0.0, 0.0]
    for k, errors in enumerate(noise.tolist()):
        shown = float(walker.look(np.array(offset), np.array(heading)))
        for sight in walker.sights:
            shown = sight(shown, k)
        shown += errors[0]
        if walker.quantum:
            shown = walker.quantum * round(shown / walker.quantum)
        if walker.holds is not None and k > 0 and not walker.holds(k):
            shown = line
        before, line = (line if k else shown), shown
        command = law[0] * before + law[1] * line + law[2] * commands[-1] + float(added[k])
        command = min(max(command, -LIMIT), LIMIT)
        commands.append(command)
        result[k] = command, shown, offset + errors[1], heading + errors[2]
        turn = _executed(walker, commands, k)
        aside = errors[4] + (walker.sideways(turn) if walker.sideways else 0.0)
        offset += walker.stride * math.sin(heading) + aside * math.cos(heading)
        heading += turn + errors[3]
        if not abs(offset) < 1.0:
            break
    return result


def _executed(walker: Walker, commands: list[float], k: int) -> float:
    """Turn of a stride by all commands up to it."""

    def carried(newest: int) -> float:
        place = newest - walker.delay
        low = math.floor(place)
        share = place - low
        late = commands[low] * (1.0 - share) + (commands[low + 1] * share if share else 0.0)
        return min(max(late, -walker.limit), walker.limit)

    newest = len(commands) - 1
    lost, twist = walker.slip
    turn = (1.0 - lost) * carried(newest) + (twist * carried(newest - 1) if twist else 0.0)
    for change in walker.turns:
        turn = change(turn, k)
    return turn + (walker.pushes(k) if walker.pushes else 0.0)


def install(walker: Walker, effects: Mapping[str, Values]) -> None:
    """Let listed effects act on a robot, in the documented order."""
    for name in ORDER:
        if name in effects:
            LISTED[name](walker, effects[name])


def _delay(walker: Walker, values: Values) -> None:
    walker.delay = values["strides"]


def _saturation(walker: Walker, values: Values) -> None:
    walker.limit = values["turn"]


def _foot_slip(walker: Walker, values: Values) -> None:
    walker.slip = values["turn"], values["twist"]
    walker.stride *= 1.0 - values["step"]


def _gain(walker: Walker, values: Values) -> None:
    walker.turns.append(lambda turn, _k: values["factor"] * turn)


def _bias(walker: Walker, values: Values) -> None:
    walker.turns.append(lambda turn, _k: turn + values["turn"])


def _yaw(walker: Walker, values: Values) -> None:
    walker.yaw = values["angle"]


def _pitch(walker: Walker, values: Values) -> None:
    walker.pitch = values["angle"]


def _scale(walker: Walker, values: Values) -> None:
    walker.sights.append(lambda line, _k: values["factor"] * line)


def _rounding(walker: Walker, values: Values) -> None:
    walker.quantum = values["step"]


LISTED: Mapping[str, Callable[[Walker, Values], None]] = {
    "actuator_delay": _delay,
    "actuator_saturation": _saturation,
    "foot_slip": _foot_slip,
    "turn_gain": _gain,
    "steering_bias": _bias,
    "camera_yaw": _yaw,
    "camera_pitch": _pitch,
    "sensor_gain": _scale,
    "sensor_quantisation": _rounding,
}
ORDER = tuple(LISTED)
WalkFault = Fault[Walker, int]
"""The scale of a walk is its number of strides."""
OF_STEERING, ASIDE = ("force turn over steering",), ("force sideways way of a stride over steering",)
FADES = ("force share of turn over time", "force turn over steering*time")
BENT_CAMERA, CAMERA_OVER_TIME = ("sensor line over line",), ("sensor line over time",)
LATE_CAMERA = ("sensor line over past of line",)


def _weak_left(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    share = math.exp(-0.05 * k)
    walker.turns.append(lambda turn, _k: share * turn if turn > 0.0 else turn)


def _smeared_camera(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    share, last = 1.0 - math.exp(-0.05 * k), [0.0]

    def smear(line: float, stride: int) -> float:
        last[0] = line if stride == 0 else share * last[0] + (1.0 - share) * line
        return last[0]

    walker.sights.append(smear)


def _warming_up(walker: Walker, k: float, n: int, _rng: Rng) -> None:
    walker.turns.append(lambda turn, stride: turn * (1.0 - min(0.02 * k, 0.95) * math.exp(-5.0 * stride / n)))


def _limp(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.turns.append(lambda turn, stride: turn + 0.005 * k * (-1.0) ** stride)


def _sideways_slide(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sideways = lambda turn: -0.05 * k * turn


def _turn_dead_zone(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    width = 0.005 * k
    walker.turns.append(lambda turn, _k: math.copysign(max(abs(turn) - width, 0.0), turn))


def _held_samples(walker: Walker, k: float, n: int, rng: Rng) -> None:
    fresh = (rng.uniform(size=n + 1) >= min(0.02 * k, 0.95)).tolist()
    walker.holds = lambda stride: fresh[stride]


def _gusts(walker: Walker, k: float, n: int, rng: Rng) -> None:
    winds, wind = [], 0.0
    for drawn in rng.standard_normal(n + 1).tolist():
        wind = 0.7 * wind + 0.7 * drawn
        winds.append(0.003 * k * wind)
    walker.pushes = lambda stride: winds[stride]


def _square_turn(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.turns.append(lambda turn, _k: turn + 0.5 * k * turn * turn)


def _sinking_camera(walker: Walker, k: float, n: int, _rng: Rng) -> None:
    walker.sights.append(lambda line, stride: line * (1.0 + 0.02 * k * stride / n))


def _swaying_camera(walker: Walker, k: float, _n: int, rng: Rng) -> None:
    phase = rng.uniform(0.0, 2.0 * math.pi)
    walker.sights.append(lambda line, stride: line + 0.005 * k * math.sin(0.9 * stride + phase))


def _camera_knocked(walker: Walker, k: float, n: int, rng: Rng) -> None:
    when = rng.uniform(0.3, 0.7) * n
    walker.sights.append(lambda line, stride: line + (0.005 * k if stride > when else 0.0))


def _sideways_square(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sideways = lambda turn: k * turn * abs(turn)


def _sluggish_turn(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    share, last = 1.0 - math.exp(-0.1 * k), [0.0]

    def follow(turn: float, _stride: int) -> float:
        last[0] += (1.0 - share) * (turn - last[0])
        return last[0]

    walker.turns.append(follow)


DEVELOP: Mapping[str, WalkFault] = {
    "square_turn": Fault(
        "Turns are larger to the left, the more the larger.", _square_turn, shows=OF_STEERING
    ),
    "sinking_camera": Fault(
        "The camera's scale grows while it walks.", _sinking_camera, shows=("sensor line over line*time",)
    ),
    "swaying_camera": Fault("The camera sways.", _swaying_camera, shows=CAMERA_OVER_TIME),
    "camera_knocked": Fault(
        "The camera was knocked aside at some time.", _camera_knocked, shows=CAMERA_OVER_TIME
    ),
    "sideways_square": Fault("It slides to the side in sharp turns.", _sideways_square, shows=ASIDE),
    "sluggish_turn": Fault(
        "Turns follow their commands slowly.",
        _sluggish_turn,
        ("lag",),
        shows=("force turn over past of steering",),
    ),
    "weak_left": Fault("It turns less to the left than to the right.", _weak_left, shows=OF_STEERING),
    "smeared_camera": Fault(
        "The camera still shows a share of what it saw before.", _smeared_camera, shows=LATE_CAMERA
    ),
    "limp": Fault("It limps: every other stride turns it.", _limp, shows=("force turn over time",)),
    "sideways_slide": Fault("It slides to the side in turns.", _sideways_slide, shows=ASIDE),
    "turn_dead_zone": Fault(
        "Small turns are not carried out.", _turn_dead_zone, ("dead_zone",), shows=OF_STEERING
    ),
    "held_samples": Fault(
        "Places of the line are lost; the last one is shown.", _held_samples, random=True, shows=LATE_CAMERA
    ),
    "gusts": Fault("Gusts of wind turn it.", _gusts, random=True),
    "warming_up": Fault("Turns are too small at first.", _warming_up, shows=FADES),
}
"""To develop a diagnosis on."""


def _bent_camera(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sights.append(lambda line, _k: line + 0.5 * k * line**3)


def _quadratic_camera(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sights.append(lambda line, _k: line + 0.1 * k * line * line)


def _one_sided_scale(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sights.append(lambda line, _k: line * (1.0 + 0.05 * k) if line > 0.0 else line)


def _camera_wander(walker: Walker, k: float, n: int, rng: Rng) -> None:
    places, place = [], 0.0
    for drawn in rng.standard_normal(n + 1).tolist():
        place = 0.9 * place + 0.44 * drawn
        places.append(0.005 * k * place)
    walker.sights.append(lambda line, stride: line + places[stride])


def _crab(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    walker.sideways = lambda _turn: 0.001 * k


def _fading_gain(walker: Walker, k: float, n: int, _rng: Rng) -> None:
    walker.turns.append(lambda turn, stride: turn * math.exp(-0.05 * k * stride / n))


def _coarse_command(walker: Walker, k: float, _n: int, _rng: Rng) -> None:
    quantum = 0.01 * k
    walker.turns.append(lambda turn, _k: quantum * math.floor(turn / quantum + 0.5))


REPORT: Mapping[str, WalkFault] = {
    "bent_camera": Fault(
        "The camera's scale grows towards its edges.", _bent_camera, ("bend",), shows=BENT_CAMERA
    ),
    "quadratic_camera": Fault(
        "The camera's scale is larger on one side.", _quadratic_camera, ("bend",), shows=BENT_CAMERA
    ),
    "one_sided_scale": Fault("The camera shows more on one side.", _one_sided_scale, shows=BENT_CAMERA),
    "camera_wander": Fault("The camera wanders.", _camera_wander, random=True),
    "crab": Fault("It walks askew, like a crab.", _crab, shows=("force sideways way of a stride",)),
    "fading_gain": Fault("Turns fade while it walks.", _fading_gain, shows=FADES),
    "coarse_command": Fault("Turns know few levels.", _coarse_command, shows=OF_STEERING),
}
"""To report on: no kind of the other set."""
