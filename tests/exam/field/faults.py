"""What can be wrong with a plant: parts that are put together to the faults of the kinds."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from types import SimpleNamespace as Numbers

import numpy as np

from .plants import Array, Couple, Fault, Log, Rates, Size

By = Callable[[Size, float, Array, Array, Numbers], Array]
"""(size, time [s], states, drive, numbers) to what acts, shape (lanes,)."""


def push(state: int, by: By) -> Fault:
    """Something is added to the rate of a state."""

    def make(rates: Rates, k: Size) -> Rates:
        def pushed(t: float, x: Array, u: Array, p: Numbers) -> list[Array]:
            result = list(rates(t, x, u, p))
            result[state] = result[state] + by(k, t, x, u, p)
            return result

        return pushed

    return Fault(rates=(make,))


def vary(number: str, by: By) -> Fault:
    """One of its numbers is multiplied by something."""

    def make(rates: Rates, k: Size) -> Rates:
        def varied(t: float, x: Array, u: Array, p: Numbers) -> object:
            other = copy(p)
            setattr(other, number, getattr(p, number) * by(k, t, x, u, p))
            return rates(t, x, u, other)

        return varied

    return Fault(rates=(make,))


def driven(by: By, channel: int = 0) -> Fault:
    """Something is added to what drives it, at every moment."""

    def make(rates: Rates, k: Size) -> Rates:
        def other(t: float, x: Array, u: Array, p: Numbers) -> object:
            u = u.copy()
            u[channel] += by(k, t, x, u, p)
            return rates(t, x, u, p)

        return other

    return Fault(rates=(make,))


def second_mass(velocity: int, share: float, rate: float, damped: float) -> Fault:
    """A mass behind a spring: at a size of one a share of the first one's, with its own rate [rad/s]."""

    def make(rates: Rates, k: Size) -> Rates:
        def coupled(t: float, x: Array, u: Array, p: Numbers) -> list[Array]:
            result = list(rates(t, x[:-2], u, p))
            away, closing = x[-2], x[-1]  # of the second mass from the first one
            pull = rate**2 * away + 2.0 * damped * rate * closing
            result[velocity] = result[velocity] + k * share * pull
            return [*result, closing, -pull - result[velocity]]

        return coupled

    return Fault(rates=(make,), more=(0.0, 0.0))


def dry(velocity: int, force: float, inertia: str, name: str = "", couple: Couple | None = None) -> Fault:
    """Coulomb friction of a force at a size of one; by its full name where it is listed."""

    def taken(k: Size, x: Array, u: Array, p: Numbers) -> Array:
        return np.asarray(k * force / (getattr(p, inertia) if inertia else 1.0))

    return Fault(dry=((velocity, taken, couple),), truth={name: lambda k, _: k * force} if name else {})


def swung(x: Array, p: Numbers) -> Array:
    """By what a crane's load changes its rate where its trolley changes its speed by one."""
    return np.asarray(-np.cos(x[2]) / p.cable)


def crane_dry(force: float) -> Fault:
    """Coulomb friction of a crane's trolley."""

    def taken(k: Size, x: Array, u: Array, p: Numbers) -> Array:
        return np.asarray(k * force / (p.mass + p.load * np.sin(x[2]) ** 2))

    return Fault(dry=((1, taken, (3, swung)),), truth={"coulomb_friction.force": lambda k, _: k * force})


def told(by: Callable[[Size, float, Array, Array], Array], channel: int = 0) -> Fault:
    """A command becomes another one: (size, time, command (lanes,), states) to that."""

    def make(k: Size) -> Callable[[float, Array, Array], Array]:
        def act(t: float, u: Array, x: Array) -> Array:
            u = u.copy()
            u[channel] = by(k, t, u[channel], x)
            return u

        return act

    return Fault(command=(make,))


def named(fault: Fault, **truth: float | Callable[[float, Numbers], float]) -> Fault:
    """A fault that is listed: ``effect__parameter`` is that value at a size of one, or that of the size."""

    def value(of: float | Callable[[float, Numbers], float]) -> Callable[[float, Numbers], float]:
        return of if callable(of) else lambda k, _: k * of

    return fault + Fault(truth={name.replace("__", "."): value(of) for name, of in truth.items()})


def dead_zone(width: float, prefix: str = "actuator_", channel: int = 0) -> Fault:
    """Small commands have no effect, others less."""

    def by(k: Size, t: float, u: Array, x: Array) -> Array:
        return np.asarray(np.sign(u) * np.maximum(np.abs(u) - k * width, 0.0))

    return named(told(by, channel), **{f"{prefix}dead_zone__width": width})


def offset(value: float, prefix: str = "actuator_", channel: int = 0) -> Fault:
    """A command has a bias."""
    fault = told(lambda k, t, u, x: u + k * value, channel)
    return named(fault, **{f"{prefix}bias__bias": value})


