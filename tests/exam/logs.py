"""Logs of real machines, and what a diagnosis should say of them; FIELDGYM_DATA says where they are."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from exam.answers import CURVE, Answer
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.recording.datasets import DATA_VARIABLE, open_recording
from fieldmodels.recording.files import load_recording

FORCE = 35.15065
"""Of the EMPS's motor [N/V], as its authors give it."""
DRY = {"coulomb_friction", "stribeck_friction", "hysteresis"}
UNLIKE = {"constant_force", "asymmetric_damping"}
"""What its authors know of it: dry friction, and that friction is unlike in both directions (an offset, or a
damping that differs)."""
LATE = {"actuator_delay", "actuator_lag", "sensor_delay"}


class NoDataError(Exception):
    """A log is not there; the message says where it was looked for."""


Pair = tuple[list[Recording], list[Recording]]
"""Records to fit, and records to measure gains on."""
Findings = Iterator[tuple[bool, str]]
"""What should hold, each with words for it."""


@dataclass(frozen=True)
class Statement:
    """What should be said of a log.

    Attributes:
        machine: Name of the model.
        words: The statement.
        folder: Under FIELDGYM_DATA.
        load: Reads the records.
        holds: What of the statement an answer holds.
    """

    machine: str
    words: str
    folder: str
    load: Callable[[Path, Model], Pair]
    holds: Callable[[Answer], Findings]

    def records(self, model: Model) -> Pair:
        """Read the records.

        Raises:
            NoDataError: If they are not there.
        """
        folder = Path(os.environ.get(DATA_VARIABLE) or "missing") / self.folder
        if not folder.is_dir():
            raise NoDataError(f"{self.folder}: set {DATA_VARIABLE} to the folder that holds it")
        return self.load(folder, model)


def failures(statement: Statement, answer: Answer) -> list[str]:
    """What of a statement does not hold."""
    return [words for held, words in statement.holds(answer) if not held]


# How logs are read.


def _emps(folder: Path, model: Model, name: str) -> Recording:
    columns = {"t": "t", "force": "motor_voltage:N", "position": "position:m"}
    one = load_recording(folder / f"{name}.csv", model, columns)
    return replace(one, signals={**one.signals, "force": FORCE * one["force"]})


def _emps_whole(folder: Path, model: Model) -> Pair:
    return [_emps(folder, model, "estimation")], [_emps(folder, model, "validation_with_force_pulses")]


def _emps_piece(number: int) -> Callable[[Path, Model], Pair]:
    def load(folder: Path, model: Model) -> Pair:
        whole = _emps(folder, model, "estimation")
        first = round(4.0 * number / whole.step)
        parts = [cut(whole, first + k * round(2.0 / whole.step), round(2.0 / whole.step)) for k in (0, 1)]
        return parts[:1], parts[1:]

    return load


def _joint(name: str) -> Callable[[Path, Model], Pair]:
    """A joint of the Go2: the first half of the log to fit, the second one to measure gains on."""

    def load(folder: Path, model: Model) -> Pair:
        columns = {"t": "t", "set_point": f"{name}_setpoint:rad", "position": f"{name}_position:rad"}
        whole = load_recording(folder / "traj_0.csv", model, columns)
        half = len(whole) // 2
        return [cut(whole, 0, half)], [cut(whole, half, len(whole) - half)]

    return load


def cut(recording: Recording, first: int, count: int) -> Recording:
    """Some samples of a recording."""
    return recording.rows(slice(first, first + count))


def _public(collection: str, train: Sequence[str], test: str = "") -> Callable[[Path, Model], Pair]:
    def load(_folder: Path, model: Model) -> Pair:
        tests = [open_recording(f"{collection}/{test}", model)] if test else []
        return [open_recording(f"{collection}/{name}", model) for name in train], tests

    return load


# What should hold.


def _sets(answer: Answer) -> list[set[str]]:
    return [set(cause) for cause in answer.named]


def _value(answer: Answer, effect: str, name: str) -> float:
    return answer.values.get(effect, {}).get(name, (float("nan"), 0.0))[0]


def _error(answer: Answer, output: str, horizon: float) -> tuple[float, float]:
    """Error before and after on windows of about a length."""
    found = answer.by_horizon.get(output, ())
    if not found:
        return answer.errors.get(output, (float("nan"), float("nan")))
    return min(found, key=lambda row: abs(np.log(row[0] / horizon)))[1:]


