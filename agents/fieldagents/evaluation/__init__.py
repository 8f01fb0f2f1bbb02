"""Scoring agents on fixed episodes, with paired differences and intervals."""

from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import EvaluationError, evaluate
from fieldagents.evaluation.report import lead, report_section, show
from fieldagents.evaluation.summary import Row, Summary

__all__ = [
    "EvaluateConfig",
    "EvaluationError",
    "Row",
    "Summary",
    "evaluate",
    "lead",
    "report_section",
    "show",
]
