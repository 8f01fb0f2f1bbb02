"""What a notebook hands over wrongly is said with the remedy; what it prints is a line."""

import numpy as np
import pytest

from fieldgym.bench import as_env
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.free_run import FreeRun
from fieldmodels.machine import Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.files import load_recording


class Motor(Machine):
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)

    def derivative(self, state, input, p):
        return p.gain * input.voltage - state.speed


RECORDING = Recording(
    np.arange(300) * 0.01,
    {"voltage": np.ones(300), "speed": np.sin(np.arange(300.0))},
    units={"voltage": "V"},
    episode=np.repeat([0, 1], 150),
    source="log.csv",
)


@pytest.mark.parametrize(
    "call",
    [
        lambda: diagnose(Motor, [RECORDING]),
        lambda: load_recording("log.csv", Motor),
        lambda: as_env(Motor),
    ],
)
def test_a_class_is_no_model(call):
    with pytest.raises(ModelError, match=r"Motor is a class; give a model of it: Motor\(\)"):
        call()


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ((RECORDING,), r"train is one recording; give a list of them: \[recording\]"),
        (([RECORDING], RECORDING), "test is one recording"),
        (("log.csv",), "train holds 'log.csv', a str and no recording; load it: .*load_recording"),
        ((["log.csv"],), "train holds 'log.csv', a str and no recording; load it: .*load_recording"),
    ],
)
def test_what_is_no_list_of_recordings(given, says):
    with pytest.raises(RecordingError, match=says):
        diagnose(Motor(), *given)


def test_recordings_and_free_runs_are_shown_in_a_line():
    assert repr(RECORDING) == "<Recording of log.csv: 300 rows of 0.01 s in 2 episodes; voltage [V], speed>"
    same = {"speed": RECORDING["speed"]}
    run = FreeRun(RECORDING, {"before": {"speed": np.full(300, same["speed"].mean())}, "after": same}, (), {})
    assert repr(run) == "<Free run of log.csv, 300 rows: fit of speed 0 → 100 %>"
