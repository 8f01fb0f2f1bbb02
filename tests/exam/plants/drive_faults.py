"""What can be wrong with a drive: listed effects by their documented equations, and unlisted faults.

The documented chain: gains, dead zone, saturation, jump of the rims -> delay -> lag at a limited rate ->
unequal wheels, slip, slope -> pose -> late, turned sensor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from exam.plants.drive import Command, Drive, Ground, Motion, Pose, Rim
from exam.plants.faults import Fault

Rng = np.random.Generator
Values = Mapping[str, float]


def install(drive: Drive, effects: Mapping[str, Values]) -> None:
    """Let listed effects act on a drive, in the documented order."""
    for name in ORDER:
        if name in effects:
            LISTED[name](drive, effects[name])


def _gain(drive: Drive, values: Values) -> None:
    drive.rims.append(lambda rim, _side, _t: values["gain"] * rim)


def _turn(drive: Drive, values: Values) -> None:
    drive.commands.append(lambda speed, rate, _t: (speed, values["gain"] * rate))


def _dead_zone(drive: Drive, values: Values) -> None:
    width = values["width"]
    drive.rims.append(lambda rim, _side, _t: math.copysign(max(abs(rim) - width, 0.0), rim))


def _saturation(drive: Drive, values: Values) -> None:
    limit = values["limit"]
    drive.rims.append(lambda rim, _side, _t: min(max(rim, -limit), limit))


def _jump(drive: Drive, values: Values) -> None:
    drive.rims.append(lambda rim, _side, t: rim * (values["factor"] if t >= values["time"] else 1.0))


def _delay(drive: Drive, values: Values) -> None:
    drive.delay = values["delay"]


def _lag(drive: Drive, values: Values) -> None:
    drive.lag = values["time_constant"]


def _rate(drive: Drive, values: Values) -> None:
    drive.rate = values["rate"]


def _unequal(drive: Drive, values: Values) -> None:
    half, track = 0.5 * values["difference"], drive.track

    def veer(motion: Motion, _pose: Pose, _t: float) -> Motion:
        forward, sideways, rate = motion
        left = (forward - 0.5 * track * rate) * (1.0 + half)
        right = (forward + 0.5 * track * rate) * (1.0 - half)
        return 0.5 * (left + right), sideways, (right - left) / track

    drive.ground.append(veer)


def _yaw_slip(drive: Drive, values: Values) -> None:
    kept = 1.0 - values["share"]
    drive.ground.append(lambda motion, _pose, _t: (motion[0], motion[1], kept * motion[2]))


def _sideways(drive: Drive, values: Values) -> None:
    size = values["coefficient"]

    def slip(motion: Motion, _pose: Pose, _t: float) -> Motion:
        ahead = motion[0] + size * motion[1] * motion[2] if drive.across else motion[0]
        return ahead, motion[1] - size * motion[0] * motion[2], motion[2]

    drive.ground.append(slip)


def _slope(drive: Drive, values: Values) -> None:
    def creep(motion: Motion, pose: Pose, _t: float) -> Motion:
        fast = math.hypot(*motion[:2]) if drive.across else abs(motion[0])
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        x, y = values["x"] * fast, values["y"] * fast
        return motion[0] + cosine * x + sine * y, motion[1] - sine * x + cosine * y, motion[2]

    drive.ground.append(creep)


def _late(drive: Drive, values: Values) -> None:
    drive.late = lambda _t: values["delay"]


def _askew(drive: Drive, values: Values) -> None:
    drive.sensors.append(lambda shown, _true, _t: (shown[0], shown[1], shown[2] + values["angle"]))


LISTED: Mapping[str, Callable[[Drive, Values], None]] = {
    "turn_gain": _turn,
    "actuator_gain": _gain,
    "actuator_dead_zone": _dead_zone,
    "actuator_saturation": _saturation,
    "parameter_step": _jump,
    "actuator_delay": _delay,
    "actuator_lag": _lag,
    "actuator_rate_limit": _rate,
    "unequal_wheels": _unequal,
    "yaw_slip": _yaw_slip,
    "sideways_slip": _sideways,
    "slope": _slope,
    "sensor_delay": _late,
    "heading_bias": _askew,
}
ORDER = tuple(LISTED)


@dataclass(frozen=True)
class Scale:
    """Typical sizes of a drive, by which faults are measured.

    Attributes:
        speed: Largest speed [m/s].
        rate: Largest turn rate [rad/s].
        rim: Largest speed of a rim [m/s].
        duration: Of a record [s].
        step: Sampling interval [s].
    """

    speed: float
    rate: float
    rim: float
    duration: float
    step: float


DriveFault = Fault[Drive, Scale]


def _there(direction: str) -> str:
    """A direction on the ground, and where wheels are measured that of the drive."""
    return f"{direction}|{direction} of the drive"


def shares(directions: str) -> str:
    """Shares of directions."""
    return "|".join(f"share of {one}" for one in directions.split("|"))


TURN, FORWARD = _there("turn rate"), _there("forward speed")
LEFT, RIGHT = _there("left wheel"), _there("right wheel")
LEFT_RIM, RIGHT_RIM = "left rim|left command|left wheel", "right rim|right command|right wheel"
TURNING = "turn rate|rate of heading"
OF_TURN = (f"force {TURN} over {TURNING}",)
OF_TURN_AND_SPEED = (f"force turn rate over speed*{TURNING}",)
PAST_TURNS = (f"force {TURN} over past of turn rate",)
PAST_COMMANDS = (
    *PAST_TURNS, f"force {FORWARD} over past of speed", f"force {LEFT} over past of {LEFT_RIM}",
    f"force {RIGHT} over past of {RIGHT_RIM}",
)  # fmt: skip
LATE_POSE = (
    "sensor x over rate of x", "sensor y over rate of y", f"sensor heading over {TURNING}",
    "force turn rate over past of turn rate", "force forward speed over past of speed",
)  # fmt: skip
"""A pose that is late is one whose motion is."""
SCALED = ("sensor x over x", "sensor y over y")
FADES = (
    f"force {shares('|'.join([TURN, FORWARD, LEFT, RIGHT]))} over time", f"force {TURN} over turn rate*time",
    f"force {FORWARD} over speed*time", f"force {LEFT} over {LEFT_RIM}*time",
    f"force {RIGHT} over {RIGHT_RIM}*time",
)  # fmt: skip


def _command(drive: Drive, change: Command) -> None:
    drive.commands.append(change)


def _rim(drive: Drive, change: Rim) -> None:
    drive.rims.append(change)


def _on_ground(drive: Drive, change: Ground) -> None:
    drive.ground.append(change)


def _samples(s: Scale) -> int:
    return round(s.duration / s.step) + 2


# To develop on.


def _weak_left(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    share = math.exp(-0.02 * k)
    _command(drive, lambda speed, rate, _t: (speed, share * rate if rate > 0.0 else rate))


def _surging_drive(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    way = [0.0]

    def surge(motion: Motion, _pose: Pose, _t: float) -> Motion:
        way[0] += motion[0] * s.step / 8.0
        return motion[0] * (1.0 + 0.02 * k * math.sin(way[0] / drive.radius)), motion[1], motion[2]

    _on_ground(drive, surge)


def _marker_ahead(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    ahead = 0.002 * k * s.speed
    drive.sensors.append(
        lambda p, true, _t: (p[0] + ahead * math.cos(true[2]), p[1] + ahead * math.sin(true[2]), p[2])
    )


def _turn_dead_zone(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    width = 0.02 * k * s.rate
    _command(drive, lambda speed, rate, _t: (speed, math.copysign(max(abs(rate) - width, 0.0), rate)))


def _yaw_inertia(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    share, turning = 1.0 - math.exp(-1.0 / (0.8 * k)), [0.0]

    def follow(motion: Motion, _pose: Pose, _t: float) -> Motion:
        turning[0] += share * (motion[2] - turning[0])
        return motion[0], motion[1], turning[0]

    _on_ground(drive, follow)


def _soft_tyres(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(drive, lambda m, _p, _t: (m[0] / (1.0 + 0.02 * k * abs(m[0]) / s.speed), m[1], m[2]))


def _tracker_scale(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    scale = math.exp(0.005 * k)
    drive.sensors.append(lambda p, _true, _t: (scale * p[0], scale * p[1], p[2]))


def _stiff_wheel(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    width = 0.01 * k * s.rim
    _rim(
        drive,
        lambda rim, side, _t: math.copysign(max(abs(rim) - width, 0.0), rim) if side < 0.0 else rim,
    )


def _slippery_patch(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    kept = math.exp(-0.05 * k)

    def slip(motion: Motion, pose: Pose, _t: float) -> Motion:
        share = kept if math.sin(pose[0]) > 0.0 else 1.0
        return share * motion[0], motion[1], share * motion[2]

    _on_ground(drive, slip)


def _lost_commands(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    lost = (rng.uniform(size=_samples(s)) < min(0.01 * k, 0.95)).tolist()
    last = [(0.0, 0.0)]

    def lose(speed: float, rate: float, t: float) -> tuple[float, float]:
        if not lost[round(t / s.step)]:
            last[0] = speed, rate
        return last[0]

    _command(drive, lose)


def _held_samples(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    fresh = (rng.uniform(size=_samples(s)) >= min(0.01 * k, 0.95)).tolist()
    drive.holds = lambda i: fresh[i]


def _input_play(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    half, engaged = 0.01 * k * s.rate, [0.0]

    def play(speed: float, rate: float, _t: float) -> tuple[float, float]:
        engaged[0] = min(max(engaged[0], rate - half), rate + half)
        return speed, engaged[0]

    _command(drive, play)


def _hunting(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    phase, rate = rng.uniform(0.0, 2.0 * math.pi), 0.03 * math.pi / s.step
    _command(drive, lambda v, w, t: (v + 0.01 * k * s.speed * math.sin(rate * t + phase), w))


def _sagging_supply(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    load, share = [0.0], s.step / 1.5

    def sag(speed: float, rate: float, _t: float) -> tuple[float, float]:
        load[0] += share * ((speed / s.speed) ** 2 - load[0])
        weaker = 1.0 / (1.0 + 0.05 * k * load[0])
        return weaker * speed, weaker * rate

    _command(drive, sag)


def _patchy_grip(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    lost = np.minimum(0.02 * k * np.abs(rng.standard_normal(_samples(s))), 1.0).tolist()
    _command(drive, lambda speed, rate, t: (speed, rate * (1.0 - lost[round(t / s.step)])))


def _worn_wheel(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _rim(drive, lambda rim, side, t: rim * (1.0 - 0.005 * k * (t / s.duration) * (side > 0)))


def _heading_scale(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    drive.sensors.append(lambda p, _true, _t: (p[0], p[1], p[2] * (1.0 + 0.002 * k)))


def _tracker_lens(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    reach = 5.0 * s.speed

    def bend(p: Pose, _true: Pose, _t: float) -> Pose:
        share = 1.0 + 0.01 * k * (p[0] ** 2 + p[1] ** 2) / reach**2
        return p[0] * share, p[1] * share, p[2]

    drive.sensors.append(bend)


def _drag(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(
        drive, lambda m, _p, _t: (m[0] - 0.005 * k * s.speed * math.tanh(20.0 * m[0] / s.speed), *m[1:])
    )


def _side_skid(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(drive, lambda m, _p, _t: (m[0], m[1] - 0.01 * k * s.speed * (m[2] / s.rate) ** 2, m[2]))


def _gusts(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    gusts, gust = [], 0.0
    for drawn in rng.standard_normal(_samples(s)).tolist():
        gust = 0.9 * gust + 0.44 * drawn
        gusts.append(0.01 * k * s.rate * gust)
    _on_ground(drive, lambda m, _p, t: (m[0], m[1], m[2] + gusts[int(t / s.step + 1e-6)]))


def _furrows(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    length, phase = 1.5 * s.speed, rng.uniform(0.0, 2.0 * math.pi)
    size = 0.01 * k * s.rate
    _on_ground(
        drive,
        lambda m, p, _t: (m[0], m[1], m[2] + size * math.sin(2.0 * math.pi * p[0] / length + phase)),
    )


DEVELOP: Mapping[str, DriveFault] = {
    "worn_wheel": Fault(
        "One wheel becomes smaller.",
        _worn_wheel,
        shows=(f"force {RIGHT}|{TURN} over {RIGHT_RIM}|speed*time", f"force {shares(RIGHT)} over time"),
    ),
    "heading_scale": Fault(
        "The heading is shown too large.",
        _heading_scale,
        ("heading_gain",),
        shows=("sensor heading over heading",),
    ),
    "tracker_lens": Fault(
        "The tracker's picture is stretched towards its rim.",
        _tracker_lens,
        shows=(*SCALED, "sensor x|y over x*y"),
    ),
    "drag": Fault(
        "A constant share of its speed is lost either way.", _drag, shows=("force forward speed over speed",)
    ),
    "side_skid": Fault(
        "It skids to one side in turns of either sense.",
        _side_skid,
        shows=(f"force sideways speed over {TURNING}",),
    ),
    "gusts": Fault("Gusts of wind turn it.", _gusts, random=True),
    "furrows": Fault(
        "Furrows turn it, each time it crosses one.", _furrows, shows=("force turn rate over x",)
    ),
    "weak_left": Fault("It turns less to the left than to the right.", _weak_left, shows=OF_TURN),
    "surging_drive": Fault(
        "It surges once a turn of an eccentric wheel.",
        _surging_drive,
        shows=("force share of forward speed over speed",),
    ),
    "marker_ahead": Fault(
        "The tracked marker is ahead of the axle.",
        _marker_ahead,
        shows=("sensor x|y over heading", f"force sideways speed over {TURNING}"),
    ),
    "turn_dead_zone": Fault("Small turn rates are not carried out.", _turn_dead_zone, shows=OF_TURN),
    "yaw_inertia": Fault(
        "The body turns later than its wheels.",
        _yaw_inertia,
        shows=(f"force turn rate over past of {TURNING}",),
    ),
    "soft_tyres": Fault(
        "Tyres slip the more, the faster it goes.", _soft_tyres, shows=("force forward speed over speed",)
    ),
    "tracker_scale": Fault(
        "The tracker's unit of length is wrong.",
        _tracker_scale,
        shows=(*SCALED, "force forward speed over speed"),
    ),
    "stiff_wheel": Fault(
        "One wheel has a dead zone.",
        _stiff_wheel,
        ("dead_zone",),
        shows=(f"force {LEFT}|{TURN} over {LEFT_RIM}",),
    ),
    "slippery_patch": Fault(
        "It slips where the ground is slippery.",
        _slippery_patch,
        shows=(
            "force share of forward speed|share of turn rate over x",
            "force turn rate over turn rate*x",
            "force forward speed over speed*x",
        ),
    ),
    "lost_commands": Fault(
        "Commands are lost; the last one holds.", _lost_commands, random=True, shows=PAST_COMMANDS
    ),
    "held_samples": Fault(
        "Poses are lost; the last one is shown.", _held_samples, random=True, shows=LATE_POSE
    ),
    "input_play": Fault("The turn rate has play.", _input_play, ("play",), shows=PAST_TURNS),
    "sagging_supply": Fault(
        "The supply sags at speed.",
        _sagging_supply,
        shows=(f"force {FORWARD} over past of speed", f"force {TURN} over turn rate*past of speed"),
    ),
    "hunting": Fault(
        "The speed swings about the commanded one.", _hunting, shows=(f"force {FORWARD} over time",)
    ),
    "patchy_grip": Fault("Of each turn a random share is lost.", _patchy_grip, random=True, shows=OF_TURN),
}


# To report on.


def _understeer(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(drive, lambda m, _p, _t: (m[0], m[1], m[2] / (1.0 + 0.02 * k * (m[0] / s.speed) ** 2)))


def _compass(drive: Drive, k: float, _s: Scale, rng: Rng) -> None:
    size, phase = 0.01 * k, rng.uniform(0.0, 2.0 * math.pi)
    drive.sensors.append(lambda p, true, _t: (p[0], p[1], p[2] + size * math.sin(true[2] + phase)))


def _conveyor(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    way = rng.uniform(0.0, 2.0 * math.pi)
    drive.drift = 0.001 * k * s.speed * math.cos(way), 0.001 * k * s.speed * math.sin(way)


def _gyro_drift(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    rate = 0.03 * k / s.duration
    drive.sensors.append(lambda p, _true, t: (p[0], p[1], p[2] + rate * t))


def _scrub(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(drive, lambda m, _p, _t: (m[0] / (1.0 + 0.02 * k * abs(m[2]) / s.rate), m[1], m[2]))


def _tracker_shear(drive: Drive, k: float, _s: Scale, _rng: Rng) -> None:
    drive.sensors.append(lambda p, _true, _t: (p[0] + 0.01 * k * p[1], p[1], p[2]))


def _pull_at_speed(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    _on_ground(drive, lambda m, _p, _t: (m[0], m[1], m[2] + 0.002 * k * s.rate * (m[0] / s.speed) ** 2))


def _slow_fall(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    drive.fall = 0.1 * k * s.step


def _time_jitter(drive: Drive, k: float, s: Scale, rng: Rng) -> None:
    late = (0.05 * k * s.step * np.abs(rng.standard_normal(_samples(s)))).tolist()
    drive.late = lambda t: late[round(t / s.step)]


def _coarse_command(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    quantum = 0.01 * k * s.rate
    _command(drive, lambda speed, rate, _t: (speed, quantum * math.floor(rate / quantum + 0.5)))


def _fading_gain(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    def fade(speed: float, rate: float, t: float) -> tuple[float, float]:
        share = math.exp(-0.01 * k * t / s.duration)
        return share * speed, share * rate

    _command(drive, fade)


def _soft_saturation(drive: Drive, k: float, s: Scale, _rng: Rng) -> None:
    knee = s.rim / (0.1 * k)
    _rim(drive, lambda rim, _side, _t: knee * math.tanh(rim / knee))


REPORT: Mapping[str, DriveFault] = {
    "understeer": Fault("It turns the less, the faster it goes.", _understeer, shows=OF_TURN_AND_SPEED),
    "compass": Fault(
        "The heading's error depends on the heading (hard iron).",
        _compass,
        shows=("sensor heading over heading",),
    ),
    "conveyor": Fault(
        "The ground itself moves.",
        _conveyor,
        shows=(
            "force ground's speed along x|ground's speed along y",
            "sensor x|y over time",
            "force forward speed|sideways speed over heading",
        ),
    ),
    "gyro_drift": Fault(
        "The heading drifts.", _gyro_drift, ("heading_drift",), shows=("sensor heading over time",)
    ),
    "scrub": Fault("It is slower in turns.", _scrub, shows=(f"force forward speed over speed*{TURNING}",)),
    "tracker_shear": Fault(
        "The tracker's axes are not at right angles.", _tracker_shear, shows=("sensor x over y",)
    ),
    "pull_at_speed": Fault(
        "It pulls to one side with the square of the speed.",
        _pull_at_speed,
        shows=("force turn rate over speed",),
    ),
    "slow_fall": Fault(
        "Wheels slow down late and speed up at once.", _slow_fall, ("actuator_lag",), shows=PAST_COMMANDS
    ),
    "time_jitter": Fault("Poses are late by random times.", _time_jitter, random=True, shows=LATE_POSE),
    "coarse_command": Fault("Turn rates know few levels.", _coarse_command, shows=OF_TURN),
    "fading_gain": Fault("The drive fades.", _fading_gain, shows=FADES),
    "soft_saturation": Fault(
        "Wheels saturate softly.",
        _soft_saturation,
        ("saturation",),
        shows=(
            f"force {LEFT} over {LEFT_RIM}",
            f"force {RIGHT} over {RIGHT_RIM}",
            f"force {FORWARD} over speed",
            f"force {TURN} over turn rate*speed",
        ),
    ),
}
