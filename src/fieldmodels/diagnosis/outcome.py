"""The outcome of a diagnosis: verdict, numbers and evidence, and what one does with them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldmodels import html
from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.free_run import FreeRun, free_run
from fieldmodels.diagnosis.phrases import a, lacking, sensor_of, the, times_the_noise
from fieldmodels.diagnosis.relation import REMEDY
from fieldmodels.diagnosis.result import (
    Cause,
    Estimate,
    Evidence,
    FailedTest,
    MissingCurve,
    NextMeasurement,
    SignalGain,
    Verdict,
    Visible,
    number,
)
from fieldmodels.diagnosis.use import Simulation, loaded, table, written
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.rounding import listed, with_error, words

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

EITHER = "either the noise of a sensor is coloured, or something small is missing"
"""What a remaining error above the white noise may be where nothing is named."""
WOULD_SHOW = "What depends on one measured signal would have shown from these sizes on"
TOO_FEW = "These data are too few, or too calm, to show what depends on a measured signal, whatever its size."
MAY_ADD = "What depends on nothing measured, on several signals at once, or acts seldom may add up to"
NOTHING_CERTAIN = "No listed effect and no unlisted curve certainly helps."
"""Said where nothing is named and an error above the noise remains."""


@dataclass(frozen=True, repr=False)
class Diagnosis:
    """Result of comparing measured data with a simulation.

    Attributes:
        model: Name of the model.
        machine: The model itself, with scales that suit the data.
        verdict: "consistent", "named", "ambiguous", "unknown", or "unrelated": the command explains nothing.
        causes: The named causes, in the order in which they were found.
        mistaken: What is wrong with the columns (a reversed sign, two swapped); nothing is named then.
        misfit: Tests that the refitted nominal simulation fails.
        gain: Prediction error by signal, at the main horizon.
        curves: Unlisted curves that are missing, too, the most important first.
        possible: Effects that would help, but cannot be told from neutral.
        seen: The smallest curves that these data would have shown, by place.
        curve_effects: The curves as effects that the machine can be run with, by name.
        not_runnable: Curves that it cannot be run with, in words.
        next_measurement: What to record next, if sets of effects remain indistinguishable.
        parameters: Refitted base parameters of the extended simulation.
        undetermined: Positive base parameters whose standard error exceeds half of their value.
        bounded: Values that ended at what is allowed, in words.
        vector: Whole parameter vector of the extended simulation.
        not_testable: Effects that could not be tested, with the reason.
        trained_on: Sources of the training data.
        tested_on: Sources of the test data ("held-out part of ..." if there were none).
        windows: Number of training and of test windows.
        seconds: Duration of the whole diagnosis, compilation included; the program counts from the start of
            its command, so that reading the logs is in it, too. Drawing the report is not.
        evidence: Arrays for the report.
        notes: Peculiarities and preprocessing of the data (``Recording.notes``), and which of them were used.
        lost: Of each sensor that loses samples, that in words.
        wandering: Sensors whose zeros certainly wander, and the standard deviation of that over a record.
        simulations: How much was simulated, in plain simulations of all the windows that were fitted.
        stopped: What was left out for a budget of time; empty if nothing was.
        above_noise: Ratio of a signal's error, names and curves included, to its sensor's noise, where it is
            well above 1.
    """

    model: str
    machine: Model = field(repr=False)
    verdict: Verdict
    causes: tuple[Cause, ...]
    mistaken: str
    misfit: tuple[FailedTest, ...]
    gain: Mapping[str, SignalGain]
    curves: tuple[MissingCurve, ...]
    possible: tuple[Cause, ...]
    seen: tuple[Visible, ...]
    curve_effects: Mapping[str, Mapping[str, Estimate]]
    not_runnable: tuple[str, ...]
    next_measurement: NextMeasurement | None
    parameters: Mapping[str, Estimate]
    undetermined: tuple[str, ...]
    vector: FloatArray
    not_testable: Mapping[str, str]
    trained_on: tuple[str, ...]
    tested_on: tuple[str, ...]
    windows: tuple[int, int]
    seconds: float
    evidence: Evidence
    notes: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    wandering: Mapping[str, float] = field(default_factory=dict)
    simulations: float = 0.0
    stopped: str = ""
    above_noise: Mapping[str, float] = field(default_factory=dict)
    bounded: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The verdict in a line."""
        return f"<Diagnosis of {self.model}: {self.verdict}. {self.summary()}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the verdict and the numbers."""
        rows = [
            (kind, effect, name, f"{e.value:.4g}", f"{e.std:.2g}", e.unit)
            for effect, (kind, values) in self._groups().items()
            for name, e in values.items()
        ]
        numbers = html.table(("kind", "effect", "parameter", "value", "std", "unit"), rows)
        return f"<p><b>{self.verdict.capitalize()}.</b> {escape(self.summary())}</p>{numbers}"

    def to_dataframe(self) -> pd.DataFrame:
        """What was found, a row for each number: kind, effect, parameter, value, std, unit."""
        return table(self._groups())

    def simulate(self, recording: Recording) -> Recording:
        """A free run of the extended simulation: from each episode's first state on, commands alone.

        Args:
            recording: Commands, and what the first state is measured from.

        Returns:
            The recording with simulated outputs in the place of the measured ones.
        """
        return self.simulation.free_run(recording)

    def predict(self, recording: Recording, horizon: float = 0.0) -> pd.DataFrame:
        """Predictions of the extended simulation over windows, each from the state that fits it best.

        Args:
            recording: The measured data.
            horizon: Length of a window [s]; by default that of the diagnosis.

        Returns:
            Columns ``window``, ``t`` and for each output its name and ``<name>_predicted``.

        Raises:
            RecordingError: If there are too few windows.
        """
        return self.simulation.windows(recording, horizon or self.horizon)

    def score(self, recordings: Sequence[Recording]) -> float:
        """Share of the refitted base's squared prediction error that the extended simulation removes.

        Args:
            recordings: The measured data, cut into windows as ``predict`` does.

        Returns:
            The mean over the measured outputs, at most 1.

        Raises:
            RecordingError: If there are too few windows.
        """
        base = Simulation(self.machine, self.evidence.base).squares(recordings, self.horizon)
        after = self.simulation.squares(recordings, self.horizon)
        return float(np.mean([1 - after[name] / square for name, square in base.items() if square > 0]))

    @cached_property
    def free_run(self) -> FreeRun | None:
        """A stretch of test data beside free runs before and after; None where the model has none.

        Without test recordings it is the first recording, most of which has been fitted.
        """
        stretch = self.evidence.stretch
        if stretch is None or any(o.event for o in self.machine.outputs):
            return None
        base = Simulation(self.machine, self.evidence.base)
        return free_run(stretch, base, self.simulation, self.horizon)

    def plot(self, width: float = html.WIDE) -> Figure:
        """What the report shows first: measured, and simulated before and after; the commands below.

        Args:
            width: Width of the figure [inches].
        """
        from fieldmodels.diagnosis import figures

        run = self.free_run
        if run is None:
            return figures.windows(self.evidence.traces, self.gain, self.runs, width)
        added = listed([words(c.effect) for c in self.causes]) or "the curve"
        names = {
            "before": "simulated",
            "after": f"with {added}" if len(added) < 5 * width - 8 else "extended",
        }
        units = {s.name: s.unit for s in self.machine.signals}
        return figures.free(run, self.gain, units, names, self.runs, width)

    @property
    def runs(self) -> tuple[str, ...]:
        """Which simulations differ: before, and after if anything was added."""
        return ("before", "after") if self.causes or self.curve_effects else ("before",)

    @property
    def of_sensors(self) -> tuple[str, ...]:
        """What is wrong with sensors that is no fault of the simulation, in words."""
        units = {output.name: output.unit for output in self.machine.outputs}
        return (
            *self.lost,
            *(
                f"the zero of {sensor_of(name)} wanders by {with_error(size, unit=units[name])} "
                "(RMS) within a record"
                for name, size in self.wandering.items()
            ),
        )

    @property
    def of_bounds(self) -> str:
        """What ended at a bound, and what that means, in a sentence; empty if nothing did."""
        if not self.bounded or self.mistaken or self.verdict == "unrelated":
            return ""
        return (
            f"Caution: the fit ended with {listed([*self.bounded])}; the verdict and the extended "
            "simulation depend on that bound."
        )

    @property
    def weakest(self) -> tuple[Visible, ...]:
        """Of what would have shown one statement a place: where stages have the same, the largest size."""
        found: dict[str, Visible] = {}
        for one in self.seen:
            if one.what not in found or one.size > found[one.what].size:
                found[one.what] = one
        return tuple(found.values())

    @property
    def unseen(self) -> Mapping[str, float]:
        """Of data in which nothing is found, the most that anything may add to each output's error.

        White noise aside, root mean square in the output's unit, as an upper limit of 95 %.
        """
        if self.verdict != "consistent":
            return {}
        return {name: g.unseen for name, g in self.gain.items() if math.isfinite(g.unseen)}

    def of_unseen(self, most: int | None = None) -> str:
        """The same in a sentence, of the outputs of which it is most; empty if there is nothing to say.

        Args:
            most: Of how many outputs; by default of all.
        """

        def share(name: str) -> float:
            return self.unseen[name] / max(self.gain[name].rmse_before, 1e-300)

        said = sorted(self.unseen, key=share, reverse=True)[:most]
        if not said:
            return ""
        parts = [
            f"{self.unseen[name]:.2g}{_unit(self.gain[name].unit)} to the predicted {words(name)}"
            for name in self.gain
            if name in said
        ]
        return f"{MAY_ADD} {listed(parts)}, white noise aside."

    @property
    def of_possible(self) -> str:
        """Effects and curves that may be there, in a sentence each; empty if there are none."""
        return " ".join(filter(None, (self._of_possible_effects, self._of_unconfirmed)))

    @property
    def _of_unconfirmed(self) -> str:
        left = [f"what depends on {one.words}" for one in self.curves if one.certain and not one.confirmed]
        return f"Possible, but not confirmed by the test data: {'; '.join(left)}." if left else ""

    @property
    def _of_possible_effects(self) -> str:
        if not self.possible:
            return ""
        names, them = (
            listed([a(c.effect) for c in self.possible]),
            "it" if len(self.possible) == 1 else "them",
        )
        sentence = f"{names} may be missing, too, but these data cannot tell {them} from nothing."
        return sentence[0].upper() + sentence[1:]

    @property
    def horizon(self) -> float:
        """Length of the predicted windows [s]."""
        return next((g.horizon for g in self.gain.values()), self.machine.horizons[0])

    @cached_property
    def simulation(self) -> Simulation:
        """The extended simulation: the model with its whole parameter vector."""
        return loaded(self.machine, self.extended())

    def _effects(self) -> Mapping[str, Mapping[str, Estimate]]:
        """The named effects, and the curves that the machine can be run with."""
        return {c.effect: c.parameters for c in self.causes} | dict(self.curve_effects)

    def _groups(self) -> Mapping[str, tuple[str, Mapping[str, Estimate]]]:
        groups: dict[str, tuple[str, Mapping[str, Estimate]]] = {"base": ("parameters", self.parameters)}
        groups |= {c.effect: ("cause", c.parameters) for c in self.causes}
        groups |= {c.effect: ("possible", c.parameters) for c in self.possible}
        return groups | {name: ("curve", values) for name, values in self.curve_effects.items()}

    @property
    def unknown(self) -> MissingCurve | None:
        """The most important unlisted curve, of those that are found if there are any; None without one."""
        return next((one for one in self.curves if one.found), self.curves[0] if self.curves else None)

    @property
    def unsure(self) -> bool:
        """Whether the test data confirm none of the curves for which the training data call."""
        return bool(self.curves) and all(one.certain and not one.confirmed for one in self.curves)

    def to_json(self) -> dict[str, Any]:
        """The contract of ``diagnosis.json``: plain data, strictly valid JSON (null for unknown numbers)."""
        return {
            "schema": 2,
            "machine": self.model,
            "model": self.model,  # the key of 0.1
            "verdict": self.verdict,
            "summary": self.summary(),
            "causes": [c.to_json() for c in self.causes],
            "mistaken": self.mistaken or None,
            "misfit": [
                {"signal": m.signal, "test": m.test, "p_value": number(m.p_value), "where": m.where}
                for m in self.misfit
            ],
            "gain": {name: g.to_json() for name, g in self.gain.items()},
            "unknown": self.unknown.to_json() if self.unknown else None,
            "curves": [c.to_json() for c in self.curves],
            "seen": [v.to_json() for v in self.seen],
            "unseen": {name: number(size) for name, size in self.unseen.items()},
            "possible": [c.to_json() for c in self.possible],
            "next_measurement": (
                {"why": self.next_measurement.why, "input": dict(self.next_measurement.input)}
                if self.next_measurement
                else None
            ),
            "parameters": {name: e.to_json() for name, e in self.parameters.items()},
            "undetermined": list(self.undetermined),
            "bounded": list(self.bounded),
            "wandering": {name: number(size) for name, size in self.wandering.items()},
            "above_noise": {name: number(times) for name, times in self.above_noise.items()},
            "not_testable": dict(self.not_testable),
            "data": {
                "train": list(self.trained_on),
                "test": list(self.tested_on),
                "windows": {"train": self.windows[0], "test": self.windows[1]},
                "notes": list(self.notes),
            },
            "stopped": self.stopped or None,
            "seconds": round(self.seconds, 2),
            "simulations": round(self.simulations),
        }

    def summary(self) -> str:
        """The verdict in one sentence, the remaining error, and a caution where needed."""
        text = " ".join([self._sentence(), *(f"{one[0].upper()}{one[1:]}." for one in self.of_sensors)])
        if self.above_noise and self.verdict != "unknown":
            why = f": {EITHER}" if self.verdict == "consistent" else ""
            times = times_the_noise(self.above_noise)
            text += f" The remaining error is larger than the sensors' white noise ({times}){why}."
        if most := self.of_unseen():
            text += f" {most}"
        if self.undetermined and not self.mistaken and self.verdict != "unrelated":
            names = listed([the(name) for name in self.undetermined])
            text += (
                f" Caution: these data hardly determine {names}, so the verdict is weak; "
                "excite the machine more."
            )
        if bounds := self.of_bounds:
            text += f" {bounds}"
        if maybe := self.of_possible:
            text += f" {maybe}"
        if self.stopped:
            text += f" {self.stopped}"
        return text

    def _sentence(self) -> str:
        if self.verdict == "consistent":
            if self.above_noise:
                return NOTHING_CERTAIN
            text = "Nothing significant is missing: the refitted simulation explains these data."
            if shown := [v.words for v in self.weakest if v.errors]:
                text += f" {WOULD_SHOW} (root mean square): {listed(shown)}.{self._blind_to()}"
            elif self.seen:
                text += f" {TOO_FEW}"
            return text
        if self.mistaken:
            return f"First check the columns: {self.mistaken}. Nothing is named before that."
        if self.verdict == "unrelated":
            return f"There is no relation between command and response: {REMEDY}."
        if self.verdict == "unknown":
            shape = ""
            if self.unknown:
                shape = (
                    f": it depends on {self.unknown.words}"
                    if self.unknown.found
                    else ", and what it depends on is not certain"
                )
            sure = "may be" if self.unsure else "is"
            return f"Something {sure} missing that no listed effect explains{shape}. Nothing is named."
        if self.verdict == "ambiguous":
            return f"Missing: {self.names}; these data cannot tell these alternatives apart.{self._more()}"
        return f"Missing: {self.names}.{self._more()}"

    def _blind_to(self) -> str:
        """Where nothing would have shown, in a sentence; empty if there is no such place."""
        none = [v.what for v in self.weakest if not v.errors]
        if not none:
            return ""
        said = listed(none, "or")
        return f" {said[0].upper()}{said[1:]} would not have shown, whatever its size."

    @property
    def names(self) -> str:
        """The causes in words, with what could stand in their places."""
        return lacking([(c.effect, *c.alternatives) for c in self.causes])

    def _more(self) -> str:
        """What is missing beside the causes, in a sentence."""
        if not self.unknown or self.unsure:
            return ""
        return (
            f" More is missing: it depends on {self.unknown.words}."
            if self.unknown.found
            else " More is missing, and what it depends on is not certain."
        )

    def extended(self) -> dict[str, Any]:
        """The extended simulation as data: what ``extended.yaml`` holds."""
        return {
            **written(self.machine, self.parameters, self._effects()),
            **({"not_runnable": list(self.not_runnable)} if self.not_runnable else {}),
            "equations": {c.effect: {"words": c.cause, "symbols": c.equation} for c in self.causes},
        }


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"