def _of_emps(answer: Answer) -> Findings:
    sets = _sets(answer)
    after, with_curves = 1e3 * _error(answer, "position", 0.5)[1], 1e3 * answer.errors["position"][1]
    yield any(one & DRY for one in sets), "dry friction is not named"
    yield any(one & UNLIKE for one in sets), "that it is unlike in both directions is not named"
    yield not [one for one in sets if not one & (DRY | UNLIKE | {CURVE})], "something else is named"
    yield after <= 0.15, f"0.5 s ahead it errs by {after:.3f} mm, not 0.15 mm"
    yield with_curves <= 0.12, f"0.5 s ahead it errs with curves by {with_curves:.3f} mm, not 0.12 mm"


def _of_joint(answer: Answer) -> Findings:
    before, after = answer.errors["position"]
    yield any(one & DRY for one in _sets(answer)), "dry friction is not named"
    yield after <= 0.5 * before, f"{100 * after / before:.0f} % of the error are left, not 50 %"


def _of_emps_pieces(answer: Answer) -> Findings:
    for cause in _sets(answer):
        yield bool(cause & (DRY | UNLIKE | {CURVE})), f"{' or '.join(sorted(cause))} is named"


def _of_ddp(answer: Answer) -> Findings:
    after = _error(answer, "angle", 0.3)[1]
    torque = _value(answer, "coulomb_friction", "torque")
    yield "coulomb_friction" in answer.values, "Coulomb friction is not named"
    yield 0.1 < torque < 0.2, f"its torque is {torque:.3f} N m, not 0.1 to 0.2"
    yield after < 0.0045, f"0.3 s ahead it errs by {1e3 * after:.1f} mrad, not 4.5"


def _of_unknown(answer: Answer) -> Findings:
    yield all(CURVE in cause for cause in answer.named), f"{answer.named} are named"
    yield answer.verdict != "consistent", "nothing is missing, it says"


def _of_hand(answer: Answer) -> Findings:
    yield answer.missing or not answer.named, "names explain it all"
    yield answer.verdict != "consistent", "nothing is missing, it says"


def _of_drone(answer: Answer) -> Findings:
    exponent = _value(answer, "thrust_curve", "exponent")
    yield abs(exponent - 2.0) < 0.2, f"thrust grows with a power of {exponent:.2f}, not 2"
    yield any(one & LATE for one in _sets(answer)), "nothing is late"


def _of_warthog(answer: Answer) -> Findings:
    before, after = _error(answer, "heading", 2.0)
    share = _value(answer, "yaw_slip", "share")
    lag = _value(answer, "actuator_lag", "time_constant")
    yield abs(share - 0.38) < 0.03, f"its yaw slips by {share:.2f}, not 0.38"
    yield abs(lag - 1.2) < 0.2, f"its wheels lag by {lag:.2f} s, not 1.2"
    yield after < 0.2 * before, f"{100 * after / before:.0f} % of the heading's error are left, not 20 %"


STATEMENTS: Mapping[str, Statement] = {
    "emps": Statement(
        "rig", "Dry friction and an offset are named, and the error falls to 0.15 mm.",
        "emps", _emps_whole, _of_emps,
    ),
    **{
        f"emps_piece_{k}": Statement(
            "rig", "Two seconds: nothing but friction and an offset is named.",
            "emps", _emps_piece(k), _of_emps_pieces,
        )
        for k in range(5)
    },
    "dfki_ddp": Statement(
        "pendulum", "Coulomb friction of 0.1 to 0.2 N m is named; the error falls below 4.5 mrad.",
        "dfki_simple_pendulum", _public("dfki_simple_pendulum", ["ddp"], "direct_collocation"), _of_ddp,
    ),
    "dfki_energy_shaping": Statement(
        "pendulum", "Something is missing, and no listed effect is named.",
        "dfki_simple_pendulum", _public("dfki_simple_pendulum", ["energy_shaping"]), _of_unknown,
    ),
    "dfki_by_hand": Statement(
        "pendulum", "Names do not explain a pendulum that was moved by hand.",
        "dfki_simple_pendulum", _public("dfki_simple_pendulum", ["gravity_compensation"]), _of_hand,
    ),
    "quarter_drone": Statement(
        "propeller_arm", "Thrust grows with the square of the command, and something is late.",
        "quarter_drone", _public("quarter_drone", ["multisine", "steps"], "swept_sine"), _of_drone,
    ),
    "warthog": Statement(
        "pose_reaching", "Yaw slips by 0.38, wheels lag by 1.2 s, a fifth of the heading's error is left.",
        "drive_ugv", _public("drive_ugv", ["warthog_even_steps"], "warthog_odd_steps"), _of_warthog,
    ),
    **{
        f"go2_{joint}": Statement(
            "servo", "Dry friction is named, and half of the error goes.",
            "go2_joints", _joint(f"FL_{joint}"), _of_joint,
        )
        for joint in ("hip", "thigh")
    },
}  # fmt: skip
"""What should be said of each log."""