def asymmetry(value: float) -> Fault:
    """Stronger one way than the other."""
    fault = told(lambda k, t, u, x: u * (1.0 + 0.5 * value * k * np.sign(u)))
    return named(fault, actuator_asymmetry__difference=value)


def play(width: float) -> Fault:
    """The command acts through play."""

    def make(k: Size) -> Callable[[float, Array, Array], Array]:
        engaged: list[Array] = []

        def act(t: float, u: Array, x: Array) -> Array:
            last = engaged.pop() if engaged else u
            half = 0.5 * k * width
            engaged.append(np.minimum(np.maximum(last, u - half), u + half))
            return engaged[-1]

        return act

    return named(Fault(command=(make,)), actuator_play__width=width)


def limited(limit: float, prefix: str = "actuator_") -> Fault:
    """The command has no effect beyond a limit, the lower the larger the size."""
    fault = told(lambda k, t, u, x: np.clip(u, -limit / k, limit / k))
    return named(fault, **{f"{prefix}saturation__limit": lambda k, _: limit / k})


def lag(seconds: float) -> Fault:
    """The drive follows with a first-order lag."""
    return named(Fault(lag=lambda k: k * seconds), actuator_lag__time_constant=seconds)


def delay(seconds: float) -> Fault:
    """The drive acts late."""
    return named(Fault(delay=lambda k: k * seconds), actuator_delay__delay=seconds)


def slow(rate: float) -> Fault:
    """The drive's rate is limited, to less at a larger size."""
    return named(Fault(fastest=lambda k: rate / k), actuator_rate_limit__rate=lambda k, _: rate / k)


def shows(output: int, by: Callable[[Size, Log], Array]) -> Fault:
    """A sensor shows something else: (size, log) to that, shape (instants, lanes)."""

    def sensor(k: Size, log: Log) -> None:
        log.shown[:, output] = by(k, log)

    return Fault(sensors=(sensor,))


def bias(output: int, value: float, name: str) -> Fault:
    """A sensor shows too much."""
    return named(shows(output, lambda k, log: log.shown[:, output] + k * value), **{name: value})


def gain(output: int, value: float, name: str) -> Fault:
    """A sensor shows too much in proportion."""
    fault = shows(output, lambda k, log: log.shown[:, output] * (1.0 + k * value))
    return named(fault, **{name: lambda k, _: 1.0 + k * value})


def sluggish(output: int, seconds: float, name: str) -> Fault:
    """A sensor follows with a lag."""

    def by(k: Size, log: Log) -> Array:
        true, keep = log.shown[:, output], np.exp(-np.diff(log.time)[:, None] / (k * seconds))
        result = true.copy()
        for i in range(1, len(true)):
            middle = 0.5 * (true[i - 1] + true[i])
            result[i] = middle + (result[i - 1] - middle) * keep[i - 1]
        return result

    return named(shows(output, by), **{name: seconds})


def drag(velocity: int, coefficient: float, inertia: str = "") -> Fault:
    """Drag by the square of the speed."""

    def by(k: Size, t: float, x: Array, u: Array, p: Numbers) -> Array:
        mass = getattr(p, inertia) if inertia else 1.0
        return np.asarray(-k * coefficient * x[velocity] * np.abs(x[velocity]) / mass)

    return named(push(velocity, by), quadratic_drag__coefficient=coefficient)


def bristle(velocity: int, force: float, distance: float, inertia: str, name: str = "force") -> Fault:
    """Dahl's friction: a force that follows the way it came. Its state is the force at a size of one."""

    def make(rates: Rates, k: Size) -> Rates:
        def rubbed(t: float, x: Array, u: Array, p: Numbers) -> list[Array]:
            result = list(rates(t, x[:-1], u, p))
            result[velocity] = result[velocity] - k * x[-1] / getattr(p, inertia)
            return [*result, (force * x[velocity] - x[-1] * np.abs(x[velocity])) / distance]

        return rubbed

    fault = Fault(rates=(make,), more=(0.0,))
    return named(fault, **{f"hysteresis__{name}": force}, hysteresis__distance=lambda k, _: distance)


def slipping_spring(velocity: int, force: float, distance: float, inertia: str) -> Fault:
    """A spring that slips where it holds no more: its state is the force at a size of one."""

    def make(rates: Rates, k: Size) -> Rates:
        def rubbed(t: float, x: Array, u: Array, p: Numbers) -> list[Array]:
            result = list(rates(t, x[:-1], u, p))
            result[velocity] = result[velocity] - k * np.clip(x[-1], -force, force) / getattr(p, inertia)
            slips = (np.abs(x[-1]) >= force) & (x[-1] * x[velocity] > 0.0)
            return [*result, np.where(slips, 0.0, force * x[velocity] / distance)]

        return rubbed

    return Fault(rates=(make,), more=(0.0,))
