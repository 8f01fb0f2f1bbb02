"""Jumps: the one that explains most, and that a knocked sensor is told by its time."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.jumps import strongest_jump
from fieldmodels.diagnosis.response import averaged, segments
from fieldmodels.diagnosis.result import JUMP
from fieldmodels.diagnosis.shapes import Curve, known_functions, tables
from fieldmodels.diagnosis.waves import strongest
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model


def test_the_strongest_jump_is_that_of_least_squares():
    rng = np.random.default_rng(4)
    windows, rows, free = 30, 6, 3
    answer = rng.normal(size=(windows, rows))
    basis = np.linalg.qr(rng.normal(size=(windows * rows, free)))[0]
    residual = rng.normal(size=windows * rows) + (np.arange(windows) >= 17).repeat(rows) * answer.ravel()
    order = rng.permutation(windows)  # windows need not be in the order of time
    time = np.empty((windows, 16))
    time[order] = np.arange(windows)[:, None] + np.linspace(0.0, 0.9, 16)

    def explained(start: int) -> float:
        column = np.where(time[:, :1] >= start, answer, 0.0).ravel()
        column = column - basis @ (basis.T @ column)
        left = residual - basis @ (basis.T @ residual)
        return float((column @ left) ** 2 / (column @ column))

    others = np.einsum("wr,wrk->wk", answer, np.column_stack([basis, residual]).reshape(windows, rows, -1))
    found = strongest_jump(time, np.sum(answer**2, axis=1), others, basis.T @ residual, 0.1)
    assert found == (max(range(3, windows - 3), key=explained), windows - 6)


STEP = 0.01


def knocked(seed: int, size: float) -> Recording:
    """A pendulum whose angle's sensor is knocked after 17 s, in plain Python."""
    rng, count = np.random.default_rng(seed), 3000
    pendulum = get_model("pendulum")
    names = {p.name: p.nominal for p in pendulum.parameters}
    torque = np.repeat(rng.uniform(-1.0, 1.0, count // 20), 20)
    angle, rate, rows = 0.0, 0.0, np.empty((count, 2))
    for n in range(count):
        rows[n] = angle, rate
        for _ in range(20):
            push = torque[n] - names["gravity_moment"] * np.sin(angle)
            rate += STEP / 20 * push / names["inertia"]
            angle += STEP / 20 * rate
    time = STEP * np.arange(count)
    noise = rng.normal(size=(count, 2)) * [s.noise for s in pendulum.outputs]
    shown = rows + noise
    shown[:, 0] += size * (time >= 17.0)
    return Recording(time=time, signals={"torque": torque, "angle": shown[:, 0], "velocity": shown[:, 1]})


@pytest.mark.nightly
def test_a_knocked_sensor_is_told_by_its_time():
    found = diagnose(get_model("pendulum"), [knocked(1, 0.05)], [knocked(2, 0.05)])
    assert not found.causes, found.summary()
    curve = found.curves[0]
    assert (curve.place, curve.target, curve.over) == ("sensor", "angle", "time")
    assert float(curve.formula.removeprefix(JUMP).split()[0]) == pytest.approx(17.0, abs=0.4)
    at, value, _ = curve.curve.T
    assert np.ptp(value) == pytest.approx(0.05, abs=0.01)
    assert value[at > 18.0].mean() > value[at < 16.0].mean()
    assert found.gain["angle"].rmse_with_curves < found.gain["angle"].rmse_before


def test_averages_of_empty_segments_are_those_before():
    """Five samples fill five of sixteen segments."""
    values = np.array([[3.0, 5.0, 7.0, 9.0, 11.0]])
    result = averaged(values, segments(np.array([5]), 5))[0]
    assert (np.diff(result) >= 0.0).all()
    assert set(result) == {3.0, 5.0, 7.0, 9.0, 11.0}


def test_waves_of_a_slow_machine_are_sought_down_to_two_samples_a_cycle():
    """Segments without samples repeat the time before them, which is no pace."""
    samples = np.arange(1000.0).reshape(125, 8)
    time = averaged(samples, segments(np.full(125, 8), 8))
    place = Curve("sensor", "line", "time", "s", "m", time / 999.0, np.array([0.0, 999.0]), np.eye(2))
    asked = []
    strongest(place, lambda _, counts: asked.append(counts) or np.zeros(len(counts)))
    assert asked[0][-1] == pytest.approx(499.0, abs=2.0)


def test_waves_over_a_command_of_few_levels_have_four_levels_in_a_cycle():
    """With more cycles a wave would fit forty levels with any errors."""
    levels = np.random.default_rng(1).integers(0, 40, (60, 2)).repeat(8, axis=1) / 39.0
    place = Curve("force", "", "command", "N", "N", levels, np.array([-5.0, 5.0]), np.eye(2))
    asked = []
    strongest(place, lambda _, counts: asked.append(counts) or np.zeros(len(counts)))
    assert asked[0][-1] == pytest.approx(10.0, abs=0.5)


def test_a_table_of_the_ends_rises_where_a_command_is_at_its_largest_for_long():
    """Extended simulations take only curves whose places rise."""
    rng = np.random.default_rng(1)
    command = np.minimum(rng.uniform(-1.0, 1.0, (40, 8)), 0.5)
    [ends] = [c for c in tables({"command": ("V", command)}) if c.formula == "ends"]
    assert (np.diff(ends.knots) > 0.0).all()
    assert ends.shapes.shape == (len(ends.knots), ends.values.shape[-1])


def test_known_functions_go_on_beyond_what_was_seen():
    speed = np.random.default_rng(1).uniform(-1.0, 2.0, (40, 8))
    [table, _ends] = tables({"speed": ("m/s", speed)})
    [cube] = [c for c in known_functions(table, speed) if c.formula == "cube"]
    size = np.abs(speed).max()
    assert cube.knots[0] < speed.min() - 0.5
    assert cube.knots[-1] > speed.max() + 0.5
    assert cube.shapes[-1, 0] == pytest.approx((cube.knots[-1] / size) ** 3)
