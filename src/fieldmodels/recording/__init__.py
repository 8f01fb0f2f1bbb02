"""Measured data: recordings, and reading, checking, resampling and cutting them into windows."""

from fieldmodels.recording.data import (
    Recording,
    RecordingError,
    RecordingWarning,
    check_apart,
    check_recordings,
    once,
)
from fieldmodels.recording.windows import Windows, uniform_windows

__all__ = [
    "Recording",
    "RecordingError",
    "RecordingWarning",
    "Windows",
    "check_apart",
    "check_recordings",
    "once",
    "uniform_windows",
]
