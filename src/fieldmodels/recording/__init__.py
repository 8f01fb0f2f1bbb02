"""Measured data: recordings, and reading, checking, resampling and cutting them into windows."""

from fieldmodels.recording.data import Recording, RecordingError, RecordingWarning, check_recordings
from fieldmodels.recording.windows import Windows, uniform_windows

__all__ = [
    "Recording",
    "RecordingError",
    "RecordingWarning",
    "Windows",
    "check_recordings",
    "uniform_windows",
]
