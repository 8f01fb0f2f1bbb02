"""What a policy is told of its machine: a diagnosis' estimates, and how sure they are.

In training a diagnosis is drawn for each episode: the truth and a normal error, whose standard deviation is
drawn as well and told beside it. All of it follows from the truth's bits, so that there is nothing to keep
for a resume, and equal seeds are told the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldgym import find_task
from fieldmodels.drivers.named import apply_reality
from fieldmodels.registry import get_model

LEAST, NAMED = 0.003, 4.0
"""Smallest standard error that is drawn, in spreads; and how many of them a named effect is from neutral."""
NORTH_EAST = ("north", "east")
"""Names of an effect's numbers that are a vector on the map."""
UNSAID, EXACT = (0.0, 1.0), (0.0, 0.0)
"""Of a parameter of which nothing is said, and of one that is known to be neutral."""


@dataclass(frozen=True)
class Condition:
    """A parameter that a policy is told of.

    Attributes:
        effect: Its effect; ``parameters`` for a base parameter.
        name: Its name.
        neutral: Its value in the nominal simulation, or the nearest that was drawn: a limit's is far out.
        spread: Half of the range that it was drawn from in training, the unit of what is told.
        turned_by: Of a number to the north or the east in a task that turns its observations, the entry of
            ``info`` with their angle; see `turned`.
    """

    effect: str
    name: str
    neutral: float
    spread: float
    turned_by: str = ""

    def numbers(self, estimate: Any, error: Any) -> NDArray[np.float64]:
        """Estimate and standard error as a policy reads them, shape (..., 2)."""
        sure = np.minimum(np.asarray(error, dtype=np.float64) / self.spread, 1.0)
        away = (np.asarray(estimate, dtype=np.float64) - self.neutral) / self.spread
        return np.stack([away, np.broadcast_to(sure, away.shape)], axis=-1)


def conditions_of(task: str, reality: Any) -> tuple[Condition, ...]:
    """All parameters that a task's random reality draws, in its model's order.

    Raises:
        ValueError: If observations are turned, and of an effect's ``north`` and ``east`` one is not drawn as
            the other is.
    """
    model, drawn = apply_reality(get_model(find_task(task).model), reality)
    lowest, highest = drawn.extremes(model)
    found = []
    for i in drawn.samplers(model):
        effect, _, name = model.names[i].rpartition(".")
        neutral = float(np.clip(model.all_parameters[i].nominal, lowest[i], highest[i]))
        by = find_task(task).turned_by if name in NORTH_EAST else ""
        found.append(Condition(effect or "parameters", name, neutral, float(highest[i] - lowest[i]) / 2, by))
    for one in found:
        if one.turned_by and sum(replace(one, name=name) in found for name in NORTH_EAST) < 2:
            raise ValueError(
                f"observations are turned, and so is what a policy is told: of {one.effect}, draw both north "
                "and east, from ranges of one width"
            )
    return tuple(found)


def said(conditions: Iterable[Condition], found: Mapping[str, Mapping[str, Any]]) -> NDArray[np.float32]:
    """What a diagnosis says, shape (2 parameters,).

    Args:
        conditions: What the policy is told of.
        found: Effects to their parameters, each with its ``value`` and ``std``, as ``extended.yaml`` holds
            them. Of an effect that is not among them nothing is said.
    """
    numbers = []
    for one in conditions:
        entry = found.get(one.effect, {}).get(one.name)
        if entry is None or entry["value"] is None:
            numbers.append(np.array(UNSAID))
        else:
            error = one.spread if entry["std"] is None else entry["std"]
            numbers.append(one.numbers(entry["value"], error))
    return np.concatenate(numbers).astype(np.float32)


def known(conditions: Iterable[Condition], reality: Mapping[str, Mapping[str, float]]) -> NDArray[np.float32]:
    """What one knows who knows a reality, shape (2 parameters,); what it does not name is neutral."""
    numbers = [one.numbers(reality.get(one.effect, {}).get(one.name, one.neutral), 0.0) for one in conditions]
    return np.concatenate(numbers).astype(np.float32)


