"""The extension as a user gets it: written, loaded again, and run, before a gain is stated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.causes import refitted
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.extension import compared, extend
from fieldmodels.diagnosis.gain import Prediction, predict
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.result import Cause, Estimate
from fieldmodels.diagnosis.runnable import runnable
from fieldmodels.diagnosis.statements import base_estimates
from fieldmodels.diagnosis.use import loaded, written
from fieldmodels.diagnosis.whole import WholeRecords
from fieldmodels.model import Model, ModelError

NO_BETTER = "in the extended simulation it predicts the test data no better"


@dataclass(frozen=True)
class Delivered:
    """An extension that was written, loaded and run.

    Attributes:
        curves: The curves in it.
        causes: The causes with the values of the joint fit.
        parameters: The base parameters, likewise.
        effects: The curves as effects, by name.
        vector: The fitted values of the model's own parameters.
        testing: The test windows, of the model that was loaded.
        loaded: Its whole vector.
        prediction: Of the test windows.
    """

    curves: tuple[Scored, ...]
    causes: tuple[Cause, ...]
    parameters: Mapping[str, Estimate]
    effects: Mapping[str, Mapping[str, Estimate]]
    vector: FloatArray
    testing: Problem
    loaded: FloatArray
    prediction: Prediction


@dataclass(frozen=True)
class Writer:
    """Writes extensions with some of the curves.

    Attributes:
        candidates: Training windows, and what was made of them.
        kept: The named effects, as fitted without curves.
        causes: What is named.
        testing: Test windows.
        fixed: Values that are not refitted.
    """

    candidates: Candidates
    kept: Candidate
    causes: Sequence[Cause]
    testing: Problem
    fixed: Mapping[str, float]

    def best(self, curves: Sequence[Scored]) -> tuple[Delivered, tuple[str, ...]]:
        """The extension with all curves that run and predict the test data better, the first ones first.

        Args:
            curves: Curves that the search has confirmed.

        Returns:
            The extension, and the curves that it is without, each with the reason.
        """
        able, left = list[Scored](), list[str]()
        for one in curves:
            reasons = runnable(self._machine, [one.shown()], self.candidates.problem.horizon)[1]
            left += reasons
            able += [] if reasons else [one]
        now = self._with(())
        whole = self._better(able, now) if able else now
        if isinstance(whole, Delivered):
            return whole, tuple(left)
        chosen = list[Scored]()
        for one in able:
            more = self._better([*chosen, one], now)
            if isinstance(more, Delivered):
                now, chosen = more, [*chosen, one]
            else:
                left.append(f"{one.curve.direction} ({more})")
        return now, tuple(left)

    def _better(self, curves: Sequence[Scored], now: Delivered) -> Delivered | str:
        """The extension with curves that can run; or why it is not to be had in another's place."""
        try:
            more = self._with(curves)
        except ModelError as error:  # what curves add may not settle
            return str(error)
        whole = bool((more.prediction.counts >= now.prediction.counts).all())  # no window has diverged
        return more if whole and compared(more.prediction, now.prediction) < 0.0 else NO_BETTER

    @property
    def _machine(self) -> Model:
        model = self.candidates.problem.model
        return model.inner if isinstance(model, WholeRecords) else model

    def _with(self, curves: Sequence[Scored]) -> Delivered:
        """Write an extension, load it and predict the test windows with it."""
        training, machine = self.candidates.problem, self._machine
        extension = extend(self.candidates, self.kept, curves)
        final = extension.fit if extension else self.kept.fit
        problem = replace(training, model=extension.model) if extension else training
        scored = extension.curves if extension else ()
        base = base_estimates(problem, final, training.model, self.fixed)
        causes = tuple(refitted(c, problem, final) for c in self.causes)
        effects, _ = runnable(machine, [one.shown() for one in scored], training.horizon)
        named = {c.effect: c.parameters for c in causes}
        simulation = loaded(machine, written(machine, base, named | effects))
        whole = isinstance(training.model, WholeRecords)
        model = WholeRecords(simulation.model) if whole else simulation.model
        testing = self.testing if simulation.model is machine else replace(self.testing, model=model)
        prediction = predict(testing, simulation.vector)
        own = final.parameters[: len(training.model.names)]
        return Delivered(scored, causes, base, effects, own, testing, simulation.vector, prediction)
