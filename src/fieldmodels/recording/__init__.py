"""Measured data: what they are, how files of them are read, checked, put on a clock and cut into windows."""

from fieldmodels.recording.data import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.windows import Windows, uniform_windows

__all__ = [
    "Recording",
    "RecordingError",
    "RecordingWarning",
    "Windows",
    "uniform_windows",
]
