"""A user's own code under guard: whatever its code does at any call becomes a number or one clear message."""

from __future__ import annotations

import functools
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.limits import TooLongError, processor_limit
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording, RecordingError, Windows

CALLED = (
    "simulate", "initial_states", "windows", "scaled_to", "stages", "runs", "between", "with_commands",
    "derived",
)  # fmt: skip
"""Methods of a model through which a user's code is reached."""


GUARDED = "_fieldgym_guarded"
Check = Callable[..., Any]


class ContractError(ModelError):
    """A model that breaks the contract; the message says which part, and the remedy."""


@contextmanager
def located(path: Path, doing: str = "") -> Iterator[None]:
    """Turn what a user's code raises into one message with the line in the user's file.

    What it prints goes to standard error: standard output belongs to results.

    Raises:
        ModelError: Instead of any other exception but a RecordingError.
    """
    try:
        with redirect_stdout(sys.stderr):
            yield
    except RecordingError:
        raise
    except ModelError as error:
        if str(error).startswith(str(path)):  # of a call within this one
            raise
        raise type(error)(f"{path}: {error}") from error
    except SyntaxError as error:
        place = f"{error.filename or path}:{error.lineno}"
        raise ModelError(f"{place}: {type(error).__name__}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == path.resolve()]
        place = f"{path}:{frames[-1].lineno}" if frames else str(path)
        kind = "took" if isinstance(error, TooLongError) else f"{type(error).__name__}:"
        raise ModelError(f"{place}: {kind} {error}" + (f" (in {doing})" if doing else "")) from error


def guard(
    kind: type, path: Path, methods: Mapping[str, Check | None], call_limit: float | None = None
) -> None:
    """Put calls into a class under guard, those through its subclasses and copies included.

    Args:
        kind: The class, of a user's own.
        path: The user's file, which messages name.
        methods: Names of its methods, each with what checks the result: called with the object, the result
            and the arguments, it gives the result back.
        call_limit: Processor time that one call may take [s]; None for no limit.
    """
    if GUARDED not in vars(kind):
        setattr(kind, GUARDED, True)
        for name, check in methods.items():
            setattr(kind, name, _guarded(getattr(kind, name), check, path, call_limit))


def _guarded(
    plain: Callable[..., Any], check: Check | None, path: Path, call_limit: float | None
) -> Callable[..., Any]:
    @functools.wraps(plain)
    def method(one: Any, *args: Any, **named: Any) -> Any:
        with located(path, plain.__name__):
            with processor_limit(call_limit):
                result = plain(one, *args, **named)
            return check(one, result, *args) if check and not named else result

    return method


def guard_model(kind: type[Model], path: Path, call_limit: float | None = None) -> None:
    """Put a user's class of models under guard; arguments as of `guard`."""
    checks: dict[str, Check] = {"simulate": checked_outputs, "initial_states": checked_states}
    guard(kind, path, {name: checks.get(name) for name in CALLED}, call_limit)


def checked_outputs(model: Model, result: Any, parameters: FloatArray, windows: Windows) -> FloatArray:
    """What ``simulate`` returned, as it must be; numbers that are not finite may be among it.

    Raises:
        ContractError: If it is not of the shape, or no numbers.
    """
    values = numbers(result, "simulate")
    wanted = len(np.atleast_2d(parameters)), len(windows), windows.samples, len(model.outputs)
    if values.shape != wanted:
        raise ContractError(
            f"simulate returned shape {values.shape}, not (vectors, windows, samples, outputs) = {wanted}"
        )
    return values


def checked_states(model: Model, result: Any, recording: Recording, starts: IntArray) -> FloatArray:
    """What ``initial_states`` returned, as it must be.

    Raises:
        ContractError: If it is not of the shape, or not finite.
    """
    del recording
    values = numbers(result, "initial_states")
    wanted = len(starts), len(model.states)
    if values.shape != wanted:
        raise ContractError(f"initial_states returned shape {values.shape}, not (starts, states) = {wanted}")
    if not np.isfinite(values).all():
        window, state = np.argwhere(~np.isfinite(values))[0]
        raise ContractError(
            f"initial_states: state {model.states[state].name!r} is {values[window, state]} "
            f"at sample {starts[window]}"
        )
    return values


def numbers(result: Any, doing: str) -> FloatArray:
    """What a call returned, as an array of real numbers.

    Raises:
        ContractError: If it is none.
    """
    try:
        values = np.asarray(result)
    except ValueError:
        values = np.asarray(None)
    if values.dtype.kind not in "fiub":
        what = type(result).__name__ if values.ndim == 0 else f"an array of {values.dtype}"
        raise ContractError(f"{doing} returned {what}, not an array of real numbers")
    return np.asarray(values, dtype=np.float64)
