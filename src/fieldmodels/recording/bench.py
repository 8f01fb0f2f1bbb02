"""What the columns of a bench's logs are, written once to a small ``bench.yaml`` for all its logs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.names import machine_in
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.tables import Table
from fieldmodels.yaml import YamlError, load_yaml, save_yaml

TIME, EPISODE = "t", "episode"
OTHER_CLOCK = re.compile(r"t[2-9]\d*")
"""Names of the clocks of further files of a run, as of signals: ``t2`` is moved to ``t`` by its offset."""
EPOCH = 1e8
"""Times above this [s] count from 1970, and are told from the first row on."""
NAME = "bench.yaml"
"""A bench's file beside its logs."""
NO_COMMAND = "none"
"""Stands for the column of a command that was none."""
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_CODING = re.compile(r"(int|sign)(\d+)")
_SPEC = re.compile(
    rf"(?:(?P<gain>{_NUMBER})\*|(?P<minus>-))?(?P<name>.+?)(?:%(?P<period>{_NUMBER[5:]}|(?:int|sign)\d+))?"
    rf"(?P<offset>[-+]{_NUMBER[5:]})?",
    re.S,
)


@dataclass(frozen=True)
class Channel:
    """A column, and what its numbers mean: ``gain * cell + offset``, in ``unit``; cells may wrap around.

    Attributes:
        column: Its name in the file; empty for a command that was none, zero throughout.
        unit: Unit of the result; empty for what the file states, else the model's.
        gain: A scale or a sign.
        offset: What is added then, in ``unit``.
        period: Of cells that wrap around, as a counter of 12 bits does at 4096: they are unwrapped first; 0
            for cells that do not.
        coding: Of cells without a sign that hold signed numbers: "int16" for two's complement of 16 bits (-1
            is 65535), "sign1024" for a sign in the bit that is worth 1024 (-1 is 1025); empty for others.
    """

    column: str
    unit: str = ""
    gain: float = 1.0
    offset: float = 0.0
    period: float = 0.0
    coding: str = ""

    @classmethod
    def parse(cls, spec: str, header: Sequence[str] = ()) -> Channel:
        """Read ``[GAIN*]COLUMN[%PERIOD][+OFFSET][:UNIT]``.

        Examples are ``-2.5*tau:N cm``, ``-tau``, ``0.1*adc-12:deg``, ``-count%4096``, which wraps, and
        ``speed%int16`` or ``load%sign1024``, which are signed (see ``coding``); ``none`` is for a command
        that was none.

        Args:
            spec: The text; a column of the header that is really named so is taken whole.
            header: The file's columns.
        """
        if spec in header or spec == NO_COMMAND:
            return cls(spec if spec in header else "")
        body, colon, unit = spec.rpartition(":")
        body, unit = (body, unit) if colon else (spec, "")
        match = None if body in header else _SPEC.fullmatch(body)
        if match is None:
            return cls(body, unit)
        gain = float(match["gain"]) if match["gain"] else -1.0 if match["minus"] else 1.0
        name, offset, period = match["name"].strip(), match["offset"] or "", match["period"] or ""
        tail = f"%{period}" * bool(period)
        if name not in header:  # a column may be named as if it had a period or an offset
            if name + tail in header:
                name, period = name + tail, ""
            elif name + tail + offset in header:
                name, period, offset = name + tail + offset, "", ""
        if not header and not match["gain"] and not match["minus"] and not period:
            name, offset = body, ""
        coding = period if _CODING.fullmatch(period) else ""
        return cls(
            name, unit, gain, float(offset or 0.0), float(period or 0.0) if not coding else 0.0, coding
        )

    def __str__(self) -> str:
        """The text that ``parse`` reads."""
        if not self.column:
            return NO_COMMAND
        gain = "" if self.gain == 1 else "-" if self.gain == -1 else f"{self.gain:.12g}*"
        offset = f"{self.offset:+.12g}" if self.offset else ""
        period = f"%{self.coding or format(self.period, '.12g')}" if self.coding or self.period else ""
        return f"{gain}{self.column}{period}{offset}" + (f":{self.unit}" if self.unit else "")


