"""The answer of a diagnosis for a reader in a hurry: what is wrong, by how much, how sure, what to do."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fieldmodels import html
from fieldmodels.diagnosis.outcome import EITHER, NOTHING_CERTAIN, TOO_FEW, WOULD_SHOW, Diagnosis
from fieldmodels.diagnosis.phrases import a, lacking, the, times_the_noise
from fieldmodels.diagnosis.relation import REMEDY
from fieldmodels.diagnosis.result import Cause, SignalGain, Visible
from fieldmodels.drivers.variables import MEMORY
from fieldmodels.html import text
from fieldmodels.rounding import listed, percent, with_error, words

TONE = {"consistent": "good", "named": "good", "ambiguous": "warn", "unknown": "bad", "unrelated": "bad"}
SURE = ((1e-6, "practically certain"), (1e-3, "very likely"), (1.0, "likely"))
"""How the probability that chance alone makes a cause seem to be there reads, by its upper end."""
UNSIZED = 1e-3
"""Least probability of chance that is stated of a cause whose size the data do not determine."""
STORES = (
    "What depends on a recent mean may be stored where the simulation has no store (heat in a wall, air in a "
    "hose): give a machine of your own a state for it, behind an effect that is off at 0."
)
SHOWN = 4
"""Of what could be missing without being seen, how much is said."""


def headline(diagnosis: Diagnosis) -> str:
    """What is wrong, in a sentence of plain text."""
    if diagnosis.mistaken:
        return f"Check the columns first: {diagnosis.mistaken}."
    if diagnosis.verdict == "consistent":
        if diagnosis.above_noise:
            return NOTHING_CERTAIN
        if diagnosis.of_sensors:
            return f"The simulation explains these data, but {diagnosis.of_sensors[0]}."
        return "The simulation explains these data; nothing significant is missing."
    if diagnosis.verdict == "unrelated":
        return "There is no relation between command and response."
    if diagnosis.verdict == "unknown":
        curves = [curve.words for curve in diagnosis.curves if curve.found]
        if len(curves) > 1:
            each = ", ".join(f"one {'' if k else 'depends '}on {words}" for k, words in enumerate(curves))
            return f"The simulation lacks {len(curves)} things that no listed effect explains: {each}."
        where = f": it depends on {curves[0]}" if curves else ""
        lacks = "may lack" if diagnosis.unsure else "lacks"
        return f"The simulation {lacks} something that no listed effect explains{where}."
    more = ", and something else" if diagnosis.curves and not diagnosis.unsure else ""
    return f"The simulation lacks {diagnosis.names}{more}."


def by_how_much(diagnosis: Diagnosis) -> str:
    """The fall of the prediction error in a sentence; empty if nothing was added."""
    found = most_improved(diagnosis)
    if found is None or not diagnosis.gain[found].rmse_before > 0:
        return ""
    gain, curved = diagnosis.gain[found], bool(diagnosis.curve_effects)
    share = gain.gain_with_curves if curved else gain.gain
    after = gain.rmse_with_curves if curved else gain.rmse_after
    if not share.percent > 0:
        return ""
    added = _it(diagnosis)
    fell = f"{with_error(gain.rmse_before)} to {with_error(after, unit=gain.unit)}"
    lower = percent(share.percent)
    return f"With {added}, the error of the predicted {words(found)} falls from {fell}: {lower} less."


def _it(diagnosis: Diagnosis) -> str:
    if not diagnosis.causes:
        found = sum(curve.found for curve in diagnosis.curves)
        if not found:
            return "the curve that helps most"
        return "that curve" if found == 1 else "these curves"
    if len(diagnosis.causes) == 1:
        return "the first of these" if diagnosis.verdict == "ambiguous" else "it"
    return "them"


def what_is_left(diagnosis: Diagnosis) -> str:
    """The error that remains, by the sensors' noise; empty where that is all."""
    if not diagnosis.above_noise:
        return ""
    why = f": {EITHER}" if diagnosis.verdict == "consistent" else ""
    times = times_the_noise(diagnosis.above_noise)
    return f"The remaining error is larger than the sensors' white noise ({times}){why}."


def most_improved(diagnosis: Diagnosis) -> str | None:
    """The signal whose error falls most; None if nothing was added."""
    if len(diagnosis.runs) < 2:
        return None

    def share(one: SignalGain) -> float:
        found = (one.gain_with_curves if diagnosis.curve_effects else one.gain).percent
        return found if math.isfinite(found) else -math.inf

    return max(diagnosis.gain, key=lambda name: share(diagnosis.gain[name]), default=None)


def how_sure(diagnosis: Diagnosis) -> str:
    """How certain the answer is, in a sentence or two."""
    if diagnosis.verdict == "consistent":
        shown, rest = _least_visible(diagnosis)
        more = " The report lists the rest." if rest else ""
        seen = f"{WOULD_SHOW}: {listed(shown)}.{more}" if shown else TOO_FEW if diagnosis.seen else ""
        return " ".join(filter(None, (seen, diagnosis.of_unseen(SHOWN), diagnosis.of_bounds)))
    said = [
        f"{word} that {'it' if k else 'the simulation'} lacks {lacking(sets)}"
        for k, (word, sets) in enumerate(_by_certainty(diagnosis.causes).items())
    ]
    parts = [f"It is {', and '.join(said)}."] if said else []
    if diagnosis.verdict == "ambiguous" and said:
        parts.append("These data cannot tell the alternatives apart.")
    if diagnosis.undetermined:
        names = listed([the(name) for name in diagnosis.undetermined])
        parts.append(f"Caution: these data hardly determine {names}; excite the machine more.")
    if diagnosis.of_bounds:
        parts.append(diagnosis.of_bounds)
    return " ".join(filter(None, [*parts, diagnosis.of_possible]))


