"""Windows reduced to features, which a fit compares between simulation and measurement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.effort import simulated
from fieldmodels.diagnosis.events import Observations
from fieldmodels.diagnosis.resolution import of_averages, rounding
from fieldmodels.model import Model
from fieldmodels.recording import Recording, RecordingError, Windows

IntArray = NDArray[np.int64]
MIN_WINDOWS = 8
FOLDS = 4  # of held-out losses
BLOCK = 4  # windows per block: the unit of resampling, since slow noise correlates neighbours
HUGE = 1e100  # larger values mean that a simulation has diverged, in any unit: their squares would overflow
SPARSE = 12  # observations in a window up to which each is a feature by itself
FIXED = 1e-4  # of a state's noise, within which it stays as it is
MIN_BLOCKS = 20  # blocks are smaller if there would be fewer


@dataclass(frozen=True)
class Part:
    """Windows of one recording with the features that they are compressed to.

    Attributes:
        windows: The windows, each with its measured initial state.
        slots: Feature to which each sample contributes, -1 for none, shape (windows, samples, outputs).
        counts: Samples per feature, shape (windows, features).
        features: Measured features, shape (windows, features).
        blocks: Block number of each window within this recording, shape (windows,).
        noise_ratio: By which measured and simulated features are divided, shape (features,): noise of this
            recording over that of the others.
        rounding: Standard deviation of each average's rounding, shape (windows, features).
    """

    windows: Windows
    slots: IntArray
    counts: FloatArray
    features: FloatArray
    blocks: IntArray
    noise_ratio: FloatArray | float = 1.0
    rounding: FloatArray | None = None

    def compressed(self, outputs: FloatArray) -> FloatArray:
        """Outputs of every sample, shape (batch, windows, samples, outputs), as features."""
        features = _compress(outputs, self.slots, self.counts)
        return features if isinstance(self.noise_ratio, float) else np.asarray(features / self.noise_ratio)

    def select(self, which: NDArray[np.bool_] | IntArray) -> Part:
        """Some of the windows."""
        return replace(
            self,
            windows=self.windows.select(which),
            slots=self.slots[which],
            counts=self.counts[which],
            features=self.features[which],
            blocks=self.blocks[which],
            rounding=None if self.rounding is None else self.rounding[which],
        )

    def repeated(self, times: int) -> Part:
        """The windows, each so many times after the other."""
        if times not in self._repeated:
            self._repeated[times] = self.select(np.repeat(np.arange(len(self.windows)), times))
        return self._repeated[times]

    @cached_property
    def _repeated(self) -> dict[int, Part]:
        return {}


@dataclass(frozen=True)
class Problem:
    """All windows of some recordings at one horizon.

    Features are averages over equal bins of a window (subsampling would lose information); an output that
    is observed only a few times per window, or is an event, keeps each observation.

    Attributes:
        model: The simulation.
        parts: One part per recording.
        outputs: Index of the output that each feature belongs to, shape (features,).
        horizon: Length of a window [s].
        bins: Averages per window and densely observed output.
        fine: Whether they are more than the windows support by themselves; see ``averages``.
    """

    model: Model
    parts: tuple[Part, ...]
    outputs: IntArray
    horizon: float
    bins: int
    fine: bool = False

    def __len__(self) -> int:
        """Number of windows."""
        return sum(len(part.windows) for part in self.parts)

    @cached_property
    def features(self) -> FloatArray:
        """Measured features, shape (windows, features)."""
        return np.concatenate([part.features for part in self.parts])

    @cached_property
    def states(self) -> FloatArray:
        """Measured initial states, shape (windows, states)."""
        return np.concatenate([part.windows.states for part in self.parts])

    @cached_property
    def blocks(self) -> IntArray:
        """Block number of each window, counted over all recordings, shape (windows,)."""
        return _counted_on([part.blocks for part in self.parts])

    @property
    def folds(self) -> IntArray:
        """Fold of each window for held-out losses: blocks in turn, shape (windows,)."""
        return np.asarray(self.blocks % FOLDS)

    @property
    def apart(self) -> bool:
        """Whether each window is simulated by itself, from a start of its own."""
        return self.runs is None and self.model.windows_apart

    @cached_property
    def runs(self) -> IntArray | None:
        """Number of the run that each window is a piece of, shape (windows,); None where each is its own."""
        runs = [self.model.runs(part.windows) for part in self.parts]
        own = [np.unique(r, return_inverse=True)[1] for r in runs if r is not None]
        return _counted_on(own) if len(own) == len(runs) else None

    def coordinates(self, free: IntArray) -> Coordinates:
        """Free parameters as numbers of order one; a fit asks at every step."""
        key = free.tobytes()
        if key not in self._coordinates:
            self._coordinates[key] = Coordinates(self.model.all_parameters, free)
        return self._coordinates[key]

    @cached_property
    def _coordinates(self) -> dict[bytes, Coordinates]:
        return {}

    @cached_property
    def predicted(self) -> dict[tuple[bytes, tuple[int, ...]], Any]:
        """What ``gain.predict`` has found of these windows, by its other arguments."""
        return {}

    @cached_property
    def state_scale(self) -> FloatArray:
        """How much each initial state varies between windows, shape (states,)."""
        if self.model.corrected:  # what a start errs is an innovation
            return FIXED * np.array([state.noise for state in self.model.states])
        if self.model.random_force:
            # Free states would absorb the random force of their windows and bias every fit.
            return 0.5 * np.array([state.noise for state in self.model.states])
        # Where all windows start in the same state by definition, their measured states still have noise.
        noise = np.array([state.noise for state in self.model.states])
        spread = np.maximum(self.states.std(axis=0), noise)
        if self.events.all():  # events alone hardly constrain the initial states
            spread = np.where(noise > 0, 0.5 * noise, spread)
        return np.asarray(np.maximum(spread, 1e-3 * np.abs(self.states).max(axis=0) + 1e-9))

    @property
    def alike(self) -> bool:
        """Whether each sample is a feature, and errors are innovations, alike at every sample."""
        samples = max(part.windows.samples for part in self.parts)
        return self.model.corrected and bool((np.bincount(self.outputs) % samples == 0).all())

    @cached_property
    def output_scale(self) -> FloatArray:
        """How much each feature varies between windows (1 for an event), shape (features,)."""
        spread = self.features.std(axis=0)
        scale = np.maximum(spread, 1e-6 * np.abs(self.features).max(axis=0) + 1e-12)
        return np.asarray(np.where(self.events, 1.0, scale))

    @property
    def resolution(self) -> FloatArray:
        """Error of the simulation over each feature's spread, shape (features,)."""
        return np.broadcast_to(self.model.resolution, len(self.model.outputs))[self.outputs]

    @cached_property
    def floor(self) -> FloatArray:
        """Error below which nothing is told of a feature (1 for an event), shape (features,)."""
        parts = [p.rounding / p.noise_ratio for p in self.parts if p.rounding is not None]
        rounded = np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0)) if parts else 0.0
        return np.asarray(
            np.where(self.events, 1.0, np.maximum(rounded, self.resolution * self.output_scale))
        )

    def resolved(self, output: int) -> float:
        """Error of an output below which nothing is told, in its unit; 0 for one that is not measured."""
        own = self.outputs == output
        floors = [np.broadcast_to(p.noise_ratio, own.shape)[own] * self.floor[own] for p in self.parts]
        return float(np.sqrt(np.mean(np.concatenate(floors) ** 2))) if own.any() else 0.0

    def is_exact(self, raw: FloatArray) -> bool:
        """Whether errors, shape (windows, features), are no larger in any output than the simulation's own.

        Those of an integration are alike in all windows: what imitates them looks significant, however finely
        each is weighed.
        """
        finest = self.resolution * self.output_scale
        sizes = np.mean((raw / finest) ** 2, axis=0)
        return not self.events.any() and all(
            np.mean(sizes[self.outputs == j]) <= 1.0 for j in np.unique(self.outputs)
        )

    @cached_property
    def events(self) -> NDArray[np.bool_]:
        """Which features are single observations of an event output, shape (features,)."""
        return np.array([self.model.outputs[j].event for j in self.outputs], dtype=np.bool_)

    @cached_property
    def zeros(self) -> dict[int, FloatArray]:
        """What a unit too much in each output adds, also to what is derived from it, (windows, features)."""
        result = {}
        for j in np.unique(self.outputs[~self.events]).tolist():
            parts = []
            for part in self.parts:
                true = np.zeros((1, *part.slots.shape))
                shown = true + (np.arange(true.shape[3]) == j)
                parts.append(part.compressed(self.model.derived(true, shown, part.windows))[0])
            result[j] = np.concatenate(parts)
        return result

    @cached_property
    def observations(self) -> Observations | None:
        """The event features; None if there are none."""
        if not self.events.any():
            return None
        seen = np.concatenate([part.counts for part in self.parts])[:, self.events] > 0
        return Observations(self.events, seen, self.features[:, self.events])

    def simulate(self, parameters: FloatArray, states: FloatArray) -> FloatArray:
        """Simulated features from given initial states, shape (batch, windows, features)."""
        simulated(len(parameters) * len(self))
        results, first = [], 0
        for part in self.parts:
            last = first + len(part.windows)
            outputs = self.model.simulate(parameters, part.windows.with_states(states[first:last]))
            results.append(part.compressed(outputs))
            first = last
        return results[0] if len(results) == 1 else np.concatenate(results, axis=1)

    def simulate_from(
        self, parameters: FloatArray, states: FloatArray, some: IntArray | None = None
    ) -> FloatArray:
        """Simulated features of one parameter vector from several sets of initial states.

        Args:
            parameters: The vector, shape (parameters,).
            states: Of all windows, shape (sets, windows, states).
            some: Numbers of the windows to simulate, rising; by default all.

        Returns:
            Shape (sets, windows or some, features).
        """
        # The windows of a run go on from each other; where steps follow from some windows, all are simulated.
        if self.runs is not None or not len(states) or not (some is None or self.model.windows_apart):
            found = [self.simulate(parameters[None], one)[0] for one in states]
            every = np.array(found).reshape(len(states), *self.features.shape)
            return every if some is None else np.asarray(every[:, some])
        results, first = [], 0
        for part in self.parts:
            last = first + len(part.windows)
            own = np.arange(first, last) if some is None else some[(some >= first) & (some < last)]
            simulated(len(states) * len(own))
            if len(own):
                whole = len(own) == last - first
                numbers = np.repeat(own - first, len(states))
                each = part.repeated(len(states)) if whole else part.select(numbers)
                starts = np.ascontiguousarray(states[:, own].swapaxes(0, 1)).reshape(
                    len(numbers), states.shape[2]
                )
                outputs = self.model.simulate(parameters[None], each.windows.with_states(starts))
                features = each.compressed(outputs).reshape(len(own), len(states), -1)
                results.append(np.ascontiguousarray(features.swapaxes(0, 1)))
            first = last
        return results[0] if len(results) == 1 else np.concatenate(results, axis=1)

    def response(self, parameters: FloatArray, states: FloatArray, forces: list[FloatArray]) -> FloatArray:
        """Simulated features with a generalised force along each recording, shape (windows, features)."""
        simulated(len(self))
        results, first = [], 0
        for part, force in zip(self.parts, forces, strict=True):
            last = first + len(part.windows)
            windows = part.windows.with_states(states[first:last]).with_force(force)
            results.append(part.compressed(self.model.simulate(parameters[None], windows))[0])
            first = last
        return np.concatenate(results)

    def samples(self, parameters: FloatArray, states: FloatArray) -> list[FloatArray]:
        """Simulated outputs of every part at every sample, NaN where not observed."""
        simulated(len(self))
        results, first = [], 0
        for part in self.parts:
            last = first + len(part.windows)
            outputs = self.model.simulate(parameters[None], part.windows.with_states(states[first:last]))[0]
            results.append(np.where(part.windows.observed, np.clip(outputs, -HUGE, HUGE), np.nan))
            first = last
        return results

    def select(self, blocks: NDArray[np.bool_]) -> Problem:
        """Keep the windows of some blocks; ``blocks`` says for each window whether it stays."""
        parts, first = [], 0
        for part in self.parts:
            keep = blocks[first : first + len(part.windows)]
            first += len(part.windows)
            if keep.any():
                parts.append(part.select(keep))
        return replace(self, parts=tuple(parts))


