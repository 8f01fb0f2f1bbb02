"""Oracles: what every machine should show, computed a second time from its documented equations.

A test that hides an effect with the code that looks for it cannot see an error in that effect. So each
machine has an oracle here, a module of its own name that shares no code with the machine: NumPy and SciPy
only, adaptive integration or a closed form, written from the docs and from ``Effect.equation``. An oracle
module holds

* ``NEUTRAL``: every effect that it knows, with its parameters and their neutral values;
* ``simulate(base, effects, commands, step, start=None)``: one noise-free episode, see ``Oracle``.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from typing import Protocol, cast

from fieldmodels.arrays import FloatArray

Values = Mapping[str, Mapping[str, float]]
"""Values of effects' parameters: ``{"sensor_bias": {"bias": 0.1}}``."""


class OracleError(ValueError):
    """An oracle does not know a machine, an effect or a parameter."""


class Simulate(Protocol):
    """The function ``simulate`` of an oracle."""

    def __call__(
        self,
        base: Mapping[str, float],
        effects: Values,
        commands: FloatArray,
        step: float,
        start: Mapping[str, float] | None = None,
    ) -> FloatArray:
        """Work out what the sensors show in one episode, without noise.

        Args:
            base: Value of every base parameter of the machine.
            effects: Values of the parameters of the effects that are on.
            commands: What the machine is given at each sample (a machine that nobody commands: what it
                is told of its world), columns in the order of the model's inputs, shape (n, inputs).
            step: Sampling interval [s]; the first sample is at time zero.
            start: True state at the first sample, by name; what is not named is at rest.

        Returns:
            Outputs at the samples, in the order of the model's, shape (n, outputs).

        Raises:
            OracleError: For an effect or a parameter that it does not know.
        """
        ...


class Oracle(Protocol):
    """What a module of this package gives."""

    NEUTRAL: Values
    simulate: Simulate


def has_oracle(machine: str) -> bool:
    """Whether a machine has an oracle."""
    return find_spec(f"{__name__}.{machine}") is not None


def find_oracle(machine: str) -> Oracle:
    """The oracle of a machine, which is the module of its name.

    Raises:
        OracleError: If there is none.
    """
    if not has_oracle(machine):
        raise OracleError(f"no oracle for {machine!r}: write {__name__.replace('.', '/')}/{machine}.py")
    return cast(Oracle, import_module(f"{__name__}.{machine}"))


def filled(effects: Values, neutral: Values) -> dict[str, dict[str, float]]:
    """Values of every effect's parameters, neutral where they are not given.

    Raises:
        OracleError: For an effect or a parameter that is not among the neutral ones.
    """
    for name, values in effects.items():
        unknown = set(values) - set(neutral.get(name, {}))
        if name not in neutral or unknown:
            raise OracleError(f"the oracle does not know {name!r} with {sorted(values)}")
    return {name: {**values, **effects.get(name, {})} for name, values in neutral.items()}
