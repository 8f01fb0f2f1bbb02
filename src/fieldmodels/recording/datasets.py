"""Public recordings of real machines, found locally or fetched on demand, and checked by SHA-256.

Looked up first under the directory that ``FIELDGYM_DATA`` names, then in the user's cache, then fetched from
the project that published them, at a fixed commit.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from fieldmodels.model import Model
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.windowed_tables import Layout, load_windows
from fieldmodels.yaml import load_yaml

DATA_VARIABLE = "FIELDGYM_DATA"
_TIMEOUT = 10.0  # seconds without an answer


class DatasetError(ValueError):
    """A public recording that is unknown, damaged or out of reach."""


@dataclass(frozen=True)
class Dataset:
    """One public recording.

    Attributes:
        name: ``collection/recording``.
        file: Path under ``FIELDGYM_DATA``.
        size: Size [bytes].
        sha256: Checksum of the content.
        source: Where it was published: repository, commit and path.
        licence: Its licence.
        about: What was recorded.
        columns: Signal to column and unit, as ``load_recording`` takes it; empty for a table of windows.
        url: Where to fetch it; empty if the published file has another format.
        windows: How a table of windows is laid out, None for a record over time.
    """

    name: str
    file: str
    size: int
    sha256: str
    source: str
    licence: str
    about: str
    columns: Mapping[str, str] = field(default_factory=dict)
    url: str = ""
    windows: Layout | None = None


@cache
def datasets() -> dict[str, Dataset]:
    """The public recordings of ``datasets.yaml`` by name."""
    collections = load_yaml(Path(__file__).with_name("datasets.yaml"))
    return {
        f"{collection}/{name}": _dataset(f"{collection}/{name}", shared | one)
        for collection, shared in collections.items()
        for name, one in shared.pop("recordings").items()
    }


def _dataset(name: str, entry: Mapping[str, Any]) -> Dataset:
    source, url, windows = entry.get("source", ""), "", None
    if not source:
        repository, commit, path = entry["repository"], entry["commit"], entry["path"]
        source = f"{repository}@{commit[:8]}, {path}"
        url = f"https://raw.githubusercontent.com/{repository}/{commit}/{path}"
    if "windows" in entry:
        windows = Layout(**entry["windows"], part=entry.get("part"))
    return Dataset(
        name=name,
        file=f"{name.partition('/')[0]}/{entry['file']}",
        source=source,
        url=url,
        windows=windows,
        columns=entry.get("columns", {}),
        **{key: entry[key] for key in ("size", "sha256", "licence", "about")},
    )


def dataset_names() -> tuple[str, ...]:
    """Names of the public recordings, ``collection/recording``."""
    return tuple(datasets())


def get_dataset(name: str) -> Dataset:
    """Return what is known about a public recording.

    Raises:
        DatasetError: If there is none of that name.
    """
    if name not in datasets():
        raise DatasetError(f"no public recording {name!r}{did_you_mean(name, datasets())}")
    return datasets()[name]


def fetch(name: str) -> Path:
    """Return the file of a public recording, from ``FIELDGYM_DATA``, the cache or the network.

    Raises:
        DatasetError: If it is unknown, out of reach, or its content is not the published one.
    """
    dataset = get_dataset(name)
    root = os.environ.get(DATA_VARIABLE)
    if root and (path := Path(root) / dataset.file).is_file():
        if _sha256(path) != dataset.sha256:
            raise DatasetError(
                f"{path}: damaged or changed: its SHA-256 is not {dataset.sha256[:12]}...; "
                f"delete it, so that it is fetched again, or get it from {dataset.url or dataset.source}"
            )
        return path
    return _download(dataset)


def recognise(path: Path) -> Dataset | None:
    """Return the public recording whose content a file has, whatever its name."""
    if not path.is_file():
        return None
    same_size = [d for d in datasets().values() if d.size == path.stat().st_size]
    if not same_size:
        return None
    digest = _sha256(path)
    return next((d for d in same_size if d.sha256 == digest), None)


def is_public(source: str | Path) -> bool:
    """Whether a source is a public recording's name, or a file of its content, whatever its own name."""
    path = Path(source)
    named = not path.exists() and (str(source) in datasets() or _looks_like_name(str(source)))
    return named or recognise(path) is not None


