"""A motor as a `Model`: a simulation that is not written as a derivative."""

import numpy as np

from fieldgym import Effect, Model, Parameter, Signal


class Lag(Model):
    """Speed of a motor, with a constant load and a dead zone."""

    name = "lag"
    inputs = (Signal("voltage", "V"),)
    outputs = (Signal("speed", "rad/s", noise=0.2),)
    states = (Signal("speed", "rad/s"),)
    parameters = (
        Parameter("gain", "rad/s/V", 10.0, 0.0, 1e3, 1.0),
        Parameter("time_constant", "s", 0.1, 0.01, 10.0, 0.01),
    )
    effects = (
        Effect("constant_load", "A load always pulls the same way.", "force",
               (Parameter("speed", "rad/s", 0.0, -100.0, 100.0, 1.0),)),
        Effect("dead_zone", "Small voltages do not arrive.", "actuator",
               (Parameter("width", "V", 0.0, 0.0, 10.0, 0.2, starts=(0.2, 1.0)),)),
    )  # fmt: skip
    horizons = (0.1, 0.2, 0.4)

    def simulate(self, parameters, windows):
        """Speeds of shape (parameter vectors, windows, samples, 1)."""
        gain, time_constant, load, width = np.atleast_2d(parameters).T[:, :, None]
        step = windows.recording.step
        speed = np.tile(windows.states[:, 0], (len(gain), 1))
        result = np.full((*speed.shape, windows.samples, 1), np.nan)
        for k in range(windows.samples):
            inside = k < windows.lengths
            result[:, inside, k, 0] = speed[:, inside]
            row = np.minimum(windows.starts + k, len(windows.recording) - 1)
            voltage = windows.recording["voltage"][row]
            arriving = np.sign(voltage) * np.maximum(np.abs(voltage) - width, 0.0)
            target = gain * arriving - load
            speed = target + (speed - target) * np.exp(-step / time_constant)
        return result

    def initial_states(self, recording, starts):
        """Every window starts at the measured speed."""
        return recording["speed"][starts][:, None]