@dataclass(frozen=True)
class Bench:
    """Which column of a log holds which signal of a model.

    Attributes:
        columns: Signal (also ``t`` and ``episode``) to its column; the others are looked up by their names.
        rate: Rows a second, for logs without a column of times; None where there is one.
        model: Name of the machine that the signals belong to (``machine`` in the file), empty for any.
        aligned: Whether the clocks of several files were moved until command and response agree, so that no
            delay can be told.
    """

    columns: Mapping[str, Channel] = field(default_factory=dict)
    rate: float | None = None
    model: str = ""
    aligned: bool = False

    @classmethod
    def of(
        cls,
        specs: Mapping[str, str],
        header: Sequence[str] = (),
        rate: float | None = None,
        aligned: bool = False,
    ) -> Bench:
        """A bench out of texts as ``Channel.parse`` reads them."""
        columns = {signal: Channel.parse(spec, header) for signal, spec in specs.items()}
        return cls(columns, rate, aligned=aligned)

    @classmethod
    def load(cls, path: str | Path) -> Bench:
        """Read a ``bench.yaml``.

        Raises:
            RecordingError: If it is missing or not of this form; names the place.
        """
        try:
            data = load_yaml(Path(path))
        except YamlError as error:
            raise RecordingError(str(error)) from None
        if not isinstance(data, dict) or not set(data) <= {"machine", "model", "rate", "columns", "aligned"}:
            raise RecordingError(
                f"{path}: holds 'columns', and perhaps 'machine', 'rate' and 'aligned', nothing else"
            )
        columns, rate = data.get("columns") or {}, data.get("rate")
        if not isinstance(columns, dict):
            raise RecordingError(f"{path}: 'columns' maps signals to columns, as in 'torque: -tau:N cm'")
        if rate is not None and not (_is_number(rate) and rate > 0):
            raise RecordingError(f"{path}: 'rate' is a positive number of rows a second, not {rate!r}")
        channels = {str(signal): _channel(path, signal, value) for signal, value in columns.items()}
        named, aligned = str(machine_in(data) or ""), data.get("aligned") is True
        return cls(channels, None if rate is None else float(rate), named, aligned)

    def save(self, path: str | Path) -> None:
        """Write a ``bench.yaml`` that ``load`` reads back to an equal one; whole or not at all."""
        data: dict[str, object] = {"machine": self.model} if self.model else {}
        if self.rate is not None:
            data["rate"] = self.rate
        if self.aligned:
            data["aligned"] = True
        data["columns"] = {
            signal: NO_COMMAND
            if not c.column
            else {"column": c.column}
            | ({"unit": c.unit} if c.unit else {})
            | ({"gain": c.gain} if c.gain != 1 else {})
            | ({"offset": c.offset} if c.offset else {})
            | ({"period": c.period} if c.period else {})
            | ({"coding": c.coding} if c.coding else {})
            for signal, c in self.columns.items()
        }
        save_yaml(data, Path(path))

    def fits(self, table: Table) -> bool:
        """Whether a log has all of its columns."""
        return all(c.column in table.header for c in self.columns.values() if c.column)


def option(spec: str) -> str:
    """What declares a column, as it can be typed."""
    return "--column '" + spec.replace("'", "'\\''") + "'"


def decoded(values: FloatArray, channel: Channel, episode: FloatArray | None = None) -> FloatArray:
    """Cells as the numbers that they stand for; see ``Channel.coding`` and ``unwrapped``."""
    if coding := _CODING.fullmatch(channel.coding):
        if coding[1] == "sign":
            bit = float(coding[2])
            return np.where(values >= bit, bit - values, values)
        period = 2.0 ** int(coding[2])
        return np.where(values >= period / 2, values - period, values)
    return unwrapped(values, channel.period, episode) if channel.period else values


def unwrapped(values: FloatArray, period: float, episode: FloatArray | None = None) -> FloatArray:
    """Cells that wrap around as if they went on: no step is longer than half a period.

    Args:
        values: The cells, shape (n,); missing ones (NaN) stay so.
        period: Of the counter or the angle, in the cells' unit.
        episode: Number of each row's episode, shape (n,): each goes on by itself; None for one.
    """
    result = values.copy()
    edges = [] if episode is None else (np.flatnonzero(np.diff(episode)) + 1).tolist()
    for rows in np.split(np.arange(len(values)), edges):
        known = rows[np.isfinite(values[rows])]
        result[known] = np.unwrap(values[known], period=period)
    return result


def beside(path: Path, model: str) -> Path | None:
    """The bench file of a log: ``<log>.bench.yaml``, else ``bench.yaml`` in its folder, if for this model."""
    for candidate in (path.with_name(f"{path.stem}.{NAME}"), path.with_name(NAME)):
        if candidate.is_file() and Bench.load(candidate).model in ("", model):
            return candidate
    return None


def _channel(path: str | Path, signal: object, value: object) -> Channel:
    if isinstance(value, str):
        return Channel.parse(value)
    known = {"column", "unit", "gain", "offset", "period", "coding"}
    if isinstance(value, dict) and "column" in value and set(value) <= known:
        numbers = [value.get("gain", 1.0), value.get("offset", 0.0), value.get("period", 0.0)]
        coding = str(value.get("coding") or "")
        said = not coding or _CODING.fullmatch(coding)
        if all(map(_is_number, numbers)) and numbers[0] != 0 and numbers[2] >= 0 and said:
            gain, offset, period = map(float, numbers)
            return Channel(str(value["column"]), str(value.get("unit") or ""), gain, offset, period, coding)
    raise RecordingError(
        f"{path}: {signal!r} needs 'column', and perhaps 'unit', 'gain', 'offset' and 'period' (numbers), "
        f"and 'coding' (int16, sign1024), not {value!r}"
    )


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and isfinite(value)
