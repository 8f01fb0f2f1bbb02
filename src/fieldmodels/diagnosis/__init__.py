"""Diagnosis of a simulation from measured data: errors, their causes, and the gain of a remedy."""

from fieldmodels.diagnosis.procedure import diagnose
from fieldmodels.diagnosis.result import Cause, Diagnosis, Estimate, Verdict

__all__ = ["Cause", "Diagnosis", "Estimate", "Verdict", "diagnose"]
