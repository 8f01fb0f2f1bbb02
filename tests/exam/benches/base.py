"""What a bench of the exam offers: records of a machine with something wrong, and how far off a fit is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal
from zlib import crc32

import numpy as np

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

Set = Literal["develop", "report"]
FIRST = {"develop": 1_000, "report": 50_000}
"""First seed of the cases of each set; they have none in common."""
FIT, TEST, THIRD = 0, 1, 4
"""Records of a machine: the one to fit, the one on which a diagnosis tests, and one that it never sees."""


@dataclass(frozen=True)
class Conditions:
    """Under what conditions a machine is recorded.

    Attributes:
        noise: Kind of the sensors' noise, of ``plants.noise``.
        factor: On its deviation.
        commands: Kind of the commands, of ``plants.commands``; empty for the machine's usual ones.
        closed: Whether a controller commands by what the sensors show.
        without: Outputs that are not measured.
        duration: Of a record, in the machine's own time; 0 for the usual one [s].
        cut: How much of its beginning is given; 0 for all [s].
        sampling: Times the usual sampling interval.
        length: Times the usual length (or unit of length).
        inertia: Times the usual inertia.
        pace: Times faster than usual, sampling included.
    """

    noise: str = "white"
    factor: float = 1.0
    commands: str = ""
    closed: bool = False
    without: tuple[str, ...] = ()
    duration: float = 0.0
    cut: float = 0.0
    sampling: float = 1.0
    length: float = 1.0
    inertia: float = 1.0
    pace: float = 1.0

    def to_json(self) -> dict[str, Any]:
        """What differs from the usual, as plain data."""
        usual = asdict(Conditions())
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
            if value != usual[name]
        }

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Conditions:
        """Read back."""
        return Conditions(**{**data, "without": tuple(data.get("without", ()))})


def noisy(rng: np.random.Generator) -> Conditions:
    """Usual conditions, three in ten with noise that is not white."""
    kinds = ["autoregressive", "heavy_tailed", "pink", "bursting"]
    return Conditions(noise=str(rng.choice(kinds)) if rng.uniform() < 0.3 else "white")


@dataclass(frozen=True)
class Hidden:
    """Something wrong with a machine.

    Attributes:
        name: A listed effect, or a kind of fault that no model lists.
        size: Multiple of a typical size.
        sign: -1 for the other direction, where it has one.
    """

    name: str
    size: float
    sign: int = 1


@dataclass(frozen=True)
class Log:
    """What was commanded and shown, in the machine's usual units.

    Attributes:
        step: Sampling interval [s].
        inputs: Shape (n, inputs).
        outputs: In the order of the model's; NaN where nothing is measured, shape (n, outputs).
        record: Which of a machine's records it is.
    """

    step: float
    inputs: FloatArray
    outputs: FloatArray
    record: int = FIT

    @property
    def finite(self) -> bool:
        """Whether the machine did not run away."""
        shown = self.outputs[:, ~np.isnan(self.outputs[:1]).ravel()]
        return bool(np.isfinite(shown).all() and np.isfinite(self.inputs).all())


class Bench(ABC):
    """A machine on which the diagnosis is examined.

    Attributes:
        name: Of the model.
        effects: Listed effects that are hidden.
        needs_base: Those that a refitted base absorbs: there the base is known to the diagnosis.
        needs: Outputs without which a listed effect does not show.
        alike: Pairs of effects that are one and the same in the data.
        steady: Listed effects that do not depend on how long a record is.
        usual_length: Times 10, 20, 40, 80 s that records of growing length are long.
        unlisted: Kinds of faults that the model does not list, of each set.
        typical: Values of every effect's parameters, of (size, sign, angle).
        horizon: Length of the windows by which a fault is measured, at the usual pace; 0 if all have one [s].
    """

    name: ClassVar[str]
    effects: ClassVar[tuple[str, ...]]
    needs_base: ClassVar[frozenset[str]] = frozenset()
    needs: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    alike: ClassVar[frozenset[frozenset[str]]] = frozenset()
    steady: ClassVar[tuple[str, ...]]
    usual_length: ClassVar[float] = 1.0
    unlisted: ClassVar[Mapping[str, Mapping[str, Fault[Any, Any]]]]
    typical: ClassVar[Mapping[str, Callable[[float, int, float], dict[str, float]]]] = {}
    horizon: float = 0.0

    @cached_property
    def model(self) -> Model:
        """The model that is held against the data."""
        return get_model(self.name)

    @abstractmethod
    def base(self, seed: int) -> dict[str, float]:
        """True base parameters of the machine of a seed, in its usual units."""

    def values(self, effect: str, size: float, sign: int, seed: int) -> dict[str, float]:
        """Values of a listed effect's parameters at a multiple of its typical size."""
        angle = np.random.default_rng([seed, crc32(effect.encode())]).uniform(0.0, 2.0 * math.pi)
        return self.typical[effect](size, sign, float(angle))

    def hide(
        self, hidden: Sequence[Hidden], plant: Any, scales: Any, seed: int, record: int
    ) -> dict[str, dict[str, float]]:
        """Let faults act on a plant; gives the values of the listed effects among what is hidden."""
        listed = {}
        for one in hidden:
            fault = self.fault(one.name)
            if fault is None:
                listed[one.name] = self.values(one.name, one.size, one.sign, seed)
            else:
                drawn = [seed, crc32(one.name.encode()), *([record] if fault.random else [])]
                fault.act(plant, one.size, scales, np.random.default_rng(drawn))
        return listed

    def shown(self, outputs: FloatArray, conditions: Conditions) -> FloatArray:
        """Outputs, shape (n, outputs), without those that are not measured."""
        missing = [output.name in conditions.without for output in self.model.outputs]
        return np.where(missing, np.nan, outputs)

    def recorded(
        self, columns: Mapping[str, FloatArray], step: float, conditions: Conditions, seed: int, **more: Any
    ) -> Recording:
        """A recording of those columns that are measured, in the units and with the digits of its file.

        Args:
            columns: Signals of the model, each of shape (n,).
            step: Sampling interval [s].
            conditions: Of the record.
            seed: Of the machine.
            more: Further arguments of the recording, ``time`` if it is not from 0 on by that step.
        """
        signals = {name: column for name, column in columns.items() if name not in conditions.without}
        if conditions.noise == "float32":
            signals = {name: v.astype(np.float32).astype(float) for name, v in signals.items()}
        units = {s.name: s.unit for s in (*self.model.inputs, *self.model.outputs) if s.name in signals}
        time = np.arange(float(len(next(iter(signals.values()))))) * step
        source = f"{self.name} {seed}"
        return Recording(**{"time": time, "signals": signals, "units": units, "source": source, **more})

    @abstractmethod
    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """Run the machine.

        Args:
            hidden: What is wrong with it.
            conditions: Of the record.
            seed: Of the machine, of what excites it and of the noise.
            record: ``FIT``, ``TEST`` or ``THIRD``.
        """

    @abstractmethod
    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """Error of each output of the nominal machine on another record, NaN where nothing is measured.

        Args:
            train: Record to which base parameters are fitted.
            test: Record on which the error is measured.
            conditions: Of both.
            seed: Of the machine.
            known: Whether the base is known, and not fitted.
        """

    @abstractmethod
    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """What a diagnosis is given, in the units that the conditions ask for."""

    @abstractmethod
    def nothing(self) -> Iterator[Conditions]:
        """Conditions under which nothing is hidden."""

    def usual(self, rng: np.random.Generator, hidden: tuple[str, ...]) -> Conditions:
        """Draw conditions of a case in which something is hidden, such that it can show."""
        del hidden
        return noisy(rng)

    def scaled(self, values: Mapping[str, float], effect: str, conditions: Conditions) -> dict[str, float]:
        """Values of an effect's parameters in the units that the conditions ask for."""
        del effect, conditions
        return dict(values)

    def needed(self, hidden: tuple[str, ...]) -> tuple[str, ...]:
        """Outputs that have to be measured for all of these to show."""
        faults = [self.fault(name) for name in hidden]
        of_faults = [fault.needs for fault in faults if fault is not None]
        return sum([*of_faults, *(self.needs.get(name, ()) for name in hidden)], ())

    def fault(self, name: str) -> Fault[Any, Any] | None:
        """A kind of fault that the model does not list; None if it is a listed effect."""
        for kinds in self.unlisted.values():
            if name in kinds:
                return kinds[name]
        return None
