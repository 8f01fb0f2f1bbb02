"""Diagnosis of a simulation from measured data: errors, their causes, and the gain of a remedy."""

from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.procedure import diagnose
from fieldmodels.diagnosis.result import Cause, Estimate, MissingCurve, Verdict

__all__ = ["Cause", "Diagnosis", "DiagnosisOptions", "Estimate", "MissingCurve", "Verdict", "diagnose"]