def _by_certainty(causes: Sequence[Cause]) -> dict[str, list[tuple[str, ...]]]:
    """Causes, each with what could stand in its place, by how certain it is that one of these is missing."""
    result: dict[str, list[tuple[str, ...]]] = {}
    for level, word in SURE:
        for cause in causes:
            sets = (cause.effect, *cause.alternatives)
            chance = cause.chance if cause.sized else max(cause.chance, UNSIZED)
            if chance < level and not any(sets in known for known in result.values()):
                result.setdefault(word, []).append(sets)
    return result


def _least_visible(diagnosis: Diagnosis) -> tuple[list[str], bool]:
    """The few unseen faults that would add most to an error, in words; and whether there are more."""

    def added(one: Visible) -> float:
        known = {name: diagnosis.gain[name].rmse_before for name in one.errors if name in diagnosis.gain}
        return max((one.errors[name] / before for name, before in known.items() if before > 0), default=0.0)

    known = [v for v in diagnosis.weakest if v.errors]
    most = sorted(known, key=added, reverse=True)[:SHOWN]
    return [v.words for v in known if v in most], len(known) > SHOWN


def what_to_do(diagnosis: Diagnosis) -> Sequence[str]:
    """The next steps, each a sentence of HTML."""
    steps = []
    if diagnosis.mistaken:
        return [
            "Correct the column (<code>--column</code>), then diagnose again; nothing is named before that."
        ]
    if diagnosis.verdict == "unrelated":
        return [f"{REMEDY[0].upper()}{REMEDY[1:]}; then diagnose again."]
    if diagnosis.next_measurement:
        steps.append(text(diagnosis.next_measurement.why))
    if len(diagnosis.runs) > 1:
        steps.append(
            f"Simulate with {_it(diagnosis)}: <code>extended.yaml</code> holds the extended simulation, for "
            '<code>gym.make(..., reality="extended.yaml")</code> and <code>fieldgym export</code>.'
        )
    if diagnosis.not_runnable:
        steps.append(text(f"Not in extended.yaml: {'; '.join(diagnosis.not_runnable)}."))
    explained = bool(diagnosis.curve_effects) and not diagnosis.above_noise
    if diagnosis.verdict == "unknown" and not explained:
        steps.append(
            "Look at the shape of the remaining error in the report: it shows where in the machine to look."
        )
    elif diagnosis.above_noise:
        steps.append(
            "Record the sensors with the machine at rest. If their noise is as large and as slow there, it "
            "is the remaining error; otherwise the shape of that error in the report shows where to look."
        )
    if any(curve.over.startswith(MEMORY) and curve.confirmed for curve in diagnosis.curves):
        steps.append(STORES)
    if diagnosis.wandering:
        steps.append("Zero that sensor before each run, or estimate its zero as a state that wanders.")
    if diagnosis.lost:
        steps.append(
            "Repair that sensor or its logging: what it did not measure says nothing about the machine."
        )
    return steps or ["Nothing: go on with this simulation."]


def in_words(diagnosis: Diagnosis) -> list[str]:
    """The answer as lines of plain text: what is wrong and by how much, how sure that is, what to do."""
    first = (headline(diagnosis), by_how_much(diagnosis), what_is_left(diagnosis), diagnosis.stopped)
    steps = [line for step in what_to_do(diagnosis) for line in html.plain(step)]
    return [line for line in (" ".join(filter(None, first)), how_sure(diagnosis), *steps) if line]


def cause_html(cause: Cause) -> str:
    """A cause with its numbers and its equation, as HTML."""
    values = "; ".join(
        f"{text(words(name))} <b>{text(with_error(e.value, e.std, e.unit))}</b>"
        for name, e in cause.parameters.items()
    )
    term = f" <code>{text(cause.equation)}</code>" if cause.equation else ""
    return f"<p><b>{text(words(cause.effect))}</b>: {values}.<br>{text(cause.cause)}{term}</p>"


def section(diagnosis: Diagnosis, picture: str) -> str:
    """What a report shows first, as HTML: the answer, one picture, and what one asks next.

    Args:
        diagnosis: The diagnosis.
        picture: The figure as HTML.
    """
    said = (by_how_much(diagnosis), what_is_left(diagnosis), diagnosis.stopped)
    lead = f"<strong>{text(headline(diagnosis))}</strong> {text(' '.join(filter(None, said)))}"
    gains = [
        f"{text(words(name))}: {text(percent(g.gain.percent, g.gain.ci95))}"
        for name, g in diagnosis.gain.items()
        if diagnosis.causes and math.isfinite(g.gain.percent)
    ]
    instead = [
        f"{listed([a(name) for name in c.alternatives], 'or')} in place of {a(c.effect)}"
        for c in diagnosis.causes
        if c.alternatives
    ]
    rows = [
        ("Cause", "".join(map(cause_html, diagnosis.causes))),
        ("How sure", text(how_sure(diagnosis))),
        ("Or instead", text("; ".join(instead))),
        ("What it gains", "<br>".join(gains)),
        ("What to do", "<br>".join(what_to_do(diagnosis))),
    ]
    return f'<p class="lead {TONE[diagnosis.verdict]}">{lead}</p>\n{picture}\n{html.facts(rows)}'