def _counted_on(numbers: Sequence[IntArray]) -> IntArray:
    """Numbers of several recordings' windows, each recording counted on from the one before."""
    result, first = [], 0
    for own in numbers:
        result.append(own + first)
        first = int(result[-1].max()) + 1 if len(own) else first
    return np.concatenate(result)


def build(
    model: Model,
    recordings: Sequence[Recording],
    horizon: float,
    like: Problem | None = None,
    coarsest: float = 0.0,
    bins: int = 0,
) -> Problem:
    """Cut recordings into windows and compress them.

    Args:
        model: The simulation.
        recordings: Measured data; an output is used if all recordings have it.
        horizon: Length of a window [s].
        like: A problem whose fits are compared with this one's: use as many features per output. By default
            as many averages as the number of windows supports, and every event.
        coarsest: Longest step of recordings that will be compared [s]: they must fill as many averages.
        bins: Averages per window and output instead of those that the windows support; 0 for these.

    Raises:
        RecordingError: If there are too few windows.
    """
    names = tuple(o.name for o in model.outputs)
    cut = [model.windows(recording, horizon).without_lost(names) for recording in recordings]
    common = np.array([all(o.name in w.recording for w in cut) for o in model.outputs])
    if like:
        common &= np.isin(np.arange(len(model.outputs)), like.outputs)
    observed = [w.observed & common & _event_observed(model, w) for w in cut]
    samples = {int(j): max(int(o[:, :, j].sum(1).max()) for o in observed) for j in np.flatnonzero(common)}
    fine = like.fine if like else bins > 0
    if like:
        bins, count = like.bins, {j: int(np.sum(like.outputs == j)) for j in samples}
        dense = [j for j in samples if samples[j] > count[j] and not model.outputs[j].event]
    else:
        dense = [j for j in samples if samples[j] > SPARSE and not model.outputs[j].event]
        total = sum(len(w) for w in cut)
        bins = bins or int(np.clip(total // (5 * max(len(dense), 1)), 5, 10))
        if coarsest > 0.0:
            bins = min(bins, max(int(horizon / coarsest), 3))
        count = {j: bins if j in dense else samples[j] for j in samples}
    outputs = np.repeat(list(count), list(count.values())).astype(np.int64)
    block = int(np.clip(sum(len(w) for w in cut) // MIN_BLOCKS, 1, BLOCK))
    parts: list[Part] = []
    for windows, seen in zip(cut, observed, strict=True):
        slots = _slots(seen, windows.lengths, dense, count)
        counts = _counts(slots, len(outputs))
        # an event that was not observed is no gap
        whole = np.asarray((counts > 0)[:, [not model.outputs[j].event for j in outputs]].all(axis=1))
        if not whole.any():
            continue
        kept = windows.select(whole)
        measured = kept.measured(names)
        slots, counts = slots[whole], counts[whole]
        way = np.abs(np.diff(measured, axis=1, append=measured[:, -1:]))
        features, passed = _compress(np.nan_to_num(np.stack([measured, way]), copy=False), slots, counts)
        steps = np.array([rounding(windows.recording[o.name]) if o.name in windows.recording else 0.0
                          for o in model.outputs])  # fmt: skip
        rounded = of_averages(steps[outputs], passed * counts, counts)
        parts.append(Part(kept, slots, counts, features, _blocks(kept, block), rounding=rounded))
    problem = Problem(model, tuple(parts), outputs, horizon, bins, fine)
    if len(problem) < MIN_WINDOWS:
        sources = ", ".join(recording.source for recording in recordings)
        needed = MIN_WINDOWS * max(w.samples * w.recording.step for w in cut)
        raise RecordingError(
            f"{sources}: only {len(problem)} windows of {horizon:g} s; a diagnosis needs {MIN_WINDOWS} "
            f"(at least {needed:.4g} s of data in one piece). Record longer."
        )
    return problem


def _event_observed(model: Model, windows: Windows) -> NDArray[np.bool_]:
    """Where event outputs were observed, True for the others; shape (windows, samples, outputs).

    Raises:
        RecordingError: If an event is anything but 0, 1 or not a number.
    """
    result = np.ones(windows.observed.shape, dtype=np.bool_)
    for j, output in enumerate(model.outputs):
        if not output.event or output.name not in windows.recording:
            continue
        values = windows.recording[output.name]
        wrong = np.flatnonzero(~(np.isnan(values) | (values == 0) | (values == 1)))
        if len(wrong):
            raise RecordingError(
                f"{windows.recording.source}: signal {output.name!r}, sample {wrong[0]}: "
                f"{values[wrong[0]]:g}; an event is 1 or 0, and empty where it was not observed"
            )
        result[:, :, j] = np.isfinite(windows.measured(tuple(o.name for o in model.outputs))[:, :, j])
    return result


def _blocks(windows: Windows, block: int) -> IntArray:
    """Number consecutive windows in blocks that do not extend across episodes."""
    episode = windows.recording.episode[windows.starts]
    result = np.zeros(len(windows), dtype=np.int64)
    number = -1
    inside = 0
    for i in range(len(windows)):
        if i == 0 or episode[i] != episode[i - 1] or inside == block:
            number, inside = number + 1, 0
        result[i] = number
        inside += 1
    return result


def _slots(
    observed: NDArray[np.bool_], lengths: IntArray, dense: Sequence[int], count: dict[int, int]
) -> IntArray:
    """Assign samples to features: bins of dense outputs, single observations of sparse ones."""
    slots = np.full(observed.shape, -1, dtype=np.int64)
    position = np.arange(observed.shape[1])[None, :] / lengths[:, None]
    first = 0
    for j, features in count.items():
        seen = observed[:, :, j]
        if j in dense:
            index = np.minimum((position * features).astype(np.int64), features - 1)
        else:
            index = np.cumsum(seen, axis=1) - 1
        slots[:, :, j] = np.where(seen & (index < features), index + first, -1)
        first += features
    return slots


@compiled
def _counts(slots: IntArray, features: int) -> FloatArray:
    windows, samples, outputs = slots.shape
    result = np.zeros((windows, features))
    for w in range(windows):
        for n in range(samples):
            for o in range(outputs):
                if slots[w, n, o] >= 0:
                    result[w, slots[w, n, o]] += 1.0
    return result


@compiled
def _compress(simulated: FloatArray, slots: IntArray, counts: FloatArray) -> FloatArray:
    batch, windows, samples, outputs = simulated.shape
    features = counts.shape[1]
    result = np.zeros((batch, windows, features))
    for p in range(batch):
        for w in range(windows):
            for n in range(samples):
                for o in range(outputs):
                    if slots[w, n, o] >= 0:
                        result[p, w, slots[w, n, o]] += simulated[p, w, n, o]
            for f in range(features):
                if counts[w, f] > 0.0:
                    result[p, w, f] /= counts[w, f]
                if not abs(result[p, w, f]) < HUGE:
                    result[p, w, f] = np.nan
    return result
