"""What can be reproduced, and how one asks for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter, ValidationError

from fieldagents.progress import Report
from fieldmodels.html import palette
from fieldmodels.names import did_you_mean
from fieldmodels.yaml import YamlError, parse_yaml
from papers.claim import Decided
from papers.report import write
from papers.source import Reproducible, Reproduction, all_sources


class ReproductionError(ValueError):
    """A request that names nothing that can be reproduced, or an option that it does not have."""


def reproducible() -> dict[str, Reproducible]:
    """All that can be reproduced, by ``<task>/<table or figure>``."""
    return {
        f"{task}/{name}": one
        for task, source in all_sources().items()
        for name, one in source.figures.items()
    }


def reproduce(
    what: str,
    out: Path,
    overrides: Sequence[str] = (),
    progress: Report = lambda _stage, _part: None,
) -> Reproduction:
    """Redo a table or figure and write ``table.csv``, a PNG for each figure, and ``report.html``.

    Args:
        what: Its name, a key of `reproducible`.
        out: Result folder; each file appears whole or not at all.
        overrides: ``"option=value"`` each; the value is YAML.
        progress: Called with what is being done and the part of the whole that is done.

    Raises:
        ReproductionError: If there is no such entry, or it has no such option.
    """
    return carry_out(what, out, _options(what, known_entry(what), overrides), progress)


def carry_out(what: str, out: Path, options: Mapping[str, Any], progress: Report) -> Reproduction:
    """As `reproduce`, with options as values.

    Raises:
        ReproductionError: If there is no such entry, or it has no such option.
    """
    entry = known_entry(what)
    for name in options:
        if name not in entry.options:
            raise ReproductionError(f"{what} has no option {name!r}{did_you_mean(name, entry.options)}")
    with palette():
        result = entry.run(progress, **options)
    decided = _decided(what, {**entry.options, **options}, result)
    result = replace(result, title=entry.title, decided=decided)
    write(what, result, out)
    return result


def _decided(what: str, options: Mapping[str, Any], result: Reproduction) -> tuple[Decided, ...]:
    """The claims that a run decides, each in those readings whose options it had."""
    task, name = what.split("/")
    defaults = known_entry(what).options
    found = []
    for claim in all_sources()[task].claims.values():
        differ = {key for ours in claim.readings.values() if ours.run == name for key in ours.options}
        measured = {
            reading: result.statistics.get(ours.statistic)
            for reading, ours in claim.readings.items()
            if ours.run == name
            and all(options[key] == ours.options.get(key, defaults[key]) for key in differ)
        }
        if measured:
            found.append(Decided(claim, task, measured))
    return tuple(found)


def known_entry(what: str) -> Reproducible:
    """What a name stands for.

    Raises:
        ReproductionError: If it names nothing.
    """
    if what not in (known := reproducible()):
        raise ReproductionError(
            f"there is nothing to reproduce by the name {what!r}{did_you_mean(what, known)}"
        )
    return known[what]


def _options(what: str, entry: Reproducible, overrides: Sequence[str]) -> dict[str, Any]:
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
                options[name] = TypeAdapter(types[name]).validate_python(parse_yaml(value, ""))
            except YamlError:
                problems.append(f"--set {text}: {value!r} is not a YAML value")
            except ValidationError as error:
                problems += [f"--set {text}: {item['msg']}" for item in error.errors()]
    if problems:
        raise ReproductionError("\n".join(problems))
    return options
