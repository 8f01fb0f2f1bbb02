"""What the comparisons of models with the exam's plants share: when the two agree."""

import zlib

import numpy as np
import pytest

ROUNDING = 1e-9
"""Share of an output's own size that the plant's integration and rounding may take."""


@pytest.fixture
def rng(request):
    """A generator of this test's own, the same in every run."""
    return np.random.default_rng(zlib.crc32(request.node.name.encode()))


@pytest.fixture(scope="session")
def agree():
    """Check a simulation against the plant, relative to what the effect itself contributes."""

    def check(simulated, on, off, tolerance, absolute=0.0):
        """Each output may err by ``tolerance`` of what the effect adds to it at most, or by rounding.

        Args:
            simulated: Outputs to be checked, shape (n, outputs).
            on: The plant's with the effect.
            off: The plant's without it.
            tolerance: Share of the largest difference of the two.
            absolute: What each output may err beside that, for a limit that is documented.
        """
        assert np.isfinite(simulated).all()
        contribution = np.abs(on - off).max(axis=0)
        assert contribution.max() > 0.0, "the effect does nothing here: drive it harder"
        allowed = tolerance * contribution + ROUNDING * np.abs(on).max(axis=0) + absolute
        error = np.abs(simulated - on).max(axis=0)
        assert (error <= allowed).all(), (
            f"errors {error}, allowed {allowed}, of the effect's contribution {contribution}"
        )

    return check
