"""Parquet and Feather (Arrow's IPC), by pyarrow; a column's metadata may state its unit under ``unit``."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from fieldmodels.arrays import FloatArray
from fieldmodels.recording.data import RecordingError
from fieldmodels.recording.readers import lists
from fieldmodels.recording.tables import LARGEST, Problem, Table, check_size, collect, readable
from fieldmodels.recording.words import unit_of

_BLOCK = 1 << 20  # bytes
_BATCH = 1 << 17  # rows decoded at once


def read(path: Path) -> Table:
    """Open a file by what it is, whatever its name."""
    with path.open("rb") as file:
        kind = _Feather if file.read(6) == b"ARROW1" else _Parquet
    with readable(path, f"{kind.__name__.strip('_')} file"):
        table = kind(path)
    if lists.has_lists(table.schema):
        return lists.read(path, "ipc" if kind is _Feather else "parquet")
    return table


class _ArrowTable(Table):
    """Typed columns with metadata, read a batch of rows at a time."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        self.path, self.schema, self.header = path, schema, tuple(schema.names)
        stated = {f.name: (f.metadata or {}).get(b"unit", b"").decode(errors="replace") for f in schema}
        self.units = {
            n: u for n in self.header if (u := "s" if self._temporal(n) else stated[n] or unit_of(n))
        }

    @abstractmethod
    def _batches(self, names: Sequence[str]) -> Iterator[pa.RecordBatch]:
        """The columns, batch by batch."""

    @abstractmethod
    def _rows(self, names: Sequence[str]) -> int:
        """How many rows there are, known before any is loaded."""

    def _temporal(self, name: str) -> bool:
        kind = self.schema.field(self.header.index(name)).type
        return bool(pa.types.is_timestamp(kind) or pa.types.is_time(kind) or pa.types.is_duration(kind))

    def numbers(self) -> tuple[str, ...]:
        """Columns of numbers, truth values and times."""
        kinds = zip(self.header, self.schema.types, strict=True)
        primitive = (n for n, k in kinds if pa.types.is_primitive(k) or pa.types.is_decimal(k))
        return tuple(n for n in primitive if not pa.types.is_date(self.schema.field(n).type))

    def read(self, names: Sequence[str], rows: int | None = None) -> dict[str, FloatArray]:
        """Read columns in batches of rows."""
        for name in names:
            if name not in self.numbers():
                kind = self.schema.field(self.header.index(name)).type
                raise self.fail([Problem(f"holds {kind}, not numbers; write numbers", name)])
        with readable(self.path, "file: damaged data"):
            expected = self._rows(names)
            check_size(self.path, expected, len(names))
            batches = ({n: lists.numeric(b.column(n)) for n in names} for b in self._batches(names))
            return collect(self.path, batches, names, expected, rows)


class _Parquet(_ArrowTable):
    def __init__(self, path: Path) -> None:
        self._file = pq.ParquetFile(path, buffer_size=_BLOCK)
        super().__init__(path, self._file.schema_arrow)

    def _rows(self, names: Sequence[str]) -> int:
        data = self._file.metadata
        for group in range(data.num_row_groups):  # a page is decoded as a whole, whatever a batch takes of it
            columns = (data.row_group(group).column(j) for j in range(data.num_columns))
            size = max((c.total_uncompressed_size for c in columns if c.path_in_schema in names), default=0)
            if size > LARGEST:
                raise RecordingError(f"{self.path}: unpacks to {1e-9 * size:.1f} GB; cut the log")
        return int(data.num_rows)

    def _batches(self, names: Sequence[str]) -> Iterator[pa.RecordBatch]:
        for group in range(
            self._file.metadata.num_row_groups
        ):  # a reader holds on to groups it has been through
            yield from self._file.iter_batches(_BATCH, [group], list(names), use_threads=False)


class _Feather(_ArrowTable):
    def __init__(self, path: Path) -> None:
        with pa.memory_map(str(path)) as source:
            super().__init__(path, pa.ipc.open_file(source).schema)

    def _rows(self, names: Sequence[str]) -> int:
        del names
        return 0  # stated by each batch alone: ``collect`` counts

    def _batches(self, names: Sequence[str]) -> Iterator[pa.RecordBatch]:
        options = pa.ipc.IpcReadOptions(included_fields=[self.header.index(n) for n in names])
        with pa.memory_map(str(self.path)) as source:
            reader = pa.ipc.open_file(source, options=options)
            for k in range(reader.num_record_batches):
                batch = reader.get_batch(k)
                yield batch.select(list(names))
