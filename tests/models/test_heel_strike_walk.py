"""Heel strike: the truth, its noises, and walkers that do not depend on who watches them."""

import numpy as np
import pytest
from scipy import integrate, special, stats

from fieldmodels.compiled import compiled
from fieldmodels.elementary import sine_and_cosine
from fieldmodels.machines.heel_strike.declaration import as_plants
from fieldmodels.machines.heel_strike.leg import leg_step, sine_near
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import SILENT, Leg, Noise, Regimes
from fieldmodels.machines.heel_strike.search import record_walks, score_gains, stride_errors
from fieldmodels.machines.heel_strike.strides import Strides
from fieldmodels.machines.heel_strike.walker import Walk
from fieldmodels.model import ModelError
from fieldmodels.streams import draw_gaussians, gaussian, normal_quantile, symmetric

PAPER = (1.0, 1.0, 0.1, 1000 / 3)


def walkers(batch: int, noise: Noise | Regimes | None = None, seed: int = 0, **settings: object) -> Strides:
    strides = Strides(batch, noise=noise, **settings)  # type: ignore[arg-type]
    for i in range(batch):
        strides.seed(i, np.random.default_rng(seed + i))
    return strides


@compiled
def draws(count: int) -> tuple[np.ndarray, np.ndarray]:
    normal, flat = np.empty(count), np.empty(count)
    for i in range(count):
        normal[i] = gaussian(np.uint64(7), i)
        flat[i] = symmetric(np.uint64(11), i)
    return normal, flat


@compiled
def drawn_ahead(first: int, count: int) -> np.ndarray:
    normal = np.empty(count)
    draw_gaussians(np.uint64(7), first, normal, np.empty(count), np.empty(count, dtype=np.int64))
    return normal


@compiled
def quantiles(p: np.ndarray) -> np.ndarray:
    result = np.empty_like(p)
    for i in range(len(p)):
        result[i] = normal_quantile(p[i])
    return result


@compiled
def swung(
    theta: float, omega: float, torque: float, step: float, count: int, plants: np.ndarray
) -> tuple[float, float]:
    for _ in range(count):
        sines = sine_and_cosine(theta)
        theta, omega = leg_step(theta, omega, torque, sines, 0.0, step, 9.81, plants[0], False)
    return theta, omega


def swing(*arguments: float) -> tuple[float, float]:
    plants, _ = as_plants([HeelStrikeModel().nominal])
    return swung(*arguments, plants)


def test_normal_quantile_is_exact():
    p = np.concatenate([np.logspace(-17, -1, 400), np.linspace(0.1, 0.9, 400), 1 - np.logspace(-12, -1, 200)])
    assert quantiles(p) == pytest.approx(special.ndtri(p), rel=2e-15, abs=1e-15)


def test_draws_have_their_distributions_and_no_memory():
    normal, flat = draws(200_000)
    assert stats.kstest(normal, "norm").pvalue > 0.01
    assert stats.kstest(flat, "uniform", args=(-1, 2)).pvalue > 0.01
    for values in (normal, flat):
        for lag in (1, 2, 500):
            assert abs(np.corrcoef(values[lag:], values[:-lag])[0, 1]) < 4 / np.sqrt(len(values))


def test_draws_ahead_are_those_one_by_one():
    assert drawn_ahead(5, 2000).tobytes() == draws(2005)[0][5:].tobytes()


@pytest.mark.every("change", [0.3, -0.3])
def test_the_sine_a_little_further_is_exact_to_the_fourth_order(change):
    for angle in np.linspace(-3.0, 3.0, 25):
        off = sine_near(np.sin(angle), np.cos(angle), change) - np.sin(angle + change)
        # Lagrange's form of the rest: the fifth derivative somewhere between.
        assert abs(off) <= abs(change) ** 5 / 120 * (1.0 + 1e-9)


