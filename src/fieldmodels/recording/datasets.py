"""Public recordings of real machines, found locally or fetched on demand, and checked by SHA-256.

Looked up first under the directory that ``FIELDGYM_DATA`` names, then in the user's cache, then fetched from
the project that published them, at a fixed commit.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.model import Model
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.windowed_tables import Layout, load_windows

DATA_VARIABLE = "FIELDGYM_DATA"
_TIMEOUT = 20.0  # seconds without an answer


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


def _github(repository: str, commit: str, path: str) -> str:
    return f"https://raw.githubusercontent.com/{repository}/{commit}/{path}"


def _dfki(name: str, size: int, sha256: str, commit: str, path: str, about: str) -> Dataset:
    repository = "dfki-ric-underactuated-lab/torque_limited_simple_pendulum"
    return Dataset(
        name=f"dfki_simple_pendulum/{name}",
        file=f"dfki_simple_pendulum/{name}__data_measured.csv",
        size=size,
        sha256=sha256,
        source=f"{repository}@{commit[:8]}, {path}",
        licence="BSD-3-Clause",
        about=about,
        columns={
            "t": "time:s",
            "angle": "position:rad",
            "velocity": "velocity:rad/s",
            "torque": "torque:N m",
        },
        url=_github(repository, commit, path),
    )


def _drone(name: str, file: str, size: int, sha256: str, commit: str, about: str) -> Dataset:
    first = file.startswith("sinal")
    time, reference, angle, command = (
        ("Tempo_s:s", "Referencia:deg", "Saida_y:deg", "Controle_u:%")
        if first
        else ("tempo_ms:ms", "referencia:deg", "angulo_deg:deg", "u_pct:%")
    )
    path = f"data/quarter_drone/{file}"
    return Dataset(
        name=f"quarter_drone/{name}",
        file=f"quarter_drone/{file}",
        size=size,
        sha256=sha256,
        source=f"helonayala/sysid@{commit[:8]}, {path}",
        licence="Unlicense",
        about=about,
        columns={"t": time, "reference": reference, "angle": angle, "command": command},
        url=_github("helonayala/sysid", commit, path),
    )


def _warthog(name: str, part: int | None, about: str) -> Dataset:
    return Dataset(
        name=f"drive_ugv/{name}",
        file="drive_ugv/warthog_torch_ready_dataframe.csv",
        size=4013703,
        sha256="bfce3074ef4475d0adf377076094ba78de4647edd7072f79451650bf9f5d4849",
        source="norlab-ulaval/DRIVE@e158a19b, calib_data/test_warthog/torch_ready_dataframe.pkl, as CSV",
        licence="BSD-3-Clause",
        about=f"skid-steered vehicle driven in steps of commands, windows of 2 s at 20 Hz{about}",
        windows=Layout(
            columns={
                "left_command": "cmd_left_#:rad/s",
                "right_command": "cmd_right_#:rad/s",
                "left_wheel": "left_wheel_vel_#:rad/s",
                "right_wheel": "right_wheel_vel_#:rad/s",
                "x": "icp_x_#:m",
                "y": "icp_y_#:m",
                "heading": "icp_yaw_#:rad",
            },
            step=0.05,
            group="calib_step",
            part=part,
            # model_training/complete_training.py of the same repository.
            known={"wheel_radius": 0.3, "track": 1.1652},
        ),
    )


_FIRST_VIDEO = "c761de7813573a6674ebd94afb66b83e44ea9148"
_DRONE_FIRST = "e945bce8210eca8728a3a7c8e8b7a02498b39855"
_DRONE_SIGNALS = "8d6739321d0d550d94c9779777d4e5944a59ebd9"

_DATASETS = (
    _dfki(
        "ddp", 304325, "14748fd189abae7b6392a016f2f0494b54bb2a8c014bc435a84b58dbecb2da35",
        _FIRST_VIDEO, "results/video_recorded_ddp/data_measured.csv",
        "swing-up by differential dynamic programming, 500 Hz",
    ),
    _dfki(
        "direct_collocation", 118474, "c3f990980169815b93ab37078780e13803327dcb6fc9e019f2d261b988cdaf8f",
        _FIRST_VIDEO, "results/video_recorded_direct_collocation/data_measured.csv",
        "swing-up by direct collocation, 333 Hz",
    ),
    _dfki(
        "energy_shaping", 408318, "e1844e56f87cf763bdecb3f6f7e5b622a9a3b2d71e907b48ed6148b0a059c209",
        _FIRST_VIDEO, "results/video_recorded_energy_shaping/data_measured.csv",
        "swing-up by energy shaping (bang-bang torque), 200 Hz",
    ),
    _dfki(
        "gravity_compensation", 3058857, "1d15acddde86dbe513418bc964cfac8230c3d2afa4d088a2ba9fd94b68da0c78",
        _FIRST_VIDEO, "results/video_recorded_gravity_compensation/data_measured.csv",
        "gravity compensation, moved by hand (forces not logged), 1 kHz",
    ),
    _dfki(
        "ilqr", 101625, "f678b8650c167b04476be244f1b2d807d3e0949c5d7b7fa58522164bdcad0afe",
        "fca72ac81dde31d9eb62f836d085084c668638c6", "results/control_method_ilqr/data_measured.csv",
        "swing-up by iterative LQR, 50 Hz",
    ),
    _dfki(
        "pd_1nm_failure", 805492, "e127d443853f937fa41d6000c71a6ec85c51406f193711806c1fc36a06c9c24a",
        _FIRST_VIDEO, "results/video_recorded_torque_limit/data_measured.csv",
        "swing-up that fails under a torque limit of 1 N m, 200 Hz",
    ),
    _dfki(
        "pd_system_identification", 118575,
        "3a5728e9c5530dd9066c0d7fda4c6a9bf50d86f94538629ace6d2508a7053469",
        "86d96d01ac3471d34b49910c912d2360c1f8ced6", "results/20210611-040141-PM_pd/data_measured.csv",
        "stiff position control for the bench's own identification, 300 Hz",
    ),
    _drone(
        "first", "dados_14_drone.csv", 442714,
        "3594e61316d9ee4f386015d0eeb161abcb863f4198996a803e138dc18da2fbb3", _DRONE_FIRST,
        "propeller arm, first record, time stamps in whole milliseconds",
    ),
    _drone(
        "second", "14_drone_seq_20260529_195254.csv", 147780,
        "bd13ffbf161c9ae5fb0468caa3b11ba8780f588d0e56627fcc1f09a8bd9a7c11", _DRONE_FIRST,
        "propeller arm, second record, time stamps in whole milliseconds",
    ),
    _drone(
        "staircase", "sinal1_semi_estatica_malha_fechada.csv", 513901,
        "c42687107162ab1eda527e76bd463bf50023e200d0cb8a9a27e0172d630dcf15", _DRONE_SIGNALS,
        "propeller arm in closed loop, nearly static staircase, 100 Hz",
    ),
    _drone(
        "steps", "sinal2_degraus_malha_fechada.csv", 435512,
        "fab77b74b362ef5dfd93ef558a74475f449dcf7152444e0a951162b594408220", _DRONE_SIGNALS,
        "propeller arm in closed loop, steps, 100 Hz",
    ),
    _drone(
        "swept_sine", "sinal3_swept_sine_malha_fechada.csv", 435853,
        "be31a47c7e42d9d24a23ee4c8a18860de416463daa5bd21947ac7255277af3db", _DRONE_SIGNALS,
        "propeller arm in closed loop, swept sine, 100 Hz",
    ),
    _drone(
        "multisine", "sinal4_multiseno_malha_fechada.csv", 436030,
        "8a650d0df3a91addd0770ee1128a7b82ea0a272e7b6cde2fcbf7026808a6163e", _DRONE_SIGNALS,
        "propeller arm in closed loop, multisine, 100 Hz",
    ),
    _warthog("warthog", None, ""),
    _warthog("warthog_even_steps", 0, "; the half with even command steps"),
    _warthog("warthog_odd_steps", 1, "; the half with odd command steps"),
)  # fmt: skip
_BY_NAME = {dataset.name: dataset for dataset in _DATASETS}


def dataset_names() -> tuple[str, ...]:
    """Names of the public recordings, ``collection/recording``."""
    return tuple(_BY_NAME)


def get_dataset(name: str) -> Dataset:
    """Return what is known about a public recording.

    Raises:
        DatasetError: If there is none of that name.
    """
    if name not in _BY_NAME:
        raise DatasetError(f"no public recording {name!r}{did_you_mean(name, _BY_NAME)}")
    return _BY_NAME[name]


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
    same_size = [d for d in _DATASETS if d.size == path.stat().st_size]
    if not same_size:
        return None
    digest = _sha256(path)
    return next((d for d in same_size if d.sha256 == digest), None)


def is_public(source: str | Path) -> bool:
    """Whether a source is a public recording's name, or a file of its content, whatever its own name."""
    path = Path(source)
    named = not path.exists() and (str(source) in _BY_NAME or _looks_like_name(str(source)))
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
    if not path.exists() and (str(source) in _BY_NAME or _looks_like_name(str(source))):
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
    return not Path(source).suffix and source.split("/")[0] in {n.split("/")[0] for n in _BY_NAME}


def _download(dataset: Dataset) -> Path:
    import pooch

    where = f"put the file at ${DATA_VARIABLE}/{dataset.file}"
    if not dataset.url:
        raise DatasetError(
            f"{dataset.name} cannot be fetched, for it was published in another format ({dataset.source}); "
            f"{where}"
        )
    folder = Path(pooch.os_cache("fieldgym"))
    try:
        found = pooch.retrieve(
            dataset.url,
            known_hash=f"sha256:{dataset.sha256}",
            path=folder / Path(dataset.file).parent,
            fname=Path(dataset.file).name,
            downloader=pooch.HTTPDownloader(timeout=_TIMEOUT),
        )
    except ValueError as error:
        raise DatasetError(
            f"{dataset.name}: what {dataset.url} gave is not the published file ({error})"
        ) from None
    except OSError as error:  # requests' errors among them
        raise DatasetError(
            f"{dataset.name} could not be fetched ({type(error).__name__}); "
            f"download {dataset.url} and {where}"
        ) from None
    return Path(found)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
