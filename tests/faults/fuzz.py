"""A fuzzer guided by coverage, for what is read from files: configs, realities, bench files, tables.

``python tests/faults/fuzz.py INPUTS [SEED [DOOR...]]`` hands each door so many inputs, prints what got
through as anything but an answer or a clear message, and publishes the counts in docs/faults.md. An input
that reaches a line of the project by a way that none before it took is kept and changed further. All is
made from the seed.
"""

import json
import re
import signal
import sys
import tempfile
import traceback
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather as feather
import pyarrow.parquet as pq

from exam.hostile import EXTENDED, RECORD, TOKENS, YAML_TOKENS, bench, mutated
from exam.table import put
from fieldagents.cli import _message
from fieldagents.config import load_config
from fieldagents.learned.config import TrainConfig
from fieldagents.record.config import RecordConfig
from fieldmodels.reality import read_reality
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.files import load_recording
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

ROOT = Path(__file__).parents[2]
KEPT = Path(__file__).with_name("fuzz.json")
RIG = get_model("rig")
LONGEST = 10.0
"""Processor time after which an input hangs its door [s]."""


class Hang(BaseException):
    """An input takes too long."""


def _yaml(data):
    def make(folder):
        save_yaml(data, folder / "seed.yaml")
        return (folder / "seed.yaml").read_bytes()

    return make


def _table(write):
    def make(folder):
        values = bench(np.random.default_rng(0), 60)
        path = folder / "seed"
        write(pa.table(dict(zip(("t", "force", "position"), values.T, strict=True))), values, path)
        return path.read_bytes()

    return make


def _text(separator, point, header):
    def write(_, values, path):
        rows = [header, *(separator.join(f"{x:.6g}".replace(".", point) for x in row) for row in values)]
        path.write_text("\n".join(rows) + "\n")

    return write


def _as_json(table, _, path):
    path.write_text(json.dumps(table.to_pylist()))


BENCH = {
    "model": "rig", "rate": 100.0,
    "columns": {"t": "time", "force": {"column": "f", "unit": "N", "gain": -2}, "position": "2*x+1:mm"},
}  # fmt: skip
TRAIN = {"name": "a", "task": "heel_strike", "algorithm": "ppo", "steps": 1024, "num_envs": 4}
DOORS = {
    "config": (lambda path: load_config(path, RecordConfig), YAML_TOKENS, {".yaml": _yaml(RECORD)}),
    "training": (lambda path: load_config(path, TrainConfig), YAML_TOKENS, {".yaml": _yaml(TRAIN)}),
    "reality": (lambda path: read_reality(path, RIG), YAML_TOKENS, {".yaml": _yaml(EXTENDED)}),
    "bench": (Bench.load, YAML_TOKENS, {".yaml": _yaml(BENCH)}),
    "text table": (lambda path: load_recording(path, RIG), TOKENS, {
        ".csv": _table(_text(",", ".", "t,force,position")),
        ".txt": _table(_text(";", ",", "# a bench\nt [s];force [N];position [mm]")),
        ".json": _table(_as_json),
    }),
    "binary table": (lambda path: load_recording(path, RIG), TOKENS, {
        ".parquet": _table(lambda table, _, path: pq.write_table(table, path)),
        ".feather": _table(lambda table, _, path: feather.write_feather(table, path)),
        ".npy": _table(lambda _, values, path: np.save(path.open("wb"), values)),
    }),
}  # fmt: skip


class Traced:
    """Ways taken through the lines of some files: pairs of lines that follow each other."""

    def __init__(self, root=f"{ROOT}/"):
        self.root, self.ways, self._last = str(root), set(), 0

    def __enter__(self):
        self.ways = set()
        sys.settrace(self._enter)
        return self

    def __exit__(self, *_):
        sys.settrace(None)

    def _enter(self, frame, event, _):
        return self._line if frame.f_code.co_filename.startswith(self.root) else None

    def _line(self, frame, event, _):
        here = hash((frame.f_code, frame.f_lineno))
        self.ways.add((self._last, here))
        self._last = here
        return self._line


def outcome(door, path):
    """``answered``, ``refused``, or the error that got through and its place."""

    def late(*_):
        raise Hang

    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)  # NumPy's own, which tell a user nothing
            door(path)
    except Hang as error:
        return f"hang in {_place(error)}"
    except Exception as error:
        if _message(error) is not None:
            return "refused"
        return f"{type(error).__name__} in {_place(error)}: {str(error)[:100]}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)
    return "answered"


