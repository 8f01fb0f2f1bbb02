"""Windows of a recording: as long as the horizon, inside one episode, showing what was measured there."""

import numpy as np
import pytest

from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.windows import uniform_windows


@pytest.fixture
def recording() -> Recording:
    """Two episodes of 25 and 14 samples, 0.1 s apart; the signal counts the samples."""
    time = np.concatenate([0.1 * np.arange(25), 0.1 * np.arange(14)])
    return Recording(time, {"x": np.arange(39.0)}, episode=np.repeat([0, 1], [25, 14]), source="log")


def cut(recording: Recording, horizon: float):
    return uniform_windows(recording, horizon, ("x", "y"), lambda r, starts: r["x"][starts][:, None])


def test_a_window_spans_its_horizon_and_stays_in_its_episode(recording):
    windows = cut(recording, 0.9)
    assert windows.samples == 10  # ten samples span nine steps
    assert windows.starts.tolist() == [0, 10, 25]  # what is left over is shorter than a window
    np.testing.assert_array_equal(windows.lengths, 10)
    np.testing.assert_array_equal(windows.states[:, 0], [0.0, 10.0, 25.0])


def test_a_window_shows_what_was_measured_from_its_start_on(recording):
    measured = cut(recording, 0.9).measured(("x", "y"))
    np.testing.assert_array_equal(measured[1, :, 0], np.arange(10.0, 20.0))
    assert np.isnan(measured[:, :, 1]).all()  # the recording has no such signal


def test_a_horizon_beyond_every_episode_is_refused(recording):
    assert len(cut(recording, 2.4)) == 1
    with pytest.raises(RecordingError, match="record longer"):
        cut(recording, 2.5)
