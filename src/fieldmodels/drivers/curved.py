"""A simulation with unlisted curves, for any model: it is run again with what the curves add on its way.

The variables of the curves are read from the run before. Over a diagnosis's short windows that settles in two
or three repetitions, or a few more where a curve changes the motion much; a machine that is run for long has
the curves in its own equations (``effects.curve``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.variables import SHARE, direction_of, rows_of, variable
from fieldmodels.model import Effect, Model, ModelError, Parameter, Wrapper
from fieldmodels.recording import Windows

REPETITIONS, SETTLED = 8, 1e-9
FAR = 1e9  # coefficients are of the order of one standard error: no bound


@dataclass(frozen=True)
class FreeCurve:
    """A curve with free coefficients.

    Attributes:
        place: "force", "sensor", "parameter" or "odds".
        target: The output, base parameter or direction that it adds to; empty for the only force.
        over: The variable.
        knots: Values of the variable, shape (points,).
        basis: What each coefficient adds there, shape (points, coefficients).
        sizes: Of the coefficients, by which a fit's steps go; by default one.
        period: After which it begins anew; 0 where it does not.
    """

    place: str
    target: str
    over: str
    knots: FloatArray
    basis: FloatArray
    sizes: tuple[float, ...] = ()
    period: float = 0.0

    def at(self, variable: FloatArray, coefficients: FloatArray) -> FloatArray:
        """The curve's values at those of its variable; constant beyond the knots, or as a cycle before."""
        if self.period > 0.0:
            low, high = self.knots[[0, -1]]
            cycles = np.where(variable < low, np.floor((variable - low) / self.period), 0.0)
            cycles = np.where(variable > high, np.ceil((variable - high) / self.period), cycles)
            variable = variable - self.period * cycles
        return np.asarray(np.interp(variable, self.knots, self.basis @ coefficients))


