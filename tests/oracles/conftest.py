"""What the tests of all oracles share: cases from the declarations, and when two simulations agree.

A test module holds ``CASES``: machine -> effect -> values at which it is tried. A test that takes
``machine``, ``effect`` and ``values`` runs once for each, for every effect that the machine declares; one
without ``machine`` runs on the first machine of the module.
"""

import zlib

import numpy as np
import pytest

from fieldmodels.registry import get_model


def pytest_generate_tests(metafunc):
    wanted = [name for name in ("machine", "effect", "values") if name in metafunc.fixturenames]
    own = ",".join(str(marker.args[0]) for marker in metafunc.definition.iter_markers("parametrize"))
    if wanted[-2:] != ["effect", "values"] or "effect" in own:
        return
    cases = metafunc.module.CASES
    rows = {}
    for machine in cases if "machine" in wanted else list(cases)[:1]:
        for effect in get_model(machine).effects:
            for k, values in enumerate(cases[machine].get(effect.name, [{}])):
                row = {"machine": machine, "effect": effect.name, "values": values}
                rows["-".join([*(row[name] for name in wanted[:-1]), str(k)])] = [
                    row[name] for name in wanted
                ]
    metafunc.parametrize(wanted, list(rows.values()), ids=list(rows))


ROUNDING = 1e-9
"""Share of an output's own size that the oracle's integration and rounding may take."""


@pytest.fixture
def rng(request):
    """A generator of this test's own, the same in every run."""
    return np.random.default_rng(zlib.crc32(request.node.name.encode()))


@pytest.fixture(scope="session")
def agree():
    """Check a simulation against the oracle, relative to what the effect itself contributes."""

    def check(simulated, on, off, tolerance, absolute=0.0):
        """Each output may err by ``tolerance`` of what the effect adds to it at most, or by rounding.

        Args:
            simulated: Outputs to be checked, shape (n, outputs).
            on: The oracle's with the effect.
            off: The oracle's without it.
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