def _place(error):
    ours = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
    return f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "?"


def changed(data, rng, tokens):
    """A word, a byte, or a few lines are others; sometimes more at once."""
    kind, words = rng.random(), list(re.finditer(rb"[\w.+-]+", data))
    token = tokens[int(rng.integers(len(tokens)))]
    if kind < 0.4 and words:
        word = words[int(rng.integers(len(words)))]
        data = data[: word.start()] + token + data[word.end() :]
    elif kind < 0.55:
        at = int(rng.integers(len(data) + 1))
        data = data[:at] + token + data[at:]
    elif kind < 0.7 and data:
        at = int(rng.integers(len(data)))
        data = data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]
    elif kind < 0.9:
        lines = data.splitlines(keepends=True) or [b""]
        a, b = rng.integers(len(lines), size=2)
        lines[int(a)] = [b"", lines[int(b)], lines[int(a)] * 2][int(rng.integers(3))]
        data = b"".join(lines)
    else:
        return mutated(data, rng, tokens)
    return changed(data, rng, tokens) if rng.random() < 0.3 else data


def fuzzed(door, tokens, seeds, count, seed, traced=None):
    """Hand a door so many inputs.

    Args:
        door: What reads a path.
        tokens: Bytes that are put in.
        seeds: Suffix to inputs to begin with.
        count: How many inputs.
        seed: Of all random numbers.
        traced: What tells the ways; None for blind changes of the seeds.

    Returns:
        How often each outcome was, how many inputs were kept, and an input for each outcome that is a fault.
    """
    rng, known, counts, faults = np.random.default_rng(seed), set(), {}, {}
    corpus, good = list(seeds), list(seeds)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            if number < len(seeds):
                suffix, data = seeds[number]
            else:
                pool = good if rng.random() < 0.6 else corpus  # what is right still leads deepest
                recent = len(pool) - 1 - int(len(pool) * rng.random() ** 2)  # rather the newest
                suffix, data = pool[recent]
                data = changed(data, rng, tokens)
                if rng.random() < 0.05:  # the end of another
                    other = corpus[int(rng.integers(len(corpus)))][1]
                    data = data[: rng.integers(len(data) + 1)] + other[rng.integers(len(other) + 1) :]
            path = Path(folder) / f"input{suffix}"
            path.write_bytes(data[: 1 << 20])
            if traced is None:
                what = outcome(door, path)
            else:
                with traced:
                    what = outcome(door, path)
                if traced.ways - known:
                    known |= traced.ways
                    corpus.append((suffix, data))
                    if what == "answered":
                        good.append((suffix, data))
            counts[what] = counts.get(what, 0) + 1
            if what not in ("answered", "refused"):
                faults.setdefault(what, (suffix, data))
    return counts, len(corpus), faults


def through(name, count, seed, traced=None):
    """One of `DOORS`, fuzzed."""
    door, tokens, made = DOORS[name]
    with tempfile.TemporaryDirectory() as folder:
        seeds = [(suffix, make(Path(folder))) for suffix, make in made.items()]
    return fuzzed(door, tokens, seeds, count, seed, traced)


def publish(kept):
    """Put the counts into the page."""
    lines = [
        "| read as | inputs | answered | refused | other |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, one in kept.items():
        other = one["inputs"] - one["answered"] - one["refused"]
        counts = f"{one['inputs']:,} | {one['answered']:,} | {one['refused']:,} | {other:,}"
        lines.append(f"| {name} | {counts} |")
    put("\n".join([*lines, ""]), ROOT / "docs" / "faults.md", "fuzzer")


def main(count, seed=0, *names):
    """Fuzz, say what got through, and publish."""
    found = {}
    for name in names or DOORS:
        counts, kept, faults = through(name, int(count), int(seed), Traced())
        print(name, counts, flush=True)
        for what, (suffix, data) in faults.items():
            print(f"  {what}\n    {suffix} {data[:2000]!r}", flush=True)
        answers = {key: counts.get(key, 0) for key in ("answered", "refused")}
        found[name] = {"inputs": int(count), **answers, "kept": kept}
    before = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    KEPT.write_text(json.dumps(before | found, indent=1) + "\n")
    publish(before | found)


if __name__ == "__main__":
    main(*sys.argv[1:])
