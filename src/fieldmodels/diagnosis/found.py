"""What a search has found, whichever engine searched."""

from __future__ import annotations

from dataclasses import dataclass

from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.extension import Extension
from fieldmodels.diagnosis.gain import Prediction
from fieldmodels.diagnosis.result import Cause
from fieldmodels.diagnosis.selection import Selection
from fieldmodels.diagnosis.verdict import Judgement


@dataclass(frozen=True)
class Found:
    """What a search has found.

    Attributes:
        mistaken: What is wrong with the columns; empty if nothing is.
        unrelated: Whether the command explains nothing of the response.
        selection: The search's outcome, without what the test data contradict.
        judged: What stands after unlisted curves have competed.
        causes: What is named.
        possible: What cannot be told from neutral.
        curves: Unlisted curves.
        certain: Whether the data call for these, or an error above the noise does.
        before: Prediction of the test windows by the refitted base.
        after: The same with the causes.
        extension: The simulation with all of these, where the search has fitted it.
    """

    mistaken: str
    unrelated: bool
    selection: Selection
    judged: Judgement
    causes: tuple[Cause, ...]
    possible: tuple[Cause, ...]
    curves: tuple[Scored, ...]
    certain: bool
    before: Prediction
    after: Prediction
    extension: Extension | None = None