def open_recording(
    source: str | Path,
    model: Model | None = None,
    columns: Mapping[str, str] | None = None,
    horizon: float | None = None,
) -> Recording:
    """Load a recording from a file or by the name of a public one, such as ``dfki_simple_pendulum/ddp``.

    A file with a public recording's content gets its column names and units by itself.

    Args:
        source: A path, or a name from ``dataset_names()``; a file of that path goes first.
        model: As in ``load_recording``.
        columns: As in ``load_recording``; goes before what is known of a public recording.
        horizon: As in ``load_recording``.

    Raises:
        DatasetError: If the public recording is out of reach or damaged, or a table of windows that has not
            what the model needs.
        RecordingError: If the file cannot be used.
    """
    path, dataset = Path(source), None
    if not path.exists() and (str(source) in datasets() or _looks_like_name(str(source))):
        path = fetch(str(source))
        dataset = get_dataset(str(source))
    dataset = dataset or recognise(path)
    if dataset is None:
        return load_recording(path, model, columns, horizon)
    wanted = None if model is None else {"t", *(s.name for s in model.signals)}
    if dataset.windows:
        recording = _with_body_speeds(load_windows(path, dataset.windows))
        lacking = [s.name for s in model.inputs if s.name not in recording] if model else []
        if columns or lacking:
            reason = f"has no {', '.join(lacking)}" if lacking else "takes no column declarations"
            raise DatasetError(f"{path}: {dataset.name}, a table of windows, {reason}")
        kept = {k: v for k, v in recording.signals.items() if wanted is None or k in wanted}
        return replace(recording, signals=kept, source=dataset.name)
    known = {k: v for k, v in dataset.columns.items() if wanted is None or k in wanted}
    recording = load_recording(path, model, {**known, **(columns or {})}, horizon)
    return replace(recording, source=dataset.name)


def _with_body_speeds(recording: Recording) -> Recording:
    """Add the speed and turn rate that commanded wheel speeds mean for an ideal differential drive."""
    from fieldmodels.machines.pose_reaching.unicycle import body_speeds

    left: Any = recording["left_command"]  # the kernel takes arrays as it takes numbers
    right: Any = recording["right_command"]
    speed, rate = body_speeds(left, right, recording.known["wheel_radius"], recording.known["track"])
    return replace(
        recording,
        signals={**recording.signals, "speed": np.asarray(speed), "turn_rate": np.asarray(rate)},
        units={**recording.units, "speed": "m/s", "turn_rate": "rad/s"},
    )


def _looks_like_name(source: str) -> bool:
    """Whether a missing file was rather meant as a public recording's name."""
    return not Path(source).suffix and source.split("/")[0] in {n.split("/")[0] for n in datasets()}


def _download(dataset: Dataset) -> Path:
    """The file in the user's cache, fetched there first unless it is there already."""
    import pooch  # with the web's library: a quarter of a second

    path = Path(platformdirs.user_cache_dir("fieldgym")) / dataset.file
    where = f"put the file at ${DATA_VARIABLE}/{dataset.file}"
    if not dataset.url and not path.is_file():
        raise DatasetError(
            f"{dataset.name} cannot be fetched, for it was published in another format ({dataset.source}); "
            f"{where}"
        )
    web = pooch.HTTPDownloader(timeout=_TIMEOUT)
    try:
        pooch.retrieve(dataset.url, f"sha256:{dataset.sha256}", path.name, path.parent, downloader=web)
    except ValueError:
        raise DatasetError(
            f"{dataset.name}: what {dataset.url} gave is not the published file; {where}"
        ) from None
    except OSError as error:
        raise DatasetError(
            f"{dataset.name} could not be fetched ({type(error).__name__}); "
            f"download {dataset.url} and {where}"
        ) from None
    return path


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
