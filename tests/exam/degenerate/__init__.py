"""An exam of faults: whatever a user hands in ends in an answer or in one clear message."""

from exam.degenerate.cases import KINDS, Case, cases_of
from exam.degenerate.run import run_cases
from exam.degenerate.table import publish, summary, write

__all__ = ["KINDS", "Case", "cases_of", "publish", "run_cases", "summary", "write"]
