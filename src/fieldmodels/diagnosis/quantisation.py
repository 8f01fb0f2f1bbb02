"""Sensor quantisation, detected from the measured values themselves.

If noise is of the order of the quantisation step, prediction errors cannot reveal it; the values do.
"""

from __future__ import annotations

from collections.abc import Sequence

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import is_quantisation
from fieldmodels.diagnosis.resolution import lattice
from fieldmodels.model import Effect, Model
from fieldmodels.recording import Recording

SHARE = 0.05  # of the error's variance that quantisation must explain to be named


def coarse_sensor(
    model: Model, recordings: Sequence[Recording], rmse: FloatArray
) -> tuple[Effect, float, float] | None:
    """The quantisation effect that explains a considerable share of an output's error.

    Args:
        model: Its effect named ``...quantisation`` acts on the first measured output of that unit.
        recordings: The measured data.
        rmse: Prediction error of the chosen simulation by output.

    Returns:
        The effect, the step, and the share of the error's variance that it explains; or None.
    """
    for effect in filter(is_quantisation, model.effects):
        for j, output in enumerate(model.outputs):
            if output.unit != effect.parameters[0].unit or not all(output.name in r for r in recordings):
                continue
            steps = [lattice(recording[output.name]) for recording in recordings]
            step = steps[0]
            if step is not None and all(s is not None and abs(s - step) < 0.02 * step for s in steps):
                share = step**2 / 12 / max(float(rmse[j]) ** 2, 1e-300)
                if share >= SHARE:
                    return effect, step, min(share, 1.0)
            break
    return None