def smooth(knots: FloatArray, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """The natural cubic spline through values at knots, along a line beyond them."""
    from scipy.interpolate import make_interp_spline  # slow to import

    flat: Any = ([(2, np.zeros(values.shape[1:]))],) * 2
    spline = make_interp_spline(knots, values, k=3, bc_type=flat)

    def at(x: FloatArray) -> FloatArray:
        inside = np.clip(x, knots[0], knots[-1])
        beyond = (x - inside)[(..., *[None] * (values.ndim - 1))]
        return np.asarray(spline(inside) + beyond * spline(inside, 1))

    return at


class Curved(Wrapper):
    """A model with curves as further effects, whose coefficients follow its own parameters.

    Attributes:
        curves: Its curves.
        repetitions: How often it is run again at most, until nothing changes.
    """

    repetitions = REPETITIONS

    def __init__(self, inner: Model, curves: Sequence[FreeCurve]) -> None:
        super().__init__(inner)
        self.curves = tuple(curves)
        self.unmeasured = inner.unmeasured
        self.effects = (*inner.effects, *(self._effect(k, c) for k, c in enumerate(curves)))

    @staticmethod
    def _effect(k: int, curve: FreeCurve) -> Effect:
        return Effect(
            f"curve_{k + 1}",
            f"A curve of {direction_of(curve.place, curve.target, curve.over)}.",
            "force",
            tuple(
                Parameter(f"coefficient_{i + 1}", "1", 0.0, -FAR, FAR, size)
                for i, size in enumerate(curve.sizes or (1.0,) * curve.basis.shape[1])
            ),
        )

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate``."""
        return self.simulate_all(parameters, windows)[..., : len(self.outputs)]

    def simulate_all(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate_all``."""
        vectors = np.atleast_2d(parameters)
        own, coefficients = vectors[:, : len(self.inner.names)], self._split(vectors)
        out = self.inner.simulate_all(own, windows)
        for b in range(len(vectors)):
            mine = [c[b] for c in coefficients]
            if any(c.any() for c in mine):
                out[b] = self._curved(own[b], mine, windows, out[b])
        return out

    def _curved(
        self, own: FloatArray, coefficients: Sequence[FloatArray], windows: Windows, plain: FloatArray
    ) -> FloatArray:
        """Outputs of one parameter vector, shape (windows, samples, outputs)."""
        out = self._moved(own, coefficients, windows, plain)
        result = out.copy()
        shown = self._at(("sensor", "odds"), coefficients)
        for curve, a in shown:
            j = [s.name for s in self.outputs].index(curve.target)
            added = curve.at(variable(self.inner, windows, out, curve.over), a)
            if curve.place == "sensor":
                result[:, :, j] += added
            else:
                p = np.clip(out[:, :, j], 1e-12, 1 - 1e-12)
                result[:, :, j] = 1 / (1 + (1 - p) / p * np.exp(-added))
        if shown:
            measured = slice(len(self.outputs))
            true, erring = out[None, ..., measured], result[None, ..., measured]
            result[..., measured] = self.inner.derived(true, erring, windows)[0]
        return result

    def _at(
        self, places: Sequence[str], coefficients: Sequence[FloatArray]
    ) -> list[tuple[FreeCurve, FloatArray]]:
        """The curves at some places, with their coefficients."""
        return [(c, a) for c, a in zip(self.curves, coefficients, strict=True) if c.place in places]

    def _moved(
        self, own: FloatArray, coefficients: Sequence[FloatArray], windows: Windows, plain: FloatArray
    ) -> FloatArray:
        """The same before the curves of sensors."""
        forces, changes = (self._at((place,), coefficients) for place in ("force", "parameter"))
        out = plain
        for _ in range(self.repetitions if forces or changes else 0):
            pushed = self._pushed(windows, out, forces)
            again = self.inner.simulate_all(own[None], pushed)[0]
            for curve, a in changes:
                again = again + self._changed(own, curve, a, pushed, out)
            moved, out = float(np.nanmax(np.abs(again - out), initial=0.0)), again
            if moved <= SETTLED * float(np.nanmax(np.abs(out), initial=0.0)):
                break
        else:
            if self.repetitions > REPETITIONS and (forces or changes):
                raise ModelError(
                    f"model {self.name!r}: what a curve adds does not settle: "
                    + ", ".join(direction_of(c.place, c.target, c.over) for c in self.curves)
                )
        if self.corrected:
            out = self._observed(own, windows, forces, self._at(("sensor", "odds"), coefficients), out)
        return out

    def as_given(self, parameters: FloatArray, windows: Windows) -> Windows:
        """Windows in which what the curves add is known: forces act, and sensors have not shown their errors.

        Args:
            parameters: The whole vector.
            windows: The windows, from the states that fit them.
        """
        own = parameters[: len(self.inner.names)]
        coefficients = self._split(parameters)
        out = self._moved(own, coefficients, windows, self.inner.simulate_all(own[None], windows)[0])
        given = self._pushed(windows, out, self._at(("force",), coefficients))
        for curve, a in self._at(("sensor",), coefficients):
            given = given.with_errors(
                curve.target, curve.at(variable(self.inner, windows, out, curve.over), a)
            )
        return given

    def _split(self, vectors: FloatArray) -> list[FloatArray]:
        """The coefficients of each curve in vectors, shape (..., parameters)."""
        ends = np.cumsum([c.basis.shape[1] for c in self.curves])[:-1]
        return np.split(vectors[..., len(self.inner.names) :], ends, axis=-1)

    def _observed(
        self,
        own: FloatArray,
        windows: Windows,
        forces: Sequence[tuple[FreeCurve, FloatArray]],
        shown: Sequence[tuple[FreeCurve, FloatArray]],
        out: FloatArray,
    ) -> FloatArray:
        """Outputs of an observer that does not believe what curves of sensors explain of what they show."""
        for _ in range(self.repetitions if shown else 0):
            true = self._pushed(windows, out, forces)
            for curve, a in shown:
                true = true.with_errors(
                    curve.target, curve.at(variable(self.inner, windows, out, curve.over), a)
                )
            out = self.inner.simulate_all(own[None], true)[0]
        return out

    def _pushed(
        self, windows: Windows, out: FloatArray, forces: Sequence[tuple[FreeCurve, FloatArray]]
    ) -> Windows:
        """The windows with what the curves of force add along a run."""
        if not forces or not self.disturbance_unit:
            return windows
        pushes = {push.name: push for push in (*self.inner.staged, *self.inner.pushes)}
        columns = len(self.inner.pushes[0].weights)
        total = np.zeros((len(windows.recording), columns))
        inside = np.arange(windows.samples) < windows.lengths[:, None]
        rows = rows_of(windows)[inside]
        for curve, coefficients in forces:
            push = pushes[curve.target.removeprefix(SHARE)]
            if push.moves:
                total += np.multiply.outer(self._along(windows, curve, coefficients), push.weights)
                continue
            added = curve.at(variable(self.inner, windows, out, curve.over), coefficients)
            if curve.target.startswith(SHARE):
                added = added * variable(self.inner, windows, out, push.rate)
            total[rows] += np.multiply.outer(np.where(np.isfinite(added), added, 0.0)[inside], push.weights)
        return windows.with_force(total[:, 0] if columns == 1 else total)

    def _along(self, windows: Windows, curve: FreeCurve, coefficients: FloatArray) -> FloatArray:
        """A curve of what a machine is told along whole episodes: it runs smoothly between windows, too."""
        bounds = windows.recording.bounds
        lengths = bounds[:, 1] - bounds[:, 0]
        longest = np.ones((len(bounds), int(lengths.max()), len(self.outputs)), dtype=np.bool_)
        whole = replace(windows, starts=bounds[:, 0], lengths=lengths, observed=longest)
        told = variable(self.inner, whole, np.zeros((0, 0, 0)), curve.over)
        values = smooth(curve.knots, curve.basis @ coefficients)(told)
        return np.asarray(values[np.arange(longest.shape[1]) < lengths[:, None]])

    def _changed(
        self, own: FloatArray, curve: FreeCurve, a: FloatArray, windows: Windows, out: FloatArray
    ) -> FloatArray:
        """Change of the outputs by a parameter that differs between windows: a parabola of three runs."""
        i = self.inner.index(curve.target)
        values = curve.at(self.of_window(curve.over, windows, out), a)
        p = self.inner.all_parameters[i]
        values = np.clip(own[i] + values, p.lower, p.upper) - own[i]
        low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
        if low == high:
            return np.zeros_like(out)
        nodes = np.array([0.0, low or 0.5 * high, high or 0.5 * low])
        moved = np.tile(own, (3, 1))
        moved[:, i] += nodes
        runs = self.inner.simulate_all(moved, windows)
        weights = [
            np.prod([(values - nodes[n]) / (nodes[m] - nodes[n]) for n in range(3) if n != m], axis=0)
            for m in (1, 2)
        ]
        changes = runs[1:] - runs[0]
        return np.asarray(np.einsum("mw,mwso->wso", np.stack(weights), changes))

    def of_window(self, over: str, windows: Windows, out: FloatArray) -> FloatArray:
        """A variable's mean over each window, or its root mean square ("size of"), shape (windows,)."""
        if over.startswith("size of "):
            values = variable(self.inner, windows, out, over.removeprefix("size of "))
            return np.asarray(np.sqrt(np.nanmean(values**2, axis=1)))
        return np.asarray(np.nanmean(variable(self.inner, windows, out, over), axis=1))
