"""Components of a simulation: parameters, signals, effects, and the model that combines them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording, Windows, uniform_windows

Where = Literal["force", "actuator", "sensor", "environment", "change"]
EffectValues = Mapping[str, Mapping[str, float]]


class ModelError(ValueError):
    """A name or a value that a model does not know or does not allow."""


class StrayedError(ModelError):
    """A recording during which the robot has left what it follows.

    Attributes:
        lasted: Time until then [s].
    """

    def __init__(self, message: str, lasted: float) -> None:
        super().__init__(message)
        self.lasted = lasted


@dataclass(frozen=True)
class Parameter:
    """A number that the simulation depends on.

    Attributes:
        name: Name within its model or effect.
        unit: SI unit, "1" if it has none.
        nominal: Value in the nominal simulation; of an effect's parameter, the neutral value.
        lower: Smallest allowed value.
        upper: Largest allowed value.
        scale: Typical significant change; step size and screening of starts in a fit are proportional to it.
        source: Where the nominal value comes from ("Table I", "section 2.4.3", "assumed").
        starts: Initial values tried by a fit (several where the cost has local minima).
        smooth: False where outputs are not differentiable in it (a quantisation step, a jump's time).
        refitted: False for one that is known (a wheel's radius, a curve's range): a diagnosis keeps it.
        reduces_to: Simpler effects that its owner equals at its lower and at its upper bound; empty for none.
        knot: True for a value of a curve or table, which is a function already.
    """

    name: str
    unit: str
    nominal: float
    lower: float
    upper: float
    scale: float
    source: str = "assumed"
    starts: tuple[float, ...] = ()
    smooth: bool = True
    refitted: bool = True
    reduces_to: tuple[str, str] = ("", "")
    knot: bool = False

    def __post_init__(self) -> None:
        """Check that the numbers make sense.

        Raises:
            ModelError: If the nominal value lies outside the bounds or the scale is not positive.
        """
        if not self.lower <= self.nominal <= self.upper:
            raise ModelError(
                f"parameter {self.name!r}: nominal {self.nominal} is outside [{self.lower}, {self.upper}]"
            )
        if not self.scale > 0:
            raise ModelError(f"parameter {self.name!r}: scale must be positive, not {self.scale}")


@dataclass(frozen=True)
class Signal:
    """A measured or commanded quantity.

    Attributes:
        name: Column name in a recording.
        unit: SI unit of the column; empty for any, as the file states it.
        noise: Standard deviation of the sensor's white noise in that unit (0 for an input).
        optional: True for an output that a recording may lack.
        angle: True for an angle in radians (so that a column in degrees can be suspected).
        averaged: True for a mean since the sample before, as of a counter (an encoder), else a sample.
        event: True for a binary observation: 1 if the event happened, 0 if not, NaN if not observed; its
            simulation is the probability of a 1.
    """

    name: str
    unit: str
    noise: float = 0.0
    optional: bool = False
    angle: bool = False
    averaged: bool = False
    event: bool = False

    def __post_init__(self) -> None:
        """Check that the noise makes sense.

        Raises:
            ModelError: If it is negative or no number.
        """
        if not (isinstance(self.noise, int | float) and 0.0 <= self.noise < math.inf):
            raise ModelError(
                f"signal {self.name!r}: noise is a standard deviation in {self.unit}, not {self.noise!r}"
            )


@dataclass(frozen=True)
class Effect:
    """A named group of parameters whose neutral (nominal) values switch it off.

    Attributes:
        name: Shared name of the effect (see the architecture page).
        cause: What happens in the real machine, in one plain sentence.
        where: Where in the loop it acts.
        parameters: Its parameters; all at their nominal value means that the effect is off.
        equation: The term it adds, in plain notation.
    """

    name: str
    cause: str
    where: Where
    parameters: tuple[Parameter, ...]
    equation: str = ""

    @property
    def size(self) -> int:
        """Number of its parameters that are fitted."""
        return sum(p.refitted for p in self.parameters)


@dataclass(frozen=True)
class ForceDirection:
    """A weighted sum that has a name of its own.

    Attributes:
        name: In a few words ("forward speed").
        unit: SI unit.
        weights: Of what it sums, in order.
        rate: Variable that says how fast a machine moves that way by itself; empty for none.
        over: Signals on which, and on whose rates and memory, what acts in this direction may depend; empty
            for all.
        moves: True where it is a place, whose second derivative acts: its curves are smooth, over what the
            machine is told (``over``).
        input: The input that it adds to; empty where it is none.
    """

    name: str
    unit: str
    weights: tuple[float, ...]
    rate: str = ""
    over: tuple[str, ...] = ()
    moves: bool = False
    input: str = ""

    def may_depend_on(self, variable: str) -> bool:
        """Whether a curve in this direction may run over a variable; see ``drivers.variables``."""
        if self.moves:
            return variable in self.over
        return not self.over or any(one in variable for one in self.over)


@dataclass(frozen=True)
class Stage:
    """A part of a machine whose inputs and outputs are measured, so that it is diagnosed by itself.

    Attributes:
        model: The model, comparing this stage's outputs only; names and their order are the whole's.
        effects: Names of the effects that act in this stage.
    """

    model: Model
    effects: tuple[str, ...]


class Model(ABC):
    """A simulation with named base parameters and switchable effects.

    A parameter vector holds the base parameters, then each effect's parameters, in the order of
    ``names``; an effect's parameter is called ``effect.parameter``. A user's own simulator joins by
    subclassing: declare the tuples below, and implement ``simulate`` and ``initial_states``.

    Attributes:
        name: Name used on the command line.
        inputs: Commanded signals.
        outputs: Measured signals; optional ones may be missing in a recording.
        states: State at a window's start, as plain signals.
        parameters: Base parameters, refitted by a diagnosis unless fixed.
        effects: What may be missing from the nominal simulation.
        horizons: Prediction horizons [s] of a diagnosis, shortest first; the second is the main one.
        disturbance_unit: Unit of the additive generalised force that ``Windows.disturbance`` holds,
            empty if the model has no such entry.
        directions: Directions of motion in which something unlisted may act, where there are several: what
            one unit of each is in the columns of ``Windows.disturbance``, then of shape (n, columns). The
            first column is the one of ``disturbance_unit``.
        staged: Directions in which what was found in a stage by itself acts in the whole, where they differ.
        rates: States that no output measures, each with the output whose rate of change it is.
        unmeasured: Signals of the simulation that no sensor measures, and on which something unlisted may
            depend (a suspension's deflection); see ``simulate_all``.
        lasting: How long what acts in a window is felt after it [s], where windows do not start anew.
        sums: Sums of the inputs on which something unlisted may depend (both wheels' commands: a speed).
        scale_parameter: Base parameter to which, without a command, all others are in proportion: it is not
            refitted then. Empty for none.
        measured_inputs: Signals that measure the actual response to each input, if a recording has them; see
            ``stages``.
        random_force: True if random forces drive the real machine, so that errors far above the sensors'
            noise prove nothing by themselves.
        noisy_inputs: True if inputs are what sensors show, whose noise then drives the simulation.
        resolution: Error of the simulation by its longest integration steps, over a signal's spread; one
            for all outputs, or one each.
        inputs_are_free: False if inputs cannot be chosen freely (a walker's own steering).
        windows_apart: False if how finely a window is simulated depends on the others, so that some of them
            cannot be simulated alone.
        stock_names: Effects that the user did not write, but took from the library.
        unbounded_outputs: Outputs that may leave the recorded range (a robot's position on an open floor).
        wrapped_outputs: Outputs that are measured within a turn, [-pi, pi): its errors go by that.
        measured_states: Which output a window's state is taken from, where it has another name.
        corrected: True if what was measured puts every sample of a window right (an observer), so that errors
            are innovations, alike at every sample; see ``running_free``.
        whole_records: True for a process whose memory is longer than any window (with hidden states): a
            diagnosis then runs through each episode from one start. A hidden state says by its ``noise`` how
            uncertain its start is.
    """

    name: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    states: tuple[Signal, ...]
    parameters: tuple[Parameter, ...]
    effects: tuple[Effect, ...]
    horizons: tuple[float, ...]
    disturbance_unit: str = ""
    directions: tuple[ForceDirection, ...] = ()
    staged: tuple[ForceDirection, ...] = ()
    unmeasured: tuple[Signal, ...] = ()
    rates: Mapping[str, str] = MappingProxyType({})
    lasting: float = 0.0
    sums: tuple[ForceDirection, ...] = ()
    random_force: bool = False
    noisy_inputs: bool = False
    resolution: float | tuple[float, ...] = 1.3e-5
    inputs_are_free: bool = True
    windows_apart: bool = True
    stock_names: tuple[str, ...] = ()
    unbounded_outputs: tuple[str, ...] = ()
    scale_parameter: str = ""
    measured_inputs: tuple[Signal, ...] = ()
    wrapped_outputs: tuple[str, ...] = ()
    measured_states: Mapping[str, str] = MappingProxyType({})
    corrected: bool = False
    whole_records: bool = False
    file: ClassVar[str] = ""
    """What ``load_model_file`` loaded a user's own model from, and a pickle loads it from again."""

    @abstractmethod
    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window from its own initial state, for a batch of parameter vectors.

        Args:
            parameters: Parameter vectors, shape (batch, len(names)).
            windows: Windows of one recording; commands are read from the whole recording.

        Returns:
            Outputs, shape (batch, windows, samples, outputs), in the order of ``outputs``; samples
            after a window's end are NaN.
        """

    def simulate_all(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """As ``simulate``, followed by what is ``unmeasured``: shape (..., outputs + unmeasured)."""
        return self.simulate(parameters, windows)

    @abstractmethod
    def initial_states(self, recording: Recording, starts: NDArray[np.int64]) -> FloatArray:
        """Estimate the state at given samples from the measured signals around them.

        Returns:
            States, shape (len(starts), len(states)).
        """

    def unseen(self, recording: Recording) -> tuple[str, ...]:
        """Names of states of which nothing says where a window starts; by default none."""
        del recording
        return ()

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """Cut a recording into the non-overlapping windows on which this model predicts.

        Args:
            recording: The measured data.
            horizon: Length of a window [s].

        Raises:
            RecordingError: If the recording is too short for a single window.
        """
        outputs = [signal.name for signal in self.outputs]
        return uniform_windows(recording, horizon, outputs, self.initial_states)

    def runs(self, windows: Windows) -> NDArray[np.int64] | None:
        """Number of the run that each window is a piece of; by default each has a start of its own (None)."""
        del windows
        return None

    def running_free(self) -> Model:
        """The same model, whose windows run on from their starts; itself, unless it is ``corrected``."""
        return self

    def scaled_to(self, recordings: Sequence[Recording]) -> Model:
        """The same model with scales, starts and sensor noise that suit these data.

        A bench may weigh a gram or a tonne: which force is small and which time is short depends on the
        data. Names, order, bounds and neutral values stay unchanged. A diagnosis calls this first; a model
        whose scales are known keeps this default.
        """
        del recordings
        return self

    def sized(self, base: Mapping[str, object]) -> Model:
        """The same model with sums and directions that suit base parameters, by name; by default itself."""
        del base
        return self

    def between(self, commands: FloatArray, refine: int) -> FloatArray:
        """Commands on a finer time grid: by default held from sample to sample, as a controller does.

        Args:
            commands: Commands of one episode, shape (n, inputs).
            refine: How many times finer.

        Returns:
            Shape (n * refine, inputs).
        """
        return np.repeat(commands, refine, axis=0)

    def with_commands(self, recording: Recording, commands: Mapping[str, FloatArray]) -> Recording:
        """The same recording under other commands; a model that derives columns from them derives them anew.

        Args:
            recording: As ``windows`` has it.
            commands: The inputs that change, each of shape (n,).
        """
        return replace(recording, signals={**recording.signals, **commands})

    def derived(self, outputs: FloatArray, shown: FloatArray, windows: Windows) -> FloatArray:
        """Outputs behind sensors that err, with those that the model derives from them; by default none.

        Args:
            outputs: As simulated, shape (batch, windows, samples, outputs).
            shown: What the sensors show of them; what is derived is still as simulated.
            windows: The windows.
        """
        del outputs, windows
        return shown

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """The parts that a diagnosis can examine separately with these data; by default the whole.

        A drive with measured wheel speeds has two: command to wheels, wheels to motion.
        """
        del recordings
        return (Stage(self, tuple(effect.name for effect in self.effects)),)

    @property
    def pushes(self) -> tuple[ForceDirection, ...]:
        """Every direction in which something unlisted may act; the only one has no name."""
        return self.directions or (ForceDirection("", self.disturbance_unit, (1.0,)),)

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Everything that a recording may hold for this model."""
        return (*self.inputs, *self.outputs, *self.measured_inputs)

    @cached_property
    def all_parameters(self) -> tuple[Parameter, ...]:
        """Base parameters, then every effect's, in the order of a parameter vector."""
        return self.parameters + tuple(p for effect in self.effects for p in effect.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Full names in the order of a parameter vector."""
        return tuple(p.name for p in self.parameters) + tuple(
            f"{effect.name}.{p.name}" for effect in self.effects for p in effect.parameters
        )

    @cached_property
    def nominal(self) -> FloatArray:
        """The nominal parameter vector: base parameters as stated, all effects off."""
        return np.array([p.nominal for p in self.all_parameters])

    def index(self, name: str) -> int:
        """Position of a full parameter name in the vector.

        Raises:
            ModelError: If the model has no such parameter.
        """
        if name not in self.names:
            raise ModelError(f"model {self.name!r} has no parameter {name!r}{did_you_mean(name, self.names)}")
        return self.names.index(name)

    def effect(self, name: str) -> Effect:
        """Return one effect by name.

        Raises:
            ModelError: If the model has no such effect.
        """
        for effect in self.effects:
            if effect.name == name:
                return effect
        raise ModelError(
            f"model {self.name!r} has no effect {name!r}{did_you_mean(name, [e.name for e in self.effects])}"
        )

    def slice_of(self, effect: str) -> slice:
        """Positions of an effect's parameters in the vector."""
        start = len(self.parameters)
        for candidate in self.effects:
            stop = start + len(candidate.parameters)
            if candidate.name == self.effect(effect).name:
                return slice(start, stop)
            start = stop
        raise AssertionError("unreachable")

    def vector(
        self, base: Mapping[str, float] | None = None, effects: EffectValues | None = None
    ) -> FloatArray:
        """Build a parameter vector from named values; all others stay nominal.

        Args:
            base: Values of base parameters.
            effects: Values of effects' parameters, ``{"gyro_bias": {"rate": 0.004}}``.

        Returns:
            Parameter vector, shape (len(names),).

        Raises:
            ModelError: For an unknown name, a value that is not a finite number, or one out of bounds.
        """
        named = dict(base or {})
        for effect_name, values in (effects or {}).items():
            effect = self.effect(effect_name)
            if not isinstance(values, Mapping):
                known = ", ".join(f"{p.name} [{p.unit}]" for p in effect.parameters)
                raise ModelError(f"effect {effect_name!r} takes a mapping of its parameters: {known}")
            for key, value in values.items():
                own = [p.name for p in effect.parameters]
                if key not in own:
                    raise ModelError(
                        f"effect {effect_name!r} has no parameter {key!r}{did_you_mean(key, own)}"
                    )
                named[f"{effect_name}.{key}"] = value
        result = self.nominal.copy()
        for name, value in named.items():
            i = self.index(name)
            parameter = self.all_parameters[i]
            try:
                number = float(value)
            except (TypeError, ValueError):
                raise ModelError(f"{name!r} must be a number in {parameter.unit}, not {value!r}") from None
            if not parameter.lower <= number <= parameter.upper:
                raise ModelError(
                    f"{name!r} = {number} is outside [{parameter.lower}, {parameter.upper}] {parameter.unit}"
                )
            result[i] = number
        return result


class Wrapper(Model):
    """A model around another one, which has the other's signals and parameters, and its own simulation.

    Attributes:
        inner: The other model.
    """

    def __init__(self, inner: Model) -> None:
        self.inner = inner
        for name in Model.__annotations__:
            setattr(self, name, getattr(inner, name))
        self.unmeasured = ()  # of most wrappers, which simulate outputs alone

    def initial_states(self, recording: Recording, starts: NDArray[np.int64]) -> FloatArray:
        """The inner model's."""
        return self.inner.initial_states(recording, starts)

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """The inner model's."""
        return self.inner.windows(recording, horizon)

    def runs(self, windows: Windows) -> NDArray[np.int64] | None:
        """The inner model's."""
        return self.inner.runs(windows)

    def running_free(self) -> Model:
        """The same around the inner model that runs free."""
        result = copy(self)
        result.inner, result.corrected = self.inner.running_free(), False
        return result

    def between(self, commands: FloatArray, refine: int) -> FloatArray:
        """The inner model's."""
        return self.inner.between(commands, refine)

    def with_commands(self, recording: Recording, commands: Mapping[str, FloatArray]) -> Recording:
        """The inner model's."""
        return self.inner.with_commands(recording, commands)

    def derived(self, outputs: FloatArray, shown: FloatArray, windows: Windows) -> FloatArray:
        """The inner model's."""
        return self.inner.derived(outputs, shown, windows)


def check_instance(model: object) -> None:
    """See that a model is one, and not its class.

    Raises:
        ModelError: For a class.
    """
    if isinstance(model, type):
        raise ModelError(f"{model.__name__} is a class; give a model of it: {model.__name__}()")
