"""What can be reproduced, and how one asks for it."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, get_type_hints

from pydantic import TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from fieldagents.progress import Report
from fieldmodels.names import did_you_mean

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class ReproductionError(ValueError):
    """A request that names nothing that can be reproduced, or an option that it does not have."""


@dataclass(frozen=True)
class Reproduction:
    """A table or figure of a source, redone.

    Attributes:
        title: What it is, in a line.
        source: Where it is printed: work, section, table or figure number.
        table: The numbers, with the printed ones beside ours where the source prints any.
        figures: File name (without ending) to a figure.
        remarks: What agrees, what does not and why; one sentence or two each.
    """

    title: str
    source: str
    table: pd.DataFrame
    figures: Mapping[str, Figure] = field(default_factory=dict)
    remarks: Sequence[str] = ()


@dataclass(frozen=True)
class Entry:
    """What can be reproduced.

    Attributes:
        title: What it is, in a line.
        function: Where the function is that does it, ``module:function``. It takes the result folder and
            ``Report``, and returns a `Reproduction`; its keyword-only parameters, all with a default and a
            type, are what ``--set`` may change.
    """

    title: str
    function: str

    @property
    def run(self) -> Callable[..., Reproduction]:
        """The function, imported when asked for."""
        found: Callable[..., Reproduction] = resolve_name(self.function)
        return found

    @property
    def options(self) -> dict[str, Any]:
        """Name and default of each option."""
        parameters = inspect.signature(self.run).parameters.values()
        return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}

    def to_json(self, name: str) -> dict[str, Any]:
        """It as plain data."""
        return {"name": name, "title": self.title, "options": self.options}


ENTRIES: dict[str, Entry] = {
    "excitation/table-1": Entry(
        "The 22 unknowns under constant and adaptive excitation (with Figs 7 to 10)",
        "fieldagents.reproduce.excitation:table_1",
    ),
    "excitation/table-2": Entry(
        "Five unknowns without an accelerometer (with Figs 11 to 13)",
        "fieldagents.reproduce.excitation:table_2",
    ),
    "heel_strike/figure-2.10": Entry(
        "Ranger's estimator under gyro noise and under collision noise (with Fig 2.9)",
        "fieldagents.reproduce.heel_strike:figure_2_10",
    ),
    "heel_strike/figure-2.12": Entry(
        "The best decay of the gyro filter", "fieldagents.reproduce.heel_strike:figure_2_12"
    ),
    "heel_strike/figure-2.14": Entry(
        "Model or sensor: the best share of each under process noise (with Figs 2.13 and 2.15)",
        "fieldagents.reproduce.heel_strike:figure_2_14",
    ),
    "line_following/figure-3.13": Entry(
        "Levels of tape and floor by light, and the threshold between them",
        "fieldagents.reproduce.line_following:figure_3_13",
    ),
    "line_following/information": Entry(
        "What one band of the image does not tell", "fieldagents.reproduce.line_following:information"
    ),
    "pose_reaching/figure-5.9": Entry(
        "Training paths and generated paths of the path memory (Figs 5.3 to 5.9)",
        "fieldagents.reproduce.pose_reaching:figures_5_3_to_5_9",
    ),
    "pose_reaching/rules": Entry(
        "The path memory with one rule changed at a time", "fieldagents.reproduce.pose_reaching:rules"
    ),
    "pose_reaching/paths": Entry(
        "Success against the number of training paths",
        "fieldagents.reproduce.pose_reaching:number_of_paths",
    ),
    "pose_reaching/own-data": Entry(
        "The robot that makes its own training data (section 5.4)",
        "fieldagents.reproduce.pose_reaching:own_training_data",
    ),
    "uav_route/figure-4.5": Entry(
        "Paths under detection and lock loss (Figs 4.4 to 4.6)",
        "fieldagents.reproduce.uav_route:figures_4_4_to_4_6",
    ),
    "pose_reaching/ceiling": Entry(
        "How near the ceiling is to the least time possible", "fieldagents.reproduce.pose_reaching:ceiling"
    ),
}
"""By ``<task>/<table or figure>``."""


def reproduce(
    what: str,
    out: Path,
    overrides: Sequence[str] = (),
    progress: Report = lambda _stage, _part: None,
) -> Reproduction:
    """Redo a table or figure and write ``table.csv``, a PNG for each figure, and ``report.html``.

    Args:
        what: Its name, a key of `ENTRIES`.
        out: Result folder; each file appears whole or not at all.
        overrides: ``"option=value"`` each; the value is YAML.
        progress: Called with what is being done and the part of the whole that is done.

    Raises:
        ReproductionError: If there is no such entry, or it has no such option.
    """
    from fieldagents.reproduce.report import write

    if what not in ENTRIES:
        raise ReproductionError(
            f"there is nothing to reproduce by the name {what!r}{did_you_mean(what, ENTRIES)}"
        )
    entry = ENTRIES[what]
    result = entry.run(out, progress, **_options(what, entry, overrides))
    write(what, result, out)
    return result


def _options(what: str, entry: Entry, overrides: Sequence[str]) -> dict[str, Any]:
    """Options as their function wants them.

    Raises:
        ReproductionError: With every option that is unknown or has a wrong value.
    """
    known, types = entry.options, get_type_hints(entry.run, include_extras=True)
    options: dict[str, Any] = {}
    problems = []
    for text in overrides:
        name, equals, value = text.partition("=")
        if not equals:
            problems.append(f"--set {text}: write --set option=value")
        elif name not in known:
            problems.append(f"--set {text}: {what} has no option {name!r}{did_you_mean(name, known)}")
        else:
            try:
                options[name] = TypeAdapter(types[name]).validate_python(
                    YAML(typ="safe", pure=True).load(value)
                )
            except YAMLError:
                problems.append(f"--set {text}: {value!r} is not a YAML value")
            except ValidationError as error:
                problems += [f"--set {text}: {item['msg']}" for item in error.errors()]
    if problems:
        raise ReproductionError("\n".join(problems))
    return options
