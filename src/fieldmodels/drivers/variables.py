"""Variables over which a curve may run: signals, their rates and sums, and what remembers them.

Two kinds of memory, each as the difference from the signal itself, so that a signal that does not change
remembers nothing: an exponentially forgetting mean ("memory of speed over 0.5 s"), as behind a lag or a load
that builds up, and a play operator ("play of speed of 0.1"), as behind loose gears. Before a window both have
seen what was commanded or measured; within it, what is simulated: an output's own noise there would look like
a curve of itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled
from fieldmodels.drivers.windows import Once
from fieldmodels.model import Model
from fieldmodels.recording import Recording, Windows

SEGMENTS = 16
"""Of a window, on each of which a force is constant where responses are combined."""
MEMORY, PLAY, SHARE, CHANGE, WAY = "memory of ", "play of ", "share of ", "change of ", "way of "
TIMES = (0.125, 0.5, 2.0)
"""Time constants that are tried, in lengths of a window."""
WIDTHS = (0.1, 0.3)
"""Half widths of play that are tried, in standard deviations of the signal."""
_KNOWN: Once[dict[str, FloatArray]] = Once(lambda _: {})
"""What remembers a signal along a whole recording, by name."""
_MOST_KNOWN = 8_000_000
"""Numbers of them that are kept; of a long recording they would take more memory than all else."""


def direction_of(place: str, target: str, over: str) -> str:
    """What a curve depends on and where it acts, in a few words."""
    acts = {
        "force": f", in the {target}" if target else "",
        "sensor": f", in the sensor of {target}",
        "parameter": f", in {target.replace('_', ' ')}",
        "odds": f", in the log-odds of {target}",
    }
    return over + acts[place]


def remembering(name: str, duration: float, deviation: float) -> Iterator[str]:
    """Names of what may remember a signal.

    Args:
        name: The signal.
        duration: Of a window [s].
        deviation: Standard deviation of the signal.
    """
    for share in TIMES:
        yield f"{MEMORY}{name} over {share * duration:.4g} s"
    for share in WIDTHS:
        yield f"{PLAY}{name} of {share * deviation:.4g}"


def variable(model: Model, windows: Windows, out: FloatArray, over: str) -> FloatArray:
    """A variable on every sample of a run, shape (windows, samples).

    Args:
        model: The model that was run.
        windows: The windows.
        out: Its outputs, shape (windows, samples, outputs), and what is unmeasured, if it has that.
        over: Name of the variable.
    """
    if " times " in over:
        first, second = over.split(" times ", 1)
        return variable(model, windows, out, first) * variable(model, windows, out, second)
    if over.startswith((MEMORY, PLAY)):
        return _remembered(model, windows, out, over)
    if over.startswith("size of "):
        return np.abs(variable(model, windows, out, over.removeprefix("size of ")))
    names, recording = [s.name for s in (*model.outputs, *model.unmeasured)], windows.recording
    if over in names:
        return out[:, :, names.index(over)]
    if over in model.rates:
        over = f"rate of {model.rates[over]}"
    if over.startswith("rate of "):
        return np.gradient(out[:, :, names.index(over.removeprefix("rate of "))], recording.step, axis=1)
    rows = rows_of(windows)
    if over.startswith(CHANGE):
        name, _, time = over.removeprefix(CHANGE).partition(" over ")
        signal = given(model, recording, name)
        lag = round(float(time[:-2]) / recording.step) if time else windows.samples // SEGMENTS
        lag = max(1, lag)
        return signal[rows] - signal[np.maximum(rows - lag, 0)]
    return given(model, recording, over)[rows]


def given(model: Model, recording: Recording, name: str) -> FloatArray:
    """What a machine is told along a whole recording: an input, a sum, a size or an integral, or the time."""
    if name == "time":
        return recording.time
    if name.startswith("size of "):
        return np.abs(given(model, recording, name.removeprefix("size of ")))
    if name.startswith(WAY):  # since the beginning of an episode
        rate = given(model, recording, name.removeprefix(WAY))
        return np.concatenate([np.cumsum(rate[a:b]) * recording.step for a, b in recording.bounds])
    for one in model.sums:
        if one.name == name:
            columns = [recording[s.name] for s in model.inputs]
            return np.asarray(np.tensordot(one.weights, columns, 1))
    return recording[name]


def rows_of(windows: Windows) -> IntArray:
    """Row of the recording of every sample, shape (windows, samples)."""
    rows = windows.starts[:, None] + np.arange(windows.samples)
    return np.asarray(np.minimum(rows, len(windows.recording) - 1))


def _remembered(model: Model, windows: Windows, out: FloatArray, over: str) -> FloatArray:
    """What remembers a signal, less the signal."""
    plays = over.startswith(PLAY)
    name, _, size = over.removeprefix(PLAY if plays else MEMORY).rpartition(" of " if plays else " over ")
    keep = 0.0 if plays else float(np.exp(-windows.recording.step / float(size.removesuffix(" s"))))

    def follow(values: FloatArray, before: FloatArray) -> FloatArray:
        """Along the last axis, from what was remembered before the first sample."""
        if not plays:
            from scipy.signal import lfilter  # slow to import

            return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values, zi=keep * before[..., None])[0])
        rows = np.ascontiguousarray(values).reshape(-1, values.shape[-1])
        return np.asarray(_play(rows, float(size), np.atleast_1d(before)).reshape(values.shape))

    recording, simulated = windows.recording, name in {s.name for s in model.outputs}
    signal = recording[name] if simulated and name in recording else given(model, recording, name)
    signal, known = _without_gaps(signal), _KNOWN(recording)
    if over not in known:
        if len(known) * len(signal) > _MOST_KNOWN:
            known.clear()
        known[over] = np.concatenate([follow(signal[a:b], signal[a]) for a, b in recording.bounds])
    whole = known[over]
    if not simulated:
        return np.asarray((whole - signal)[rows_of(windows)])
    inside = out[:, :, [s.name for s in model.outputs].index(name)]
    first = np.isin(windows.starts, recording.bounds[:, 0])
    before = np.where(first, inside[:, 0], whole[windows.starts - 1])
    return follow(inside, before) - inside


@compiled
def _play(values: FloatArray, half: float, before: FloatArray) -> FloatArray:
    """What play of a half width leaves of rows of samples, from where it was before; shape of ``values``."""
    result = np.empty(values.shape)
    for i in range(len(values)):
        now = before[i]
        for k in range(values.shape[1]):
            if math.isnan(values[i, k]):
                now = math.nan
            elif now < values[i, k] - half:
                now = values[i, k] - half
            elif now > values[i, k] + half:
                now = values[i, k] + half
            result[i, k] = now
    return result


def _without_gaps(signal: FloatArray) -> FloatArray:
    """A signal whose gaps hold the last value that was known."""
    known = np.isfinite(signal)
    if known.all():
        return np.asarray(signal, dtype=np.float64)
    last = np.maximum.accumulate(np.where(known, np.arange(len(signal)), 0))
    return np.nan_to_num(signal[last])
