"""The cases: degenerate logs, hostile files, models and agents that fail late; each made from its number."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from fieldmodels.yaml import save_yaml

Floats = NDArray[np.float64]
Words = list[str]
ROWS = 600


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        kind: A key of `KINDS`.
        number: What its random numbers are seeded by.
    """

    kind: str
    number: int

    @property
    def key(self) -> str:
        """Its name."""
        return f"{self.kind}/{self.number}"

    def make(self, folder: Path) -> Words:
        """Write its files into a folder; the words of the command, without the place of results."""
        rng = np.random.default_rng([self.number, sorted(KINDS).index(self.kind)])
        return KINDS[self.kind](folder, rng)


def cases_of(count: int) -> list[Case]:
    """So many cases, of every kind in turn; most of files that a fuzzer tears, which take least."""
    turn = [(kind, MORE if kind in FUZZED else 1) for kind in KINDS]
    endless = (Case(kind, i * of + k) for i in itertools.count() for kind, of in turn for k in range(of))
    return list(itertools.islice(endless, count))


def bench(rng: np.random.Generator, rows: int = ROWS, step: float = 0.01, noise: float = 0.002) -> Floats:
    """Time, force and position of a mass on a damped spring by its exact response, shape (rows, 3)."""
    mass, period = rng.uniform(0.5, 3.0), rng.uniform(0.5, 2.0)
    stiffness = mass * (2 * np.pi / period) ** 2
    damping = 2 * rng.uniform(0.05, 0.3) * np.sqrt(mass * stiffness)
    system = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]]), np.array([[0.0], [1 / mass]])
    a, b = cont2discrete((*system, np.eye(2), np.zeros((2, 1))), step)[:2]
    force = rng.uniform(-3.0, 3.0, rows // 20 + 1).repeat(20)[:rows]
    state, found = np.zeros(2), np.zeros((rows, 3))
    for k, u in enumerate(force):
        found[k] = k * step, u, state[0]
        state = a @ state + b[:, 0] * u
    found[:, 2] += noise * rng.standard_normal(rows)
    return found


def table(path: Path, values: Floats, header: str = "t,force,position") -> str:
    """Write a table; its path."""
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.12g")
    return str(path)


def _log(change: Callable[[Floats, np.random.Generator], Floats], **given: float) -> Callable[..., Words]:
    """A log of the bench, changed."""

    def make(folder: Path, rng: np.random.Generator) -> Words:
        values = change(bench(rng, **given), rng)  # type: ignore[arg-type]
        return ["diagnose", table(folder / "log.csv", values), "--model", "rig"]

    return make


def _column(column: int, of: Callable[[Floats, np.random.Generator], Floats]) -> Callable[..., Words]:
    def change(values: Floats, rng: np.random.Generator) -> Floats:
        values[:, column] = of(values[:, column], rng)
        return values

    return _log(change)


def _scaled(values: Floats, rng: np.random.Generator) -> Floats:
    values[:, 1:] *= 10.0 ** rng.uniform(-12.0, -6.0) if rng.random() < 0.5 else 10.0 ** rng.uniform(4.0, 9.0)
    return values


def _extreme(values: Floats, rng: np.random.Generator) -> Floats:
    values[:, rng.integers(1, 3)] *= 10.0 ** rng.choice([-300.0, -150.0, 100.0, 300.0])
    return values


def _clipped(column: Floats, rng: np.random.Generator) -> Floats:
    share = rng.uniform(0.1, 0.4)
    return np.clip(column, *np.quantile(column, [share, 1.0 - share]))


def _rounded(column: Floats, rng: np.random.Generator) -> Floats:
    quantum = np.ptp(column) / rng.integers(2, 9)
    return np.round(column / quantum) * quantum


def _few(folder: Path, rng: np.random.Generator) -> Words:
    rows = int(rng.choice([0, 1, 2, 3, 10, 40]))
    return ["diagnose", table(folder / "log.csv", bench(rng)[:rows]), "--model", "rig"]


def _gaps(values: Floats, rng: np.random.Generator) -> Floats:
    values[rng.random(values.shape) < rng.choice([0.01, 0.3, 0.95])] = np.nan
    values[:, 0] = np.arange(len(values)) * 0.01
    return values


def _clock(time: Floats, rng: np.random.Generator) -> Floats:
    """Backwards, at rest, restless, or with a leap."""
    kind = rng.integers(4)
    restless = time + rng.standard_normal(len(time)) * 0.02
    leap = np.where(np.arange(len(time)) < len(time) // 2, time, time + 1e9)
    return (time[::-1].copy(), 0.0 * time, restless, leap)[kind]


def _grids(folder: Path, rng: np.random.Generator) -> Words:
    """A training and a test log of one machine at different steps."""
    seed, other = int(rng.integers(1 << 30)), float(rng.choice([0.002, 0.02, 0.05]))
    first = table(folder / "train.csv", bench(np.random.default_rng(seed)))
    second = table(folder / "test.csv", bench(np.random.default_rng(seed), 400, other))
    option = ["--test"] if rng.random() < 0.7 else []
    return ["diagnose", first, *option, second, "--model", "rig"]


def _dead_test(folder: Path, rng: np.random.Generator) -> Words:
    values = bench(rng)
    first = table(folder / "train.csv", values)
    values[:, 1:] = 0.0
    return ["diagnose", first, "--test", table(folder / "test.csv", values), "--model", "rig"]


def _many(folder: Path, rng: np.random.Generator) -> Words:
    parts = bench(rng, 50 * 60).reshape(50, 60, 3)
    parts[:, :, 0] -= parts[:, :1, 0]
    names = [table(folder / f"log{i}.csv", part) for i, part in enumerate(parts)]
    return ["diagnose", *names, "--model", "rig"]


TOKENS = (
    b"nan", b"inf", b"1e999", b"-", b'"', b",", b";", b"\n", b"\x00", b"\xff\xfe", b"t", b"9" * 400, b"",
    b"\t",
)  # fmt: skip


def _torn_table(folder: Path, rng: np.random.Generator) -> Words:
    """A table, some of whose bytes are others."""
    path = Path(table(folder / "log.csv", bench(rng, 200)))
    path.write_bytes(mutated(path.read_bytes(), rng, TOKENS))
    return ["diagnose", str(path), "--model", "rig"]


def _junk(folder: Path, rng: np.random.Generator) -> Words:
    path = folder / str(rng.choice(["log.csv", "log.parquet"]))
    header = b"t,force,position\n" if rng.random() < 0.5 else b""
    path.write_bytes(header + rng.bytes(int(rng.integers(0, 5000))))
    return ["diagnose", str(path), "--model", "rig"]


def _wide(folder: Path, rng: np.random.Generator) -> Words:
    """Thousands of columns, or one cell of a million characters."""
    values = bench(rng, 50)
    path = folder / "log.csv"
    if rng.random() < 0.5:
        more = int(rng.integers(2000, 20000))
        header = "t,force,position," + ",".join(f"c{i}" for i in range(more))
        table(path, np.hstack([values, np.zeros((len(values), more))]), header)
    else:
        table(path, values)
        path.write_text(path.read_text() + "9" * 1_000_000 + ",0,0\n")
    return ["diagnose", str(path), "--model", "rig"]


MODEL = """
import sys
import numpy as np
from fieldmodels.model import Effect, Model, Parameter, Signal

CALLS = [0]


class Lag(Model):
    name = "lag"
    inputs = (Signal("force", "N"),)
    outputs = states = (Signal("position", "m", noise=0.002),)
    parameters = (Parameter("gain", "m/N", 1.0, 0.0, 100.0, 0.1),)
    effects = (
        Effect("load", "A load always pulls.", "force", (Parameter("size", "N", 0.0, -10.0, 10.0, 0.2),)),
    )
    horizons = (0.1, 0.2)

    def simulate(self, parameters, windows):
        gain, load = np.atleast_2d(parameters).T[:, :, None]
        position = np.tile(windows.states[:, 0], (len(gain), 1))
        result = np.full((*position.shape, windows.samples, 1), np.nan)
        for k in range(windows.samples):
            row = np.minimum(windows.starts + k, len(windows.recording) - 1)
            result[:, :, k, 0] = position
            position = position + 0.1 * (gain * (windows.recording["force"][row] - load) - position)
        CALLS[0] += 1
        if CALLS[0] > {calls}:
            {what}
        return result

    def initial_states(self, recording, starts):
        return recording["position"][starts][:, None]
"""
LATE = (
    "result = result.tolist()", "result = result + 1j", "result = result.astype(object)", "return None",
    "result = result * np.nan", "result = result + np.inf", "result[:, :1] = np.nan", "result = result[0]",
    "raise KeyError('late')", "raise MemoryError", "sys.exit(0)", "print('late')", "result = result * 1e200",
    "while True: pass", "raise RecursionError", "result = -result",
)  # fmt: skip


def _late_model(folder: Path, rng: np.random.Generator) -> Words:
    path = folder / "lag.py"
    what, calls = str(rng.choice(LATE)), int(10 ** rng.uniform(0.0, 2.7))
    path.write_text(MODEL.replace("{calls}", str(calls)).replace("{what}", what))
    data = table(folder / "log.csv", bench(rng, 400))
    return ["diagnose", data, "--model", str(path), "--call-limit", "1"]


AGENT = """
import sys
import numpy as np
from fieldagents.agent import Agent


class Mine(Agent):
    name = "mine"
    calls = 0

    def __init__(self, settings):
        pass

    def act(self, observation, info):
        action = np.zeros((len(observation), 3))
        self.calls += 1
        if self.calls > {calls}:
            {what}
        return action
"""
ACTIONS = (
    "return None", "action[0] = np.nan", "action = action + np.inf", "action = action[0]", "action = 'no'",
    "action = action.astype(object)", "raise KeyError('late')", "sys.exit(0)", "action = action * 1j",
    "action = [[1.0], [1.0, 2.0]]", "action = action + 1e300", "print('late')", "1 / 0",
)  # fmt: skip


def _late_agent(folder: Path, rng: np.random.Generator) -> Words:
    what, calls = str(rng.choice(ACTIONS)), int(rng.integers(0, 8))
    module = f"late_agent_{rng.integers(1 << 30)}"
    (folder / f"{module}.py").write_text(AGENT.replace("{calls}", str(calls)).replace("{what}", what))
    config = {
        "name": "late", "task": "heel_strike", "environments": {"usual": {"settings": {"strides": 6}}},
        "agents": [f"{module}:Mine", "ranger"], "baseline": "ranger", "episodes": 2,
    }  # fmt: skip
    save_yaml(config, folder / "late.yaml")
    return ["evaluate", str(folder / "late.yaml")]


RECORD = {
    "name": "log", "model": "rig", "reality": {"coulomb_friction": {"force": 0.5}},
    "excitation": {"kind": "mixed", "amplitude": 3}, "duration": 2, "step": 0.01, "episodes": 1,
    "noise": 1.0, "seed": 3, "format": "csv",
}  # fmt: skip
EXTENDED = {
    "schema": 1, "model": "rig", "hold": "held",
    "parameters": {"mass": {"value": 1.0, "std": 0.1, "unit": "kg"}},
    "effects": {"coulomb_friction": {"force": {"value": 0.2, "std": 0.01, "unit": "N"}}},
}  # fmt: skip
YAML_TOKENS = (
    b"nan", b".inf", b"-1", b"1e300", b"9" * 5000, b"[" * 200, b"{", b"&a ", b"*a", b"!!python/object:os.x ",
    b": ", b"- ", b"\t", b"\x00", b"\xff", b"null", b"off", b"2026-13-45", b"<<: *a", b"", b"''",
    b"{uniform: [1, 0]}",
    b"../../etc", b"36000", b"1e-6", b"99",
)  # fmt: skip


def _yaml(folder: Path, rng: np.random.Generator) -> Words:
    """A config, or the file of a reality, some of whose bytes are others."""
    paths = [folder / "record.yaml", folder / "extended.yaml"]
    save_yaml(EXTENDED, paths[1])
    save_yaml({**RECORD, "reality": str(paths[1])} if rng.random() < 0.5 else RECORD, paths[0])
    spoilt = paths[int(rng.integers(2))]
    spoilt.write_bytes(mutated(spoilt.read_bytes(), rng, YAML_TOKENS))
    return ["record", str(paths[0])]


def _override(folder: Path, rng: np.random.Generator) -> Words:
    """Overrides of every key by whatever."""
    save_yaml(RECORD, folder / "record.yaml")
    words = ["record", str(folder / "record.yaml")]
    for _ in range(int(rng.integers(1, 4))):
        key = str(
            rng.choice([*RECORD, "excitation.kind", "reality.coulomb_friction.force", "reality.x", "a.b", ""])
        )
        value = bytes(rng.choice([t for t in YAML_TOKENS if b"\x00" not in t])).decode("latin-1")
        words += ["--set", f"{key}={value}"]
    return words


def mutated(data: bytes, rng: np.random.Generator, tokens: Sequence[bytes]) -> bytes:
    """Some bytes cut out, doubled, or replaced by tokens."""
    for _ in range(int(rng.integers(1, 5))):
        a = int(rng.integers(len(data) + 1))
        b = a + int(10 ** rng.uniform(0.0, 2.5))
        kind = rng.integers(4)
        token = tokens[int(rng.integers(len(tokens)))]
        put, rest = ((b"", b), (data[a:b], a), (token, a + len(token)), (token, a))[kind]
        data = data[:a] + put + data[rest:]
    return data


KINDS: dict[str, Callable[[Path, np.random.Generator], Words]] = {
    "dead": _log(lambda values, _: values * [1.0, 0.0, 0.0]),
    "dead output": _column(2, lambda column, _: 0.0 * column),
    "dead input": _column(1, lambda column, _: 0.0 * column),
    "constant": _column(2, lambda column, rng: np.full_like(column, rng.normal())),
    "clipped": _column(2, _clipped),
    "unrelated": _column(2, lambda _, rng: bench(rng)[:, 2]),
    "noise alone": _column(2, lambda column, rng: 0.01 * rng.standard_normal(len(column))),
    "input is noise": _column(1, lambda column, rng: rng.standard_normal(len(column))),
    "tiny or huge": _log(_scaled),
    "extreme": _log(_extreme),
    "clean": _log(lambda values, _: values, noise=0.0),
    "coarse": _log(lambda values, _: values, rows=300, step=0.1),
    "quantised": _column(2, _rounded),
    "mixed grids": _grids,
    "dead test": _dead_test,
    "few rows": _few,
    "fifty files": _many,
    "gaps": _log(_gaps),
    "clock": _column(0, _clock),
    "torn table": _torn_table,
    "junk": _junk,
    "wide table": _wide,
    "late model": _late_model,
    "late agent": _late_agent,
    "YAML": _yaml,
    "overrides": _override,
}  # fmt: skip
"""Each kind of case: what writes its files and says the command."""

FUZZED, MORE = frozenset({"torn table", "junk", "YAML", "overrides"}), 8
"""Kinds of which there are so many more cases."""

HONEST = frozenset({
    "dead", "dead output", "dead input", "constant", "unrelated", "noise alone", "input is noise",
    "tiny or huge", "clean", "coarse", "mixed grids", "dead test", "few rows", "fifty files",
})  # fmt: skip
"""Kinds whose machine lacks nothing that could be named: any name is false."""
