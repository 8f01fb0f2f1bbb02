"""What a user hands to a diagnosis on the command line, and how its result reads there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from fieldagents.config import ConfigError
from fieldmodels.diagnosis.phrases import depends_on
from fieldmodels.model import Model, ModelError
from fieldmodels.names import did_you_mean
from fieldmodels.rounding import with_error

if TYPE_CHECKING:
    from rich.console import Console


GAIN = "Gain over the others: how much smaller the error is with this cause than without it, all others kept."


def fixed_parameters(model: Model, texts: Sequence[str]) -> dict[str, float]:
    """Read ``parameter=value`` texts.

    Raises:
        ConfigError: With every text that names no base parameter of the model, or no allowed value.
    """
    fixed: dict[str, float] = {}
    problems: list[str] = []
    names = [p.name for p in model.parameters]
    for text in texts:
        name, _, value = text.partition("=")
        try:
            if name not in names:
                raise ModelError(f"{model.name} has no base parameter {name!r}{did_you_mean(name, names)}")
            fixed[name] = float(value)
            model.vector({name: fixed[name]})
        except ModelError as error:
            problems.append(f"--set {text}: {error}")
        except ValueError:
            problems.append(f"--set {text}: write --set {name}=NUMBER")
    if problems:
        raise ConfigError(problems)
    return fixed


def show(diagnosis: Mapping[str, Any], console: Console, said: Sequence[str] = ()) -> None:
    """Print the contract's ``diagnosis.json`` for a reader, below the answer in words."""
    from rich.table import Table

    lead, *more = said or [diagnosis.get("summary", "")]
    console.print(f"\n{lead}", style="bold", markup=False)
    for line in [*more, f"Verdict: {diagnosis['verdict']}"]:
        console.print(line, markup=False)
    if diagnosis["causes"]:
        table = Table("effect", "where", "parameters", "gain over the others", "cause")
        for cause in diagnosis["causes"]:
            values = "\n".join(f"{name} = {_value(entry)}" for name, entry in cause["parameters"].items())
            names = "\nor ".join([cause["effect"], *cause["alternatives"]])
            table.add_row(
                names,
                cause["where"],
                values,
                _own_gain(cause["gain"]),
                cause["cause"],
            )
        console.print(table)
        console.print(GAIN, markup=False)
    if diagnosis["gain"]:
        table = Table("signal", "unit", "error before", "after", "gain", "with curves", "horizon")
        for signal, gain in diagnosis["gain"].items():
            table.add_row(
                signal,
                gain["unit"],
                f"{gain['rmse_before']:.4g}",
                f"{gain['rmse_after']:.4g}",
                _gain(gain),
                f"{gain['rmse_with_curves']:.4g}" if diagnosis.get("curves") else "–",
                f"{gain['horizon_s']:g} s",
            )
        console.print(table)
    for curve in diagnosis.get("curves", ()):
        runs = depends_on(curve["place"], curve["target"], curve["over"], curve["formula"] or "")
        sure = not curve["direction"].startswith("undetermined")
        which = "something that" if sure else "no curve is certain; the closest"
        console.print(f"Unlisted: {which} depends on {runs}", markup=False)
    for effect, why in diagnosis.get("not_testable", {}).items():
        console.print(f"Not testable: {effect}: {why}", markup=False)


def _own_gain(gain: Mapping[str, Any]) -> str:
    """What a cause gains over all the others; a dash where that is nothing."""
    if gain["percent"] is None:
        return "– (it explains noise)"
    if gain["percent"] <= 0:
        return "– (the others make up for it)"
    return f"{gain['signal']}: {_gain(gain)}"


def _value(entry: Mapping[str, Any]) -> str:
    std = entry.get("std")
    return with_error(entry["value"], math.nan if std is None else std, entry["unit"])


def _gain(gain: Mapping[str, Any] | None) -> str:
    if not gain or gain["percent"] is None:
        return "-"
    interval = gain.get("ci95")
    spread = f" ({interval[0]:.1f} to {interval[1]:.1f})" if interval and None not in interval else ""
    return f"{gain['percent']:.1f} %{spread}"
