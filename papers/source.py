"""What the sources print and claim, and where it is found by the name of the task.

A source is a folder beside this file with the name of its task. It holds ``figures.py`` with ``FIGURES``
(`Reproducible`), its tables and figures redone, and ``claims.yaml``, what it claims, which these decide.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TYPE_CHECKING, Any

from fieldagents.task import code_of
from papers.claim import Claim, Decided, Statistic, read_claims

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Reproduction:
    """A table or figure of a source, redone.

    Attributes:
        source: Where it is printed: work, section, table or figure number.
        table: The numbers, with the printed ones beside ours where the source prints any.
        figures: File name (without ending) to a figure.
        remarks: What agrees, what does not and why; one sentence or two each.
        statistics: Numbers that decide claims, by the name under which these ask for them.
        decided: The claims that they decide; `papers.run` fills them in, and the title.
    """

    source: str
    table: pd.DataFrame
    figures: Mapping[str, Figure] = field(default_factory=dict)
    remarks: Sequence[str] = ()
    statistics: Mapping[str, Statistic] = field(default_factory=dict)
    decided: Sequence[Decided] = ()
    title: str = ""


@dataclass(frozen=True)
class Reproducible:
    """A table or figure of a source that can be reproduced.

    Attributes:
        name: Its name within the task, such as ``table-1``.
        run: Redoes it, given a ``Report`` of progress. Its keyword-only parameters, all with a default and a
            type, are what ``--set`` may change; its docstring's first line is the title.
        quick: Options with which it takes seconds and still decides its claims.
        processor_s: What it took when it was recorded, in full and quick, compiled kernels at hand
            [s of one processor]; None if nobody has recorded it.
    """

    name: str
    run: Callable[..., Reproduction]
    quick: Mapping[str, Any] = field(default_factory=dict)
    processor_s: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """What it is, in a line."""
        return (self.run.__doc__ or "").partition("\n")[0].removesuffix(".")

    @property
    def options(self) -> dict[str, Any]:
        """Name and default of each option."""
        parameters = inspect.signature(self.run).parameters.values()
        return {p.name: p.default for p in parameters if p.kind is p.KEYWORD_ONLY}


def reproduces(
    name: str, *, quick: Mapping[str, Any] | None = None, processor_s: tuple[float, float] | None = None
) -> Callable[[Callable[..., Reproduction]], Reproducible]:
    """Declare that a function redoes a table or figure; arguments as of `Reproducible`."""
    return lambda run: Reproducible(name, run, quick or {}, processor_s)


@dataclass(frozen=True)
class Source:
    """What a task's source prints and claims.

    Attributes:
        name: Name of the task.
    """

    name: str

    @property
    def figures(self) -> dict[str, Reproducible]:
        """The tables and figures that can be reproduced, by name."""
        return {figure.name: figure for figure in import_module(f"papers.{self.name}.figures").FIGURES}

    @property
    def claims(self) -> dict[str, Claim]:
        """What is claimed, by name, in the source's order."""
        return read_claims(Path(__file__).parent / self.name / "claims.yaml")

    @property
    def code(self) -> str:
        """Hash over the code of the runs. Claims do not count: verdicts are computed anew each time."""
        return code_of(self.name, f"papers.{self.name}")


def all_sources() -> dict[str, Source]:
    """Every source, by the name of its task."""
    return {one.name: Source(one.name) for one in iter_modules([str(Path(__file__).parent)]) if one.ispkg}