def turned(
    conditions: Sequence[Condition], numbers: NDArray[np.float32], info: Mapping[str, Any]
) -> NDArray[np.float32]:
    """What is told, as observations are turned: instead of north and east, ahead and to the right.

    Args:
        conditions: What policies are told of.
        numbers: Shape (rows, 2 parameters).
        info: Of these rows.

    Returns:
        Shape (rows, 2 parameters). The standard errors of a vector are turned as those of independent
        numbers.

    Raises:
        ValueError: If the angle is not in ``info``, once a row.
    """
    result = np.array(numbers, dtype=np.float32).reshape(len(numbers), len(conditions), 2)
    for k, one in enumerate(conditions):
        if not one.turned_by or one.name == "east":
            continue
        angle = np.asarray(info.get(one.turned_by, np.nan), dtype=np.float64)
        if angle.shape != (len(numbers),):
            raise ValueError(
                f"what is told of {one.effect} is turned by info[{one.turned_by!r}], one angle for each of "
                f"{len(numbers)} rows: give act the info of the step, of a single aircraft or robot a row"
            )
        cosine, sine = np.cos(angle), np.sin(angle)
        east = conditions.index(replace(one, name="east"))
        (north_by, north_error), (east_by, east_error) = result[:, k].T.copy(), result[:, east].T.copy()
        result[:, k, 0] = north_by * cosine + east_by * sine
        result[:, east, 0] = east_by * cosine - north_by * sine
        result[:, k, 1] = np.hypot(north_error * cosine, east_error * sine)
        result[:, east, 1] = np.hypot(north_error * sine, east_error * cosine)
    return result.reshape(numbers.shape)


def simulated(
    conditions: Sequence[Condition], reality: Mapping[str, Mapping[str, Any]]
) -> NDArray[np.float32]:
    """What diagnoses of random realities might say.

    Standard errors are drawn by their logarithm, two thirds of which all parameters of a row share: a record
    is long or short. In half of the rows all estimates are told, in the others the effects that a diagnosis
    would name. Rows of equal truths are told the same.

    Args:
        conditions: What policies are told of.
        reality: The truth, arrays of shape (rows,).

    Returns:
        Shape (rows, 2 parameters).
    """
    truth = [np.asarray(reality[one.effect][one.name], dtype=np.float64) for one in conditions]
    key = np.zeros(len(truth[0]), dtype=np.uint64)
    for column in truth:
        key = _mixed(key ^ column.view(np.uint64))
    names_only, quality = _luck(key, 0) < 0.5, _luck(key, 1)
    numbers, stands_out = (
        [],
        dict.fromkeys((one.effect for one in conditions), np.zeros(len(key), dtype=np.bool_)),
    )
    for k, (one, true) in enumerate(zip(conditions, truth, strict=True)):
        error = LEAST ** ((2 * quality + _luck(key, 2 * k + 2)) / 3) * one.spread
        estimate = true + error * _normal(_luck(key, 2 * k + 3))
        numbers.append(one.numbers(estimate, error))
        stands_out[one.effect] = stands_out[one.effect] | (np.abs(estimate - one.neutral) > NAMED * error)
    for one, row in zip(conditions, numbers, strict=True):
        row[names_only & ~stands_out[one.effect]] = UNSAID
    return np.concatenate(numbers, axis=-1).astype(np.float32)


def _mixed(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The output function of splitmix64 (Steele, Lea and Flood, 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _luck(key: NDArray[np.uint64], number: int) -> NDArray[np.float64]:
    """The key's even draw between 0 and 1 of a number, neither end included."""
    z = _mixed(key + np.uint64((number + 1) * 0x9E3779B97F4A7C15 % 2**64))
    return (z >> np.uint64(11)).astype(np.float64) * 2.0**-53 + 2.0**-54


def _normal(even: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.special import ndtri  # slow to import

    return np.asarray(ndtri(even))