def test_truth_agrees_with_an_adaptive_integrator():
    # Section 2.4.2 states an error of about 1e-9.
    def slope(_t: float, x: np.ndarray) -> list[float]:
        return [x[1], -9.81 * np.sin(x[0]) + 0.3]

    exact = integrate.solve_ivp(slope, (0, 2), [0.2, 1.5], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    assert swing(0.2, 1.5, 0.3, 0.002, 1000) == pytest.approx(tuple(exact), abs=1e-9)


def test_truth_keeps_the_energy():
    theta, omega = swing(0.0, 1.0, 0.0, 0.002, 50_000)
    assert omega**2 / 2 - 9.81 * np.cos(theta) == pytest.approx(0.5 - 9.81, abs=1e-8)


def test_silent_stride_lasts_half_a_period():
    # Amplitude from the energy: 1 - cos = 1 / (2 g); the period by the elliptic integral.
    amplitude = np.arccos(1 - 0.5 / 9.81)
    half = 2 * special.ellipk(np.sin(amplitude / 2) ** 2) / np.sqrt(9.81)
    strides = walkers(1, SILENT)
    durations = [strides.advance(PAPER).duration[0] for _ in range(20)]
    assert np.mean(durations) == pytest.approx(half, abs=0.0002)


SEVERAL = (
    Walk(regimes=Regimes(collision_kind="ar1")),
    Walk(Leg(speed=3.0)),  # swings further than an eighth of a turn
    Walk(Leg(limit=0.4)),  # is said to have fallen
    Walk(regimes=Regimes(hold=0.07, envelope=0.05), cromer=False),
)


@pytest.mark.every("batch", [3, 11])
@pytest.mark.every("bank", [False, True])
def test_a_batch_of_one_is_a_row_of_a_batch_to_the_bit(batch, bank):
    """Walkers go side by side, and each strikes when it does."""
    many, *single = (walkers(n, seed=s, bank=bank) for n, s in ((batch, 0), *((1, s) for s in range(batch))))
    for i, alone in enumerate(single):
        many.set_walk(i, SEVERAL[i % len(SEVERAL)])
        alone.set_walk(0, SEVERAL[i % len(SEVERAL)])
    for _ in range(5):
        result = many.advance(PAPER)
        for i, alone in enumerate(single):
            one = alone.advance(PAPER)
            assert many.walkers[i].tobytes() == alone.walkers[0].tobytes()
            for row, value in zip(result[:8], one[:8], strict=True):
                assert row[i].tobytes() == value[0].tobytes()


def test_gains_do_not_change_the_walk():
    first, second = walkers(2), walkers(2)
    for _ in range(5):
        a = first.advance(PAPER, traces=True)
        b = second.advance((0.01, 0.02, 0.9, 100.0), traces=True)
        assert np.array_equal(a.traces[:, :, :4], b.traces[:, :, :4], equal_nan=True)
        assert np.array_equal(a.floor_mm, b.floor_mm)
    assert not np.array_equal(a.signed_mm[:, 0], b.signed_mm[:, 0])


def test_a_snapshot_continues_exactly():
    strides = walkers(3, bank=True)
    strides.advance(PAPER)
    saved = strides.state()
    first = [strides.advance(PAPER).signed_mm for _ in range(4)]
    other = Strides(3, bank=True)
    other.set_state(saved)
    again = [other.advance(PAPER).signed_mm for _ in range(4)]
    assert np.array_equal(first, again)


def test_effects_that_are_off_give_the_nominal_bits():
    nominal, extended = walkers(2), walkers(2)
    extended.extended[:] = True
    for _ in range(4):
        a, b = nominal.advance(PAPER), extended.advance(PAPER)
    assert np.array_equal(a.signed_mm[:, :4], b.signed_mm[:, :4])
    assert np.array_equal(nominal.walkers["omega"], extended.walkers["omega"])


@pytest.mark.every("kind", ["low_pass", "ar1"])
def test_collision_noise_has_its_envelope_and_correlation(kind):
    noise = Noise(gyro=0.0, process=0.0, floor=0.0, collision=0.5, collision_kind=kind)
    strides = walkers(400, noise)
    result = strides.advance(PAPER, traces=True)
    omega, gyro = result.traces[:, :, 2], result.traces[:, :, 3]
    error = (gyro - omega)[:, :200]
    assert np.all(error[:, 125:] == 0.0)
    free = error[:, :120] / (1 - np.arange(1, 121) / 125)
    innovation = free[:, 1:] - 0.995 * free[:, :-1]
    drive = 0.5 * np.sqrt((1 - 0.995**2) / 3) if kind == "ar1" else 0.5 * 0.005 / np.sqrt(3)
    assert innovation.std() == pytest.approx(drive, rel=0.02)
    assert abs(np.corrcoef(innovation[:, 1:].ravel(), innovation[:, :-1].ravel())[0, 1]) < 0.02
    # ar1 starts from the spread at which it stays, low_pass from nothing.
    stationary = 0.5 / np.sqrt(3) if kind == "ar1" else drive
    assert free[:, 0].std() == pytest.approx(stationary, rel=0.1)


def test_process_torque_is_held_and_bounded():
    strides = walkers(50, Noise(process=0.5, hold=0.25))
    torque = strides.advance(PAPER, traces=True).traces[:, :450, 7]
    assert np.abs(torque).max() < 0.5
    assert torque.std() == pytest.approx(0.5 / np.sqrt(3), rel=0.1)
    changes = np.flatnonzero(np.diff(torque[0])) + 1
    assert list(changes) == [125, 250, 375]


def test_floor_is_two_sided_unless_printed():
    heights = {}
    for one_sided in (False, True):
        strides = walkers(200, Noise(floor=0.004, floor_one_sided=one_sided))
        heights[one_sided] = np.concatenate([strides.advance(PAPER).floor_mm for _ in range(10)])
    assert np.abs(heights[False]).max() <= 4.0
    assert heights[False].mean() == pytest.approx(0.0, abs=0.2)
    assert heights[True].min() >= 0.0
    assert heights[True].mean() == pytest.approx(2.0, abs=0.1)


def test_regimes_dwell_and_are_independent():
    strides = walkers(300, Regimes(dwell=5.0))
    levels = np.array([strides.advance(PAPER).levels for _ in range(60)])
    assert levels.mean(axis=(0, 1)) == pytest.approx([0.5, 0.5, 0.5], abs=0.05)
    switched = (levels[1:] != levels[:-1]).mean(axis=(0, 1))
    assert switched == pytest.approx([0.2, 0.2, 0.2], abs=0.015)
    flat = levels.reshape(-1, 3)
    assert np.abs(np.corrcoef(flat.T) - np.eye(3)).max() < 0.08


def test_without_push_off_the_leg_falls_and_says_so():
    # The undamped pendulum of the source goes over the top under its own process noise.
    noise = Noise(process=0.9, hold=0.4)
    leg = Leg(push_off=0.0)
    strides = Strides(4, leg, noise)
    for i in range(4):
        strides.seed(i, np.random.default_rng(i))
    fell = np.zeros(4, dtype=bool)
    for _ in range(900):
        fell |= strides.advance(PAPER).fallen
    assert fell.all()
    held = walkers(4, noise)
    assert not any(held.advance(PAPER).fallen.any() for _ in range(900))


def test_recorded_walks_are_scored_as_walkers_are():
    gains = np.array([[0.3, 0.6, 0.2, 400.0], [1.0, 1.0, 0.1, 1000 / 3]])
    walks = record_walks([np.random.default_rng(s) for s in (4, 5)], 12)
    errors = stride_errors(walks, gains)
    for row, gain in enumerate(gains):
        for walk, seed in enumerate((4, 5)):
            strides = walkers(1, seed=seed)
            own = [strides.advance(gain).signed_mm[0, 0] for _ in range(12)]
            assert errors[row, walks.walk == walk] == pytest.approx(own, abs=1e-8)
    told = np.repeat(gains[1][None, None], 8, axis=1)
    assert stride_errors(walks, told, walks.regime)[0] == pytest.approx(errors[1], abs=1e-12)
    assert score_gains(walks, gains) == pytest.approx(np.abs(errors).mean(axis=1))


def test_bad_input_is_refused():
    with pytest.raises(ModelError, match="seed every walker"):
        Strides(2).advance(PAPER)
    with pytest.raises(ModelError, match=r"gains must have shape \(4,\) or \(2, 4\)"):
        walkers(2).advance(np.ones((3, 4)))
    with pytest.raises(ModelError, match="numbers, not shape"):
        Strides(2, reality=np.ones(3))
    with pytest.raises(ModelError, match=r"a reality has shape \(n,\) or \(2, n\)"):
        Strides(2, reality=np.tile(HeelStrikeModel().nominal, (3, 1)))
    late = HeelStrikeModel().vector(effects={"gyro_delay": {"delay": 0.02}})
    with pytest.raises(ModelError, match="is longer than the 14 that a walker"):
        Strides(2, Leg(step=0.001), reality=late)
    with pytest.raises(ModelError, match="snapshot of 2 walkers"):
        walkers(2).set_state(walkers(3).state())
    with pytest.raises(ValueError, match="push_off must be at least 0, at most 1"):
        Leg(push_off=1.5)
    with pytest.raises(ValueError, match="collision_kind must be"):
        Noise(collision_kind="white")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="floor must be at least 0 m"):
        Noise(floor=-0.1)
    with pytest.raises(ValueError, match="each of process must be at least 0"):
        Regimes(process=(0.1, -0.2))
